"""Whether left and right keypoints have been exchanged: poses of the other labelings.

A body seen from afar is nearly symmetric in depth: exchanged sides are explained by the pose that
is mirrored at the picture's plane. So each labeling descends from the given one's best pose and
from its mirror image, all in one batch, on the keypoints alone.
"""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.pose.levenberg_marquardt import CameraPoses, descend
from animal3dbox.labels.pose.multi_start_search import (
    CAUCHY_95,
    RAYLEIGH_MEDIAN,
    keypoint_cost,
    keypoint_distances,
)
from animal3dbox.labels.pose.problem import PoseProblem

Array = NDArray[np.float64]
EXCHANGED_ROUNDS = (4, 5)
"""Most steps at the wide loss, and at the narrow one."""
EXCHANGED_SIGMA = 20.0
"""Width of the loss at first, in standard deviations of a keypoint."""
YET_TO_GAIN = 4.0
"""What refinement may yet gain, in halves of a squared standard deviation."""
MIRROR = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Exchange:
    """A part of the body whose left and right may have been exchanged.

    Attributes:
        part: its name.
        points_world: (N, 3) the landmarks that the keypoints then are.
        poses: that explain them, one or two.
        misfit: see search_poses.
    """

    part: str
    points_world: Array
    poses: CameraPoses
    misfit: float


def likely_exchanges(
    problem: PoseProblem, given: CameraPoses, misfit: float, *, handicap: float
) -> list[Exchange]:
    """The exchanges that may turn out cheaper than the labeling given.

    Args:
        problem: about its own mean, in units of its own spread.
        given: the best pose of the labeling given.
        misfit: of that.
        handicap: what an exchange costs more beside its keypoints, at least.

    """
    start = _with_mirror_image(problem, given)
    parts = [part for part, _ in problem.exchanged]
    points = np.repeat(np.stack([points for _, points in problem.exchanged]), 2, axis=0)
    starts = CameraPoses(np.tile(start.R, (len(parts), 1, 1)), np.tile(start.t, (len(parts), 1)))
    wide = math.sqrt(EXCHANGED_SIGMA * CAUCHY_95) * misfit
    cost_of = partial(keypoint_cost, problem, wide, points=points)
    poses, *_ = descend(cost_of, starts, EXCHANGED_ROUNDS[0])
    cost_of = partial(keypoint_cost, problem, CAUCHY_95 * misfit, points=points)
    poses, *_ = descend(cost_of, poses, EXCHANGED_ROUNDS[1])
    medians = np.median(keypoint_distances(problem, poses, points), -1) / RAYLEIGH_MEDIAN
    common = max(1.0, min(misfit, float(medians.min())))
    cost = keypoint_cost(problem, CAUCHY_95 * common, poses, points).cost / common**2
    least = keypoint_cost(problem, CAUCHY_95 * common, given).cost[0] / common**2
    likely = []
    for i, part in enumerate(parts):
        both = np.array([2 * i, 2 * i + 1])
        kept = both[cost[both] < least - handicap + YET_TO_GAIN]
        if len(kept):
            own_misfit = max(1.0, float(medians[kept].min()))
            likely.append(Exchange(part, points[2 * i], poses[kept], own_misfit))
    return likely


def _with_mirror_image(problem: PoseProblem, pose: CameraPoses) -> CameraPoses:
    """A pose, and the one that shows the exchanged body alike from afar.

    The body is mirrored left and right, and then at the plane through it across the line of sight
    v: R' = (I - 2 v v^T) R S, with S the mirror of the body's sides.
    """
    sight = pose.t[0] / np.linalg.norm(pose.t[0])
    sides = problem.R_box @ MIRROR @ problem.R_box.T
    mirrored = (np.eye(3) - 2 * np.outer(sight, sight)) @ pose.R[0] @ sides
    return CameraPoses(np.stack((pose.R[0], mirrored)), np.repeat(pose.t, 2, axis=0))

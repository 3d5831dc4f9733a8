"""The robust joint cost of method "default": keypoints, and the body's bounds against the mask's.

Batched over poses; every coordinate's residual has its own Cauchy loss of width CAUCHY_95. With a
mask, the points that bound the body to the left, top, right and bottom are four more points, each
of which has a target and a weight in one coordinate only. docs/solver.md has the formulas.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.levenberg_marquardt import (
    LEAST_DEPTH,
    NOTHING,
    LocalModel,
    descend,
    project_with_slopes,
)
from animal3dbox.labels.pose.multi_start_search import CAUCHY_95
from animal3dbox.labels.pose.problem import PoseEstimate, PoseProblem

Array = NDArray[np.float64]
MASK_SLACK_PX = 1.0
"""A mask's border is that of pixel centres, and tips thinner than a pixel fall between them.

Up to 0.8 px (benchmarks/masks_and_visibility.py).
"""
ROUNDS = (2, 14, 24)
BEHIND = 1.5
"""Times the least cost: what a pose may cost more and still be refined further."""
BAND = 0.06
"""Of the body's extent in the picture: vertices so near to its bounds can come to bound it while
the pose moves a little."""
LEAST_CURVATURE = 0.05
"""Of a residual's weight.

The Cauchy loss bends down beyond its width, which a descent must not follow.
"""
BOUNDS_PX = 1e-7
"""Bounds that differ by less are the same."""
SIDES = (0, 1, 0, 1)
"""Which coordinate left, top, right and bottom are."""
ONE_COORDINATE = np.eye(2)[:, SIDES]


@dataclass(frozen=True)
class RobustJointCost:
    """The joint cost of a pose problem, as a function of poses.

    Attributes:
        points: (N, 3) landmarks, about their mean, in units of their spread.
        target: (2, N) keypoints about the principal point; (2, N + 4) with a mask, whose box is the
            last four's.
        weight: (2, N) or (2, N + 4) in 1 / px, by which residuals are multiplied.
        linear: (2, 2) K's upper left.
        body_points: (3, V) the points whose bounds are compared with the mask's; V = 0 without that
            term.
    """

    points: Array
    target: Array
    weight: Array
    linear: Array
    body_points: Array

    @property
    def has_bounds(self) -> bool:
        """Whether the mask's box counts."""
        return bool(self.body_points.size)

    def local_model(self, outline: Array, R: Array, t: Array) -> LocalModel:
        """The cost of poses and its derivatives.

        Args:
            outline: (B, 3, M) see outline_candidates.
            R: (B, 3, 3).
            t: (B, 3).

        """
        residuals, slopes, in_front = self.residuals(outline, R, t)
        square = (residuals / CAUCHY_95) ** 2
        weight = 1 / (1 + square)
        curvature = weight * np.maximum((1 - square) * weight, LEAST_CURVATURE)
        cost = CAUCHY_95**2 / 2 * np.log1p(square).sum(-1)
        A = (slopes * curvature[:, None]) @ slopes.mT
        b = (slopes @ (weight * residuals)[..., None])[..., 0]
        return LocalModel(np.where(in_front, cost, np.inf), A, b)

    def residuals(
        self, outline: Array, R: Array, t: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Weighted residuals of poses, coordinate by coordinate.

        Args:
            outline: (B, 3, M) see outline_candidates.
            R: (B, 3, 3).
            t: (B, 3).

        Returns:
            residuals: (B, D).
            slopes: (B, 6, D) their derivatives by a step.
            in_front: (B,) whether all landmarks are before the camera.

        """
        points, count = self.points, len(self.points)
        if self.has_bounds:
            landmarks = np.broadcast_to(points, (len(R), count, 3))
            points = np.concatenate((landmarks, self._outermost(outline, R, t)), 1)
        residuals, slopes, depth = project_with_slopes(points, self.linear, R, t)
        residuals -= self.target
        if self.has_bounds:  # how far they are beyond the mask's, as the paper's d_bbox
            beyond = residuals[..., count:]
            beyond -= np.minimum(np.maximum(beyond, -MASK_SLACK_PX), MASK_SLACK_PX)
            slopes[..., count:] *= (beyond != 0)[:, None]
        residuals *= self.weight
        slopes *= self.weight
        return (
            residuals.reshape(len(R), -1),
            slopes.reshape(len(R), 6, -1),
            depth[:, :count].min(-1) > LEAST_DEPTH,
        )

    def outline_candidates(self, R: Array, t: Array) -> Array:
        """The few points (B, 3, M) that can bound the body near these poses.

        The bounding box of all projected points is set by four of them. While a pose moves a
        little, only points within BAND of the box's sides can take over, so the descent projects
        those instead of the whole mesh. `outline_is_complete` checks afterwards that no other point
        sticks out; if one does, the search goes on from there. Rows with fewer candidates repeat
        some of theirs.
        """
        if not self.has_bounds:
            return np.zeros((len(R), 3, 0))
        px = self._pixels(self.body_points, R, t)
        least, greatest = px.min(-1)[..., None], px.max(-1)[..., None]
        band = BAND * (greatest - least)
        near_a_side = ((px < least + band) | (px > greatest - band)).any(1)
        ids = [np.flatnonzero(row) for row in near_a_side]
        most = max(map(len, ids))
        return np.stack([self.body_points[:, np.resize(row, most)] for row in ids])

    def outline_is_complete(self, outline: Array, R: Array, t: Array) -> bool:
        """Whether at these poses no other point bounds the body than those of its outline."""
        if not self.has_bounds:
            return True
        of_body, of_outline = self._pixels(self.body_points, R, t), self._pixels(outline, R, t)
        apart = np.maximum(
            of_outline.min(-1) - of_body.min(-1), of_body.max(-1) - of_outline.max(-1)
        )
        return bool(apart.max() <= BOUNDS_PX)

    def _pixels(self, points: Array, R: Array, t: Array) -> Array:
        """Where points (3, M) or (B, 3, M) are seen about the principal point, (B, 2, M)."""
        lens = np.eye(3)
        lens[:2, :2] = self.linear
        cam = lens @ R @ points
        cam += (t @ lens.T)[..., None]
        px: Array = cam[:, :2]
        px /= np.maximum(cam[:, 2:], 1e-9)
        return px

    def _outermost(self, outline: Array, R: Array, t: Array) -> Array:
        """The points (B, 4, 3) of the outline that are farthest left, up, right and down."""
        px = self._pixels(outline, R, t)
        ids = np.concatenate((px.argmin(-1), px.argmax(-1)), -1)
        outermost: Array = outline[np.arange(len(R))[:, None], :, ids]
        return outermost


def joint_cost_of(problem: PoseProblem, misfit: float, config: LabelConfig) -> RobustJointCost:
    """The joint cost of a problem about its own mean, in units of its own spread.

    Args:
        problem: without the mask term if the mask touches the border of the image.
        misfit: how badly the body fits, see search_poses.
        config: lambda, and what is compared with the mask: by default the mesh.

    """
    sigma, points = problem.sigma_px, problem.points_world
    target, by_keypoint = problem.pixels, np.sqrt(config.lambda_keypoints) / (misfit * sigma)
    weight = np.stack((by_keypoint, by_keypoint))
    extent = "none" if problem.is_cut or problem.mask_box is None else config.mask_box or "mesh"
    if problem.mask_box is None or extent == "none":
        return RobustJointCost(points, target, weight, problem.linear, np.zeros((3, 0)))
    body_points = points
    if extent != "keypoints" and problem.vertices_world is not None:
        body_points = problem.vertices_world
    by_bound = np.sqrt(1 - config.lambda_keypoints) / (misfit * float(np.median(sigma)))
    bounds = ONE_COORDINATE * (problem.mask_box - problem.K[SIDES, 2])
    target = np.concatenate((target, bounds), 1)
    weight = np.concatenate((weight, by_bound * ONE_COORDINATE), 1)
    return RobustJointCost(points, target, weight, problem.linear, body_points.T)


def refine_jointly(
    problem: PoseProblem, candidates: list[PoseEstimate], misfit: float, config: LabelConfig
) -> list[PoseEstimate]:
    """Candidate poses refined by the joint cost, cheapest first.

    Those that fall far behind the best are left on the way; at least one is left.
    """
    joint = joint_cost_of(problem, misfit, config)
    names = [pose.hypothesis for pose in candidates]
    R = np.stack([pose.R for pose in candidates])
    t = np.stack([pose.t for pose in candidates])
    for rounds in ROUNDS if len(R) > 1 else ROUNDS[1:]:
        outline = joint.outline_candidates(R, t)
        R, t, cost, settled = descend(partial(joint.local_model, outline), R, t, rounds)
        order = np.argsort(cost, kind="stable")
        order = order[cost[order] <= BEHIND * cost[order[0]] + NOTHING]
        R, t, names = R[order], t[order], [names[i] for i in order.tolist()]
        if settled and joint.outline_is_complete(outline[order], R, t):
            break
    return [PoseEstimate(R[i].copy(), t[i].copy(), name) for i, name in enumerate(names)]

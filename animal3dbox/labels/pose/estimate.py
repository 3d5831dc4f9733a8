"""The camera pose of one animal, by the configured method."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import torch

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.epnp_ransac import basic_pose, checked_pose, sqpnp_pose
from animal3dbox.labels.pose.multi_start_search import search_poses
from animal3dbox.labels.pose.paper_refinement import refined_pose
from animal3dbox.labels.pose.problem import (
    PoseEstimate,
    PoseFailure,
    PoseProblem,
    degenerate_points,
    in_unit_scale,
    landmark_frame,
)
from animal3dbox.labels.pose.robust_joint_cost import refine_jointly

FINALISTS = 3


def estimate_pose(
    problem: PoseProblem, config: LabelConfig, hypotheses: tuple[PoseEstimate, ...] = ()
) -> PoseEstimate | PoseFailure:
    """The camera pose of an animal (section 2.2).

    ``basic`` is EPnP + RANSAC, ``paper`` refines it by the joint cost. ``default`` starts from the
    hypotheses given, SQPnP, EPnP + RANSAC and a grid of views, in this order and only until a start
    explains every keypoint; it keeps the animal in front of the camera throughout, and refines the
    best by a robust joint cost with the mesh's bounds instead of the keypoints', without the mask
    term when the mask touches the border of the image.

    Args:
        problem: keypoints, landmarks and mask.
        config: the method and its numbers.
        hypotheses: further starting poses, in the problem's own frame and unit; for ``default``
            only.

    Returns:
        The pose, or why there is none.

    """
    failure = degenerate_points(problem, config.min_keypoints)
    if failure is not None:
        return failure
    if config.method == "default":
        scaled = _in_unit_scale(problem, hypotheses) if hypotheses else []
        return in_unit_scale(problem, lambda p: _default(p, config, scaled))
    return in_unit_scale(problem, lambda p: _published(p, config))


def _in_unit_scale(problem: PoseProblem, poses: Sequence[PoseEstimate]) -> list[PoseEstimate]:
    """Poses of the problem as poses of in_unit_scale's."""
    middle, unit = landmark_frame(problem)
    return [
        PoseEstimate(pose.R, (pose.t + pose.R @ middle) / unit, pose.hypothesis) for pose in poses
    ]


def _published(problem: PoseProblem, config: LabelConfig) -> PoseEstimate | PoseFailure:
    """``basic`` and ``paper``."""
    start = basic_pose(problem, config)
    if config.method == "basic" or isinstance(start, PoseFailure):
        return start
    return refined_pose(problem, start, config)


def _default(
    problem: PoseProblem, config: LabelConfig, hypotheses: list[PoseEstimate]
) -> PoseEstimate | PoseFailure:
    """The best of several starts under the robust joint cost."""
    candidates = search_poses(problem, _starts(problem, config, hypotheses))
    R, t, costs = refine_jointly(problem, candidates, FINALISTS, config)
    for i in np.argsort(costs, kind="stable").tolist():
        estimate = checked_pose(
            problem,
            PoseEstimate(
                torch.from_numpy(R[i].copy()), torch.from_numpy(t[i].copy()), candidates.names[i]
            ),
        )
        if isinstance(estimate, PoseEstimate):
            return estimate
    return PoseFailure("behind_camera", "every refined pose puts the animal behind the camera")


def _starts(
    problem: PoseProblem, config: LabelConfig, hypotheses: list[PoseEstimate]
) -> Iterator[PoseEstimate]:
    """Poses worth trying, the cheapest first, each solved for when it is asked for."""
    solvers = (
        *(partial(checked_pose, problem, h) for h in hypotheses),
        partial(sqpnp_pose, problem),
        partial(basic_pose, problem, config),
    )
    for solver in solvers:
        found = solver()
        if isinstance(found, PoseEstimate):
            yield found

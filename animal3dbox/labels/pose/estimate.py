"""The camera pose of one animal, by the configured method."""

from collections.abc import Iterator
from functools import partial

from animal3dbox.geometry.unit_frame import translation_in_unit_frame, unit_frame
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
)
from animal3dbox.labels.pose.robust_joint_cost import refine_jointly

FINALISTS = 3
"""So many of the poses that the search finds are refined by the joint cost."""


def estimate_pose(
    problem: PoseProblem, config: LabelConfig, hypotheses: tuple[PoseEstimate, ...] = ()
) -> PoseEstimate | PoseFailure:
    """The camera pose of an animal (section 2.2).

    ``basic`` is EPnP + RANSAC, ``paper`` refines it by the joint cost. ``default`` starts from the
    hypotheses given, SQPnP, EPnP + RANSAC and a grid of views, in this order and only until a start
    explains every keypoint; it keeps the animal in front of the camera throughout, and refines the
    best by a robust joint cost with the mesh's bounds instead of the keypoints', without the mask
    term when the mask touches the border of the image. docs/solver.md has the formulas.

    Args:
        problem: keypoints, landmarks and mask.
        config: the method and its numbers.
        hypotheses: further starting poses, in the problem's own frame and unit; for ``default``
            only.

    Returns:
        The pose, or why there is none.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import LabelConfig, PoseProblem, estimate_pose
        >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1]])
        >>> K = np.array([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]])
        >>> pixels = 100 * points[:, :2] / (points[:, 2:] + 5) + K[:2, 2]
        >>> problem = PoseProblem(
        ...     points, pixels, sigma_px=np.ones(6), K=K, image_hw=(120, 160), R_box=np.eye(3),
        ...     vertices_world=None, mask_box=None)
        >>> estimate_pose(problem, LabelConfig()).t.round(3)
        array([0., 0., 5.])
    """
    failure = degenerate_points(problem, config.min_keypoints)
    if failure is not None:
        return failure
    if config.method == "default":
        starts = _in_unit_frame(problem, hypotheses)
        return in_unit_scale(problem, lambda scaled: _default_pose(scaled, config, starts))
    return in_unit_scale(problem, lambda scaled: _published_pose(scaled, config))


def _in_unit_frame(
    problem: PoseProblem, poses: tuple[PoseEstimate, ...]
) -> tuple[PoseEstimate, ...]:
    """Poses of the problem as poses of in_unit_scale's problem."""
    if not poses:
        return ()
    middle, unit = unit_frame(problem.points_world)
    return tuple(
        PoseEstimate(
            pose.R,
            translation_in_unit_frame(pose.R, pose.t, middle=middle, unit=unit),
            pose.hypothesis,
        )
        for pose in poses
    )


def _published_pose(problem: PoseProblem, config: LabelConfig) -> PoseEstimate | PoseFailure:
    """The pose by ``basic`` or ``paper``."""
    start = basic_pose(problem, config)
    if config.method == "basic" or isinstance(start, PoseFailure):
        return start
    return refined_pose(problem, start, config)


def _default_pose(
    problem: PoseProblem, config: LabelConfig, hypotheses: tuple[PoseEstimate, ...]
) -> PoseEstimate | PoseFailure:
    """The best of several starts under the robust joint cost."""
    candidates, misfit = search_poses(problem, _starting_poses(problem, config, hypotheses))
    for pose in refine_jointly(problem, candidates[:FINALISTS], misfit, config):
        estimate = checked_pose(problem, pose)
        if isinstance(estimate, PoseEstimate):
            return estimate
    return PoseFailure("behind_camera", "every refined pose puts the animal behind the camera")


def _starting_poses(
    problem: PoseProblem, config: LabelConfig, hypotheses: tuple[PoseEstimate, ...]
) -> Iterator[PoseEstimate]:
    """Poses worth trying, the cheapest first, each solved for when it is asked for."""
    solvers = (
        *(partial(checked_pose, problem, hypothesis) for hypothesis in hypotheses),
        partial(sqpnp_pose, problem),
        partial(basic_pose, problem, config),
    )
    for solve in solvers:
        pose = solve()
        if isinstance(pose, PoseEstimate):
            yield pose

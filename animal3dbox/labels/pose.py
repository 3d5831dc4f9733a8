"""The camera pose of one animal, by the configured method."""

import numpy as np
import torch
from scipy.optimize import least_squares

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.joint_cost import Array, joint_cost, rotate
from animal3dbox.labels.pose_basic import basic_pose, checked_pose, sqpnp_pose
from animal3dbox.labels.pose_problem import PoseEstimate, PoseFailure, PoseProblem, degenerate_points, in_unit_scale
from animal3dbox.labels.pose_refine import refined_pose
from animal3dbox.labels.pose_search import CAUCHY_95, Candidates, search_poses

FINALISTS = 3
TIGHT = 1e-12
MASK_SLACK_PX = 1.0
"""A mask's border is that of pixel centres, and tips thinner than a pixel fall between them: up to 0.8 px (benchmarks/masks_and_visibility.py)."""


def estimate_pose(problem: PoseProblem, config: LabelConfig, hypotheses: tuple[PoseEstimate, ...] = ()) -> PoseEstimate | PoseFailure:
    """The camera pose of an animal (section 2.2).

    ``basic`` is EPnP + RANSAC, ``paper`` refines it by the joint cost. ``default`` starts from those, SQPnP, the
    hypotheses given and a grid of views, keeps the animal in front of the camera throughout, and refines the best
    by a robust joint cost with the mesh's bounds instead of the keypoints', without the mask term when the mask
    touches the border of the image.

    Args:
        problem: keypoints, landmarks and mask.
        config: the method and its numbers.
        hypotheses: further starting poses, in the problem's own frame and unit; for ``default`` only.

    Returns:
        The pose, or why there is none.

    """
    failure = degenerate_points(problem, config.min_keypoints)
    if failure is not None:
        return failure
    if config.method == "default":
        middle = problem.points_world.mean(0)
        unit = float((problem.points_world - middle).pow(2).sum(-1).mean().sqrt())
        scaled = [PoseEstimate(h.R, (h.t + h.R @ middle) / unit, h.hypothesis) for h in hypotheses]
        return in_unit_scale(problem, lambda p: _default(p, config, scaled))
    return in_unit_scale(problem, lambda p: _published(p, config))


def _published(problem: PoseProblem, config: LabelConfig) -> PoseEstimate | PoseFailure:
    """``basic`` and ``paper``."""
    start = basic_pose(problem, config)
    if config.method == "basic" or isinstance(start, PoseFailure):
        return start
    return refined_pose(problem, start, config)


def _default(problem: PoseProblem, config: LabelConfig, hypotheses: list[PoseEstimate]) -> PoseEstimate | PoseFailure:
    """The best of several starts under the robust joint cost."""
    solved = (basic_pose(problem, config), sqpnp_pose(problem), *(checked_pose(problem, h) for h in hypotheses))
    candidates = search_poses(problem, [s for s in solved if isinstance(s, PoseEstimate)])
    finalists = [_robust_joint(problem, start, candidates, config) for start in candidates.estimates[:FINALISTS]]
    good = [(cost, estimate) for cost, estimate in finalists if isinstance(checked_pose(problem, estimate), PoseEstimate)]
    if not good:
        return PoseFailure("behind_camera", "every refined pose puts the animal behind the camera")
    return min(good, key=lambda pair: pair[0])[1]


def _robust_joint(problem: PoseProblem, start: PoseEstimate, candidates: Candidates, config: LabelConfig) -> tuple[float, PoseEstimate]:
    """One start refined by the joint cost under a Cauchy loss, and its cost."""
    extent = "none" if problem.is_cut else config.mask_box or "mesh"
    cost = joint_cost(problem, start.R.numpy(), extent, MASK_SLACK_PX)
    by_keypoint = np.sqrt(config.lambda_keypoints) / candidates.scale
    by_bound = np.sqrt(1 - config.lambda_keypoints) / (candidates.scale * float(problem.sigma_px.median()))

    def residuals(x: Array) -> Array:
        return np.concatenate(((by_keypoint * cost.keypoints(x)[0]).ravel(), by_bound * cost.box(x)[0]))

    def jacobian(x: Array) -> Array:
        return np.concatenate(((by_keypoint * cost.keypoints(x)[1]).reshape(-1, 6), by_bound * cost.box(x)[1]))

    pose = np.concatenate((np.zeros(3), start.t.numpy()))
    solved = least_squares(residuals, pose, jac=jacobian, loss="cauchy", f_scale=CAUCHY_95, xtol=TIGHT, ftol=TIGHT, gtol=TIGHT, max_nfev=60)
    R = torch.from_numpy(rotate(solved.x[:3])[0] @ cost.R_start)
    return float(solved.cost), PoseEstimate(R, torch.from_numpy(solved.x[3:].copy()), start.hypothesis)

"""The paper's initial pose, its baseline: EPnP inside RANSAC.

The one wrapper around OpenCV's PnP solvers.
"""

import cv2
import numpy as np
import torch
from torch import Tensor

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.problem import (
    PoseEstimate,
    PoseFailure,
    PoseProblem,
    reprojection_errors,
)

FARTHEST = 1e6
"""Depth in body sizes beyond which a pose is no answer.

OpenCV gives 1e13 for keypoints that coincide.
"""


def basic_pose(problem: PoseProblem, config: LabelConfig) -> PoseEstimate | PoseFailure:
    """The pose by EPnP on RANSAC's consensus set (section 2.2, EPnP and RANSAC).

    OpenCV's own result is not taken over: when it fails it leaves the answer of an earlier call in
    the outputs, and its inliers belong to the best sample rather than to the pose returned. EPnP is
    solved again on the consensus set.

    Args:
        problem: in any unit; at least 4 points.
        config: RANSAC's numbers.

    Returns:
        The pose, or why there is none.

    """
    cv2.setRNGSeed(config.ransac_seed)
    points, pixels, K = _as_opencv(problem)
    ok, _, _, inliers = cv2.solvePnPRansac(
        points,
        pixels,
        K,
        None,
        iterationsCount=config.ransac_iterations,
        reprojectionError=config.ransac_threshold_px,
        confidence=config.ransac_confidence,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not ok or inliers is None or len(inliers) < 4:
        return PoseFailure(
            "no_pose",
            f"RANSAC found no {config.ransac_threshold_px:g} px consensus among {len(points)}"
            " keypoints",
        )
    consensus = np.sort(inliers[:, 0])
    estimate = _solve(points[consensus], pixels[consensus], K, cv2.SOLVEPNP_EPNP, "epnp_ransac")
    return estimate if isinstance(estimate, PoseFailure) else checked_pose(problem, estimate)


def sqpnp_pose(problem: PoseProblem) -> PoseEstimate | PoseFailure:
    """The pose by SQPnP on all points, without outlier rejection: another starting pose."""
    estimate = _solve(*_as_opencv(problem), cv2.SOLVEPNP_SQPNP, "sqpnp")
    return estimate if isinstance(estimate, PoseFailure) else checked_pose(problem, estimate)


def checked_pose(problem: PoseProblem, estimate: PoseEstimate) -> PoseEstimate | PoseFailure:
    """The pose if it puts the animal before the camera at a believable depth, else why not."""
    depth = reprojection_errors(problem, estimate.R, estimate.t)[1].numpy()
    if (
        not np.isfinite(depth).all()
        or np.abs(depth).max() > FARTHEST * np.abs(problem.points_world.numpy()).max()
    ):
        return PoseFailure(
            "no_pose",
            f"{estimate.hypothesis} puts the animal at depth {float(depth.mean()):.3g}, which is no"
            " answer",
        )
    if depth.min() <= 0:
        return PoseFailure(
            "behind_camera",
            f"{estimate.hypothesis} puts {int((depth <= 0).sum())} of {len(depth)} keypoints behind"
            " the camera",
        )
    return estimate


def _as_opencv(problem: PoseProblem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 3), pixels (N, 2) and K for OpenCV, which ignores skew.

    Skewed pixels are straightened first.
    """
    K = problem.K
    pixels = problem.points_px
    if float(K[0, 1]) != 0:
        pixels = pixels.clone()
        pixels[:, 0] -= K[0, 1] / K[1, 1] * (pixels[:, 1] - K[1, 2])
        K = K.clone()
        K[0, 1] = 0.0
    return problem.points_world.numpy(), pixels.contiguous().numpy(), K.numpy()


def _solve(
    points: np.ndarray, pixels: np.ndarray, K: np.ndarray, flag: int, name: str
) -> PoseEstimate | PoseFailure:
    """One PnP solver on all the points it is given."""
    try:
        ok, axis_angle, translation = cv2.solvePnP(points, pixels, K, None, flags=flag)
    except cv2.error as error:
        return PoseFailure("no_pose", f"{name} failed: {error.err}")
    if not ok or not (np.isfinite(axis_angle).all() and np.isfinite(translation).all()):
        return PoseFailure("no_pose", f"{name} found no pose for {len(points)} keypoints")
    R = torch.from_numpy(cv2.Rodrigues(axis_angle)[0])
    return PoseEstimate(R, _vector(translation), name)


def _vector(column: np.ndarray) -> Tensor:
    return torch.from_numpy(column.reshape(3).astype(np.float64))

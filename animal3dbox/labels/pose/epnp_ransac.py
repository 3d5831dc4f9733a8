"""The paper's initial pose, its baseline: EPnP inside RANSAC.

The one wrapper around OpenCV's PnP solvers.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.problem import (
    PoseEstimate,
    PoseFailure,
    PoseProblem,
    reprojection_errors,
)

Array = NDArray[np.float64]
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
    points, pixels, K = _without_skew(problem)
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
            f"RANSAC found no {config.ransac_threshold_px:g} px consensus among"
            f" {len(points)} keypoints",
        )
    consensus = np.sort(inliers[:, 0])
    estimate = _pnp_pose(
        points[consensus], pixels[consensus], K, solver=cv2.SOLVEPNP_EPNP, name="epnp_ransac"
    )
    return estimate if isinstance(estimate, PoseFailure) else checked_pose(problem, estimate)


def sqpnp_pose(problem: PoseProblem) -> PoseEstimate | PoseFailure:
    """The pose by SQPnP on all points, without outlier rejection: another starting pose."""
    estimate = _pnp_pose(*_without_skew(problem), solver=cv2.SOLVEPNP_SQPNP, name="sqpnp")
    return estimate if isinstance(estimate, PoseFailure) else checked_pose(problem, estimate)


def checked_pose(problem: PoseProblem, estimate: PoseEstimate) -> PoseEstimate | PoseFailure:
    """The pose if it puts the animal before the camera at a believable depth, else why not."""
    depth = reprojection_errors(problem, estimate.R, estimate.t)[1]
    reach = FARTHEST * np.abs(problem.points_world).max()
    if not np.isfinite(depth).all() or np.abs(depth).max() > reach:
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


def _without_skew(problem: PoseProblem) -> tuple[Array, Array, Array]:
    """Points (N, 3), pixels (N, 2) and K for OpenCV, which ignores skew.

    u' = u - K01 / K11 (v - K12) is the pixel that a camera of no skew shows.
    """
    K, pixels = problem.K, problem.points_px
    if float(K[0, 1]) != 0:
        pixels = pixels.copy()
        pixels[:, 0] -= K[0, 1] / K[1, 1] * (pixels[:, 1] - K[1, 2])
        K = K.copy()
        K[0, 1] = 0.0
    return problem.points_world, np.ascontiguousarray(pixels), K


def _pnp_pose(
    points: Array, pixels: Array, K: Array, *, solver: int, name: str
) -> PoseEstimate | PoseFailure:
    """The pose by one of OpenCV's PnP solvers on all the points it is given."""
    try:
        ok, axis_angle, translation = cv2.solvePnP(points, pixels, K, None, flags=solver)
    except cv2.error as error:
        return PoseFailure("no_pose", f"{name} failed: {error.err}")
    if not ok or not (np.isfinite(axis_angle).all() and np.isfinite(translation).all()):
        return PoseFailure("no_pose", f"{name} found no pose for {len(points)} keypoints")
    R = cv2.Rodrigues(axis_angle)[0].astype(np.float64, copy=False)
    return PoseEstimate(R, translation.reshape(3).astype(np.float64), name)

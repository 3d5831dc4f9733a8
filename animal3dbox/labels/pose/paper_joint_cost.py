"""The residuals of the paper's joint cost and their derivatives, for SciPy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from animal3dbox.labels.pose.problem import PoseProblem

Array = NDArray[np.float64]


def _cross(v: Array) -> Array:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack((zero, -z, y, z, zero, -x, -y, x, zero), -1).reshape(*v.shape, 3)


def rotate(axis_angle: Array) -> tuple[Array, Array]:
    """The rotation exp(w), and the left Jacobian at w, (3, 3) each.

    The Jacobian turns a change of w into one of the rotation. With a = |w| and W the cross-product
    matrix of w: exp(w) = 1 + sin a / a W + (1 - cos a) / a^2 W^2.
    """
    angle = float(np.linalg.norm(axis_angle))
    W = _cross(axis_angle)
    if angle < 1e-6:
        return np.eye(3) + W + W @ W / 2, np.eye(3) + W / 2 + W @ W / 6
    first, second = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return (
        np.eye(3) + np.sin(angle) / angle * W + first * W @ W,
        np.eye(3) + first * W + second * W @ W,
    )


@dataclass(frozen=True)
class JointCost:
    """Residuals of E_total at a pose near a start (section 2.2.2, E_total).

    A pose is (w, t): R = exp(w) R_start.

    Attributes:
        points: (N, 3) landmarks.
        pixels: (N, 2) keypoints.
        sigma: (N,) px.
        K: (3, 3).
        R_start: (3, 3).
        extent: (M, 3) the points whose projected bounding box is compared with the mask's; M = 0
            without that term.
        mask_box: (4,) xyxy px.
    """

    points: Array
    pixels: Array
    sigma: Array
    K: Array
    R_start: Array
    extent: Array
    mask_box: Array

    def _project(self, points: Array, pose: Array) -> tuple[Array, Array]:
        """Pixels (N, 2) and their derivatives (N, 2, 6) by the pose."""
        turn, jacobian = rotate(pose[:3])
        turned = points @ (turn @ self.R_start).T
        cam = turned + pose[3:]
        px, z = self._pixels(cam)
        by_cam = np.empty((len(points), 2, 3))
        by_cam[:, :, :2] = self.K[:2, :2] / z[:, None, None]
        by_cam[:, :, 2] = -(px - self.K[:2, 2]) / z[:, None]
        by_pose = np.concatenate((by_cam @ -_cross(turned) @ jacobian, by_cam), axis=2)
        return px, by_pose

    def _pixels(self, cam: Array) -> tuple[Array, Array]:
        """Pixels (N, 2) and depths (N,) of points in the camera frame."""
        z = np.where(np.abs(cam[:, 2]) < 1e-9, 1e-9, cam[:, 2])
        return (cam @ self.K.T)[:, :2] / z[:, None], z

    def keypoints(self, pose: Array) -> tuple[Array, Array]:
        """Residuals whose lengths are Mahalanobis distances (section 2.2.2, d_Mahalanobis).

        (x_hat - x) / sigma, (N, 2), and their derivatives by the pose, (N, 2, 6).
        """
        px, by_pose = self._project(self.points, pose)
        return (px - self.pixels) / self.sigma[:, None], by_pose / self.sigma[:, None, None]

    def box(self, pose: Array) -> tuple[Array, Array]:
        """Projected bounds minus the mask's, coordinate by coordinate (section 2.2.2, d_bbox).

        (4,) px and (4, 6), or none.
        """
        if len(self.extent) == 0:
            return np.zeros(0), np.zeros((0, 6))
        px, _ = self._pixels(self.extent @ (rotate(pose[:3])[0] @ self.R_start).T + pose[3:])
        rows = np.concatenate((px.argmin(0), px.argmax(0)))
        bounds, by_pose = self._project(self.extent[rows], pose)
        pick = np.arange(4), np.array([0, 1, 0, 1])
        return bounds[pick] - self.mask_box, by_pose[pick]


def outermost(vertices: Array) -> Array:
    """The vertices (M, 3) of a body's convex hull.

    Before the camera, they alone can bound its projection.
    """
    try:
        return vertices[ConvexHull(vertices).vertices]
    except QhullError:  # a flat body has no hull in space
        return vertices


def joint_cost(problem: PoseProblem, R_start: Array, extent: str) -> JointCost:
    """The joint cost of a problem about a starting rotation.

    Args:
        problem: about its own mean, in units of its own spread.
        R_start: (3, 3).
        extent: what to compare with the mask: "keypoints", "mesh" (the keypoints if there is no
            mesh) or "none".

    """
    points = problem.points_world
    cloud = np.zeros((0, 3))
    if problem.mask_box is not None and extent != "none":
        cloud = (
            points
            if extent == "keypoints" or problem.vertices_world is None
            else outermost(problem.vertices_world)
        )
    box = np.zeros(4) if problem.mask_box is None else problem.mask_box
    return JointCost(
        points,
        problem.points_px,
        problem.sigma_px,
        problem.K,
        R_start,
        cloud,
        box,
    )

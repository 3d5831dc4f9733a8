"""Lens distortion by OpenCV's polynomial, and what a map of pixels does to its coefficients.

Order of the coefficients: k1, k2, p1, p2 [, k3 [, k4, k5, k6 [, s1, s2, s3, s4]]].
"""

import torch
from torch import Tensor

from animal3dbox.errors import ShapeError

COUNTS = (4, 5, 8, 12)


def check_distortion(name: str, coefficients: Tensor) -> None:
    """Raise a ShapeError unless these are 4, 5, 8 or 12 finite coefficients."""
    if coefficients.ndim != 1 or coefficients.shape[0] not in COUNTS:
        raise ShapeError(
            f"{name} must have shape (4,), (5,), (8,) or (12,) in OpenCV's order, got {tuple(coefficients.shape)}; "
            "tilted sensors (14 coefficients) are not supported: undistort the image first"
        )
    if not bool(torch.isfinite(coefficients).all()):
        raise ShapeError(f"{name} must be finite, got {coefficients.tolist()}")


def distort(points: Tensor, coefficients: Tensor) -> Tensor:
    """Where a lens puts points of the plane at depth 1.

    Args:
        points: (..., 2) x / z and y / z in the camera frame.
        coefficients: (4,), (5,), (8,) or (12,).

    Returns:
        (..., 2) in the same plane; K maps them to pixels.

    """
    check_distortion("distortion", coefficients)
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = torch.nn.functional.pad(coefficients, (0, 12 - coefficients.shape[0])).unbind(-1)
    r2 = (points * points).sum(-1, keepdim=True)
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    tangent = torch.stack((p2, p1))
    along = 2 * (points * tangent).sum(-1, keepdim=True)
    return points * (radial + along) + r2 * (tangent + torch.stack((s1, s3)) + r2 * torch.stack((s2, s4)))


def turned_distortion(coefficients: Tensor, Q: Tensor) -> Tensor:
    """The lens of the mapped image: its tangential and prism terms are vectors in the picture's plane and turn with it.

    A flip negates p2, a vertical one p1, a roll rotates (p2, p1), a crop or a resize changes nothing.

    Args:
        coefficients: (4,), (5,), (8,) or (12,).
        Q: (3, 3) the turn of the camera frame by the map (CameraUpdate.Q).

    Returns:
        The coefficients after the map, in the same order.

    Raises:
        ShapeError: Q turns the optical axis: no coefficients describe the lens then; undistort the image first.

    """
    check_distortion("distortion", coefficients)
    if float((Q[2, :2].abs().sum() + (Q[2, 2] - 1).abs()).detach()) > 1e-6:
        raise ShapeError(
            "distortion cannot be carried through a map that turns the optical axis (yaw, pitch, perspective): "
            "undistort the image first and drop the field, or use crops, flips, resizes and rolls only"
        )
    q = Q[:2, :2].to(coefficients.dtype)
    turned = coefficients.clone()
    turned[[3, 2]] = q @ coefficients[[3, 2]]
    if coefficients.shape[0] == 12:
        turned[[8, 10]] = q @ coefficients[[8, 10]]
        turned[[9, 11]] = q @ coefficients[[9, 11]]
    return turned

"""Lens distortion by OpenCV's polynomial, and what a map of pixels does to its coefficients.

Order of the coefficients: k1, k2, p1, p2 [, k3 [, k4, k5, k6 [, s1, s2, s3, s4]]].
"""

from typing import Any

import numpy as np
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import AnyArray, namespace, norm

COUNTS = (4, 5, 8, 12)


def check_distortion(name: str, coefficients: Tensor | np.ndarray) -> None:
    """Raise a ShapeError unless these are 4, 5, 8 or 12 finite coefficients."""
    if coefficients.ndim != 1 or coefficients.shape[0] not in COUNTS:
        raise ShapeError(
            f"{name} must have shape (4,), (5,), (8,) or (12,) in OpenCV's order, got {tuple(coefficients.shape)}; "
            "tilted sensors (14 coefficients) are not supported: undistort the image first"
        )
    if not bool(namespace(coefficients).isfinite(coefficients).all()):
        raise ShapeError(f"{name} must be finite, got {coefficients.tolist()}")


def distort(points: AnyArray, coefficients: AnyArray) -> AnyArray:
    """Where a lens puts points of the plane at depth 1.

    Args:
        points: (..., 2) x / z and y / z in the camera frame.
        coefficients: (4,), (5,), (8,) or (12,).

    Returns:
        (..., 2) in the same plane; K maps them to pixels.

    """
    check_distortion("distortion", coefficients)
    xp = namespace(points)
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = xp.concatenate((coefficients, xp.zeros_like(coefficients).repeat(3)))[:12]
    r2 = (points * points).sum(-1)[..., None]
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    tangent = xp.stack((p2, p1))
    along = 2 * (points * tangent).sum(-1)[..., None]
    bent: AnyArray = points * (radial + along) + r2 * (tangent + xp.stack((s1, s3)) + r2 * xp.stack((s2, s4)))
    return bent


def field_of_view(coefficients: Tensor | np.ndarray) -> float:
    """The radius x / z up to which the radial polynomial grows: beyond it the lens would fold the scene back into the picture.

    Args:
        coefficients: (4,), (5,), (8,) or (12,).

    Returns:
        The radius at depth 1; infinite if it grows all the way to 10 (84 degrees off the axis).

    """
    k1, k2, _, _, k3, k4, k5, k6 = [float(value) for value in coefficients[:8]] + [0.0] * (8 - min(len(coefficients), 8))
    radius = np.linspace(0, 10, 4001)
    r2 = radius * radius
    bent = radius * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    falls = np.flatnonzero(~(np.diff(bent) > 0))
    return float(radius[falls[0]]) if len(falls) else float("inf")


def check_field_of_view(coefficients: AnyArray, corners_cam: AnyArray) -> None:
    """Raise a ShapeError if boxes (N, 8, 3) reach behind the camera or to where the lens folds: their projection means nothing there."""
    depth = corners_cam[..., 2]
    off_axis = norm(corners_cam[..., :2])
    outside: Any = ((depth <= 0) | (off_axis > field_of_view(coefficients) * depth)).any(-1)
    beyond = [bool(outside[animal]) for animal in range(corners_cam.shape[0])]
    if any(beyond):
        raise ShapeError(
            f"animal {beyond.index(True)} reaches beyond the lens's field of view, where its polynomial folds: "
            "undistort the image first and drop the field, or leave the animal out"
        )


def turned_distortion(coefficients: AnyArray, Q: AnyArray) -> AnyArray:
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
    if float(abs(Q[2, :2]).sum() + abs(Q[2, 2] - 1)) > 1e-6:
        raise ShapeError(
            "distortion cannot be carried through a map that turns the optical axis (yaw, pitch, perspective): "
            "undistort the image first and drop the field, or use crops, flips, resizes and rolls only"
        )
    xp = namespace(coefficients)
    order = [3, 2, *((8, 10, 9, 11) if coefficients.shape[0] == 12 else ())]
    pairs = coefficients[order].reshape(-1, 2) @ Q[:2, :2].mT
    new = list(coefficients)
    for index, value in zip(order, pairs.reshape(-1), strict=True):
        new[index] = value
    turned: AnyArray = xp.stack(new)
    return turned

"""Lens distortion by OpenCV's polynomial, and its coefficients after a map of pixels.

Order of the coefficients: k1, k2, p1, p2 [, k3 [, k4, k5, k6 [, s1, s2, s3, s4]]].
"""

from functools import lru_cache
from typing import Any

import numpy as np
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import AnyArray, like, namespace, norm

COUNTS = (4, 5, 8, 12)
"""How many coefficients a lens may have."""
WIDEST = 10.0
"""The radius x / z, 84 degrees off the axis, up to which a lens is looked at."""
NEWTON_ROUNDS = 50
NEWTON_OFF = 1e-10
"""How far a point put back through the lens may be off, in the plane at depth 1."""


def check_distortion(name: str, coefficients: Tensor | np.ndarray) -> None:
    """Raise a ShapeError unless these are 4, 5, 8 or 12 finite coefficients."""
    if coefficients.ndim != 1 or coefficients.shape[0] not in COUNTS:
        raise ShapeError(
            f"{name} must have shape (4,), (5,), (8,) or (12,) in OpenCV's order, got"
            f" {tuple(coefficients.shape)}; tilted sensors (14 coefficients) are not supported:"
            " undistort the image first"
        )
    if not bool(namespace(coefficients).isfinite(coefficients).all()):
        raise ShapeError(f"{name} must be finite, got {coefficients.tolist()}")


def distort(points: AnyArray, coefficients: AnyArray) -> AnyArray:
    """The places at which a lens shows points of the plane at depth 1.

    p' = p (radial + 2 p . (p2, p1)) + r^2 ((p2, p1) + (s1, s3) + r^2 (s2, s4)), with r = |p| and
    radial = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6).

    Args:
        points: (..., 2) x / z and y / z in the camera frame.
        coefficients: (4,), (5,), (8,) or (12,).

    Returns:
        (..., 2) in the same plane; K maps them to pixels.

    Example:
        >>> barrel = np.array([-0.1, 0.0, 0.0, 0.0])
        >>> distort(np.array([[1.0, 0.0]]), barrel).tolist()
        [[0.9, 0.0]]
    """
    check_distortion("distortion", coefficients)
    xp = namespace(points)
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = _twelve(coefficients)
    r2 = (points * points).sum(-1)[..., None]
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    tangent = xp.stack((p2, p1))
    along = 2 * (points * tangent).sum(-1)[..., None]
    bent: AnyArray = points * (radial + along) + r2 * (
        tangent + xp.stack((s1, s3)) + r2 * xp.stack((s2, s4))
    )
    return bent


def _twelve(coefficients: AnyArray) -> AnyArray:
    """All twelve coefficients, with zeros for those that a lens does not have."""
    xp = namespace(coefficients)
    padded: AnyArray = xp.concatenate((coefficients, xp.zeros_like(coefficients).repeat(3)))[:12]
    return padded


def distortion_slope(points: AnyArray, coefficients: AnyArray) -> AnyArray:
    """The derivative of distort: how a lens stretches the plane at depth 1 about its points.

    Args:
        points: (..., 2) x / z and y / z in the camera frame.
        coefficients: (4,), (5,), (8,) or (12,).

    Returns:
        (..., 2, 2), rows are the coordinates of the distorted point.

    """
    xp = namespace(points)
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = _twelve(coefficients)
    r2 = (points * points).sum(-1)[..., None]
    above, below = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    # d radial / d r^2, by the quotient rule
    by_r2 = (
        (k1 + r2 * (2 * k2 + 3 * r2 * k3)) * below - above * (k4 + r2 * (2 * k5 + 3 * r2 * k6))
    ) / below**2
    tangent = xp.stack((p2, p1))
    scale = above / below + 2 * (points * tangent).sum(-1)[..., None]
    along_r2 = tangent + xp.stack((s1, s3)) + 2 * r2 * xp.stack((s2, s4))
    slope: Any = 2 * (
        points[..., :, None] * (by_r2 * points + tangent)[..., None, :]
        + along_r2[..., :, None] * points[..., None, :]
    )
    derivative: AnyArray = slope + scale[..., None] * like(points, [[1.0, 0.0], [0.0, 1.0]])
    return derivative


def undistort(bent: AnyArray, coefficients: AnyArray) -> tuple[AnyArray, AnyArray]:
    """The points that a lens puts at given places, by Newton's method.

    Args:
        bent: (..., 2) places in the plane at depth 1: K's inverse times pixels.
        coefficients: (4,), (5,), (8,) or (12,).

    Returns:
        points: (..., 2) x / z and y / z in the camera frame.
        converged: (...,) bool; False where the lens shows nothing, and the point means nothing.

    Example:
        >>> barrel = np.array([-0.1, 0.0, 0.0, 0.0])
        >>> points, converged = undistort(np.array([[0.9, 0.0]]), barrel)
        >>> points.round(6).tolist(), converged.tolist()
        ([[1.0, 0.0]], [True])
    """
    limit = min(field_of_view(coefficients), WIDEST)

    def clamped(points: AnyArray) -> AnyArray:
        """Points no further from the axis than the lens can show."""
        radius = norm(points)[..., None]
        inside: AnyArray = namespace(points).where(
            radius > limit, points * (limit / (radius + (radius == 0))), points
        )
        return inside

    points = clamped(bent)
    for _ in range(NEWTON_ROUNDS):
        off = distort(points, coefficients) - bent
        if not bool((abs(off) > NEWTON_OFF / 1000).any()):
            break
        slope = distortion_slope(points, coefficients)
        (a, b), (c, d) = (slope[..., 0, 0], slope[..., 0, 1]), (slope[..., 1, 0], slope[..., 1, 1])
        determinant = a * d - b * c
        determinant = determinant + (abs(determinant) < 1e-12)
        # step = slope^-1 off
        adjugate = (d * off[..., 0] - b * off[..., 1], a * off[..., 1] - c * off[..., 0])
        step = namespace(points).stack(adjugate, -1) / determinant[..., None]
        points = clamped(points - step)
    return points, (abs(distort(points, coefficients) - bent) <= NEWTON_OFF).all(-1)


def field_of_view(coefficients: Tensor | np.ndarray) -> float:
    """The radius x / z up to which the radial polynomial grows, and the lens shows the scene.

    Beyond it the polynomial would fold the scene back into the picture.

    Args:
        coefficients: (4,), (5,), (8,) or (12,).

    Returns:
        The radius at depth 1; infinite if it grows all the way to WIDEST.

    """
    return _field_of_view(tuple(float(value) for value in coefficients[:8]))


@lru_cache(maxsize=256)
def _field_of_view(coefficients: tuple[float, ...]) -> float:
    """The value of field_of_view, remembered for each lens."""
    k1, k2, _, _, k3, k4, k5, k6 = [*coefficients] + [0.0] * (8 - len(coefficients))
    radius = np.linspace(0, WIDEST, 4001)
    r2 = radius * radius
    bent = radius * (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    folds = np.flatnonzero(~(np.diff(bent) > 0))
    return float(radius[folds[0]]) if len(folds) else float("inf")


def bent_points(points_cam: AnyArray, coefficients: AnyArray | None) -> AnyArray:
    """Points moved at their depth to where a pinhole shows them as the lens does.

    Args:
        points_cam: (..., 3) in the camera frame, in front of it.
        coefficients: of the lens; None for a pinhole, which moves nothing.

    Returns:
        (..., 3).

    """
    if coefficients is None:
        return points_cam
    depth = points_cam[..., 2:]
    moved: AnyArray = namespace(depth).concatenate(
        (distort(points_cam[..., :2] / depth, coefficients) * depth, depth), -1
    )
    return moved


def beyond_lens(coefficients: AnyArray, points_cam: AnyArray) -> AnyArray:
    """Which bodies reach behind the camera, or to where the lens folds: their pixels mean nothing.

    Args:
        coefficients: of the lens.
        points_cam: (..., N, 3) the bodies' points in the camera frame.

    Returns:
        (...,) bool.

    """
    depth = points_cam[..., 2]
    outside: Any = (depth <= 0) | (norm(points_cam[..., :2]) > field_of_view(coefficients) * depth)
    beyond: AnyArray = outside.any(-1)
    return beyond


def check_field_of_view(coefficients: AnyArray, corners_cam: AnyArray) -> None:
    """Raise a ShapeError if one of the boxes (N, 8, 3) reaches beyond the lens; see beyond_lens."""
    outside: Any = beyond_lens(coefficients, corners_cam)
    beyond = [bool(outside[animal]) for animal in range(corners_cam.shape[0])]
    if any(beyond):
        raise ShapeError(
            f"animal {beyond.index(True)} reaches beyond the lens's field of view, where its"
            " polynomial folds: undistort the image first and drop the field, or leave the"
            " animal out"
        )


def turned_distortion(coefficients: AnyArray, Q: AnyArray) -> AnyArray:
    """The coefficients of the lens that took the mapped image.

    The tangential and prism terms are vectors in the picture's plane and turn with it: a flip
    negates p2, a vertical one p1, a roll rotates (p2, p1), a crop or a resize changes nothing.

    Args:
        coefficients: (4,), (5,), (8,) or (12,).
        Q: (3, 3) the turn of the camera frame by the map (CameraUpdate.Q).

    Returns:
        The coefficients after the map, in the same order.

    Raises:
        ShapeError: Q turns the optical axis: no coefficients describe the lens then; undistort the
            image first.

    """
    check_distortion("distortion", coefficients)
    if float(abs(Q[2, :2]).sum() + abs(Q[2, 2] - 1)) > 1e-6:
        raise ShapeError(
            "distortion cannot be carried through a map that turns the optical axis (yaw, pitch,"
            " perspective): undistort the image first and drop the field, or use crops, flips,"
            " resizes and rolls only"
        )
    xp = namespace(coefficients)
    order = [3, 2, *((8, 10, 9, 11) if coefficients.shape[0] == 12 else ())]
    pairs = coefficients[order].reshape(-1, 2) @ Q[:2, :2].mT
    values = list(coefficients)
    for index, value in zip(order, pairs.reshape(-1), strict=True):
        values[index] = value
    mapped: AnyArray = xp.stack(values)
    return mapped

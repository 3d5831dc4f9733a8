"""Maps of pixels as (3, 3) float64 matrices; pixel centres sit at whole numbers."""

import math

import numpy as np

from animal3dbox.errors import ConfigError

Size = int | tuple[int, int]
"""A size of pictures: (height, width), or one number for both."""


def check_size(name: str, size: Size) -> tuple[int, int]:
    """(height, width) of a size given as one number or a pair.

    Raises:
        ConfigError: not one or two whole numbers > 0.

    """
    pair = (size, size) if isinstance(size, int | np.integer) else tuple(size)
    if len(pair) != 2 or any(
        isinstance(side, bool) or int(side) != side or side <= 0 for side in pair
    ):
        raise ConfigError(
            f"{name} must be a whole number > 0 or a pair (height, width) of them, got {size!r}"
        )
    return int(pair[0]), int(pair[1])


def scaling(scale_xy: tuple[float, float]) -> np.ndarray:
    """Resize by (x, y) factors.

    X' = (x + 1/2) s - 1/2, since the image starts half a pixel before its first centre.
    """
    x, y = scale_xy
    return np.array([[x, 0, 0.5 * x - 0.5], [0, y, 0.5 * y - 0.5], [0, 0, 1.0]])


def shifting(x: float, y: float) -> np.ndarray:
    """Move the picture by (x, y) px."""
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


def cropping(box: tuple[float, float, float, float], image_hw: tuple[int, int]) -> np.ndarray:
    """Show an upright box in an image of the given size, which it fills.

    Args:
        box: x least, y least, x greatest, y greatest, from edge to edge.
        image_hw: of the image after.

    Example:
        >>> cropping((-0.5, -0.5, 9.5, 4.5), (10, 20)).tolist()  # ten columns become twenty
        [[2.0, 0.0, 0.5], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]]
    """
    x_least, y_least, x_most, y_most = box
    H: np.ndarray = scaling(
        (image_hw[1] / (x_most - x_least), image_hw[0] / (y_most - y_least))
    ) @ shifting(-x_least - 0.5, -y_least - 0.5)
    return H


def flipping(image_hw: tuple[int, int], *, horizontal: bool) -> np.ndarray:
    """Mirror the picture: x' = W - 1 - x, or y' = H - 1 - y."""
    height, width = image_hw
    return (
        np.array([[-1.0, 0, width - 1], [0, 1, 0], [0, 0, 1]])
        if horizontal
        else np.array([[1.0, 0, 0], [0, -1, height - 1], [0, 0, 1]])
    )


def inverse_map(H: np.ndarray) -> np.ndarray:
    """The inverse of a map of pixels or of intrinsics (3, 3), by its cofactors.

    In plain numbers: LAPACK, which a worker needs for nothing else, takes ten times as long for
    nine numbers whenever a picture has just gone through the processor's caches
    (benchmarks/augment.py). Zeros in the last row stay exact, so that affine maps stay affine.

    Raises:
        numpy.linalg.LinAlgError: there is none.

    Example:
        >>> inverse_map(np.array([[2.0, 0, 4], [0, 2, 6], [0, 0, 1]])).tolist()
        [[0.5, 0.0, -2.0], [0.0, 0.5, -3.0], [0.0, 0.0, 1.0]]
    """
    (a, b, c), (d, e, f), (g, h, i) = H.tolist()
    first, second, third = e * i - f * h, f * g - d * i, d * h - e * g
    det = a * first + b * second + c * third
    if det == 0:
        raise np.linalg.LinAlgError("a map of pixels without an inverse")
    cofactors = (
        (first, c * h - b * i, b * f - c * e),
        (second, a * i - c * g, c * d - a * f),
        (third, b * g - a * h, a * e - b * d),
    )
    # Plus zero, since the cofactors of zeros may be negative zeros.
    inverse: np.ndarray = np.array(cofactors) / det + 0.0
    return inverse


def about(linear: np.ndarray, fixed_px: tuple[float, float]) -> np.ndarray:
    """The affine map with this (2, 2) linear part that leaves one pixel where it is."""
    point = np.asarray(fixed_px)
    H = np.eye(3)
    H[:2, :2] = linear
    H[:2, 2] = point - linear @ point
    return H


def center_of(image_hw: tuple[int, int]) -> tuple[float, float]:
    """The middle of an image, ((W - 1) / 2, (H - 1) / 2)."""
    return (image_hw[1] - 1) / 2, (image_hw[0] - 1) / 2


def camera_rotation(yaw_deg: float, pitch_deg: float, roll_deg: float) -> np.ndarray:
    """R_new_old (3, 3) of a camera that turns right, then up, then clockwise about its axis."""
    yaw, pitch, roll = (math.radians(angle) for angle in (yaw_deg, pitch_deg, roll_deg))
    turn = np.array(
        [[math.cos(yaw), 0, -math.sin(yaw)], [0, 1, 0], [math.sin(yaw), 0, math.cos(yaw)]]
    )
    tilt = np.array(
        [[1, 0, 0], [0, math.cos(pitch), math.sin(pitch)], [0, -math.sin(pitch), math.cos(pitch)]]
    )
    spin = np.array(
        [[math.cos(roll), math.sin(roll), 0], [-math.sin(roll), math.cos(roll), 0], [0, 0, 1]]
    )
    R: np.ndarray = spin @ tilt @ turn
    return R


def rolling(K: np.ndarray | None, angle_deg: float) -> np.ndarray:
    """The (2, 2) linear part of a picture turned clockwise by rolling the camera.

    Exact, without skew, for fx != fy too.

    Args:
        K: (3, 3); None turns the picture as if its pixels were square.
        angle_deg: of the picture's content, clockwise on the screen.

    """
    angle = math.radians(angle_deg)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    if K is None:
        return turn
    (fx, skew, _), (_, fy, _), _ = K.tolist()
    K_inverse = np.array([[1 / fx, -skew / (fx * fy)], [0.0, 1 / fy]])
    linear: np.ndarray = K[:2, :2] @ turn @ K_inverse
    return linear

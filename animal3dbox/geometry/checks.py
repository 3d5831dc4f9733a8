"""Checks of the arrays and tensors that come in through the public functions."""

import math
from functools import lru_cache

import numpy as np
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import as_numpy, cross

IDENTITY = np.eye(3)
FEW = 4
"""Up to so many matrices are checked number by number, in less time than NumPy's calls take."""


def check_shape(name: str, tensor: Tensor | np.ndarray, spec: str) -> None:
    """Raise unless a tensor has the shape that a spec describes.

    Args:
        name: the argument's name, for the message.
        tensor: any tensor.
        spec: one word a dimension: a number is that size, a word any size, a leading ``...`` any
            number of batch dimensions; ``"... 3 3"``, ``"N 3"``.

    Raises:
        ShapeError: naming the argument, the shape expected and the shape that came.

    """
    batched, count, sizes = _parsed(spec)
    shape = tensor.shape
    fits = len(shape) == count or (batched and len(shape) > count)
    for place, size in sizes:
        fits = fits and shape[place] == size
    if not fits:
        raise ShapeError(f"{name} must have shape ({', '.join(spec.split())}), got {tuple(shape)}")


@lru_cache
def _parsed(spec: str) -> tuple[bool, int, tuple[tuple[int, int], ...]]:
    """A spec of check_shape, parsed.

    Returns:
        Whether batch dimensions may lead, how many others there are, and the (place, size) of those
        that have a fixed size, places counted from the last.

    """
    words = spec.split()
    batched = words[0] == "..."
    words = words[batched:]
    return (
        batched,
        len(words),
        tuple(
            (place - len(words), int(word)) for place, word in enumerate(words) if word.isdigit()
        ),
    )


def check_finite(name: str, tensor: Tensor | np.ndarray) -> None:
    """Raise a ShapeError naming the argument unless every value is finite."""
    values = as_numpy(tensor)
    if values.size <= 9 * FEW:
        if all(map(math.isfinite, values.ravel().tolist())):
            return
    else:
        with np.errstate(all="ignore"):
            if np.isfinite(values.sum()):  # as of all that are finite, but for sums too large
                return
    finite = np.isfinite(values)
    if not finite.all():
        raise ShapeError(
            f"{name} must be finite, but {int((~finite).sum())} of its {math.prod(tensor.shape)}"
            " values are NaN or infinite"
        )


def check_rotation(name: str, tensor: Tensor | np.ndarray, tolerance: float = 1e-5) -> None:
    """Raise a ShapeError naming the argument unless it holds rotations, (..., 3, 3) with det +1."""
    check_shape(name, tensor, "... 3 3")
    check_finite(name, tensor)
    R = as_numpy(tensor)
    if not R.size:
        return
    off, least = (
        _off_rotations(R) if R.size > 9 * FEW else _off_few_rotations(R.reshape(-1, 3, 3).tolist())
    )
    if off > tolerance:
        raise ShapeError(
            f"{name} must hold rotation matrices, but R @ R.T differs from the identity by"
            f" {off:.2g}"
        )
    if least < 0:
        raise ShapeError(
            f"{name} must have determinant +1; a determinant of -1 is a mirrored frame: negate one"
            " axis"
        )


def _off_rotations(R: np.ndarray) -> tuple[float, float]:
    """The greatest entry of R R^T - I over matrices (..., 3, 3), and the least determinant."""
    determinants = (R[..., 0, :] * cross(R[..., 1, :], R[..., 2, :])).sum(-1)
    return float(np.abs(R @ R.mT - IDENTITY).max()), float(determinants.min())


def _off_few_rotations(matrices: list[list[list[float]]]) -> tuple[float, float]:
    """The values of _off_rotations in plain numbers, for a few matrices."""
    off, least = 0.0, math.inf
    for (a, b, c), (d, e, f), (g, h, i) in matrices:
        lengths = a * a + b * b + c * c - 1, d * d + e * e + f * f - 1, g * g + h * h + i * i - 1
        angles = a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i
        off = max(off, *map(abs, (*lengths, *angles)))
        least = min(least, a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))
    return off, least


def check_intrinsics(name: str, K: Tensor | np.ndarray) -> None:
    """Raise a ShapeError naming the argument unless it holds intrinsics (..., 3, 3).

    That is: upper triangular, with positive focal lengths and K[2, 2] = 1.
    """
    check_shape(name, K, "... 3 3")
    check_finite(name, K)
    for (fx, _, _), (k_10, fy, _), (k_20, k_21, k_22) in as_numpy(K).reshape(-1, 3, 3).tolist():
        if max(abs(k_10), abs(k_20), abs(k_21), abs(k_22 - 1)) > 1e-9:
            raise ShapeError(
                f"{name} must be upper triangular with {name}[2, 2] = 1, got {K.tolist()}"
            )
        if min(fx, fy) <= 0:
            raise ShapeError(f"{name} must have positive focal lengths, got {K.tolist()}")


def check_image_hw(name: str, image_hw: tuple[int, int]) -> None:
    """Raise a ShapeError unless the pair is (height, width) in whole, positive pixels."""
    is_pair = hasattr(image_hw, "__len__") and len(image_hw) == 2
    if not is_pair or any(not float(side).is_integer() or side <= 0 for side in image_hw):
        raise ShapeError(f"{name} must be (height, width) in whole pixels > 0, got {image_hw}")

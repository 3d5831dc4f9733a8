"""Checks of the arrays that come in through the public functions."""

import math
from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import namespace


def check_shape(name: str, tensor: Tensor | np.ndarray, spec: str) -> None:
    """Raise unless a tensor has the shape that a spec describes.

    Args:
        name: the argument's name, for the message.
        tensor: any tensor.
        spec: one word a dimension: a number is that size, a word any size, a leading ``...`` any number of batch
            dimensions; ``"... 3 3"``, ``"N 3"``.

    Raises:
        ShapeError: naming the argument, the shape expected and the shape that came.

    """
    batched, sizes = _parsed(spec)
    shape = tensor.shape
    extra = len(shape) - len(sizes)
    if extra < 0 or (extra and not batched) or any(size is not None and shape[extra + at] != size for at, size in enumerate(sizes)):
        raise ShapeError(f"{name} must have shape ({', '.join(spec.split())}), got {tuple(shape)}")


@lru_cache
def _parsed(spec: str) -> tuple[bool, tuple[int | None, ...]]:
    """Whether batch dimensions may lead, and the sizes asked for, None for any."""
    words = spec.split()
    batched = words[0] == "..."
    return batched, tuple(int(word) if word.isdigit() else None for word in words[batched:])


def check_finite(name: str, tensor: Tensor | np.ndarray) -> None:
    """Raise a ShapeError naming the argument unless every value is finite."""
    finite = namespace(tensor).isfinite(tensor)
    if not bool(finite.all()):
        raise ShapeError(f"{name} must be finite, but {int((~finite).sum())} of its {math.prod(tensor.shape)} values are NaN or infinite")


def check_rotation(name: str, tensor: Tensor, tolerance: float = 1e-5) -> None:
    """Raise a ShapeError naming the argument unless it holds rotations, (..., 3, 3) with det +1."""
    check_shape(name, tensor, "... 3 3")
    check_finite(name, tensor)
    identity = torch.eye(3, dtype=tensor.dtype, device=tensor.device)
    off = float((tensor @ tensor.mT - identity).abs().amax()) if tensor.numel() else 0.0
    if off > tolerance:
        raise ShapeError(f"{name} must hold rotation matrices, but R @ R.T differs from the identity by {off:.2g}")
    if tensor.numel() and float(torch.linalg.det(tensor).amin()) < 0:
        raise ShapeError(f"{name} must have determinant +1; a determinant of -1 is a mirrored frame: negate one axis")


def check_intrinsics(name: str, K: Tensor | np.ndarray) -> None:
    """Raise a ShapeError unless K is (..., 3, 3), upper triangular, with positive focal lengths and K[2, 2] = 1."""
    check_shape(name, K, "... 3 3")
    check_finite(name, K)
    values = K if isinstance(K, np.ndarray) else K.detach().cpu().numpy()
    below = np.abs(values[..., [1, 2, 2], [0, 0, 1]]).max()
    if below > 1e-9 or np.abs(values[..., 2, 2] - 1).max() > 1e-9:
        raise ShapeError(f"{name} must be upper triangular with {name}[2, 2] = 1, got {K.tolist()}")
    if values[..., [0, 1], [0, 1]].min() <= 0:
        raise ShapeError(f"{name} must have positive focal lengths, got {K.tolist()}")


def check_image_hw(name: str, image_hw: tuple[int, int]) -> None:
    """Raise a ShapeError unless the pair is (height, width) in whole, positive pixels."""
    if len(image_hw) != 2 or any(not float(side).is_integer() or side <= 0 for side in image_hw):
        raise ShapeError(f"{name} must be (height, width) in whole pixels > 0, got {tuple(image_hw)}")


def check_known(name: str, value: str, known: Mapping[str, object] | tuple[str, ...]) -> None:
    """Raise a ShapeError that lists the known values unless the value is one of them."""
    if value not in known:
        raise ShapeError(f"{name} must be one of {', '.join(known)}, got {value!r}")

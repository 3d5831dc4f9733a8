"""One formula, two kinds of arrays.

Labels and training need the geometry in torch: batched, on any device, differentiable. A
DataLoader's worker needs the same formulas for the few numbers of one image, where NumPy costs a
third of torch a call. Functions over AnyArray do both: they return what they are given, and use
only what both libraries spell alike.
"""

from typing import Any, TypeVar

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.autograd.forward_ad import unpack_dual

NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
"""Of each coordinate, the one after it and the one before."""
AnyArray = TypeVar("AnyArray", Tensor, np.ndarray)


def namespace(array: Tensor | np.ndarray) -> Any:
    """The library whose functions take this array: torch or numpy."""
    return torch if isinstance(array, Tensor) else np


def as_numpy(array: Tensor | np.ndarray) -> np.ndarray:
    """The array itself, or a tensor's values on the host without its gradients.

    Shares memory where it can.
    """
    return array.numpy(force=True) if isinstance(array, Tensor) else array


def has_derivatives(tensor: Tensor) -> bool:
    """Whether derivatives are wanted of a tensor, in either mode."""
    return tensor.requires_grad or unpack_dual(tensor).tangent is not None  # type: ignore[no-untyped-call]


def is_plain(tensor: Tensor) -> bool:
    """Whether an array holds all of a tensor: on the host, without derivatives."""
    return tensor.is_cpu and not has_derivatives(tensor)


def like(array: AnyArray, values: Any) -> AnyArray:
    """Values (nested sequences of numbers) as an array of the same kind, dtype and device."""
    if isinstance(array, Tensor):
        return array.new_tensor(values)
    return np.array(values, dtype=array.dtype)


def rows_at(points: AnyArray, ids: np.ndarray) -> AnyArray:
    """Rows of points (..., N, D) by their numbers, an array of whole numbers of any shape (I, ...).

    (..., I, ..., D).
    """
    if isinstance(points, Tensor):
        return points[..., torch.from_numpy(ids).to(points.device), :]
    return points.take(ids, -2)


def as_type_of(array: AnyArray, other: AnyArray) -> AnyArray:
    """The array in another's floating-point type."""
    if isinstance(array, Tensor):
        return array.to(other.dtype)
    return array.astype(other.dtype, copy=False)


def cross(a: AnyArray, b: AnyArray) -> AnyArray:
    """Cross products (..., 3) of vectors (..., 3)."""
    if isinstance(a, Tensor):
        turned: Tensor = torch.linalg.cross(a, b)
        return turned
    product: np.ndarray = a.take(NEXT, -1) * b.take(LAST, -1) - a.take(LAST, -1) * b.take(NEXT, -1)
    return product


def norm(vectors: AnyArray) -> AnyArray:
    """Lengths (...,) of vectors (..., D)."""
    if isinstance(vectors, Tensor):
        length: Tensor = torch.linalg.vector_norm(vectors, dim=-1)
        return length
    root: np.ndarray = np.sqrt((vectors * vectors).sum(-1))
    return root


def clip(array: AnyArray, low: float, high: float) -> AnyArray:
    """Values held in [low, high]."""
    if isinstance(array, Tensor):
        return array.clamp(low, high)
    held: np.ndarray = np.minimum(np.maximum(array, low), high)
    return held


def at_least(array: AnyArray, least: float) -> AnyArray:
    """Values that are at least a tiny positive number, to divide by."""
    if isinstance(array, Tensor):
        return array.clamp_min(least)
    floored: np.ndarray = np.maximum(array, least)
    return floored


def transposed(matrix: np.ndarray) -> np.ndarray:
    """The transpose (N, M) of a matrix (M, N) of floating-point numbers, in memory as it is
    counted."""
    if not matrix.size:
        return matrix.T.copy()
    turned: np.ndarray = cv2.transpose(matrix)  # in blocks: half the time of a copy along columns
    return turned


def take(array: AnyArray, index: AnyArray) -> AnyArray:
    """Elements (N,) of an array (M,) by their indices (N,).

    In both libraries faster than array[index].
    """
    taken: AnyArray = (
        array.index_select(0, index) if isinstance(array, Tensor) else array.take(index)
    )
    return taken


def whole(array: AnyArray) -> AnyArray:
    """Whole numbers as int64."""
    if isinstance(array, Tensor):
        return array.to(torch.int64)
    return array.astype(np.int64)


def counting(array: AnyArray, count: int) -> AnyArray:
    """0, 1, .. count - 1 as int64, of the same kind and device as the array."""
    if isinstance(array, Tensor):
        return torch.arange(count, device=array.device)
    return np.arange(count)


def repeated(array: AnyArray, counts: AnyArray) -> AnyArray:
    """Each element (N,) so often (N,), in order."""
    if isinstance(array, Tensor):
        return array.repeat_interleave(counts)
    return np.repeat(array, counts)

"""Functions that take tensors and NumPy arrays alike: one formula for two kinds of arrays.

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
"""The coordinates y, z, x and z, x, y: of each, the one after it and the one before."""
AnyArray = TypeVar("AnyArray", Tensor, np.ndarray)
"""A tensor or an array, the same kind throughout a signature."""


def namespace(array: Tensor | np.ndarray) -> Any:
    """The library whose functions take this array, torch or numpy."""
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
    """Whether a tensor is on the host and without derivatives: an array can then stand for it."""
    return tensor.is_cpu and not has_derivatives(tensor)


def like(array: AnyArray, values: Any) -> AnyArray:
    """Values (nested sequences of numbers) as an array of the same kind, dtype and device."""
    if isinstance(array, Tensor):
        return array.new_tensor(values)
    return np.array(values, dtype=array.dtype)


def rows_at(points: AnyArray, ids: np.ndarray) -> AnyArray:
    """The rows (..., I, ..., D) of points (..., N, D) that indices (I, ...) of any shape name."""
    if isinstance(points, Tensor):
        return points[..., torch.from_numpy(ids).to(points.device), :]
    return points.take(ids, -2)


def as_type_of(array: AnyArray, other: AnyArray) -> AnyArray:
    """The array in the floating-point type of another."""
    if isinstance(array, Tensor):
        return array.to(other.dtype)
    return array.astype(other.dtype, copy=False)


def cross(a: AnyArray, b: AnyArray) -> AnyArray:
    """The cross products (..., 3) of vectors (..., 3)."""
    if isinstance(a, Tensor):
        tensor: Tensor = torch.linalg.cross(a, b)
        return tensor
    product: np.ndarray = a.take(NEXT, -1) * b.take(LAST, -1) - a.take(LAST, -1) * b.take(NEXT, -1)
    return product


def norm(vectors: AnyArray) -> AnyArray:
    """The lengths (...,) of vectors (..., D)."""
    if isinstance(vectors, Tensor):
        length: Tensor = torch.linalg.vector_norm(vectors, dim=-1)
        return length
    root: np.ndarray = np.sqrt((vectors * vectors).sum(-1))
    return root


def clip(array: AnyArray, low: float, high: float) -> AnyArray:
    """The values clamped to [low, high]."""
    if isinstance(array, Tensor):
        return array.clamp(low, high)
    clipped: np.ndarray = np.minimum(np.maximum(array, low), high)
    return clipped


def at_least(array: AnyArray, least: float) -> AnyArray:
    """The values clamped from below, as by a tiny positive number to divide by."""
    if isinstance(array, Tensor):
        return array.clamp_min(least)
    floored: np.ndarray = np.maximum(array, least)
    return floored


def transposed(matrix: np.ndarray) -> np.ndarray:
    """The transpose (N, M) of a matrix (M, N) of floating-point numbers, contiguous in memory."""
    if not matrix.size:
        return matrix.T.copy()
    columns: np.ndarray = cv2.transpose(matrix)  # in blocks: half the time of a copy along columns
    return columns


def take(array: AnyArray, index: AnyArray) -> AnyArray:
    """The elements (N,) of an array (M,) at indices (N,), faster than array[index]."""
    if isinstance(array, Tensor):
        return array.index_select(0, index)
    return array.take(index)


def whole(array: AnyArray) -> AnyArray:
    """The values of an array as int64, decimals cut off."""
    if isinstance(array, Tensor):
        return array.to(torch.int64)
    return array.astype(np.int64)


def counting(array: AnyArray, count: int) -> AnyArray:
    """The numbers 0 .. count - 1 as int64, of the same kind and device as the array."""
    if isinstance(array, Tensor):
        return torch.arange(count, device=array.device)
    return np.arange(count)


def repeated(array: AnyArray, counts: AnyArray) -> AnyArray:
    """Each element (N,) repeated as often as its count (N,) says, in order."""
    if isinstance(array, Tensor):
        return array.repeat_interleave(counts)
    return np.repeat(array, counts)

"""Upright boxes in pixels around masks and projected points."""

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy

Array = NDArray[np.float64]


def mask_box(mask: Tensor | NDArray[np.bool_]) -> Array:
    """The box (4,) xyxy in px around a mask (H, W), which must not be empty.

    Pixel centres lie at whole numbers, so it runs from the first pixel - 0.5 to the last + 0.5.

    Example:
        >>> mask_box(np.array([[False, False, False], [False, True, True]])).tolist()
        [0.5, 0.5, 2.5, 1.5]
    """
    inside = as_numpy(mask).view(np.uint8)
    if inside.flags.c_contiguous:
        top, bottom, left, right = _first_and_last(inside)
    else:  # such as of runs, which go down the columns
        left, right, top, bottom = _first_and_last(np.ascontiguousarray(inside.T))
    return np.array([left - 0.5, top - 0.5, right + 0.5, bottom + 0.5])


def _first_and_last(inside: NDArray[np.uint8]) -> tuple[int, int, int, int]:
    """First and last row, first and last column of the ones in a mask of 0 and 1.

    Args:
        inside: (H, W), row by row in memory.

    """
    content, width = inside.tobytes(), inside.shape[1]
    first, last = content.find(1) // width, content.rfind(1) // width
    columns = np.bitwise_or.reduce(inside[first : last + 1], 0).tobytes()
    return first, last, columns.find(1), columns.rfind(1)


def points_box(px: Tensor | Array, depth: Tensor | Array, image_hw: tuple[int, int]) -> Array:
    """The bounds of points in front of the camera, held inside the frame.

    Args:
        px: (N, 2).
        depth: (N,), positive in front of the camera.
        image_hw: height and width.

    Returns:
        (4,) xyxy px; zeros if no point is in front.

    """
    px = as_numpy(px)[as_numpy(depth) > 0]
    if not len(px):
        return np.zeros(4)
    last = np.array([image_hw[1] - 0.5, image_hw[0] - 0.5])
    return np.concatenate([np.clip(bound, -0.5, last) for bound in (px.min(0), px.max(0))])

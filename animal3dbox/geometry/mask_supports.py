"""How far a mask reaches in given directions of the picture: its support function.

The support of a set of points in a direction u is the greatest u · x of its points x. Where a body
is seen whole, the supports of its projection are those of its mask.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.straightening import straightened_pixels

Array = NDArray[np.float64]
PIXEL_REACH = 0.3
"""px from the outermost pixel's centre to the outline, over all directions: a pixel is the animal's
if half of it is, so that the outline lies about a third of a pixel farther out (a disc's, in
tests/geometry/test_mask_supports.py)."""


@dataclass(frozen=True)
class MaskSupports:
    """How far a mask reaches in some directions; those in which the frame cuts it are left out.

    Attributes:
        directions: (D, 2) unit, along x and y of the picture.
        heights: (D,) px, the greatest u · x of the outline's points x.
    """

    directions: Array
    heights: Array


def mask_supports(
    mask: NDArray[np.bool_],
    directions: Array,
    K: Array | None = None,
    distortion: Array | None = None,
) -> MaskSupports:
    """The supports of a mask in some directions.

    Args:
        mask: (H, W), not empty.
        directions: (D, 2) unit.
        K: (3, 3); needed with a lens.
        distortion: coefficients of OpenCV's lens; the supports are then those of the straight
            picture, and only of what the lens shows. None: a pinhole.

    Example:
        >>> mask = np.zeros((6, 6), dtype=bool)
        >>> mask[2:4, 1:5] = True
        >>> mask_supports(mask, np.array([[1.0, 0.0], [0.0, -1.0]])).heights
        array([ 4.3, -1.7])
    """
    height, width = mask.shape
    rows = np.flatnonzero(mask.any(1))
    band = np.ascontiguousarray(mask[rows])
    first, last = band.argmax(1), width - 1 - band[:, ::-1].argmax(1)
    columns, rows = np.concatenate((first, last)), np.concatenate((rows, rows))
    on_border = (rows == 0) | (rows == height - 1) | (columns == 0) | (columns == width - 1)
    points = np.stack((columns, rows), -1).astype(np.float64)
    if distortion is not None and K is not None:
        points, _, in_lens = straightened_pixels(points, K, distortion)
        on_border |= ~in_lens
        points[~in_lens] = 0.0
    reach = directions @ points.T
    farthest = reach.argmax(1)
    whole = ~on_border[farthest]
    if distortion is not None and on_border.any():
        whole[:] = False  # what the border cuts may reach anywhere in the straight picture
    heights = reach[np.arange(len(directions)), farthest] + PIXEL_REACH
    return MaskSupports(directions[whole], heights[whole])


def even_directions(count: int) -> Array:
    """So many unit vectors (count, 2) all round, the first along x.

    Example:
        >>> even_directions(4).round(6) + 0.0
        array([[ 1.,  0.],
               [ 0.,  1.],
               [-1.,  0.],
               [ 0., -1.]])
    """
    angles = 2 * np.pi * np.arange(count) / count
    return np.stack((np.cos(angles), np.sin(angles)), -1)

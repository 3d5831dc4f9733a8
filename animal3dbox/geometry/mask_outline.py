"""The outline of a mask: points along it, with the directions in which they face outwards."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.straightening import straightened_pixels

Array = NDArray[np.float64]
OUTLINE_REACH = 0.4
"""px from the centre of a pixel on the outline to the outline itself, over all directions (a disc's
in tests/geometry/test_mask_outline.py)."""
LEAST_SMOOTHING, SMOOTHING = 3, 0.005
"""Pixels on either side of a point that its direction is taken from: at least so many, and so many
of the whole outline's."""
SMALL_PART = 0.02
"""Parts of a mask smaller than this part of the largest do not count."""


@dataclass(frozen=True)
class MaskOutline:
    """Points on the outline of a mask.

    Attributes:
        points: (M, 2) px.
        normals: (M, 2) unit, outwards.
        is_whole: (M,) False where the frame or the lens ends the mask.
    """

    points: Array
    normals: Array
    is_whole: NDArray[np.bool_]


def mask_outline(
    mask: NDArray[np.bool_],
    count: int,
    K: Array | None = None,
    distortion: Array | None = None,
) -> MaskOutline:
    """So many points, evenly along the outer outlines of a mask; holes count for nothing.

    Args:
        mask: (H, W); one that is empty has no points.
        count: of points.
        K: (3, 3); needed with a lens.
        distortion: coefficients of OpenCV's lens; the outline is then that of the straight picture.
            None: a pinhole.

    Example:
        >>> mask = np.zeros((40, 40), dtype=bool)
        >>> mask[10:30, 10:30] = True
        >>> outline = mask_outline(mask, 19)
        >>> outline.points[2].round(1), outline.normals[2].round(1) + 0.0
        (array([ 9.6, 20. ]), array([-1.,  0.]))
    """
    rings = _large_rings(mask)
    whole = sum(map(len, rings))
    reach = max(LEAST_SMOOTHING, round(SMOOTHING * whole))
    picks = ((np.arange(count) + 0.5) * whole / max(count, 1)).astype(np.intp)
    windows, first = [np.zeros((0, 2 * reach + 1, 2))], 0
    for ring in rings:
        own = picks[(picks >= first) & (picks < first + len(ring))] - first
        windows.append(ring[(own[:, None] + np.arange(-reach, reach + 1)) % len(ring)])
        first += len(ring)
    return _outline_of(np.concatenate(windows), mask.shape, K, distortion)


def _large_rings(mask: NDArray[np.bool_]) -> list[Array]:
    """The outer outlines (N, 2) of a mask's large parts, pixel by pixel, as OpenCV runs."""
    rows = np.flatnonzero(mask.any(1))
    if not len(rows):
        return []
    first = int(rows[0])
    band = np.ascontiguousarray(mask[first : rows[-1] + 1]).view(np.uint8)
    rings, _ = cv2.findContours(band, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(0, first))
    areas = [cv2.contourArea(ring) + len(ring) / 2 for ring in rings]
    return [
        ring[:, 0].astype(np.float64)
        for ring, area in zip(rings, areas, strict=True)
        if area >= SMALL_PART * max(areas)
    ]


def _outline_of(
    windows: Array, shape: tuple[int, ...], K: Array | None, distortion: Array | None
) -> MaskOutline:
    """The outline at the middles of windows (M, 2 reach + 1, 2) of consecutive pixels."""
    reach = windows.shape[1] // 2
    middle = windows[:, reach]
    limits = np.array([shape[1] - 1, shape[0] - 1])
    is_whole = np.asarray(((middle > 0) & (middle < limits)).all(1))
    if distortion is not None and K is not None:
        straight, _, in_lens = straightened_pixels(windows.reshape(-1, 2), K, distortion)
        windows = straight.reshape(windows.shape)
        is_whole &= in_lens.reshape(windows.shape[:2]).all(1)
    along = (np.arange(-reach, reach + 1)[:, None] * windows).sum(1)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    # An outer ring runs so that the outside is on the right of the way, y down.
    outwards = np.stack((-along[:, 1], along[:, 0]), 1) / np.maximum(length, 1e-12)
    outwards[length[:, 0] == 0] = (1.0, 0.0)  # a single pixel
    return MaskOutline(windows[:, reach] + OUTLINE_REACH * outwards, outwards, is_whole)

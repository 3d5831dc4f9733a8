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
SMOOTHING = 3
"""Pixels on either side of a point that its direction is taken from."""
LEAST_LENGTH = 16
"""Pixels; shorter outlines are specks that tell no direction."""


@dataclass(frozen=True)
class MaskOutline:
    """Points on the outline of a mask, without those where the frame or the lens ends it.

    Attributes:
        points: (M, 2) px.
        normals: (M, 2) unit, outwards.
    """

    points: Array
    normals: Array


def mask_outline(
    mask: NDArray[np.bool_],
    count: int,
    K: Array | None = None,
    distortion: Array | None = None,
) -> MaskOutline:
    """About so many points, evenly along the outer outlines of a mask; holes count for nothing.

    Args:
        mask: (H, W).
        count: of points; fewer where the frame cuts the mask.
        K: (3, 3); needed with a lens.
        distortion: coefficients of OpenCV's lens; the outline is then that of the straight picture.
            None: a pinhole.

    Example:
        >>> mask = np.zeros((40, 40), dtype=bool)
        >>> mask[10:30, 10:30] = True
        >>> outline = mask_outline(mask, 19)
        >>> outline.points[0].round(1), outline.normals[5].round(1) + 0.0
        (array([9.7, 9.7]), array([0., 1.]))
    """
    rings = [ring[:, 0] for ring in _rings(mask) if len(ring) >= LEAST_LENGTH]
    total = sum(map(len, rings))
    points, normals = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for ring in rings:
        places = np.arange(0, len(ring), max(total / max(count, 1), 1)).astype(np.intp)
        on_outline, outwards, is_whole = _sampled(
            ring, places, mask.shape, K=K, distortion=distortion
        )
        points.append(on_outline[is_whole])
        normals.append(outwards[is_whole])
    return MaskOutline(np.concatenate(points), np.concatenate(normals))


def _rings(mask: NDArray[np.bool_]) -> list[NDArray[np.int32]]:
    """The outer outlines (N, 1, 2) of a mask, pixel by pixel, as OpenCV runs along them."""
    rows = np.flatnonzero(mask.any(1))
    if not len(rows):
        return []
    first = int(rows[0])
    band = np.ascontiguousarray(mask[first : rows[-1] + 1]).view(np.uint8)
    rings, _ = cv2.findContours(band, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(0, first))
    return [np.asarray(ring, dtype=np.int32) for ring in rings]


def _sampled(
    ring: NDArray[np.int32],
    places: NDArray[np.intp],
    shape: tuple[int, ...],
    *,
    K: Array | None,
    distortion: Array | None,
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Points (M, 2) and normals (M, 2) at places of a ring, and which of them nothing cuts."""
    height, width = shape
    limits = np.array([width - 1, height - 1])
    inside = (ring[places] > 0) & (ring[places] < limits)
    is_whole: NDArray[np.bool_] = np.asarray(inside.all(1))
    near = np.arange(-SMOOTHING, SMOOTHING + 1)
    neighbours = ring[(places[:, None] + near) % len(ring)].astype(np.float64)
    if distortion is not None and K is not None:
        straight, _, in_lens = straightened_pixels(neighbours.reshape(-1, 2), K, distortion)
        neighbours = straight.reshape(neighbours.shape)
        is_whole &= in_lens.reshape(neighbours.shape[:2]).all(1)
    along = (near[:, None] * neighbours).sum(1)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    # An outer ring runs with the mask on the left hand of y down: outwards is on the right.
    outwards = np.stack((-along[:, 1], along[:, 0]), 1)
    points: Array = neighbours[:, SMOOTHING] + OUTLINE_REACH * outwards
    return points, outwards, is_whole

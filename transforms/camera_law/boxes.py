"""Upright 2D boxes (x least, y least, x greatest, y greatest) under maps of pixels."""

import cv2
import numpy as np
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray, like, namespace

CORNERS = np.array([[0, 1], [2, 1], [2, 3], [0, 3]])
"""The coordinates (x, y) of a box's four corners."""
FEW = 4
"""Up to so many boxes are mapped in plain numbers."""


def mapped_boxes(
    boxes: AnyArray,
    H_out_in: AnyArray,
    image_hw: tuple[int, int],
    outline: tuple[AnyArray, AnyArray] | None,
) -> AnyArray:
    """Upright boxes round mapped boxes, inside the new frame.

    Exact where the map keeps the axes (flip, crop, resize, quarter turns). Any other map turns the
    box, and what lies round it bounds the animal less tightly; it is cut to the outline of the
    projected cuboid where that has any overlap with it.

    Args:
        boxes: (N, 4).
        H_out_in: (3, 3).
        image_hw: of the image after.
        outline: (N, 4) boxes round the projected cuboids and (N,) whether each means something;
            None if the map keeps the axes, or without cuboids.

    Returns:
        (N, 4); without area where nothing of the box lies in the frame.

    """
    if isinstance(boxes, np.ndarray) and len(boxes) <= FEW:
        return _few_mapped_boxes(boxes, H_out_in, image_hw, outline)
    xp = namespace(boxes)
    around = boxes[:, CORNERS]
    w = around @ H_out_in[2, :2] + H_out_in[2, 2]
    height, width = image_hw
    low, high = like(boxes, [-0.5, -0.5]), like(boxes, [width - 0.5, height - 0.5])
    px = (around @ H_out_in[:2, :2].mT + H_out_in[:2, 2]) / xp.where(w > 0, w, xp.ones_like(w))[
        ..., None
    ]
    if px.shape[0] == 0:
        return boxes
    start, end = extent(px)
    # A box across the map's horizon is bounded by nothing; one beyond it has no area.
    bounded, beyond = (w > 0).all(-1)[:, None], ~(w > 0).any(-1)[:, None]
    start = xp.where(bounded, start, low)
    end = xp.where(bounded, end, xp.where(beyond, low + 0 * start, high + 0 * start))
    if outline is not None:
        tight_start, tight_end = (
            xp.maximum(start, outline[0][:, :2]),
            xp.minimum(end, outline[0][:, 2:]),
        )
        tightens = (outline[1] & (tight_end > tight_start).all(-1))[:, None]
        start, end = xp.where(tightens, tight_start, start), xp.where(tightens, tight_end, end)
    clipped: AnyArray = xp.concatenate(
        [xp.minimum(xp.maximum(edge, low), high) for edge in (start, end)], -1
    )
    return clipped


def _few_mapped_boxes(
    boxes: np.ndarray,
    H_out_in: np.ndarray,
    image_hw: tuple[int, int],
    outline: tuple[np.ndarray, np.ndarray] | None,
) -> np.ndarray:
    """The boxes of mapped_boxes in plain numbers, for the few animals of one picture.

    NumPy's calls take four times as long for one box (benchmarks/augment.py, all targets).
    """
    outlines: list[list[float] | None] = [None] * len(boxes)
    if outline is not None:
        pairs = zip(outline[0].tolist(), outline[1].tolist(), strict=True)
        outlines = [edges if meant else None for edges, meant in pairs]
    rows = H_out_in.tolist()
    mapped = [
        _mapped_box(box, rows, image_hw, edges)
        for box, edges in zip(boxes.tolist(), outlines, strict=True)
    ]
    return np.array(mapped).reshape(-1, 4)


def _mapped_box(
    box: list[float],
    H_out_in: list[list[float]],
    image_hw: tuple[int, int],
    outline: list[float] | None,
) -> list[float]:
    """One box of mapped_boxes, (x least, y least, x greatest, y greatest)."""
    x1, y1, x2, y2 = box
    corners = [
        [a * x + b * y + c for a, b, c in H_out_in]
        for x, y in ((x1, y1), (x2, y1), (x2, y2), (x1, y2))
    ]
    first, last = [-0.5, -0.5], [image_hw[1] - 0.5, image_hw[0] - 0.5]
    if all(w > 0 for _, _, w in corners):
        across, down = [u / w for u, _, w in corners], [v / w for _, v, w in corners]
        around = [min(across), min(down), max(across), max(down)]
    else:  # across the map's horizon it is bounded by nothing; beyond it, it has no area
        around = first + (last if any(w > 0 for _, _, w in corners) else first)
    if outline is not None:
        tight = [*map(max, around[:2], outline[:2]), *map(min, around[2:], outline[2:])]
        around = tight if tight[0] < tight[2] and tight[1] < tight[3] else around
    return [*map(min, map(max, around, first * 2), last * 2)]


def extent(points: AnyArray) -> tuple[AnyArray, AnyArray]:
    """The least and the greatest coordinates (..., D) of points (..., N, D)."""
    if isinstance(points, Tensor):
        return points.amin(-2), points.amax(-2)
    return points.min(-2), points.max(-2)


def keeps_axes(H: Tensor | np.ndarray) -> bool:
    """Whether a map (3, 3) leaves upright boxes upright: no perspective, and quarter turns only."""
    (a, b, _), (c, d, _), (e, f, _) = H.tolist()
    return bool(e == 0 and f == 0 and ((b == 0 and c == 0) or (a == 0 and d == 0)))


def boxes_of_masks(masks: AnyArray, otherwise: AnyArray) -> AnyArray:
    """Upright boxes round masks, from the outer edges of their pixels.

    Args:
        masks: (N, H, W), 0 or 1.
        otherwise: (N, 4) the boxes of empty masks.

    Returns:
        (N, 4) float64.

    """
    boxes = otherwise.tolist()
    for index, mask in enumerate(masks > 0):
        x, y, width, height = cv2.boundingRect(
            (mask.cpu().numpy() if isinstance(mask, Tensor) else mask).astype(np.uint8)
        )
        if width:
            boxes[index] = (x - 0.5, y - 0.5, x + width - 0.5, y + height - 0.5)
    return like(otherwise, boxes) if len(boxes) else otherwise

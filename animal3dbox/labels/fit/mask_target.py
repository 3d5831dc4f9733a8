"""A mask as the fit compares bodies with it: points of its outline, and the way back into it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.mask_supports import PIXEL_REACH
from animal3dbox.labels.fit.problem import frame_about

Array = NDArray[np.float64]
OUTLINE_POINTS = 110
SMALL_PART = 0.02
"""Parts of a mask smaller than this part of the largest do not count."""
GRID_SIDE = 160
"""Most cells of the grid along each side."""
GRID_MARGIN = 0.3
"""How far the grid reaches beyond the mask, by the longer side of its box."""
TANGENT_REACH = 0.005
"""Half the length over which an outline's direction is taken, by the outline's."""


@dataclass(frozen=True)
class MaskTarget:
    """One mask, in px about the principal point.

    Attributes:
        points: (OUTLINE_POINTS, 2) of the outline.
        normals: (OUTLINE_POINTS, 2) unit, outward.
        counts: (OUTLINE_POINTS,) 1, or 0 of a point at which the frame cuts the mask.
        nearest: (h, w, 2) the mask's nearest point to each cell of a grid.
        corner: (2,) the first cell's centre.
        cell: side of a cell.
        frame: (4,) least and greatest u, v of the frame: u0, v0, u1, v1.
    """

    points: Array
    normals: Array
    counts: Array
    nearest: Array
    corner: Array
    cell: float
    frame: Array


def mask_target(mask: NDArray[np.bool_], center: Array) -> MaskTarget:
    """The target of a mask (H, W), not empty, about the principal point (2,)."""
    height, width = mask.shape
    points, normals = _outline(mask)
    on_border = (points < 1).any(1) | (points > np.array([width - 2, height - 2])).any(1)
    nearest, corner, cell = _way_back(mask)
    return MaskTarget(
        points=points + PIXEL_REACH * normals - center,
        normals=normals,
        counts=np.where(on_border, 0.0, 1.0),
        nearest=nearest - center,
        corner=corner - center,
        cell=cell,
        frame=frame_about((height, width), center),
    )


def _outline(mask: NDArray[np.bool_]) -> tuple[Array, Array]:
    """OUTLINE_POINTS points of the outline, evenly along it, and their outward normals."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    rings = [contour[:, 0].astype(np.float64) for contour in contours]
    areas = [cv2.contourArea(contour) + len(contour) / 2 for contour in contours]
    rings = [r for r, area in zip(rings, areas, strict=True) if area >= SMALL_PART * max(areas)]
    lengths = np.array([len(ring) for ring in rings])
    whole = int(lengths.sum())
    reach = max(2, round(TANGENT_REACH * whole))
    starts = np.cumsum(lengths) - lengths
    picks = (np.arange(OUTLINE_POINTS) + 0.5) * whole / OUTLINE_POINTS
    points, normals = [], []
    for ring, start in zip(rings, starts, strict=True):
        own = (picks[(picks >= start) & (picks < start + len(ring))] - start).astype(np.intp)
        ahead, behind = ring[(own + reach) % len(ring)], ring[(own - reach) % len(ring)]
        points.append(ring[own])
        # OpenCV's outer contours run so that the outside is at the right of the way, y down
        along = ahead - behind
        normals.append(np.stack((-along[:, 1], along[:, 0]), -1))
    outward = np.concatenate(normals)
    length = np.sqrt((outward * outward).sum(-1, keepdims=True))
    outward = np.where(length > 0, outward / np.maximum(length, 1e-12), np.array([1.0, 0.0]))
    return np.concatenate(points), outward


def _way_back(mask: NDArray[np.bool_]) -> tuple[Array, Array, float]:
    """The mask's nearest point to each cell of a grid round it, the first cell, and their side."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    low = np.array([columns[0], rows[0]], dtype=np.float64)
    high = np.array([columns[-1], rows[-1]], dtype=np.float64)
    margin = np.ceil(GRID_MARGIN * max(float((high - low).max()), 1.0)) + 2
    low, high = low - margin, high + margin
    cell = max(1.0, float((high - low).max()) / GRID_SIDE)
    count = np.ceil((high - low) / cell).astype(np.intp) + 1
    u = np.rint(low[0] + cell * np.arange(count[0])).astype(np.intp)
    v = np.rint(low[1] + cell * np.arange(count[1])).astype(np.intp)
    inside = np.zeros((len(v), len(u)), dtype=np.uint8)
    in_u, in_v = (u >= 0) & (u < mask.shape[1]), (v >= 0) & (v < mask.shape[0])
    inside[np.ix_(in_v, in_u)] = mask[np.ix_(v[in_v], u[in_u])]
    if not inside.any():  # finer than the grid
        inside[len(v) // 2, len(u) // 2] = 1
    _, labels = cv2.distanceTransformWithLabels(
        1 - inside, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    at_rows, at_columns = np.nonzero(inside)
    places = np.zeros((int(labels.max()) + 1, 2))
    places[labels[at_rows, at_columns], 0] = low[0] + cell * at_columns
    places[labels[at_rows, at_columns], 1] = low[1] + cell * at_rows
    return places[labels], low, cell

"""A mask as the fit compares bodies with it: points of its outline, and the way back into it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.mask_outline import mask_outline
from animal3dbox.labels.fit.problem import frame_about

Array = NDArray[np.float64]
OUTLINE_POINTS = 110
GRID_SIDE = 160
"""Most cells of the grid along each side."""
GRID_MARGIN = 0.3
"""How far the grid reaches beyond the mask, by the longer side of its box."""


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
    outline = mask_outline(mask, OUTLINE_POINTS)
    nearest, corner, cell = _way_back(mask)
    return MaskTarget(
        points=outline.points - center,
        normals=outline.normals,
        counts=outline.is_whole.astype(np.float64),
        nearest=nearest - center,
        corner=corner - center,
        cell=cell,
        frame=frame_about((height, width), center),
    )


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

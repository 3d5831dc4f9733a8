"""The part of each box that its image shows, for formats that say how much of a thing is hidden.

A dataset that says it is believed. Else the boxes in front tell: what of a box's projection lies
behind theirs is taken for hidden. Things that are no boxes, such as trees, are not known.
"""

from collections.abc import Sequence
from itertools import groupby

import cv2
import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import Floats
from animal3dbox.datasets.readers.visible_boxes import VisibleBoxes
from animal3dbox.datasets.records import CuboidRecord

SIDE = 64
"""Pixels of the grid on which a box and those in front of it are drawn."""
SHIFT = 4
"""Binary digits after the point of the corners that are drawn."""


def visible_parts(records: Sequence[CuboidRecord], visible: VisibleBoxes) -> Floats:
    """The part (N,), 0 to 1, of each box's projection that no nearer box of its image covers.

    Args:
        records: N boxes, those of an image one after the other.
        visible: their projections.

    Returns:
        What the dataset says where it does; NaN of a box of which the frame shows nothing.

    """
    parts = np.full(len(records), np.nan)
    for _, group in groupby(range(len(records)), key=lambda index: records[index].image_id):
        members = list(group)
        distances = {index: float(np.linalg.norm(records[index].center)) for index in members}
        for index in members:
            stated = records[index].visibility
            nearer = [other for other in members if distances[other] < distances[index]]
            parts[index] = _part(index, nearer, visible) if stated is None else stated
    return parts


def _part(index: int, nearer: Sequence[int], visible: VisibleBoxes) -> float:
    """The part of one box's projection that nearer boxes leave; NaN if the frame shows nothing."""
    window = visible.in_frame[index]
    if np.isnan(window).any():
        return float("nan")
    own = _drawn([index], visible, window)
    hidden = own & _drawn(nearer, visible, window)
    return 1.0 - float(hidden.sum()) / max(float(own.sum()), 1.0)


def _drawn(indices: Sequence[int], visible: VisibleBoxes, window: Floats) -> np.ndarray:
    """The outlines of some boxes, drawn full on a grid (SIDE, SIDE) over a window (4,), xyxy px."""
    grid = np.zeros((SIDE, SIDE), np.uint8)
    for index in indices:
        outline = visible.corners_2d[index]
        if not visible.corner_in_front[index].all():
            x1, y1, x2, y2 = visible.in_frame[index]
            outline = np.array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]])
        if np.isnan(outline).any():
            continue
        scaled = (outline - window[:2]) / (window[2:] - window[:2]) * SIDE - 0.5
        corners = np.round(np.clip(scaled, -1e3, 1e3) * 2**SHIFT).astype(np.int32)
        cv2.fillConvexPoly(grid, cv2.convexHull(corners), 1, shift=SHIFT)
    return grid > 0

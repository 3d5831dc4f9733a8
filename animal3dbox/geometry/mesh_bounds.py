"""The flat box of what the frame shows of a mesh, exactly and without drawing it."""

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import NEXT
from animal3dbox.geometry.mesh_edges import mesh_edges

Array = NDArray[np.float64]
LEFT, TOP, RIGHT, BOTTOM = SIDES = np.array([1, 2, 4, 8], dtype=np.uint8)
CORNERS = (0, 1), (2, 1), (2, 3), (0, 3)
"""The sides that meet in each of the frame's corners."""


def frame_box(image_hw: tuple[int, int]) -> Array:
    """The frame (4,) xyxy px."""
    return np.array([-0.5, -0.5, image_hw[1] - 0.5, image_hw[0] - 0.5])


def bounds_in_frame(px: Array, faces: Tensor, frame: Array) -> Array | None:
    """The bounds (4,) xyxy of the part of a projected mesh inside the frame; None if there is none.

    The corners of a triangle cut by a rectangle are those of its own inside, the places where its
    edges cross the rectangle's sides, and the rectangle's corners inside it.

    Args:
        px: (2, V) all vertices, none of them behind the camera.
        faces: (F, 3) int64; vertices of no face do not count.
        frame: (4,) xyxy px.

    """
    codes = (
        (px[0] < frame[0]) * LEFT
        + (px[1] < frame[1]) * TOP
        + (px[0] > frame[2]) * RIGHT
        + (px[1] > frame[3]) * BOTTOM
    )
    edges = mesh_edges(faces)
    columns, used = edges.columns, edges.used
    a, b, c = (codes.take(column) for column in columns)
    cut = np.flatnonzero(((a | b | c) != 0) & ((a & b & c) == 0))
    corners = px.take(columns.take(cut, 1).T, 1)  # (2, T, 3)
    passed = [
        side for side in range(4) if np.bitwise_or.reduce(codes, initial=0) & SIDES[side]
    ]  # only by these does anything leave the frame
    found = [_crossing(corners, frame, side) for side in passed]
    found += [_covered(corners, frame[[x, y]]) for x, y in CORNERS if x in passed and y in passed]
    shown = np.concatenate((px.take(used[codes.take(used) == 0], 1), *found), 1)
    return np.concatenate((shown.min(1), shown.max(1))) if shown.shape[1] else None


def _crossing(corners: Array, frame: Array, side: int) -> Array:
    """Where the edges of triangles (2, T, 3) cross one of the frame's four sides, (2, N)."""
    axis = side % 2
    here, there = corners[axis], corners[1 - axis]
    along = here.take(NEXT, 1) - here
    part = (frame[side] - here) / np.where(along == 0, np.inf, along)
    other = there + part * (there.take(NEXT, 1) - there)
    crosses = (
        (part >= 0)
        & (part <= 1)
        & (along != 0)
        & (other >= frame[1 - axis])
        & (other <= frame[3 - axis])
    )
    at = np.empty((2, np.count_nonzero(crosses)))
    at[axis], at[1 - axis] = frame[side], other[crosses]
    return at


def _covered(corners: Array, point: Array) -> Array:
    """A point (2,) if it lies in some of the triangles (2, T, 3): (2, 1), else (2, 0)."""
    x, y = corners
    turn = (x.take(NEXT, 1) - x) * (point[1] - y) - (y.take(NEXT, 1) - y) * (point[0] - x)  # (T, 3)
    inside = ((turn >= 0).all(1) | (turn <= 0).all(1)) & (
        turn.sum(1) != 0
    )  # one without area covers nothing
    return point[:, None] if inside.any() else np.empty((2, 0))

"""The 2D box of what the frame shows of a mesh, exactly and without drawing it."""

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import NEXT
from animal3dbox.geometry.mesh_edges import mesh_edges

Array = NDArray[np.float64]
LEFT, TOP, RIGHT, BOTTOM = SIDES = np.array([1, 2, 4, 8], dtype=np.uint8)
"""One bit for each side of the frame that a point lies beyond (Cohen-Sutherland's outcodes)."""
CORNERS = (0, 1), (2, 1), (2, 3), (0, 3)
"""The sides that meet in each of the frame's corners."""


def bounds_in_frame(px: Array, faces: Tensor, frame: Array) -> Array | None:
    """The 2D box of the part of a projected mesh that lies inside the frame.

    A triangle cut by a rectangle has three kinds of corners: its own that lie inside, the places
    where its edges cross the rectangle's sides, and the rectangle's corners inside the triangle.

    Args:
        px: (2, V) all vertices, none of them behind the camera.
        faces: (F, 3) int64; vertices of no face do not count.
        frame: (4,) xyxy px, see frame_box; its border belongs to it, as in_frame has it.

    Returns:
        (4,) xyxy px; None if the frame shows nothing of the mesh.

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
    # Not all inside, and not all beyond one and the same side: the frame may cut these
    cut = np.flatnonzero(((a | b | c) != 0) & ((a & b & c) == 0))
    triangles = px.take(columns.take(cut, 1).T, 1)  # (2, T, 3)
    # Only by these sides does anything leave the frame
    crossed = [side for side in range(4) if np.bitwise_or.reduce(codes, initial=0) & SIDES[side]]
    frame_corners = [frame[[x, y]] for x, y in CORNERS if x in crossed and y in crossed]
    points = np.concatenate(
        (
            px.take(used[codes.take(used) == 0], 1),
            *(_crossings(triangles, frame, side) for side in crossed),
            *(_covered(triangles, corner) for corner in frame_corners),
        ),
        1,
    )
    return np.concatenate((points.min(1), points.max(1))) if points.shape[1] else None


def _crossings(corners: Array, frame: Array, side: int) -> Array:
    """The places where edges of triangles (2, T, 3) cross one of the frame's four sides, (2, N)."""
    axis = side % 2
    across, along = corners[axis], corners[1 - axis]
    step = across.take(NEXT, 1) - across
    # across + part * step = side
    part = (frame[side] - across) / np.where(step == 0, np.inf, step)
    place = along + part * (along.take(NEXT, 1) - along)
    on_edge = (part >= 0) & (part <= 1) & (step != 0)
    crosses = on_edge & (place >= frame[1 - axis]) & (place <= frame[3 - axis])
    points = np.empty((2, np.count_nonzero(crosses)))
    points[axis], points[1 - axis] = frame[side], place[crosses]
    return points


def _covered(corners: Array, point: Array) -> Array:
    """The point (2,) if some triangle of (2, T, 3) covers it, as (2, 1); else no point, (2, 0)."""
    x, y = corners
    # The cross product of each edge and the way to the point, (T, 3); their sum is twice the area,
    # and a triangle without area covers nothing
    turn = (x.take(NEXT, 1) - x) * (point[1] - y) - (y.take(NEXT, 1) - y) * (point[0] - x)
    inside = ((turn >= 0).all(1) | (turn <= 0).all(1)) & (turn.sum(1) != 0)
    return point[:, None] if inside.any() else np.empty((2, 0))

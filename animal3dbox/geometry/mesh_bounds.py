"""The flat box of what the frame shows of a mesh, exactly and without drawing it."""

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.mesh_edges import mesh_edges

Array = NDArray[np.float64]
LEFT, TOP, RIGHT, BOTTOM = np.array([1, 2, 4, 8], dtype=np.uint8)


def frame_box(image_hw: tuple[int, int]) -> Array:
    """The frame (4,) xyxy px."""
    return np.array([-0.5, -0.5, image_hw[1] - 0.5, image_hw[0] - 0.5])


def bounds_in_frame(px: Array, faces: Tensor, frame: Array) -> Array | None:
    """The bounds (4,) xyxy of the part of a projected mesh inside the frame; None if there is none.

    The corners of a triangle cut by a rectangle are those of its own inside, the places where its edges cross the
    rectangle's sides, and the rectangle's corners inside it.

    Args:
        px: (2, V) all vertices, none of them behind the camera.
        faces: (F, 3) int64; vertices of no face do not count.
        frame: (4,) xyxy px.

    """
    codes = (px[0] < frame[0]) * LEFT + (px[1] < frame[1]) * TOP + (px[0] > frame[2]) * RIGHT + (px[1] > frame[3]) * BOTTOM
    edges = mesh_edges(faces)
    columns, used = edges.columns, edges.used
    a, b, c = (codes.take(column) for column in columns)
    cut = np.flatnonzero(((a | b | c) != 0) & ((a & b & c) == 0))
    corners = px[:, columns[:, cut].T]  # (2, T, 3)
    inside = used[codes.take(used) == 0]
    shown = np.concatenate((px[:, inside], _crossings(corners, frame), _covered_corners(corners, frame)), 1)
    return np.concatenate((shown.min(1), shown.max(1))) if shown.shape[1] else None


def _crossings(corners: Array, frame: Array) -> Array:
    """Where the edges of triangles (2, T, 3) cross the frame's four sides, (2, N)."""
    start, along = corners, corners[:, :, [1, 2, 0]] - corners
    found = []
    for side in range(4):
        axis = side % 2
        part = (frame[side] - start[axis]) / np.where(along[axis] == 0, np.inf, along[axis])
        other = start[1 - axis] + part * along[1 - axis]
        crosses = (part >= 0) & (part <= 1) & (along[axis] != 0) & (other >= frame[1 - axis]) & (other <= frame[3 - axis])
        at = np.empty((2, np.count_nonzero(crosses)))
        at[axis], at[1 - axis] = frame[side], other[crosses]
        found.append(at)
    return np.concatenate(found, 1)


def _covered_corners(corners: Array, frame: Array) -> Array:
    """Those of the frame's four corners that lie in some of the triangles (2, T, 3), (2, N)."""
    x, y = frame[[0, 2, 2, 0]], frame[[1, 1, 3, 3]]
    along = corners[:, :, [1, 2, 0]] - corners
    turn = along[0][..., None] * (y - corners[1][..., None]) - along[1][..., None] * (x - corners[0][..., None])  # (T, 3, 4)
    inside = (((turn >= 0).all(1) | (turn <= 0).all(1)) & (turn.sum(1) != 0)).any(0)  # one without area covers nothing
    return np.stack((x[inside], y[inside]))

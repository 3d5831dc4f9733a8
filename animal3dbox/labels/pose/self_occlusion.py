"""Which landmarks a body hides from a camera itself, by a coarse z-buffer of its vertices."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CELLS, VERTICES_A_CELL = 64, 1.5
"""Most cells along the longer side of the body in the picture, and the vertices that a cell needs
so that the near side of the body leaves no holes."""
BEFORE = 0.13
"""Of the landmarks' spread: how far the surface must lie before a landmark to hide it, beyond the
depth at which the landmark lies in the flesh."""


def hidden_landmarks(landmarks: Array, vertices: Array, *, R: Array, t: Array) -> NDArray[np.bool_]:
    """Which landmarks (N,) lie behind the body's own surface.

    Args:
        landmarks: (N, 3), in units of their spread.
        vertices: (V, 3), in the same frame and unit.
        R: (3, 3).
        t: (3,).

    """
    surface, points = (R @ values.T + t[:, None] for values in (vertices, landmarks))
    surface = surface.compress(surface[2] > 1e-6, axis=1)
    if not surface.size:
        return np.zeros(len(landmarks), dtype=np.bool_)
    plane, places = (values[:2] / np.maximum(values[2], 1e-6) for values in (surface, points))
    least = plane.min(1)[:, None]
    cells = int(np.clip(np.sqrt(surface.shape[1] / VERTICES_A_CELL), 1, CELLS))
    side = max(float((plane.max(1)[:, None] - least).max()), 1e-9) / cells
    column, row = np.floor((places - least) / side).astype(np.int32)
    inside = (column >= 0) & (column < cells) & (row >= 0) & (row < cells)
    cell = np.where(inside, row * cells + column, 0)
    # Only the cells that hold a landmark matter, and few vertices lie in them
    has_landmark = np.zeros(cells * cells, dtype=np.bool_)
    has_landmark[cell] = True
    columns, rows = np.minimum(((plane - least) / side).astype(np.int32), cells - 1)
    cell_of_vertex = rows * cells + columns
    before = np.flatnonzero(has_landmark.take(cell_of_vertex))
    nearest = np.full(cells * cells, np.inf)
    np.minimum.at(nearest, cell_of_vertex[before], surface[2, before])
    behind = points[2] - nearest[cell]
    hidden: NDArray[np.bool_] = inside & (behind > BEFORE)
    if hidden.any():
        flesh = depths_in_flesh(landmarks[hidden], vertices)
        hidden[hidden] = behind[hidden] > BEFORE + flesh
    return hidden


def depths_in_flesh(landmarks: Array, vertices: Array) -> Array:
    """The distances (N,) of landmarks (N, 3) from the nearest of the vertices (V, 3)."""
    # |x - v|^2 = |x|^2 - 2 x v + |v|^2
    square = (vertices * vertices).sum(1) - 2 * landmarks @ vertices.T
    least: Array = np.sqrt(np.maximum(square.min(1) + (landmarks * landmarks).sum(1), 0.0))
    return least

"""Whether a mesh's vertices are a model's, in its order: its triangles prove it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.smal.model import SmalModel


def corresponds(model: SmalModel, n_vertices: int, faces: Any) -> bool:
    """Whether a mesh has a model's vertices in the model's order.

    It does if it has as many, and if each of its triangles is one of the model's. Triangles may
    have been left out, as of a tail that was cut away, or stand in another order.

    Args:
        model: the model.
        n_vertices: how many vertices the mesh has.
        faces: (F, 3) tensor of its triangles, counter-clockwise seen from outside.

    Example:
        >>> from animal3dbox.smal import load_quadruped
        >>> model = load_quadruped()
        >>> corresponds(model, model.vertex_count, model.without_tail_faces().flip(0))
        True
        >>> corresponds(model, model.vertex_count, model.faces + 1)
        False
    """
    triangles = as_numpy(faces)
    if n_vertices != model.vertex_count or not len(triangles):
        return False
    if triangles.min() < 0 or triangles.max() >= n_vertices:
        return False
    own = _keys(as_numpy(model.faces), n_vertices)
    return bool(np.isin(_keys(triangles, n_vertices), own).all())


def _keys(faces: NDArray[np.integer[Any]], n_vertices: int) -> NDArray[np.int64]:
    """One number (F,) a triangle, the same whichever of its corners comes first."""
    first = faces.argmin(1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1).astype(np.int64)
    keys: NDArray[np.int64] = (turned[:, 0] * n_vertices + turned[:, 1]) * n_vertices + turned[:, 2]
    return keys

"""Vertices that no face uses: they are no part of a body's surface, and count for nothing.

Meshes come with them when faces were cut away (a tail that a fit got wrong) or by a slip of an
exporter. A box, a silhouette or a hull that took them in would be of points that nobody can see.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import AnyArray
from animal3dbox.labels.body import Body


@dataclass(frozen=True)
class Surface:
    """A body without its loose vertices.

    Attributes:
        body: vertices (V', 3) that some face uses, in their order; faces renumbered.
        vertex_ids: (V',) the number that each had before; None if none was loose.
    """

    body: Body
    vertex_ids: NDArray[np.intp] | None


def without_loose_vertices(body: Body, used: NDArray[np.bool_] | None) -> Surface:
    """A checked body without the vertices that no face uses; the body itself if none is loose.

    Args:
        body: vertices (V, 3) an array, faces (F, 3) a tensor or None.
        used: (V,) see geometry.used_vertices.

    """
    if used is None or body.vertices is None:
        return Surface(body, None)
    ids = np.flatnonzero(used)
    vertices = np.asfortranarray(body.vertices[ids])
    faces = body.faces
    if faces is not None:
        new_number = torch.from_numpy(np.cumsum(used) - 1)
        faces = new_number[faces]
    return Surface(replace(body, vertices=vertices, faces=faces), ids)


def read_off_surface(
    read: Callable[[AnyArray], AnyArray], vertices: AnyArray, used: NDArray[np.bool_] | None
) -> AnyArray:
    """Landmarks (J, 3) read off the vertices that some face uses.

    A landmark that is a mean of vertices is the mean of those that are used; NaN if none is.

    Args:
        read: the landmarks (J, 3), weighted means, of vertices (V, 3).
        vertices: (V, 3).
        used: (V,) see geometry.used_vertices; None: all.

    Example:
        >>> vertices = np.array([[0.0, 0, 0], [1, 0, 0], [9, 9, 9]])
        >>> read_off_surface(lambda v: v[[0, 2]].mean(0)[None], vertices, np.arange(3) < 2)
        array([[0., 0., 0.]])
    """
    if used is None:
        return read(vertices)
    is_loose = ~used
    seen, weight = vertices + 0.0, vertices * 0.0
    seen[is_loose] = 0.0
    weight[used] = 1.0
    # 0 / 0 is NaN: no vertex of such a landmark is used
    with np.errstate(invalid="ignore"):
        landmarks: AnyArray = read(seen) / read(weight)
        return landmarks

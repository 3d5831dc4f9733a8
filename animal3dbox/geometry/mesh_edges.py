"""The edges of a mesh, and its contours: the edges that bound the mesh in a picture.

The edges are found once for all poses of one mesh.
"""

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.rasterizer_clip import ProjectedTriangles

Indices = NDArray[np.int64]
Steps = NDArray[np.int8]
KNOWN_MESHES = 8
"""How many meshes' edges are remembered: about 1 MB each, for a body of 11 700 faces."""


@dataclass(frozen=True)
class MeshEdges:
    """The edges between the triangles of a mesh.

    Where more than two triangles meet, an edge is there several times.

    Attributes:
        faces: (F, 3) int64, a copy on their own device.
        ends: (2, E) int64, the edges' first and second points.
        sides: (2, E) int64, the face whose corners run from the first point to the second, and the
            one where they run back; F where there is none.
    """

    faces: Tensor
    ends: Indices
    sides: Indices

    @cached_property
    def columns(self) -> Indices:
        """The first, second and third corners of the faces, (3, F), each in a row of its own."""
        return np.ascontiguousarray(as_numpy(self.faces).T)

    @cached_property
    def used(self) -> Indices:
        """The indices (U,) of the vertices that some face has."""
        return np.unique(self.ends)


_known: deque[MeshEdges] = deque(maxlen=KNOWN_MESHES)


def mesh_edges(faces: Tensor) -> MeshEdges:
    """The edges of faces (F, 3) int64; those of the last few meshes are remembered."""
    for known in tuple(_known):
        if known.faces.device == faces.device and torch.equal(known.faces, faces):
            return known
    edges = _edges_of(faces.detach().clone())
    _known.appendleft(edges)
    return edges


def _edges_of(faces: Tensor) -> MeshEdges:
    """The edges of faces (F, 3), found by sorting their 3 F half-edges."""
    count = len(faces)
    start, end = faces.T.flatten(), faces.T.roll(-1, 0).flatten()
    runs_back = (start > end).to(torch.int64)
    first, second = torch.minimum(start, end), torch.maximum(start, end)
    _, edge = torch.unique(
        first * (int(second.max()) + 1 if count else 1) + second, return_inverse=True
    )
    # The n-th face along an edge is paired with the n-th that runs back
    alike, order = (2 * edge + runs_back).sort(stable=True)
    turn = torch.empty_like(edge)
    turn[order] = torch.arange(3 * count, device=faces.device) - torch.searchsorted(alike, alike)
    pairs, pair = torch.unique(edge * (3 * count) + turn, return_inverse=True)
    ends = faces.new_empty(2, len(pairs))
    ends[:, pair] = torch.stack((first, second))
    sides = faces.new_full((2, len(pairs)), count)
    sides[runs_back, pair] = torch.arange(count, device=faces.device).repeat(3)
    return MeshEdges(faces, as_numpy(ends), as_numpy(sides))


def contour_edges(
    edges: MeshEdges, triangles: ProjectedTriangles[np.ndarray]
) -> tuple[Indices, Indices, Steps]:
    """The edges of a mesh's contour: all but those between two triangles that face the same way.

    Args:
        edges: of the mesh.
        triangles: its parts in front of the near plane; all edges of those that the plane cut are
            taken.

    Returns:
        Upper and lower ends, indices of points, (N,) each, and (N,) what crossing the edge from the
        left adds.

    """
    facing = np.zeros(len(edges.faces) + 1, dtype=np.int8)
    if triangles.owner is None:
        facing[:-1] = triangles.orientation
        start, end, turn = _open_edges(edges, facing)
    else:
        whole = (triangles.corners == edges.columns[:, triangles.owner]).all(0)
        facing[triangles.owner[whole]] = triangles.orientation[whole]
        pieces, turns = triangles.corners[:, ~whole], triangles.orientation[~whole].astype(np.int8)
        parts = _open_edges(edges, facing), *((pieces[k - 1], pieces[k], turns) for k in range(3))
        start, end, turn = (np.concatenate(part) for part in zip(*parts, strict=True))
    # As left sides do if the area is positive, for v is down
    rises = triangles.v.take(end) < triangles.v.take(start)
    return np.where(rises, end, start), np.where(rises, start, end), np.where(rises, turn, -turn)


def _open_edges(edges: MeshEdges, facing: Steps) -> tuple[Indices, Indices, Steps]:
    """The edges whose two faces do not cancel.

    Args:
        edges: of the mesh.
        facing: (F + 1,) the orientation of each face; 0 at the end, for edges without a face.

    Returns:
        First and second points, (N,) each, and (N,) how often the edge runs that way.

    """
    ahead, behind = facing.take(edges.sides[0]), facing.take(edges.sides[1])
    open_ = np.flatnonzero(ahead != behind)
    turn = ahead.take(open_) - behind.take(open_)
    return edges.ends[0].take(open_), edges.ends[1].take(open_), turn

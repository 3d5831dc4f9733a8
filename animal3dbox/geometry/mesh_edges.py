"""The edges of a mesh, and those of them that bound what is seen of it; worked out once for all poses of one mesh."""

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from animal3dbox.geometry.rasterizer_clip import ProjectedTriangles

KNOWN_MESHES = 8
"""Meshes whose edges are remembered: about 1 MB each, for a body of 11 700 faces."""


@dataclass(frozen=True)
class MeshEdges:
    """The edges between the triangles of a mesh; where more than two triangles meet, an edge is there several times.

    Attributes:
        faces: (F, 3) int64, a copy.
        ends: (2, E) int64, the edges' first and second points.
        sides: (2, E) int64, the face whose corners run from the first point to the second, and the one where they run back;
            F where there is none.
    """

    faces: Tensor
    ends: Tensor
    sides: Tensor

    @cached_property
    def columns(self) -> Tensor:
        """The faces' first, second and third corners, (3, F), each in a row of its own."""
        return self.faces.T.contiguous()

    @cached_property
    def used(self) -> Tensor:
        """Ids (U,) of the vertices that some face has."""
        used: Tensor = torch.unique(self.ends)
        return used


_known: deque[MeshEdges] = deque(maxlen=KNOWN_MESHES)


def mesh_edges(faces: Tensor) -> MeshEdges:
    """The edges of faces (F, 3) int64; those of the last few meshes are remembered, by what is in them."""
    for known in tuple(_known):
        if known.faces.device == faces.device and torch.equal(known.faces, faces):
            return known
    found = _edges_of(faces.detach().clone())
    _known.appendleft(found)
    return found


def _edges_of(faces: Tensor) -> MeshEdges:
    count = len(faces)
    start, end = faces.T.flatten(), faces.T.roll(-1, 0).flatten()
    runs_back = (start > end).to(torch.int64)
    first, second = torch.minimum(start, end), torch.maximum(start, end)
    _, edge = torch.unique(first * (int(second.max()) + 1 if count else 1) + second, return_inverse=True)
    # The n-th face along an edge is paired with the n-th that runs back
    alike, order = (2 * edge + runs_back).sort(stable=True)
    turn = torch.empty_like(edge)
    turn[order] = torch.arange(3 * count, device=faces.device) - torch.searchsorted(alike, alike)
    pairs, pair = torch.unique(edge * (3 * count) + turn, return_inverse=True)
    ends = faces.new_empty(2, len(pairs))
    ends[:, pair] = torch.stack((first, second))
    sides = faces.new_full((2, len(pairs)), count)
    sides[runs_back, pair] = torch.arange(count, device=faces.device).repeat(3)
    return MeshEdges(faces, ends, sides)


def contour_edges(edges: MeshEdges, triangles: ProjectedTriangles) -> tuple[Tensor, Tensor, Tensor]:
    """The edges that bound what is seen: not those between two triangles that face the same way.

    Args:
        edges: of the mesh.
        triangles: its parts in front of the near plane; all edges of those that the plane cut are taken.

    Returns:
        Upper and lower ends, indices of points, (N,) each, and (N,) what crossing the edge from the left adds.

    """
    facing = torch.zeros(len(edges.faces) + 1, dtype=torch.int8, device=edges.faces.device)
    if triangles.owner is None:
        facing[:-1] = triangles.orientation
        start, end, turn = _open_edges(edges, facing)
    else:
        whole = (triangles.corners == edges.faces.T[:, triangles.owner]).all(dim=0)
        facing[triangles.owner[whole]] = triangles.orientation[whole].to(torch.int8)
        pieces, turns = triangles.corners[:, ~whole], triangles.orientation[~whole].to(torch.int8)
        parts = _open_edges(edges, facing), *((pieces[k - 1], pieces[k], turns) for k in range(3))
        start, end, turn = (torch.cat(part) for part in zip(*parts, strict=True))
    rises = triangles.v.index_select(0, end) < triangles.v.index_select(0, start)  # as left sides do, if the area is positive: v is down
    return torch.where(rises, end, start), torch.where(rises, start, end), torch.where(rises, turn, -turn)


def _open_edges(edges: MeshEdges, facing: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """First and second points (N,) of edges whose faces do not cancel, and (N,) how often they run that way; facing is (F + 1,)."""
    turn = facing.index_select(0, edges.sides[0]) - facing.index_select(0, edges.sides[1])
    kept = torch.nonzero(turn)[:, 0]
    start, end = (points.index_select(0, kept) for points in edges.ends)
    return start, end, turn.index_select(0, kept)

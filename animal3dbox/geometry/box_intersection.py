"""The exact volume that two oriented boxes have in common.

The smaller box of a pair, in its own axes and its own half sizes, is the cube [-1, 1]^3: affine
maps keep shares of volume, so needles and flat boxes are as good as cubes. The six half-spaces of
the other box then cut this cube one after the other. A convex body is kept as its edges, one slot
for each two faces that can meet; each cut shortens the edges, and lays one new edge on every face
that it crosses. The volume is the sum over faces of distance times area (the divergence theorem),
the area from the edges' cross products.

Every crossing is computed once and used by both faces of its edge, so the surface stays closed
whatever the rounding, and rounding moves volumes by about 1e-15 of the smaller box. Summing lengths
cut from each line by all twelve planes (Lasserre's recursion) loses this: planes turned by a small
angle meet at lines known only to 1e-16 / angle, and faces that coincide are counted twice.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

CONTACT = 2.0**-46
"""A corner within this of a plane counts as inside.

1.4e-14 of the half size: above the rounding of a distance (4e-16), below anything that matters.
"""
PAIRS_AT_ONCE = 2048
"""Pairs cut in one go: about 3 kB a pair and tensor."""

BOX_AXES = (0, 0, 1, 1, 2, 2)
BOX_SIGNS = (1.0, -1.0, 1.0, -1.0, 1.0, -1.0)
"""The six planes of a box, and of the cube: + and - of each axis."""


@dataclass(frozen=True)
class HalfSizeBoxes:
    """Boxes in float64 by their half sizes, with a batch of any shape; lengths in one unit.

    Attributes:
        center: (..., 3).
        rotation: (..., 3, 3), columns are the box axes.
        half: (..., 3) half sizes.
    """

    center: Tensor
    rotation: Tensor
    half: Tensor

    def volume(self) -> Tensor:
        """The volumes (...,) of the boxes."""
        return self.half.prod(dim=-1) * 8.0

    def radius(self) -> Tensor:
        """The radii (...,) of the boxes' bounding spheres."""
        radius: Tensor = torch.linalg.vector_norm(self.half.detach(), dim=-1)
        return radius

    def in_units_of(self, unit: Tensor) -> "HalfSizeBoxes":
        """The same boxes in another unit of length, (..., 1)."""
        return HalfSizeBoxes(self.center / unit, self.rotation, self.half / unit)

    def at(self, index: Tensor) -> "HalfSizeBoxes":
        """The boxes of a flat batch at (N,) indices."""
        return HalfSizeBoxes(self.center[index], self.rotation[index], self.half[index])

    def or_else(self, keep: Tensor, other: "HalfSizeBoxes") -> "HalfSizeBoxes":
        """These boxes where keep, (N,) bool, is true, and the others elsewhere."""
        column = keep[:, None]
        return HalfSizeBoxes(
            torch.where(column, self.center, other.center),
            torch.where(column[..., None], self.rotation, other.rotation),
            torch.where(column, self.half, other.half),
        )


def intersection_volume(boxes_a: HalfSizeBoxes, boxes_b: HalfSizeBoxes) -> Tensor:
    """The volume common to each of N pairs of boxes, (N,).

    Pairs whose bounding spheres are apart cost nothing.
    """
    distance = torch.linalg.vector_norm((boxes_b.center - boxes_a.center).detach(), dim=-1)
    near = torch.nonzero(~(distance > boxes_a.radius() + boxes_b.radius()))[:, 0]
    volume = torch.zeros_like(boxes_a.center[:, 0])
    differentiated = torch.is_grad_enabled() and any(
        x.requires_grad for b in (boxes_a, boxes_b) for x in (b.center, b.rotation, b.half)
    )
    # With derivatives, an empty batch is cut too: it gives gradients of 0, where none is an error
    if near.numel() == 0 and not differentiated:
        return volume
    parts = [
        _intersection_by_cutting(boxes_a.at(index), boxes_b.at(index))
        for index in torch.split(near, PAIRS_AT_ONCE)
    ]
    return volume.index_put((near,), torch.cat(parts))


def _intersection_by_cutting(boxes_a: HalfSizeBoxes, boxes_b: HalfSizeBoxes) -> Tensor:
    """The volume common to each of N pairs, (N,), near each other or not."""
    volume_a, volume_b = boxes_a.volume(), boxes_b.volume()
    a_is_smaller = (volume_a <= volume_b).detach()
    inner, outer = boxes_a.or_else(a_is_smaller, boxes_b), boxes_b.or_else(a_is_smaller, boxes_a)
    normals, offsets = _planes_about_unit_cube(inner, outer)
    volume = _cut_cube_volume(normals, offsets) * inner.half.prod(dim=-1)
    return torch.minimum(volume.clamp(min=0.0), torch.where(a_is_smaller, volume_a, volume_b))


def _planes_about_unit_cube(inner: HalfSizeBoxes, outer: HalfSizeBoxes) -> tuple[Tensor, Tensor]:
    """The half-spaces of the outer boxes where the inner box is [-1, 1]^3.

    Args:
        inner: N boxes.
        outer: N boxes.

    Returns:
        Unit normals (6, 3, N), outward, and offsets (6, N): the box is where normal . x <= offset.

    """
    # axes[n, i, j] = (R_outer^T R_inner)[i, j] half_inner[j], rows along the outer box's axes
    cosines = (outer.rotation[..., :, None] * inner.rotation[..., :, None, :]).sum(dim=-3)
    axes = cosines * inner.half[:, None]
    # between = R_outer^T (center_outer - center_inner), (N, 3)
    between = (outer.rotation * (outer.center - inner.center)[..., None]).sum(dim=-2)
    length = torch.linalg.vector_norm(axes, dim=-1)
    signs = torch.tensor(BOX_SIGNS, dtype=axes.dtype, device=axes.device)[:, None]
    normals = (axes / length[..., None]).permute(1, 2, 0)[list(BOX_AXES)] * signs[..., None]
    offsets = (outer.half / length).T[list(BOX_AXES)] + (between / length).T[list(BOX_AXES)] * signs
    return normals, offsets


def _cube_edges() -> tuple[list[tuple[int, int]], list[list[list[float]]]]:
    """The cube's 12 edges: the two faces of each, and its ends.

    Faces are numbered as planes are. Seen from outside, the first face has the edge
    counter-clockwise, the second clockwise.
    """
    faces, ends = [], []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign_u, sign_v in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            end = [0.0, 0.0, 0.0]
            end[axis], end[u], end[v] = float(sign_u * sign_v), float(sign_u), float(sign_v)
            faces.append((2 * u + (sign_u < 0), 2 * v + (sign_v < 0)))
            ends.append([[-x if k == axis else x for k, x in enumerate(end)], end])
    return faces, ends


def _slots() -> list[list[tuple[int, int]]]:
    """The faces of every edge slot, after each number of cuts from 0 to 6.

    Faces 6 to 11 are the cuts.
    """
    slots = [_cube_edges()[0]]
    for cut in range(6):
        opposite = 6 + (cut ^ 1)
        slots.append(slots[-1] + [(face, 6 + cut) for face in range(6 + cut) if face != opposite])
    return slots


SLOTS = _slots()


def _incidence(cut: int, side: int, like: Tensor) -> Tensor:
    """Which slots lie on which face after so many cuts, (faces, slots): 1 where they do, else 0.

    Side 0 asks for each slot's first face, side 1 for its second.
    """
    table = torch.zeros(6 + cut, len(SLOTS[cut]), dtype=like.dtype)
    for slot, faces in enumerate(SLOTS[cut]):
        table[faces[side], slot] = 1.0
    return table.to(like.device)


def _cut_cube_volume(normals: Tensor, offsets: Tensor) -> Tensor:
    """The volume, (N,), of the cubes [-1, 1]^3 inside six half-spaces each.

    The half-spaces are those of _planes_about_unit_cube.
    """
    ends = torch.tensor(_cube_edges()[1], dtype=normals.dtype, device=normals.device)
    ends = ends[..., None].expand(-1, -1, -1, normals.shape[-1])
    # (3, slots, N); a slot without an edge has start = end
    start, end = ends[:, 0].transpose(0, 1), ends[:, 1].transpose(0, 1)
    for cut in range(6):
        start, end = _cut(start, end, normals[cut], offsets[cut], cut=cut)
    moment = torch.stack([start[k - 2] * end[k - 1] - start[k - 1] * end[k - 2] for k in range(3)])
    # area vector of a face = 1/2 sum over its edges of start x end, counter-clockwise
    turns = (_incidence(6, 0, normals) - _incidence(6, 1, normals)) / 2
    area = torch.einsum("fs,ksn->fkn", turns, moment)
    # volume = 1/3 sum over faces of distance . area; the cube's own faces are at distance 1
    planes = enumerate(zip(BOX_AXES, BOX_SIGNS, strict=True))
    own = torch.stack([area[face, axis] * sign for face, (axis, sign) in planes])
    return (own.sum(dim=0) + (area[6:] * normals).sum(dim=1).mul(offsets).sum(dim=0)) / 3


def _cut(
    start: Tensor, end: Tensor, normal: Tensor, offset: Tensor, *, cut: int
) -> tuple[Tensor, Tensor]:
    """The edges of bodies that one more half-space has cut.

    Args:
        start: (3, S, N) of S edge slots of N bodies.
        end: (3, S, N).
        normal: (3, N).
        offset: (N,).
        cut: number of this cut, from 0.

    Returns:
        start and end of the edges then, with the new ones behind.

    """
    # d = normal . x - offset, elementwise, not a product of matrices: copies of a corner in several
    # edges must get the same bits
    d_start, d_end = (
        x[0] * normal[0] + x[1] * normal[1] + x[2] * normal[2] - offset for x in (start, end)
    )
    start_in, end_in = d_start <= CONTACT, d_end <= CONTACT
    leaves, enters = start_in & ~end_in, ~start_in & end_in
    d_start, d_end = (
        torch.where(inside, d.clamp(max=0.0), d)
        for inside, d in ((start_in, d_start), (end_in, d_end))
    )
    # crossing = start + d_start / (d_start - d_end) (end - start)
    along = d_start / torch.where(leaves | enters, d_start - d_end, 1.0)
    crossing = torch.where(leaves | enters, start + along * (end - start), 0.0)
    # An edge with both ends outside ends at the origin twice: it is one no longer
    new_start = torch.where(start_in, start, crossing)
    new_end = torch.where(end_in, end, crossing)
    leaving, entering = crossing * leaves, crossing * enters
    first, second = _incidence(cut, 0, normal), _incidence(cut, 1, normal)
    faces = [face for face in range(6 + cut) if face != 6 + (cut ^ 1)]
    exits, entries = (
        torch.einsum("fs,ksn->kfn", first, one) + torch.einsum("fs,ksn->kfn", second, other)
        for one, other in ((leaving, entering), (entering, leaving))
    )
    new_start = torch.cat((new_start, exits[:, faces]), dim=1)
    return new_start, torch.cat((new_end, entries[:, faces]), dim=1)

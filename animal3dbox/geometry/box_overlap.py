"""Exact volume of intersection, and IoU, of oriented boxes.

The smaller box of a pair, seen in its own axes and its own half sizes, is the cube [-1, 1]^3:
affine maps keep shares of volume, so needles and flat boxes are as good as cubes. The six
half-spaces of the other box then cut this cube one after the other. A convex body is kept as its
edges, one slot for each two faces that can meet; each cut shortens the edges, and lays one new edge
on every face it crosses. The volume is the sum over faces of distance times area (the divergence
theorem), the area from the edges' cross products.

Every crossing is computed once and used by both faces of its edge, so the surface stays closed
whatever the rounding, and rounding moves volumes by about 1e-15 of the smaller box. Summing lengths
cut from each line by all twelve planes (Lasserre's recursion) loses this: planes turned by a small
angle meet at lines known only to 1e-16 / angle, and faces that coincide are counted twice. A corner
within CONTACT of a plane counts as inside.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.checks import check_finite, check_rotation, check_shape

CONTACT = (
    2.0**-46
)  # 1.4e-14 of the half size: above the rounding of a distance (4e-16), below anything that matters
PAIRS_AT_ONCE = 2048  # of the exact test: about 3 kB a pair and tensor

BOX_AXES = (0, 0, 1, 1, 2, 2)  # the planes of a box: + and - of each axis
BOX_SIGNS = (1.0, -1.0, 1.0, -1.0, 1.0, -1.0)


@dataclass(frozen=True)
class _Boxes:
    """Boxes in float64, with a batch of any shape; lengths in one unit.

    Attributes:
        center: (..., 3).
        rotation: (..., 3, 3), columns are the box axes.
        half: (..., 3) half sizes.
    """

    center: Tensor
    rotation: Tensor
    half: Tensor

    def volume(self) -> Tensor:
        """Volumes, (...)."""
        return self.half.prod(dim=-1) * 8.0

    def radius(self) -> Tensor:
        """Radii of the bounding spheres, (...)."""
        radius: Tensor = torch.linalg.vector_norm(self.half.detach(), dim=-1)
        return radius

    def at(self, index: Tensor) -> "_Boxes":
        """The boxes of a flat batch at (N,) indices."""
        return _Boxes(self.center[index], self.rotation[index], self.half[index])

    def or_else(self, keep: Tensor, other: "_Boxes") -> "_Boxes":
        """These boxes where keep, (N,) bool, is true, and the others elsewhere."""
        column = keep[:, None]
        return _Boxes(
            torch.where(column, self.center, other.center),
            torch.where(column[..., None], self.rotation, other.rotation),
            torch.where(column, self.half, other.half),
        )


def box_intersection_volume(
    center_a: Tensor,
    rotation_a: Tensor,
    size_a: Tensor,
    center_b: Tensor,
    rotation_b: Tensor,
    size_b: Tensor,
) -> Tensor:
    """Volume common to two oriented boxes, exact, differentiable.

    Where boxes touch or coincide the gradient is one of the one-sided ones: finite always.

    Args:
        center_a: (..., 3), in any one frame and unit, as everything here; the batches broadcast.
        rotation_a: (..., 3, 3), columns are the box axes, det +1.
        size_a: (..., 3) full lengths along these axes, positive.
        center_b: (..., 3).
        rotation_b: (..., 3, 3).
        size_b: (..., 3).

    Returns:
        (...) in the unit cubed; computed in float64, returned in the dtype that the arguments
        promote to.

    Raises:
        ShapeError: an argument has the wrong shape, a NaN, a size <= 0, or no rotation to 1e-6.

    """
    boxes_a, boxes_b, shape, dtype = _pairs(
        center_a, rotation_a, size_a, center_b, rotation_b, size_b
    )
    return _intersection(boxes_a, boxes_b).reshape(shape).to(dtype)


def box_iou(
    center_a: Tensor,
    rotation_a: Tensor,
    size_a: Tensor,
    center_b: Tensor,
    rotation_b: Tensor,
    size_b: Tensor,
) -> Tensor:
    """Intersection over union of two oriented boxes by volume, (...) in [0, 1].

    Arguments as in box_intersection_volume.
    """
    boxes_a, boxes_b, shape, dtype = _pairs(
        center_a, rotation_a, size_a, center_b, rotation_b, size_b
    )
    return _iou(boxes_a, boxes_b).reshape(shape).to(dtype)


def pairwise_box_iou(
    center_a: Tensor,
    rotation_a: Tensor,
    size_a: Tensor,
    center_b: Tensor,
    rotation_b: Tensor,
    size_b: Tensor,
) -> Tensor:
    """IoU of every box of one set with every box of another.

    Args:
        center_a: (N, 3).
        rotation_a: (N, 3, 3).
        size_a: (N, 3).
        center_b: (M, 3).
        rotation_b: (M, 3, 3).
        size_b: (M, 3).

    Returns:
        (N, M).

    """
    for name, tensor, spec in (
        ("center_a", center_a, "N 3"),
        ("rotation_a", rotation_a, "N 3 3"),
        ("size_a", size_a, "N 3"),
    ):
        check_shape(name, tensor, spec)
    for name, tensor, spec in (
        ("center_b", center_b, "M 3"),
        ("rotation_b", rotation_b, "M 3 3"),
        ("size_b", size_b, "M 3"),
    ):
        check_shape(name, tensor, spec)
    return box_iou(
        center_a[:, None], rotation_a[:, None], size_a[:, None], center_b, rotation_b, size_b
    )


def _pairs(
    center_a: Tensor,
    rotation_a: Tensor,
    size_a: Tensor,
    center_b: Tensor,
    rotation_b: Tensor,
    size_b: Tensor,
) -> tuple[_Boxes, _Boxes, torch.Size, torch.dtype]:
    """Two flat batches of boxes of equal length, the shape of the answer, and its dtype."""
    boxes_a, boxes_b = (
        _checked("a", center_a, rotation_a, size_a),
        _checked("b", center_b, rotation_b, size_b),
    )
    fields = (
        boxes_a.center,
        boxes_a.rotation[..., 0],
        boxes_a.half,
        boxes_b.center,
        boxes_b.rotation[..., 0],
        boxes_b.half,
    )
    try:
        shape = torch.Size(np.broadcast_shapes(*(tuple(field.shape[:-1]) for field in fields)))
    except ValueError as error:
        shapes = ", ".join(
            str(tuple(tensor.shape))
            for tensor in (center_a, rotation_a, size_a, center_b, rotation_b, size_b)
        )
        raise ShapeError(
            "center_a, rotation_a, size_a, center_b, rotation_b, size_b must broadcast, got"
            f" {shapes}"
        ) from error
    dtype = torch.result_type(center_a, center_b)
    for tensor in (rotation_a, size_a, rotation_b, size_b):
        dtype = torch.promote_types(dtype, tensor.dtype)
    if not dtype.is_floating_point:
        dtype = torch.float64
    return _flat(boxes_a, shape), _flat(boxes_b, shape), shape, dtype


def _checked(which: str, center: Tensor, rotation: Tensor, size: Tensor) -> _Boxes:
    """Boxes in float64 from arguments named ``center_a`` ... or ``center_b`` ...."""
    check_shape(f"center_{which}", center, "... 3")
    check_shape(f"size_{which}", size, "... 3")
    center, rotation, size = center.double(), rotation.double(), size.double()
    check_finite(f"center_{which}", center)
    check_finite(f"size_{which}", size)
    check_rotation(f"rotation_{which}", rotation.detach(), tolerance=1e-6)
    if size.numel() and float(size.detach().amin()) <= 0:
        raise ShapeError(f"size_{which} must be positive, got {float(size.detach().amin()):.3g}")
    # One Newton step to the nearest rotation: one stored in float32 is off by 1e-7, and would make
    # a skewed box
    rotation = 1.5 * rotation - 0.5 * rotation @ (rotation.mT @ rotation)
    return _Boxes(center, rotation, size / 2)


def _flat(boxes: _Boxes, shape: torch.Size) -> _Boxes:
    """Boxes broadcast to a batch of this shape, which is then flattened."""
    return _Boxes(
        boxes.center.expand(*shape, 3).reshape(-1, 3),
        boxes.rotation.expand(*shape, 3, 3).reshape(-1, 3, 3),
        boxes.half.expand(*shape, 3).reshape(-1, 3),
    )


def _iou(boxes_a: _Boxes, boxes_b: _Boxes) -> Tensor:
    """IoU of N pairs, (N,), in units of each pair's greatest half size: no volume overflows."""
    unit = torch.maximum(boxes_a.half, boxes_b.half).detach().amax(dim=-1, keepdim=True)
    boxes_a, boxes_b = (
        _Boxes(boxes.center / unit, boxes.rotation, boxes.half / unit)
        for boxes in (boxes_a, boxes_b)
    )
    volume = _intersection(boxes_a, boxes_b)
    return volume / (boxes_a.volume() + boxes_b.volume() - volume)


def _intersection(boxes_a: _Boxes, boxes_b: _Boxes) -> Tensor:
    """Volume common to each of N pairs, (N,).

    Pairs whose bounding spheres are apart cost nothing.
    """
    apart = (
        torch.linalg.vector_norm((boxes_b.center - boxes_a.center).detach(), dim=-1)
        > boxes_a.radius() + boxes_b.radius()
    )
    near = torch.nonzero(~apart)[:, 0]
    volume = torch.zeros_like(boxes_a.center[:, 0])
    differentiated = torch.is_grad_enabled() and any(
        x.requires_grad for b in (boxes_a, boxes_b) for x in (b.center, b.rotation, b.half)
    )
    if (
        near.numel() == 0 and not differentiated
    ):  # else the empty batch below gives gradients of 0, where none would be an error
        return volume
    exact = torch.cat(
        [
            _exact_intersection(boxes_a.at(index), boxes_b.at(index))
            for index in torch.split(near, PAIRS_AT_ONCE)
        ]
    )
    return volume.index_put((near,), exact)


def _exact_intersection(boxes_a: _Boxes, boxes_b: _Boxes) -> Tensor:
    """Volume common to each of N pairs, (N,), with no regard to its cost."""
    volume_a, volume_b = boxes_a.volume(), boxes_b.volume()
    a_is_smaller = (volume_a <= volume_b).detach()
    inner, outer = boxes_a.or_else(a_is_smaller, boxes_b), boxes_b.or_else(a_is_smaller, boxes_a)
    normals, offsets = _planes_about_unit_cube(inner, outer)
    volume = _cut_cube_volume(normals, offsets) * inner.half.prod(dim=-1)
    return torch.minimum(volume.clamp(min=0.0), torch.where(a_is_smaller, volume_a, volume_b))


def _planes_about_unit_cube(inner: _Boxes, outer: _Boxes) -> tuple[Tensor, Tensor]:
    """The half-spaces of the outer boxes where the inner box is [-1, 1]^3.

    Args:
        inner: N boxes.
        outer: N boxes.

    Returns:
        Unit normals (6, 3, N), outward, and offsets (6, N): the box is where normal . x <= offset.

    """
    axes = (outer.rotation[..., :, None] * inner.rotation[..., :, None, :]).sum(
        dim=-3
    ) * inner.half[:, None]  # (N, 3 outer, 3 inner)
    between = (outer.rotation * (outer.center - inner.center)[..., None]).sum(
        dim=-2
    )  # (N, 3) along the outer axes
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
    """(faces, slots) 1 where a slot's first (side 0) or second (side 1) face is this one, after so
    many cuts."""
    table = torch.zeros(6 + cut, len(SLOTS[cut]), dtype=like.dtype)
    for slot, faces in enumerate(SLOTS[cut]):
        table[faces[side], slot] = 1.0
    return table.to(like.device)


def _cut_cube_volume(normals: Tensor, offsets: Tensor) -> Tensor:
    """Volume, (N,), of the cubes [-1, 1]^3 inside six half-spaces, given as _planes_about_unit_cube
    returns them."""
    ends = torch.tensor(_cube_edges()[1], dtype=normals.dtype, device=normals.device)[
        ..., None
    ].expand(-1, -1, -1, normals.shape[-1])
    start, end = (
        ends[:, 0].transpose(0, 1),
        ends[:, 1].transpose(0, 1),
    )  # (3, slots, N); a slot without an edge has start = end
    for cut in range(6):
        start, end = _cut(start, end, normals[cut], offsets[cut], cut)
    moment = torch.stack([start[k - 2] * end[k - 1] - start[k - 1] * end[k - 2] for k in range(3)])
    area = torch.einsum(
        "fs,ksn->fkn", (_incidence(6, 0, normals) - _incidence(6, 1, normals)) / 2, moment
    )
    own = torch.stack(
        [
            area[face, axis] * sign
            for face, (axis, sign) in enumerate(zip(BOX_AXES, BOX_SIGNS, strict=True))
        ]
    )
    return (own.sum(dim=0) + (area[6:] * normals).sum(dim=1).mul(offsets).sum(dim=0)) / 3


def _cut(
    start: Tensor, end: Tensor, normal: Tensor, offset: Tensor, cut: int
) -> tuple[Tensor, Tensor]:
    """The edges of bodies cut by one more half-space.

    Args:
        start: (3, S, N) of S edge slots of N bodies.
        end: (3, S, N).
        normal: (3, N).
        offset: (N,).
        cut: number of this cut, from 0.

    Returns:
        start and end of the edges then, with the new ones behind.

    """
    # Elementwise, not a product of matrices: copies of a corner in several edges must get the same
    # bits
    d_start, d_end = (
        x[0] * normal[0] + x[1] * normal[1] + x[2] * normal[2] - offset for x in (start, end)
    )
    start_in, end_in = d_start <= CONTACT, d_end <= CONTACT
    leaves, enters = start_in & ~end_in, ~start_in & end_in
    d_start, d_end = (
        torch.where(inside, d.clamp(max=0.0), d)
        for inside, d in ((start_in, d_start), (end_in, d_end))
    )
    along = d_start / torch.where(leaves | enters, d_start - d_end, 1.0)
    crossing = torch.where(leaves | enters, start + along * (end - start), 0.0)
    new_start = torch.where(
        start_in, start, crossing
    )  # both ends outside: both at the origin, an edge no longer
    new_end = torch.where(end_in, end, crossing)
    leaving, entering = crossing * leaves, crossing * enters
    first, second = _incidence(cut, 0, normal), _incidence(cut, 1, normal)
    faces = [face for face in range(6 + cut) if face != 6 + (cut ^ 1)]
    exits = (
        torch.einsum("fs,ksn->kfn", first, leaving) + torch.einsum("fs,ksn->kfn", second, entering)
    )[:, faces]
    entries = (
        torch.einsum("fs,ksn->kfn", first, entering) + torch.einsum("fs,ksn->kfn", second, leaving)
    )[:, faces]
    return torch.cat((new_start, exits), dim=1), torch.cat((new_end, entries), dim=1)

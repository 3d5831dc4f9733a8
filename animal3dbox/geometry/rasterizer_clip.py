"""Triangles cut at the near plane and put into the image, ready to be filled row by row."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite

import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.checks import check_finite, check_image_hw, check_intrinsics, check_shape

NEAR_SHARE = 1e-6  # of the greatest depth: the near plane if none is given
ROWS_AT_ONCE = 1 << 20  # crossings or pixels made at a time: what bounds the memory, at about 100 bytes each


@dataclass(frozen=True)
class ProjectedTriangles:
    """The parts of triangles in front of the near plane, in the image plane.

    Attributes:
        u: (P,) float64, pixels.
        v: (P,) float64, pixels.
        corners: (3, T) int64, the points at the first, second and third corner of each triangle.
        owner: (T,) int64, the face that each triangle is a part of, ascending; None: triangle t is face t.
        orientation: (T,) float64, sign of the area with u right and v down: -1 where a face with its corners counter-clockwise
            outside is seen from outside; 0 without area, and where culled.

    """

    u: Tensor
    v: Tensor
    corners: Tensor
    owner: Tensor | None
    orientation: Tensor


def check_mesh(vertices_cam: Tensor, faces: Tensor, K: Tensor, image_hw: tuple[int, int], near: float | None) -> None:
    """Raise a ShapeError naming the argument unless all of them can be rasterised."""
    check_shape("vertices_cam", vertices_cam, "V 3")
    check_shape("faces", faces, "F 3")
    check_shape("K", K, "3 3")
    check_finite("vertices_cam", vertices_cam)
    check_intrinsics("K", K.double())
    check_image_hw("image_hw", image_hw)
    if faces.dtype not in (torch.int64, torch.int32):
        raise ShapeError(f"faces must be whole numbers in int64, got {faces.dtype}")
    if faces.numel():
        least, greatest = torch.aminmax(faces)
        if int(least) < 0 or int(greatest) >= len(vertices_cam):
            raise ShapeError(f"faces must index {len(vertices_cam)} vertices, got indices from {int(least)} to {int(greatest)}")
    if near is not None and not (near > 0 and isfinite(near)):
        raise ShapeError(f"near must be a depth > 0, got {near}")


def project_triangles(vertices_cam: Tensor, faces: Tensor, K: Tensor, near: float | None, cull_backfaces: bool) -> ProjectedTriangles:
    """Clip triangles to depth >= near, and project them.

    Args:
        vertices_cam: (V, 3) float64.
        faces: (F, 3) int64.
        K: (3, 3) float64.
        near: depth of the near plane; None: NEAR_SHARE of the greatest depth.
        cull_backfaces: give triangles seen from behind the orientation 0.

    Returns:
        At most two triangles a face.

    """
    least, greatest = (float(value) for value in torch.aminmax(vertices_cam[:, 2])) if len(vertices_cam) else (0.0, 0.0)
    near = max(greatest, 0.0) * NEAR_SHARE if near is None else near
    owner = None
    if least < near or not least > 0:
        vertices_cam, faces, owner = _clip_near(vertices_cam, faces, near)
    u, v = ((K[:2] @ vertices_cam.T) / vertices_cam[:, 2]).unbind(dim=0)
    # Columns and index_select, not rows and [...]: half of the time of a silhouette
    corners = torch.stack(faces.unbind(dim=1))
    (u_a, v_a), (u_b, v_b), (u_c, v_c) = ((u.index_select(0, corner), v.index_select(0, corner)) for corner in corners.unbind(dim=0))
    area = u_b.sub_(u_a).mul_(v_c.sub_(v_a)).sub_(u_c.sub_(u_a).mul_(v_b.sub_(v_a)))
    if cull_backfaces:
        area = area.clamp(max=0.0)
    return ProjectedTriangles(u, v, corners, owner, area.sign())


def _clip_near(vertices_cam: Tensor, faces: Tensor, near: float) -> tuple[Tensor, Tensor, Tensor]:
    """Cut a mesh at the near plane.

    Args:
        vertices_cam: (V, 3).
        faces: (F, 3).
        near: depth of the plane, positive unless nothing is in front of the camera.

    Returns:
        vertices_cam: (V + N, 3), old and new; those behind the plane stand at (0, 0, 1) and are in no face.
        faces: (T, 3) in front of the plane.
        owner: (T,) the face each is a part of, ascending.

    """
    front = (vertices_cam[:, 2] >= near) & (vertices_cam[:, 2] > 0)
    count = front[faces].sum(dim=1)
    one, two, whole = (torch.nonzero(count == n)[:, 0] for n in (1, 2, 3))
    # The odd corner out is put first, which keeps the winding
    lone = _lead_with(faces[one], front[faces[one]])
    pair = _lead_with(faces[two], ~front[faces[two]])
    start = len(vertices_cam)
    new_one = start + torch.arange(2 * len(one), device=faces.device).reshape(2, -1)
    new_two = start + 2 * len(one) + torch.arange(2 * len(two), device=faces.device).reshape(2, -1)
    inside = torch.cat((lone[:, 0], lone[:, 0], pair[:, 1], pair[:, 2]))
    outside = torch.cat((lone[:, 1], lone[:, 2], pair[:, 0], pair[:, 0]))
    tip = torch.stack((lone[:, 0], new_one[0], new_one[1]), dim=1)
    first = torch.stack((new_two[0], pair[:, 1], pair[:, 2]), dim=1)
    second = torch.stack((new_two[0], pair[:, 2], new_two[1]), dim=1)
    owner, order = torch.cat((whole, one, two, two)).sort(stable=True)
    clipped = torch.cat((faces[whole], tip, first, second))[order]
    # From the corner in front to the one behind, whatever the face: neighbours cut their edge at the same bits
    a, b = vertices_cam[inside], vertices_cam[outside]
    share = (a[:, 2:] - near) / (a[:, 2:] - b[:, 2:])
    new = torch.cat(((a + share * (b - a))[:, :2], torch.full_like(share, near)), dim=1)
    unused = vertices_cam.new_tensor((0.0, 0.0, 1.0))
    return torch.cat((torch.where(front[:, None], vertices_cam, unused), new)), clipped, owner


def _lead_with(faces: Tensor, chosen: Tensor) -> Tensor:
    """Faces (N, 3) turned so that each one's one chosen corner, (N, 3) bool, comes first."""
    first = chosen.to(torch.int64).argmax(dim=1, keepdim=True)
    return faces.gather(1, (first + torch.arange(3, device=faces.device)) % 3)


def runs_at_once(counts: Tensor, limit: int) -> Iterator[tuple[int, int]]:
    """Split a list of (N,) counts into runs [first, last) whose sums stay under the limit, or of one each."""
    total = torch.cumsum(counts, dim=0)
    if len(counts) == 0 or int(total[-1]) <= limit:
        yield 0, len(counts)
        return
    first, done = 0, 0
    while first < len(counts):
        last = max(int(torch.searchsorted(total, done + limit, right=True)), first + 1)
        yield first, last
        first, done = last, int(total[last - 1])


def expand(counts: Tensor) -> tuple[Tensor, Tensor]:
    """For (N,) counts: which of the N each unit belongs to, and its number within, both (sum of counts,)."""
    index = torch.repeat_interleave(counts)
    begin = torch.cumsum(counts, dim=0) - counts
    return index, torch.arange(len(index), device=counts.device) - begin.index_select(0, index)

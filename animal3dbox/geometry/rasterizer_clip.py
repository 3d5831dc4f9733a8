"""Triangles cut at the near plane and put into the image, ready to be filled row by row."""

from dataclasses import dataclass
from math import isfinite
from typing import Generic

import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import AnyArray, namespace, take
from animal3dbox.geometry.checks import check_finite, check_image_hw, check_intrinsics, check_shape

NEAR_SHARE = 1e-6
"""The near plane if none is given, as a share of the greatest depth."""


@dataclass(frozen=True)
class ProjectedTriangles(Generic[AnyArray]):
    """The parts of triangles in front of the near plane, in the image plane.

    Attributes:
        u: (P,) float64, pixels.
        v: (P,) float64, pixels.
        corners: (3, T) int64, the points at the first, second and third corner of each triangle.
        owner: (T,) int64, the face that each triangle is a part of, ascending; None: triangle t is
            face t.
        orientation: (T,) float64, sign of the area with u right and v down: -1 where a face with
            its corners counter-clockwise outside is seen from outside; 0 without area, and where
            culled.

    """

    u: AnyArray
    v: AnyArray
    corners: AnyArray
    owner: AnyArray | None
    orientation: AnyArray


def check_mesh(
    vertices_cam: Tensor,
    faces: Tensor,
    K: Tensor,
    image_hw: tuple[int, int],
    *,
    near: float | None,
) -> None:
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
            raise ShapeError(
                f"faces must index {len(vertices_cam)} vertices, got indices from {int(least)} to"
                f" {int(greatest)}"
            )
    if near is not None and not (near > 0 and isfinite(near)):
        raise ShapeError(f"near must be a depth > 0, got {near}")


def project_triangles(
    vertices_cam: AnyArray,
    corners: AnyArray,
    K: AnyArray,
    *,
    near: float | None,
    cull_backfaces: bool,
) -> ProjectedTriangles[AnyArray]:
    """Clip triangles to depth >= near, and project them to the image plane.

    Args:
        vertices_cam: (V, 3) float64.
        corners: (3, F) int64, the first, second and third corner of each face: columns are read
            much faster than rows.
        K: (3, 3) float64.
        near: depth of the near plane; None: NEAR_SHARE of the greatest depth.
        cull_backfaces: give triangles seen from behind the orientation 0.

    Returns:
        At most two triangles a face.

    """
    least = greatest = 0.0
    if len(vertices_cam):
        least, greatest = float(vertices_cam[:, 2].min()), float(vertices_cam[:, 2].max())
    near = max(greatest, 0.0) * NEAR_SHARE if near is None else near
    owner = None
    if least < near or not least > 0:
        vertices_cam, corners, owner = _cut(vertices_cam, corners, near)
    u, v = _projected(vertices_cam, K)
    # In place, for all faces at once: 2 area = (u_b - u_a) (v_c - v_a) - (u_c - u_a) (v_b - v_a)
    (u_a, v_a), (u_b, v_b), (u_c, v_c) = ((take(u, corner), take(v, corner)) for corner in corners)
    for coordinate, start in ((u_b, u_a), (v_b, v_a), (u_c, u_a), (v_c, v_a)):
        coordinate -= start
    u_b *= v_c
    u_c *= v_b
    u_b -= u_c
    orientation = namespace(u).sign(u_b)
    if cull_backfaces:
        orientation = orientation * (orientation < 0)
    return ProjectedTriangles(u=u, v=v, corners=corners, owner=owner, orientation=orientation)


def _projected(vertices_cam: AnyArray, K: AnyArray) -> tuple[AnyArray, AnyArray]:
    """The pixels u and v (V,) of vertices (V, 3)."""
    # u = fx x / z + skew y / z + cx, v = fy y / z + cy
    (fx, skew, cx), (_, fy, cy), _ = K.tolist()
    x, y, z = vertices_cam.T
    u, v = x / z, y / z
    u *= fx
    u += v * skew + cx if skew else cx
    v *= fy
    v += cy
    return u, v


def _cut(
    vertices_cam: AnyArray, corners: AnyArray, near: float
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Cut faces by their corners (3, F) at the near plane, arrays or tensors; see _clip_near."""
    if isinstance(vertices_cam, Tensor):
        points, faces, owner = _clip_near(vertices_cam, corners.T, near)
        return points, faces.T.contiguous(), owner
    points, faces, owner = _clip_near(
        torch.from_numpy(vertices_cam), torch.from_numpy(corners).T, near
    )
    return points.numpy(), faces.T.contiguous().numpy(), owner.numpy()


def _clip_near(vertices_cam: Tensor, faces: Tensor, near: float) -> tuple[Tensor, Tensor, Tensor]:
    """Cut a mesh at the near plane.

    Args:
        vertices_cam: (V, 3).
        faces: (F, 3).
        near: depth of the plane, positive unless nothing is in front of the camera.

    Returns:
        vertices_cam: (V + N, 3), old and new; those behind the plane stand at (0, 0, 1) and are in
            no face.
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
    # From the corner in front to the one behind, whatever the face, so that neighbours cut their
    # edge at the same bits: a + (z_a - near) / (z_a - z_b) (b - a)
    a, b = vertices_cam[inside], vertices_cam[outside]
    share = (a[:, 2:] - near) / (a[:, 2:] - b[:, 2:])
    new = torch.cat(((a + share * (b - a))[:, :2], torch.full_like(share, near)), dim=1)
    unused = vertices_cam.new_tensor((0.0, 0.0, 1.0))
    return torch.cat((torch.where(front[:, None], vertices_cam, unused), new)), clipped, owner


def _lead_with(faces: Tensor, chosen: Tensor) -> Tensor:
    """Faces (N, 3) turned so that each one's one chosen corner, (N, 3) bool, comes first."""
    first = chosen.to(torch.int64).argmax(dim=1, keepdim=True)
    return faces.gather(1, (first + torch.arange(3, device=faces.device)) % 3)

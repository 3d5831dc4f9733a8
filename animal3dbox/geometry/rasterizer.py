"""Rasterisation of meshes: which pixels a mesh covers, and which face is nearest at each.

Silhouettes in NumPy, z-buffers in plain torch.

Pixel centres sit at whole numbers. A triangle covers the centres (u, v) with v_least <= v <
v_greatest that lie on or right of its left side and strictly left of its right side: of centres
exactly on the boundary, those of top and left edges count, and those of bottom and right edges do
not. The place where an edge crosses a row of pixel centres is computed from the upper to the lower
end, whichever triangle asks, so neighbours leave no gap and share no pixel.

The silhouette uses that this place does not depend on the triangle: along each row, a triangle adds
+1 where its left edge crosses and -1 at its right one, and pixels are covered where the running sum
is positive. An edge between two triangles that face the same way adds nothing in all, so only the
mesh's contours are ever drawn (mesh_edges.py).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.mesh_edges import contour_edges, mesh_edges
from animal3dbox.geometry.rasterizer_clip import ProjectedTriangles, check_mesh, project_triangles
from animal3dbox.geometry.rasterizer_rows import (
    ROWS_AT_ONCE,
    Sides,
    expand,
    runs_at_once,
    sides_between,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Raster:
    """The nearest face of a mesh at each pixel centre.

    Attributes:
        face_index: (H, W) int64, the nearest face (of equally near ones the lowest index), -1 for
            background.
        depth: (H, W) along the optical axis, inf for background.
        barycentric: (H, W, 3) weights of that face's corners, of the point on the whole face in 3D,
            also if the near plane cut it; 0 for background.

    Example:
        >>> triangle = torch.tensor([[-1.0, -1, 2], [1, -1, 2], [-1, 1, 2]], dtype=torch.float64)
        >>> K = torch.tensor([[2.0, 0, 1], [0, 2, 1], [0, 0, 1]], dtype=torch.float64)
        >>> raster = rasterize(triangle, torch.tensor([[0, 1, 2]]), K, (3, 3))
        >>> raster.depth[0].tolist(), raster.barycentric[0, 0].tolist()
        ([2.0, 2.0, inf], [1.0, 0.0, 0.0])
    """

    face_index: Tensor
    depth: Tensor
    barycentric: Tensor


def silhouette(
    vertices_cam: Tensor,
    faces: Tensor,
    K: Tensor,
    image_hw: tuple[int, int],
    *,
    near: float | None = None,
    cull_backfaces: bool = False,
) -> Tensor:
    """The silhouette of a mesh: the pixels whose centre any triangle covers.

    Args:
        vertices_cam: (V, 3) camera frame, any unit.
        faces: (F, 3) int64.
        K: (3, 3) intrinsics in pixels; skew allowed.
        image_hw: height and width.
        near: depth at which triangles are cut, in that unit; None: 1e-6 of the greatest depth.
        cull_backfaces: leave out faces whose corners turn clockwise as seen from the camera.

    Returns:
        (H, W) bool, the same as rasterize(...).face_index >= 0.

    Raises:
        ShapeError: an argument has the wrong shape or values; names it.

    Example:
        >>> triangle = torch.tensor([[-1.0, -1, 2], [1, -1, 2], [-1, 1, 2]])
        >>> K = torch.tensor([[2.0, 0, 1], [0, 2, 1], [0, 0, 1]])
        >>> silhouette(triangle, torch.tensor([[0, 1, 2]]), K, (3, 3)).int().tolist()
        [[1, 1, 0], [1, 0, 0], [0, 0, 0]]
    """
    check_mesh(vertices_cam, faces, K, image_hw, near=near)
    part, place = covered_part(
        as_numpy(vertices_cam.double()),
        faces.long(),
        as_numpy(K.double()),
        image_hw,
        near=near,
        cull_backfaces=cull_backfaces,
    )
    covered = torch.zeros(*(int(side) for side in image_hw), dtype=torch.bool)
    covered[place] = torch.from_numpy(part)
    return covered.to(faces.device)


def covered_part(
    vertices_cam: Array,
    faces: Tensor,
    K: Array,
    image_hw: tuple[int, int],
    *,
    near: float | None = None,
    cull_backfaces: bool = False,
) -> tuple[NDArray[np.bool_], tuple[slice, slice]]:
    """The smallest part of a silhouette that holds all covered pixels, and its place in the image.

    On the host whatever the faces' device: the contour is about a thousand edges, too few for a
    GPU. Arguments as silhouette's, float64, and not checked.

    Returns:
        covered: (h, w).
        place: the rows and columns of the image that these are.

    """
    height, width = (int(side) for side in image_hw)
    edges = mesh_edges(faces)
    with np.errstate(all="ignore"):  # an edge along a row has no slope, and meets no row
        triangles = project_triangles(
            vertices_cam, edges.columns, K, near=near, cull_backfaces=cull_backfaces
        )
        upper, lower, step = contour_edges(edges, triangles)
        sides = sides_between(triangles.u, triangles.v, upper, lower, height=height)
        with_rows = np.flatnonzero(sides.rows)
        sides = Sides(
            sides.first_row.take(with_rows),
            sides.rows.take(with_rows),
            sides.first_u.take(with_rows),
            sides.slope.take(with_rows),
        )
    return _filled(sides, step.take(with_rows), width)


def _filled(
    sides: Sides[np.ndarray], step: NDArray[np.int8], width: int
) -> tuple[NDArray[np.bool_], tuple[slice, slice]]:
    """The pixels between sides, and their place in the image; see covered_part.

    Args:
        sides: N of them, each of which meets a row.
        step: (N,) what crossing a side from the left adds; a pixel is covered where the sum is
            positive.
        width: of the image.

    """
    if not len(step):
        return np.zeros((0, 0), dtype=np.bool_), (slice(0), slice(0))
    last_u = sides.first_u + (sides.rows - 1) * sides.slope
    least, greatest = min(sides.first_u.min(), last_u.min()), max(sides.first_u.max(), last_u.max())
    left, right = (ceil(min(max(u, 0.0), width)) for u in (least, greatest))
    top, bottom = int(sides.first_row.min()), int((sides.first_row + sides.rows).max())
    across = right - left
    steps, step = np.zeros((bottom - top) * across + 1, dtype=np.int32), step.astype(np.int32)
    for first, last in runs_at_once(sides.rows, ROWS_AT_ONCE):
        side, down = expand(sides.rows[first:last])
        side += first
        row = sides.first_row.take(side) + down
        np.add.at(
            steps, (row - top) * across + (sides.columns(side, down, width) - left), step.take(side)
        )
    # A row's steps add up to nothing, so the sum need not start anew, and a step right of the part
    # may stand in the next row
    covered = np.cumsum(steps, dtype=np.int32, out=steps) > 0
    return covered[:-1].reshape(bottom - top, across), (slice(top, bottom), slice(left, right))


def rasterize(
    vertices_cam: Tensor,
    faces: Tensor,
    K: Tensor,
    image_hw: tuple[int, int],
    *,
    near: float | None = None,
    cull_backfaces: bool = False,
) -> Raster:
    """Draw a mesh: the nearest face at every pixel centre, with its depth and the point hit.

    Arguments and errors as in silhouette.

    Returns:
        A Raster in the dtype and unit of vertices_cam; computed in float64.

    Example:
        >>> triangle = torch.tensor([[-1.0, -1, 2], [1, -1, 2], [-1, 1, 2]])
        >>> K = torch.tensor([[2.0, 0, 1], [0, 2, 1], [0, 0, 1]])
        >>> rasterize(triangle, torch.tensor([[0, 1, 2]]), K, (3, 3)).face_index.tolist()
        [[0, 0, -1], [0, -1, -1], [-1, -1, -1]]
    """
    check_mesh(vertices_cam, faces, K, image_hw, near=near)
    height, width = (int(side) for side in image_hw)
    vertices, faces, K_float64 = vertices_cam.detach().double(), faces.long(), K.detach().double()
    triangles = project_triangles(
        vertices, faces.T.contiguous(), K_float64, near=near, cull_backfaces=cull_backfaces
    )
    weights = _corner_weights(vertices, faces, K_float64)
    planes = _face_planes(weights, vertices, faces)
    depth = torch.full((height * width,), torch.inf, dtype=torch.float64, device=faces.device)
    nearest = torch.full((height * width,), len(faces), dtype=torch.int64, device=faces.device)
    for face, pixel in _fragments(triangles, height, width):
        z = planes.depth(face, pixel, width)
        nearer = depth.scatter_reduce(0, pixel, z, "amin")
        nearest = torch.where(nearer < depth, len(faces), nearest)
        wins = z == nearer.index_select(0, pixel)
        nearest = nearest.scatter_reduce(0, pixel[wins], face[wins], "amin")
        depth = nearer
    covered = torch.nonzero(nearest < len(faces))[:, 0]
    barycentric = torch.zeros(height * width, 3, dtype=torch.float64, device=faces.device)
    barycentric[covered] = _barycentric(weights[nearest[covered]], covered, width)
    return Raster(
        torch.where(nearest < len(faces), nearest, -1).reshape(height, width),
        depth.to(vertices_cam.dtype).reshape(height, width),
        barycentric.to(vertices_cam.dtype).reshape(height, width, 3),
    )


def _corner_weights(vertices_cam: Tensor, faces: Tensor, K: Tensor) -> Tensor:
    """Matrices (F, 3, 3) that give the weights of faces' corners at pixels.

    W[f] @ (u, v, 1) is proportional to the weights where that pixel's ray meets face f: the ray is
    r = K^-1 (u, v, 1), and the weight of corner a is r . (b x c).
    """
    a, b, c = vertices_cam[faces].unbind(dim=1)
    normals = torch.stack(
        (torch.linalg.cross(b, c), torch.linalg.cross(c, a), torch.linalg.cross(a, b)), dim=1
    )
    inverse: Tensor = torch.linalg.inv(K)
    return normals @ inverse


@dataclass(frozen=True)
class _FacePlanes:
    """The planes of faces, as their depth at pixels: 1 / depth = a u + b v + c.

    Attributes:
        inverse_depth: a, b, c, (F,) each.
        least: (F,) depth of the nearest corner, not behind the camera.
        greatest: (F,) of the farthest.

    """

    inverse_depth: tuple[Tensor, Tensor, Tensor]
    least: Tensor
    greatest: Tensor

    def depth(self, face: Tensor, pixel: Tensor, width: int) -> Tensor:
        """The depths (N,) of (N,) faces at (N,) flat indices of pixels."""
        a, b, c = (plane.index_select(0, face) for plane in self.inverse_depth)
        z = 1.0 / (a * (pixel % width) + b * (pixel // width) + c)
        # Of a face seen edge-on the plane says little: its corners bound it
        return torch.minimum(
            torch.maximum(z.nan_to_num(), self.least.index_select(0, face)),
            self.greatest.index_select(0, face),
        )


def _face_planes(weights: Tensor, vertices_cam: Tensor, faces: Tensor) -> _FacePlanes:
    """The planes of faces (F, 3) from their _corner_weights."""
    corners = vertices_cam[faces]
    volume = (corners[:, 0] * torch.linalg.cross(corners[:, 1], corners[:, 2])).sum(
        dim=1, keepdim=True
    )
    a, b, c = (weights.sum(dim=1) / volume).T.contiguous().unbind(dim=0)
    return _FacePlanes(
        (a, b, c), corners[..., 2].amin(dim=1).clamp(min=0.0), corners[..., 2].amax(dim=1)
    )


def _barycentric(weights: Tensor, pixel: Tensor, width: int) -> Tensor:
    """The weights (N, 3) of faces' corners at pixels that the faces cover, adding to 1.

    Args:
        weights: (N, 3, 3) of _corner_weights.
        pixel: (N,) flat indices.
        width: of the image.

    """
    u, v = (pixel % width).double()[:, None], (pixel // width).double()[:, None]
    shares = weights[..., 0] * u + weights[..., 1] * v + weights[..., 2]
    total = shares.sum(dim=1, keepdim=True)
    # Rounding on a face seen edge-on must not put the point outside of the face
    shares = torch.where(total == 0, 1.0, shares / torch.where(total == 0, 1.0, total))
    shares = shares.clamp(min=0.0, max=1.0)
    return shares / shares.sum(dim=1, keepdim=True)


def _fragments(
    triangles: ProjectedTriangles[Tensor], height: int, width: int
) -> Iterator[tuple[Tensor, Tensor]]:
    """The pixels that triangles cover, each with its face.

    Yields (N,) faces and (N,) flat indices of pixels, at most about ROWS_AT_ONCE at a time.
    """
    with_area = torch.nonzero(triangles.orientation)[:, 0]
    owner = with_area if triangles.owner is None else triangles.owner[with_area]
    corners = triangles.corners[:, with_area]
    corners = corners.gather(0, triangles.v[corners].argsort(dim=0))
    top, middle, bottom = corners.unbind(dim=0)
    long_sides, upper_sides, lower_sides = (
        sides_between(triangles.u, triangles.v, a, b, height=height)
        for a, b in ((top, bottom), (top, middle), (middle, bottom))
    )
    for first, last in runs_at_once(long_sides.rows, ROWS_AT_ONCE):
        triangle, down = expand(long_sides.rows[first:last])
        triangle = triangle + first
        below = down - upper_sides.rows[triangle]
        long_column = long_sides.columns(triangle, down, width)
        short_column = torch.where(
            below < 0,
            upper_sides.columns(triangle, down, width),
            lower_sides.columns(triangle, below, width),
        )
        column = torch.minimum(long_column, short_column)
        length = (long_column - short_column).abs()
        begin_px = (long_sides.first_row[triangle] + down) * width + column
        for begin, stop in runs_at_once(length, ROWS_AT_ONCE):
            span, right = expand(length[begin:stop])
            span = span + begin
            yield owner[triangle[span]], begin_px[span] + right

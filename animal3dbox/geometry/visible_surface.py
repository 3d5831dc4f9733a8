"""The part of a mesh that a camera really sees, side by side and vertex by vertex."""

import math

import torch
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.checks import check_rotation
from animal3dbox.geometry.frame import in_frame
from animal3dbox.geometry.rasterizer import rasterize

RESOLUTION = 192
"""Pixels along the longer side of the animal, whatever its size in the image."""
RELATIVE_GAP = 1e-6
"""Of the body's extent: a surface nearer than a vertex by less than this does not hide it."""
CELL = 2
"""Side of the cells, in pixels of the window, in which vertices and triangles meet."""
PAIRS_AT_ONCE = 1 << 18


def surface_share(
    vertices_cam: AnyArray,
    faces: Tensor,
    R_cam_box: AnyArray,
    *,
    K: AnyArray,
    image_hw: tuple[int, int],
    bent: AnyArray | None = None,
) -> AnyArray:
    """Parts of a body's visible surface by the side it faces, from a z-buffer that is fitted to it.

    Args:
        vertices_cam: (V, 3) camera frame.
        faces: (F, 3) int64, counter-clockwise seen from outside.
        R_cam_box: (3, 3) the body's axes in the camera frame.
        K: (3, 3) in px.
        image_hw: height and width; what lies outside is not seen.
        bent: (V, 3) the vertices where a lens shows them (see bent_points); None: there is no lens.

    Returns:
        (6,) in the order front, back, left, right, top, bottom; sums to 1, all 0 if nothing is
        seen. An array or a tensor, as the vertices came.

    """
    check_rotation("R_cam_box", R_cam_box)
    vertices, axes, intrinsics = (torch.as_tensor(part) for part in (vertices_cam, R_cam_box, K))
    in_picture = vertices if bent is None else torch.as_tensor(bent)
    shares = _surface_share(
        vertices, faces, R=axes, bent=in_picture, K=intrinsics, image_hw=image_hw
    )
    result: AnyArray = shares if isinstance(vertices_cam, Tensor) else shares.numpy()
    return result


def _surface_share(
    vertices: Tensor,
    faces: Tensor,
    *,
    R: Tensor,
    bent: Tensor,
    K: Tensor,
    image_hw: tuple[int, int],
) -> Tensor:
    """The shares (6,) of surface_share, in torch."""
    window = _window(bent, K, image_hw)
    if window is None:
        return torch.zeros(6, dtype=vertices.dtype)
    H_out_in, window_hw = _zoom(window)
    face_index = rasterize(bent, faces, H_out_in @ K, window_hw).face_index
    on_mesh = face_index[face_index >= 0]
    a, b, c = vertices[faces].unbind(1)
    normals = torch.linalg.cross(b - a, c - a) @ R
    axis = normals.abs().argmax(-1)
    side = 2 * axis + (normals.gather(1, axis[:, None])[:, 0] < 0)
    counts = torch.bincount(side[on_mesh], minlength=6).to(vertices.dtype)
    return counts / max(len(on_mesh), 1)


def visible_vertices(
    vertices_cam: Tensor,
    faces: Tensor,
    K: Tensor,
    image_hw: tuple[int, int],
    *,
    ids: Tensor | None = None,
) -> Tensor:
    """Which vertices the camera sees: in the frame, and with no other triangle before them; exact.

    A z-buffer would miss triangles that are smaller than its pixels (93 to 98 % right at 256 px:
    benchmarks/masks_and_visibility.py). Instead the frame is cut into cells, and each vertex is
    tested against the triangles whose projections reach into its cell.

    Args:
        vertices_cam: (V, 3) camera frame.
        faces: (F, 3) int64.
        K: (3, 3) in px.
        image_hw: height and width.
        ids: (N,) the vertices to be tested; None: all.

    Returns:
        (N,) bool.

    """
    ids = torch.arange(len(vertices_cam)) if ids is None else ids
    window = _window(vertices_cam[ids], K, image_hw, grow=1.0) if len(ids) else None
    if window is None:
        return torch.zeros(len(ids), dtype=torch.bool)
    H_out_in, window_hw = _zoom(window)
    px, depth = project(H_out_in @ K, vertices_cam)
    inside = (depth > 0) & in_frame(px, window_hw)
    inside = inside & torch.zeros_like(inside).index_fill(0, ids, True)
    occluded = torch.zeros(len(vertices_cam), dtype=torch.bool)
    gap = RELATIVE_GAP * float((vertices_cam.amax(0) - vertices_cam.amin(0)).amax())
    cells_hw = math.ceil(window_hw[0] / CELL), math.ceil(window_hw[1] / CELL)
    vertex, triangle = _pairs_by_cell(px, inside, faces, depth=depth, cells_hw=cells_hw)
    for start in range(0, len(vertex), PAIRS_AT_ONCE):
        v, f = vertex[start : start + PAIRS_AT_ONCE], triangle[start : start + PAIRS_AT_ONCE]
        crossed = _depth_on_face(vertices_cam[v] / depth[v, None], vertices_cam[faces[f]])
        own = (faces[f] == v[:, None]).any(1)
        occluded[v[~own & (crossed < depth[v] - gap)]] = True
    return (inside & ~occluded)[ids]


def _window(
    vertices_cam: Tensor, K: Tensor, image_hw: tuple[int, int], grow: float = 0.0
) -> tuple[float, float, float, float] | None:
    """The part of the frame that points can be seen in, grown by so many px.

    Returns:
        Left, top, right, bottom in px; None if the points are outside.

    """
    px, depth = project(K, vertices_cam)
    height, width = image_hw
    frame = (-0.5, -0.5, width - 0.5, height - 0.5)
    if not bool((depth > 0).any()):
        return None
    if bool((depth <= 0).any()):  # the body reaches behind the camera: its projection has no bounds
        return frame
    left, top = torch.maximum(px.amin(0) - grow, torch.tensor(frame[:2], dtype=px.dtype)).tolist()
    right, bottom = torch.minimum(
        px.amax(0) + grow, torch.tensor(frame[2:], dtype=px.dtype)
    ).tolist()
    return (left, top, right, bottom) if left < right and top < bottom else None


def _zoom(window: tuple[float, float, float, float]) -> tuple[Tensor, tuple[int, int]]:
    """The map from the image to an enlarged window, and the window's height and width."""
    left, top, right, bottom = window
    scale = RESOLUTION / max(right - left, bottom - top)
    H_out_in = torch.tensor(
        [[scale, 0, -0.5 - scale * left], [0, scale, -0.5 - scale * top], [0, 0, 1]],
        dtype=torch.float64,
    )
    return H_out_in, (max(1, round((bottom - top) * scale)), max(1, round((right - left) * scale)))


def _pairs_by_cell(
    px: Tensor, inside: Tensor, faces: Tensor, *, depth: Tensor, cells_hw: tuple[int, int]
) -> tuple[Tensor, Tensor]:
    """Every vertex with every triangle that reaches into its cell.

    Args:
        px: (V, 2) of the vertices.
        inside: (V,) which of them are to be paired.
        faces: (F, 3).
        depth: (V,).
        cells_hw: rows and columns of cells.

    Returns:
        Vertex ids (P,) and triangle ids (P,).

    """
    rows, columns = cells_hw
    corners_behind = (depth <= 0)[faces]
    behind = corners_behind.any(1)  # such a triangle may reach anywhere, unless all of it is behind
    cell = torch.tensor([columns, rows]) - 1
    low = ((px[faces].amin(1) + 0.5) / CELL).floor().clamp(-1, 1e6).long()
    high = ((px[faces].amax(1) + 0.5) / CELL).floor().clamp(-1, 1e6).long()
    low, high = (
        torch.where(behind[:, None], 0, low.clamp_min(0)),
        torch.where(behind[:, None], cell, torch.minimum(high, cell)),
    )
    spans = torch.where(corners_behind.all(1)[:, None], 0, (high - low + 1).clamp_min(0))
    triangle, k = _repeat(spans.prod(1))
    wide = spans[triangle, 0].clamp_min(1)
    cell_of_triangle = (low[triangle, 1] + k // wide) * columns + low[triangle, 0] + k % wide
    order = torch.argsort(cell_of_triangle, stable=True)
    triangle, cell_of_triangle = triangle[order], cell_of_triangle[order]
    vertex = inside.nonzero()[:, 0]
    at = ((px[vertex] + 0.5) / CELL).floor().long().clamp_min(0).minimum(cell)
    cell_of_vertex = at[:, 1] * columns + at[:, 0]
    first = torch.searchsorted(cell_of_triangle, cell_of_vertex)
    count = torch.searchsorted(cell_of_triangle, cell_of_vertex, right=True) - first
    which, k = _repeat(count)
    return vertex[which], triangle[first[which] + k]


def _repeat(counts: Tensor) -> tuple[Tensor, Tensor]:
    """Each index i counts[i] times, and 0, 1, ... within each."""
    index = torch.repeat_interleave(torch.arange(len(counts)), counts)
    return index, torch.arange(len(index)) - (counts.cumsum(0) - counts)[index]


def _depth_on_face(rays: Tensor, corners: Tensor) -> Tensor:
    """The depth (N,) at which rays (N, 3) with z = 1 cross triangles (N, 3, 3); infinite if not."""
    a, b, c = corners.unbind(1)
    weights = torch.stack(
        [(torch.linalg.cross(p, q) * rays).sum(-1) for p, q in ((b, c), (c, a), (a, b))], dim=-1
    )
    volume = (torch.linalg.cross(a, b) * c).sum(-1)
    total = weights.sum(-1)
    hit = ((weights >= 0).all(-1) | (weights <= 0).all(-1)) & (total != 0)
    depth = volume / torch.where(hit, total, torch.ones_like(total))
    return torch.where(hit & (depth > 0), depth, torch.full_like(depth, torch.inf))

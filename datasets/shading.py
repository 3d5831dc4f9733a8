"""A plain picture of bodies on a ground: z-buffered, lit from above."""

import torch
from torch import Tensor

from animal3dbox.geometry.rasterizer import Raster, rasterize, silhouette

SUN = (0.35, 0.45, 0.82)
"""Direction to the light, in the world's frame with z up."""
SUPERSAMPLING = 2


def vertex_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Unit normals (V, 3) of a mesh's vertices, its faces weighted by their area."""
    corners = vertices[faces]
    across = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = torch.zeros_like(vertices).index_add(0, faces.flatten(), across.repeat_interleave(3, dim=0))
    return torch.nn.functional.normalize(normals, dim=-1)


def shade(
    vertices_world: Tensor,
    faces: Tensor,
    colors: Tensor,
    R: Tensor,
    t: Tensor,
    K: Tensor,
    image_hw: tuple[int, int],
    background: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """A picture of a lit mesh.

    Args:
        vertices_world: (V, 3), z up.
        faces: (F, 3).
        colors: (V, 3) from 0 to 1.
        R: (3, 3) R_cam_world.
        t: (3,) t_cam_world.
        K: (3, 3).
        image_hw: height and width.
        background: (H, W, 3) from 0 to 1; None: a pale grey.

    Returns:
        image: (H, W, 3) uint8 RGB.
        mask: (H, W) bool, pixels whose centre is covered.

    """
    height, width = image_hw
    fine = SUPERSAMPLING
    K_fine = torch.tensor([[fine, 0, (fine - 1) / 2], [0, fine, (fine - 1) / 2], [0, 0, 1]], dtype=K.dtype) @ K
    vertices_cam = vertices_world @ R.mT + t
    raster = rasterize(vertices_cam, faces, K_fine, (height * fine, width * fine))
    lit = colors * _light(vertices_world, faces)[:, None]
    seen = _interpolate(raster, faces, lit)
    covered = (raster.face_index >= 0).to(seen.dtype)
    blocks = (height, fine, width, fine)
    part = covered.reshape(blocks).mean((1, 3))
    color = (seen * covered[..., None]).reshape(*blocks, 3).mean((1, 3))
    back = torch.full((height, width, 3), 0.86, dtype=seen.dtype) if background is None else background
    image = ((color + back * (1 - part[..., None])).clamp(0, 1) * 255).round().to(torch.uint8)
    return image, silhouette(vertices_cam, faces, K, image_hw)


def _light(vertices_world: Tensor, faces: Tensor) -> Tensor:
    """Brightness (V,): sun, and sky that is brighter from above."""
    normals = vertex_normals(vertices_world, faces)
    sun = torch.nn.functional.normalize(torch.tensor(SUN, dtype=normals.dtype), dim=-1)
    return 0.30 + 0.20 * (normals[:, 2] + 1) / 2 + 0.55 * (normals @ sun).clamp_min(0)


def _interpolate(raster: Raster, faces: Tensor, values: Tensor) -> Tensor:
    """Vertex values (V, C) at each pixel, (H, W, C); those of face 0 where there is none."""
    corners = values[faces[raster.face_index.clamp_min(0)]]
    return (corners * raster.barycentric[..., None].to(values.dtype)).sum(-2)


def meadow(K: Tensor, R: Tensor, t: Tensor, image_hw: tuple[int, int]) -> Tensor:
    """A background (H, W, 3): sky above the horizon, ground with soft bands below it."""
    height, width = image_hw
    v, u = torch.meshgrid(torch.arange(height, dtype=K.dtype), torch.arange(width, dtype=K.dtype), indexing="ij")
    rays = torch.stack((u, v, torch.ones_like(u)), dim=-1) @ torch.linalg.inv(K).mT @ R
    eye = -R.mT @ t
    up = torch.nn.functional.normalize(rays, dim=-1)[..., 2]
    reach = torch.where(up < -1e-3, eye[2] / (-up).clamp_min(1e-3), torch.zeros_like(up)).clamp(0, 200)
    ground_xy = eye[:2] + rays[..., :2] / torch.linalg.vector_norm(rays, dim=-1, keepdim=True) * reach[..., None]
    bands = 0.5 + 0.25 * torch.sin(3.1 * ground_xy[..., 0] + 1.3 * torch.sin(1.7 * ground_xy[..., 1])) + 0.25 * torch.sin(2.3 * ground_xy[..., 1])
    bands = 0.5 + (bands - 0.5) * torch.exp(-reach / 25)
    low, high = torch.tensor([0.42, 0.50, 0.27], dtype=K.dtype), torch.tensor([0.60, 0.63, 0.38], dtype=K.dtype)
    ground = low + (high - low) * bands[..., None]
    sky = torch.tensor([0.80, 0.88, 0.96], dtype=K.dtype) - up.clamp_min(0)[..., None] * torch.tensor([0.35, 0.25, 0.08], dtype=K.dtype)
    haze = torch.exp(-reach / 60)[..., None]
    below = ground * haze + torch.tensor([0.78, 0.84, 0.85], dtype=K.dtype) * (1 - haze)
    return torch.where((up < -1e-3)[..., None], below, sky)

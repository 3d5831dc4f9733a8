"""Pictures of meshes: one z-buffer for all of them, lit by sun and sky, over a background."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.camera import PinholeCamera
from animal3dbox.geometry.rasterizer import Raster, rasterize
from animal3dbox.geometry.rigid_transforms import rigid, transform_points

Picture = NDArray[np.float32]

SUN = (0.35, 0.45, 0.82)
"""Direction to the light, in the world's frame with z up."""
PALE = 0.86
"""Grey of the background where there is none."""


@dataclass(frozen=True)
class Light:
    """Sun and sky.

    Attributes:
        sun: towards the sun, z up, any length.
        sunny: 0 for a grey sky, 1 for a clear one.
    """

    sun: tuple[float, float, float] = SUN
    sunny: float = 1.0


@dataclass(frozen=True)
class Surface:
    """A mesh and the colour of its points.

    Attributes:
        vertices: (V, 3) world, z up.
        faces: (F, 3).
        features: (V, C) float32, what the colour depends on; between vertices by their barycentric
            weights.
        colors: features (N, C) -> colours (N, 3), 0 to 1.
    """

    vertices: Tensor
    faces: Tensor
    features: Picture
    colors: Callable[[Picture], Picture]


@dataclass(frozen=True)
class Rendering:
    """A picture and what is seen where.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        owner: (H, W) int64, the number of the surface seen at each pixel's centre, -1 for the
            background.
        raster: of all the surfaces' faces, one after the other.
    """

    image: Tensor
    owner: Tensor
    raster: Raster


def vertex_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Unit normals (V, 3) of a mesh's vertices, its faces weighted by their area."""
    corners = vertices[faces]
    across = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = torch.zeros_like(vertices).index_add(
        0, faces.flatten(), across.repeat_interleave(3, dim=0)
    )
    return torch.nn.functional.normalize(normals, dim=-1)


def joined_meshes(surfaces: Sequence[Surface]) -> tuple[Tensor, Tensor, Tensor]:
    """All vertices (V, 3) in the world, all faces (F, 3), and the surface (F,) that each face is
    of."""
    if not surfaces:
        return (
            torch.zeros(0, 3, dtype=torch.float64),
            torch.zeros(0, 3, dtype=torch.int64),
            torch.zeros(0, dtype=torch.int64),
        )
    starts = np.cumsum([0, *(len(s.vertices) for s in surfaces)]).tolist()
    faces = torch.cat([s.faces + start for s, start in zip(surfaces, starts[:-1], strict=True)])
    owner = torch.repeat_interleave(
        torch.arange(len(surfaces)), torch.tensor([len(s.faces) for s in surfaces])
    )
    return torch.cat([s.vertices for s in surfaces]), faces, owner


def render(
    surfaces: Sequence[Surface],
    camera: PinholeCamera,
    background: Picture | None = None,
    light: Light = Light(),
) -> Rendering:
    """A picture of surfaces.

    Each pixel shows what is nearest at its centre, and outlines are softened.

    Args:
        surfaces: any number.
        camera: the view.
        background: (H, W, 3), 0 to 1; None: pale grey.
        light: from where, and how hard.

    """
    vertices, faces, owner = joined_meshes(surfaces)
    raster = rasterize(
        transform_points(camera.T_cam_world, vertices), faces, camera.K, camera.image_hw
    )
    seen = torch.nonzero(raster.face_index.flatten() >= 0)[:, 0]
    face = raster.face_index.flatten()[seen]
    weights = raster.barycentric.reshape(-1, 3)[seen].numpy().astype(np.float32)
    corners, surface = faces[face].numpy(), owner[face].numpy()
    normals = np.concatenate(
        [vertex_normals(s.vertices, s.faces).numpy() for s in surfaces] or [np.zeros((0, 3))]
    ).astype(np.float32)
    colors = _colors(surfaces, corners, weights, surface) * _brightness(
        _between(normals, corners, weights), light
    )
    picture = (
        np.full((*camera.image_hw, 3), PALE, dtype=np.float32)
        if background is None
        else np.array(background, dtype=np.float32)
    )
    picture.reshape(-1, 3)[seen.numpy()] = colors
    ids = torch.full(camera.image_hw, -1, dtype=torch.int64)
    ids.view(-1)[seen] = torch.from_numpy(surface)
    picture = _softened(picture, ids.numpy())
    return Rendering(
        torch.from_numpy((picture.clip(0, 1) * 255).round().astype(np.uint8)), ids, raster
    )


def shade(
    vertices_world: Tensor,
    faces: Tensor,
    colors: Tensor,
    R: Tensor,
    t: Tensor,
    K: Tensor,
    image_hw: tuple[int, int],
) -> tuple[Tensor, Tensor]:
    """A picture of one lit mesh on pale grey.

    Args:
        vertices_world: (V, 3), z up.
        faces: (F, 3).
        colors: (V, 3) from 0 to 1.
        R: (3, 3) R_cam_world.
        t: (3,) t_cam_world.
        K: (3, 3).
        image_hw: height and width.

    Returns:
        image: (H, W, 3) uint8 RGB.
        mask: (H, W) bool, pixels whose centre is covered.

    """
    surface = Surface(
        vertices_world, faces, colors.numpy().astype(np.float32), lambda features: features
    )
    made = render([surface], PinholeCamera(K, rigid(R, t), image_hw))
    return made.image, made.owner == 0


def _between(values: Picture, corners: NDArray[np.int64], weights: Picture) -> Picture:
    """Vertex values (V, C) at points in triangles: vertices (N, 3) and weights (N, 3) -> (N, C)."""
    first, second, third = (values[corners[:, k]] * weights[:, k : k + 1] for k in range(3))
    return np.asarray(first + second + third)


def _colors(
    surfaces: Sequence[Surface],
    corners: NDArray[np.int64],
    weights: Picture,
    surface: NDArray[np.int64],
) -> Picture:
    """Unlit colours (N, 3) of points."""
    colors, start = np.zeros((len(corners), 3), dtype=np.float32), 0
    for number, one in enumerate(surfaces):
        here = np.flatnonzero(surface == number)
        if len(here):
            colors[here] = one.colors(_between(one.features, corners[here] - start, weights[here]))
        start += len(one.vertices)
    return colors


def _brightness(normals: Picture, light: Light) -> Picture:
    """Factors (N, 3).

    A sky that is brighter and bluer from above, ground light from below, and the sun.
    """
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    sun = np.array(light.sun, dtype=np.float32) / np.linalg.norm(light.sun)
    direct = np.clip(normals @ sun.astype(np.float32), 0, 1)[:, None]
    sky = (0.5 + 0.5 * normals[:, 2:]) ** 1.5
    cool, warm = (
        np.array([0.97, 1.0, 1.05], dtype=np.float32),
        np.array([1.04, 1.0, 0.93], dtype=np.float32),
    )
    ambient = 0.36 + (0.62 - 0.26 * light.sunny) * sky
    return np.asarray(ambient * cool + 0.62 * light.sunny * direct * warm, dtype=np.float32)


def _softened(picture: Picture, ids: NDArray[np.int64]) -> Picture:
    """The picture with the pixels on either side of an outline blurred."""
    edge = np.zeros(ids.shape, dtype=bool)
    across, down = ids[:, 1:] != ids[:, :-1], ids[1:] != ids[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    blurred = cv2.GaussianBlur(picture, (3, 3), 0.7)
    return np.where(edge[..., None], blurred, picture)

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
"""Colours or other values of pixels (H, W, C) or points (N, C)."""

SUN = (0.35, 0.45, 0.82)
"""Usual direction to the light, in the world's frame with z up."""
PALE = 0.86
"""Grey of pictures without a background."""


@dataclass(frozen=True)
class Light:
    """The light of a scene, from sun and sky.

    Attributes:
        sun: direction to the sun, z up, of any length.
        sunny: 0 for a grey sky, 1 for a clear one.
    """

    sun: tuple[float, float, float] = SUN
    sunny: float = 1.0


@dataclass(frozen=True)
class Surface:
    """A mesh and the colours of its points.

    Attributes:
        vertices: (V, 3) world, z up.
        faces: (F, 3).
        features: (V, C) float32 values that the colour depends on; between vertices they go by the
            barycentric weights.
        colors: features (N, C) -> colours (N, 3), 0 to 1.
    """

    vertices: Tensor
    faces: Tensor
    features: Picture
    colors: Callable[[Picture], Picture]


@dataclass(frozen=True)
class Rendering:
    """A picture with the surface that each pixel shows.

    Attributes:
        image: (H, W, 3) uint8 RGB.
        owner: (H, W) int64, the number of the surface at each pixel's centre, -1 for the
            background.
        raster: of the faces of all surfaces, one after the other.
    """

    image: Tensor
    owner: Tensor
    raster: Raster


def vertex_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """The unit normals (V, 3) of a mesh's vertices, its faces weighted by their area."""
    corners = vertices[faces]
    across = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = torch.zeros_like(vertices).index_add(
        0, faces.flatten(), across.repeat_interleave(3, dim=0)
    )
    return torch.nn.functional.normalize(normals, dim=-1)


def joined_meshes(surfaces: Sequence[Surface]) -> tuple[Tensor, Tensor, Tensor]:
    """All surfaces as one mesh.

    Returns:
        The vertices (V, 3) in the world, the faces (F, 3), and the number (F,) of each face's
        surface.

    """
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
    """The picture of surfaces, each pixel showing the nearest one at its centre.

    Outlines are softened.

    Args:
        surfaces: any number of them.
        camera: in the world.
        background: (H, W, 3), 0 to 1; None: pale grey.
        light: of the scene.

    """
    vertices, faces, owner = joined_meshes(surfaces)
    raster = rasterize(
        transform_points(camera.T_cam_world, vertices), faces, camera.K, camera.image_hw
    )
    pixels = torch.nonzero(raster.face_index.flatten() >= 0)[:, 0]
    face = raster.face_index.flatten()[pixels]
    weights = raster.barycentric.reshape(-1, 3)[pixels].numpy().astype(np.float32)
    corners, surface = faces[face].numpy(), owner[face].numpy()
    normals = np.concatenate(
        [vertex_normals(s.vertices, s.faces).numpy() for s in surfaces] or [np.zeros((0, 3))]
    ).astype(np.float32)
    brightness = _brightness(_between(normals, corners, weights), light)
    colors = _colors(surfaces, corners, weights, surface) * brightness
    picture = (
        np.full((*camera.image_hw, 3), PALE, dtype=np.float32)
        if background is None
        else np.array(background, dtype=np.float32)
    )
    picture.reshape(-1, 3)[pixels.numpy()] = colors
    ids = torch.full(camera.image_hw, -1, dtype=torch.int64)
    ids.view(-1)[pixels] = torch.from_numpy(surface)
    picture = _softened(picture, ids.numpy())
    image = (picture.clip(0, 1) * 255).round().astype(np.uint8)
    return Rendering(torch.from_numpy(image), ids, raster)


def shade(
    vertices_world: Tensor,
    faces: Tensor,
    colors: Tensor,
    *,
    R: Tensor,
    t: Tensor,
    K: Tensor,
    image_hw: tuple[int, int],
) -> tuple[Tensor, Tensor]:
    """The picture of one lit mesh on pale grey.

    Args:
        vertices_world: (V, 3), z up.
        faces: (F, 3).
        colors: (V, 3) from 0 to 1.
        R: (3, 3) R_cam_world.
        t: (3,) t_cam_world.
        K: (3, 3) in px.
        image_hw: height and width.

    Returns:
        image: (H, W, 3) uint8 RGB.
        mask: (H, W) bool, the pixels whose centre the mesh covers.

    """
    surface = Surface(
        vertices_world, faces, colors.numpy().astype(np.float32), lambda features: features
    )
    rendering = render([surface], PinholeCamera(K, rigid(R, t), image_hw))
    return rendering.image, rendering.owner == 0


def _between(values: Picture, corners: NDArray[np.int64], weights: Picture) -> Picture:
    """The values (N, C) at points in triangles, between those of the triangles' vertices.

    Args:
        values: (V, C) of the vertices.
        corners: (N, 3) vertices of each point's triangle.
        weights: (N, 3) barycentric.

    """
    first, second, third = (values[corners[:, k]] * weights[:, k : k + 1] for k in range(3))
    return np.asarray(first + second + third)


def _colors(
    surfaces: Sequence[Surface],
    corners: NDArray[np.int64],
    weights: Picture,
    surface: NDArray[np.int64],
) -> Picture:
    """The colours (N, 3) of points before they are lit.

    Args:
        surfaces: of the picture.
        corners: (N, 3) vertices of each point's triangle, among those of all surfaces.
        weights: (N, 3) barycentric.
        surface: (N,) number of each point's surface.

    """
    colors, start = np.zeros((len(corners), 3), dtype=np.float32), 0
    for number, one in enumerate(surfaces):
        here = np.flatnonzero(surface == number)
        if len(here):
            colors[here] = one.colors(_between(one.features, corners[here] - start, weights[here]))
        start += len(one.vertices)
    return colors


def _brightness(normals: Picture, light: Light) -> Picture:
    """The factors (N, 3) by which light changes the colours of points with normals (N, 3).

    The sky is brighter and bluer from above, the ground lights from below, and the sun shines.
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
    """The picture with blurred pixels on either side of an outline."""
    edge = np.zeros(ids.shape, dtype=bool)
    across, down = ids[:, 1:] != ids[:, :-1], ids[1:] != ids[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    blurred = cv2.GaussianBlur(picture, (3, 3), 0.7)
    return np.where(edge[..., None], blurred, picture)

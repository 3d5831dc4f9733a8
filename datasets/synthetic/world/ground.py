"""The ground and the sky behind the animals, and the shadows on the ground."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.camera import PinholeCamera
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.geometry.rigid_transforms import transform_points

Picture = NDArray[np.float32]
"""Colours or other values of pixels (H, W, C)."""
Color = tuple[float, float, float]
"""Red, green and blue, 0 to 1."""
Mesh = tuple[torch.Tensor, torch.Tensor]
"""Vertices (V, 3) in the world and faces (F, 3)."""

COARSE = 2
"""The background is made at 1 / COARSE of the resolution: it is out of focus."""
TILE = 256
"""Side of the tile of noise, in px."""
HAZE = 150.0
"""Distance over which the ground fades into the hills, in body lengths."""

_GROUNDS: dict[str, tuple[Color, Color]] = {
    "meadow": ((0.34, 0.44, 0.18), (0.56, 0.62, 0.32)),
    "dry grass": ((0.56, 0.47, 0.26), (0.77, 0.68, 0.44)),
    "earth": ((0.38, 0.28, 0.19), (0.58, 0.45, 0.32)),
    "sand": ((0.74, 0.64, 0.46), (0.88, 0.80, 0.62)),
    "snow": ((0.82, 0.85, 0.90), (0.95, 0.96, 0.98)),
    "stone": ((0.44, 0.43, 0.42), (0.66, 0.65, 0.62)),
    "forest floor": ((0.25, 0.20, 0.13), (0.44, 0.37, 0.22)),
}
"""Kind of ground -> its colour in hollows and on heights."""


@dataclass(frozen=True)
class Setting:
    """Ground, sky and light of a scene.

    Attributes:
        low: the ground's colour in its hollows.
        high: the ground's colour on its heights.
        tile: (TILE, TILE) noise, 0 to 1, that repeats at its borders.
        scale: units of the world that a tile spans, fine and coarse.
        sky: colours at the horizon and overhead.
        hills: (2, 6) amplitudes and phases of the skyline.
        hill_color: colour of the skyline.
        sun: unit vector to the light, z up.
        sunny: 0 for an overcast sky to 1 for a clear one.
    """

    low: Color
    high: Color
    tile: Picture
    scale: tuple[float, float]
    sky: tuple[Color, Color]
    hills: NDArray[np.float64]
    hill_color: Color
    sun: tuple[float, float, float]
    sunny: float


def draw_setting(rng: np.random.Generator) -> Setting:
    """A random ground, sky and light."""
    low, high = _GROUNDS[tuple(_GROUNDS)[int(rng.integers(len(_GROUNDS)))]]
    tint = rng.uniform(0.9, 1.05) * rng.uniform(0.97, 1.03, 3)
    sunny = float(rng.uniform(0.15, 1.0))
    blue = np.array([0.36, 0.56, 0.86]) * sunny + np.array([0.74, 0.77, 0.80]) * (1 - sunny)
    pale = np.array([0.80, 0.87, 0.94]) * sunny + np.array([0.84, 0.85, 0.86]) * (1 - sunny)
    height, turn = math.radians(rng.uniform(28, 70)), rng.uniform(-math.pi, math.pi)
    hills = np.stack(
        (rng.uniform(0.0, 0.03, 6) / (1 + 0.5 * np.arange(6)), rng.uniform(0, 6.28, 6))
    )
    green = np.array([0.30, 0.38, 0.27]) * rng.uniform(0.8, 1.3)
    sun = (math.cos(height) * math.cos(turn), math.cos(height) * math.sin(turn), math.sin(height))
    # The order of these is that of the random numbers.
    return Setting(
        low=_color(np.array(low) * tint),
        high=_color(np.array(high) * tint),
        tile=_noise_tile(rng),
        scale=(float(rng.uniform(0.7, 1.4)), float(rng.uniform(5, 9))),
        sky=(_color(pale), _color(blue)),
        hills=hills,
        hill_color=_color(green + (pale - green) * rng.uniform(0.25, 0.6)),
        sun=sun,
        sunny=sunny,
    )


def _color(value: NDArray[np.float64]) -> Color:
    """An array (3,) as a colour."""
    return float(value[0]), float(value[1]), float(value[2])


def _noise_tile(rng: np.random.Generator) -> Picture:
    """Noise (TILE, TILE) of several scales, 0 to 1, that repeats at its borders."""
    tile = np.zeros((TILE, TILE), dtype=np.float32)
    for cells, amount in ((8, 0.35), (32, 0.35), (128, 0.3)):
        small = np.pad(rng.random((cells, cells), dtype=np.float32), 1, mode="wrap")
        step = TILE // cells
        large = cv2.resize(small, None, fx=step, fy=step, interpolation=cv2.INTER_LINEAR)
        tile += np.float32(amount) * large[step:-step, step:-step]
    return np.asarray((tile - tile.min()) / (tile.max() - tile.min()), dtype=np.float32)


def background(
    setting: Setting, camera: PinholeCamera, ground_z: float, casters: list[Mesh]
) -> Picture:
    """The picture (H, W, 3), 0 to 1, of the empty scene with the shadows of the casters.

    Args:
        setting: ground, sky and light.
        camera: above the ground.
        ground_z: the ground's height.
        casters: the meshes that throw shadows.

    """
    height, width = camera.image_hw
    rows, columns = -(-height // COARSE), -(-width // COARSE)
    coarse = torch.tensor(
        [[1 / COARSE, 0, 0.5 / COARSE - 0.5], [0, 1 / COARSE, 0.5 / COARSE - 0.5], [0, 0, 1]],
        dtype=torch.float64,
    )
    K, eye = coarse @ camera.K, camera.center_world.numpy()
    v, u = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    to_world = (torch.linalg.inv(K).T @ camera.T_cam_world[:3, :3]).numpy()
    rays = np.stack((u, v, np.ones_like(u)), axis=-1).astype(np.float64) @ to_world
    x, y, up = np.moveaxis(rays / np.linalg.norm(rays, axis=-1, keepdims=True), -1, 0)
    reach = np.where(up < -1e-4, (eye[2] - ground_z) / np.maximum(-up, 1e-4), 1e4)
    pixel = reach / (
        float(K[0, 0]) * np.maximum(-up, 0.02)
    )  # in the world, along the line of sight
    picture = _ground(setting, eye[0] + x * reach, eye[1] + y * reach, pixel)
    flat = [_flattened(mesh, setting, ground_z) for mesh in casters]
    shadow = _shadows(flat, K, camera.T_cam_world, (rows, columns))
    picture *= 1 - (0.15 + 0.45 * setting.sunny) * shadow[..., None]
    sky = _sky(setting, x, y, up)
    turn = np.arctan2(y, x).astype(np.float32)
    skyline = sum(
        np.float32(a) * (1 + np.sin(np.float32(3 + 4 * i) * turn + np.float32(p)))
        for i, (a, p) in enumerate(setting.hills.T)
    )
    far = np.clip(1 - np.exp(-reach / HAZE), 0, 1).astype(np.float32)[..., None]
    hill = np.array(setting.hill_color, dtype=np.float32)
    whole = np.where(
        (up < -1e-4)[..., None],
        picture + (hill - picture) * far,
        np.where((up < skyline)[..., None], hill, sky),
    )
    soft = cv2.GaussianBlur(whole.astype(np.float32), (3, 3), 0.8)
    size = (columns * COARSE, rows * COARSE)
    large = cv2.resize(soft, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(large[:height, :width])


def _ground(
    setting: Setting, x: NDArray[np.float64], y: NDArray[np.float64], pixel: NDArray[np.float64]
) -> Picture:
    """The colours (R, C, 3) of the ground, whose texture fades to its mean where it is too fine.

    Args:
        setting: of the scene.
        x: (R, C) place on the ground of each pixel.
        y: (R, C) likewise.
        pixel: (R, C) size of each pixel on the ground.

    """
    height: Picture = np.full(x.shape, 0.5, dtype=np.float32)
    for scale, amount in zip(setting.scale, (0.55, 0.45), strict=True):
        at = np.stack((x, y), axis=-1) / scale * TILE % TILE
        u, v = (at[..., axis].astype(np.float32) for axis in (0, 1))
        noise = cv2.remap(setting.tile, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        fade = np.exp(-((8 * pixel / scale) ** 2))
        height += np.asarray(amount * fade * (noise - 0.5), dtype=np.float32)
    low, high = np.array(setting.low, dtype=np.float32), np.array(setting.high, dtype=np.float32)
    return np.asarray(low + (high - low) * (1.6 * (height - 0.5) + 0.5).clip(0, 1)[..., None])


def _sky(
    setting: Setting, x: NDArray[np.float64], y: NDArray[np.float64], up: NDArray[np.float64]
) -> Picture:
    """The colours (R, C, 3) of the sky along unit rays (R, C) of x, y and up."""
    pale, blue = (np.array(color, dtype=np.float32) for color in setting.sky)
    sky = pale + (blue - pale) * np.clip(up * 1.8, 0, 1).astype(np.float32)[..., None] ** 0.7
    over = 1 / np.maximum(up, 0.05)
    at = (np.stack((x * over, y * over), axis=-1) * 40 % TILE).astype(np.float32)
    soft = cv2.GaussianBlur(setting.tile, (9, 9), 0, borderType=cv2.BORDER_REFLECT)
    cloud = cv2.remap(soft, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    cover = np.clip((cloud - 0.5) * 3, 0, 1) * np.clip(up * 6, 0, 1)
    return np.asarray(sky + (0.96 - sky) * (0.7 * cover)[..., None].astype(np.float32))


def _flattened(mesh: Mesh, setting: Setting, ground_z: float) -> Mesh:
    """A mesh flattened onto the ground along the light."""
    vertices, faces = mesh
    sun = torch.tensor(setting.sun, dtype=torch.float64)
    return vertices - (vertices[:, 2:] - ground_z) / sun[2] * sun, faces


def _shadows(
    shadow_meshes: list[Mesh],
    K: torch.Tensor,
    T_cam_world: torch.Tensor,
    image_hw: tuple[int, int],
) -> Picture:
    """The part (R, C) of each pixel that lies in the shadow of flattened meshes, 0 to 1."""
    shadow = np.zeros(image_hw, dtype=np.float32)
    for vertices, faces in shadow_meshes:
        dark = silhouette(transform_points(T_cam_world, vertices), faces, K, image_hw)
        shadow = np.maximum(shadow, dark.numpy().astype(np.float32))
    return np.asarray(cv2.GaussianBlur(shadow, (0, 0), 1.2))

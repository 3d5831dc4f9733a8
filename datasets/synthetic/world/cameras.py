"""The cameras of scenes, handheld or from above.

Each sees the first animal in a random size and place of the frame, to which it is fitted.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.world.config import WorldConfig, log_uniform
from animal3dbox.geometry.camera import PinholeCamera, intrinsics, look_at
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle, transform_points

HANDHELD_BELOW_DEG, UAV_ABOVE_DEG = 35.0, 25.0
"""Elevations that handheld cameras keep below, and those from above over."""
NEAREST = 0.1
"""Least depth of the animal, in body lengths."""
ROUNDS = 40
"""Greatest number of rounds in which a camera is fitted."""
USUAL_ELEVATION_DEG = 10.0
"""Most common elevation of a camera."""
FILL_BIAS = 0.6
"""Below 1, large animals are drawn more often than small ones."""
_CUT = (0.15, 0.5)
"""Part of a cut animal's box that lies outside the frame."""


@dataclass(frozen=True)
class _View:
    """The random numbers of a camera before it is fitted to its animal.

    Attributes:
        K: (3, 3) in px.
        away: (3,) unit, from the animal to the camera.
        roll: radians.
        fill: longer side that the animal's box shall have, by the image's side.
        corner: (2,) place of the animal in the free room, 0 to 1 along u and v; outside of that it
            is cut.
        image_hw: height and width.
    """

    K: Tensor
    away: Tensor
    roll: float
    fill: float
    corner: Tensor
    image_hw: tuple[int, int]


def draw_camera(rng: np.random.Generator, vertices: Tensor, config: WorldConfig) -> PinholeCamera:
    """A random camera that looks at a body with vertices (V, 3) in the world, z up."""
    view = _draw_view(rng, config)
    middle = (vertices.amax(0) + vertices.amin(0)) / 2
    half = torch.tensor([config.image_hw[1], config.image_hw[0]], dtype=torch.float64) / 2
    about = vertices - middle
    distance = float(
        view.K[0, 0] * torch.linalg.vector_norm(about, dim=1).amax() / (view.fill * half.amax())
    )
    aim = half - 0.5
    for _ in range(ROUNDS):
        T = _pointed(view, distance, aim)
        low, high, nearest = _bounds(view.K, transform_points(T, about))
        if nearest < NEAREST:
            distance += NEAREST - nearest + 0.05
            continue
        size = high - low
        error = _corner_px(view.corner, size, 2 * half) + size / 2 - 0.5 - (low + high) / 2
        growth = float((size / (2 * half)).amax()) / view.fill
        if float(error.abs().amax()) < 0.5 and abs(growth - 1) < 1e-3:
            break
        aim, distance = aim + error, distance * growth**0.9
    T_cam_world = T.clone()
    T_cam_world[:3, 3] = T[:3, 3] - T[:3, :3] @ middle  # T is about the body's middle
    return PinholeCamera(view.K, T_cam_world, config.image_hw)


def _corner_px(corner: Tensor, size: Tensor, frame: Tensor) -> Tensor:
    """The least corner (2,) of an animal's box, in px from the frame's border.

    The box lies within the room that it has, or is cut by part of its size.
    """
    before, after = corner * size, frame - size + (corner - 1) * size
    return torch.where(corner < 0, before, torch.where(corner > 1, after, corner * (frame - size)))


def _draw_view(rng: np.random.Generator, config: WorldConfig) -> _View:
    """The random numbers of a camera."""
    low, high = config.elevation_deg
    if rng.random() < config.uav and high > UAV_ABOVE_DEG:
        low = max(low, UAV_ABOVE_DEG)
    elif config.uav > 0:
        high = max(low, min(high, HANDHELD_BELOW_DEG))
    usual = min(max(USUAL_ELEVATION_DEG, low), high)
    elevation, azimuth = (
        math.radians(rng.triangular(low, usual, high) if low < high else low),
        rng.uniform(-math.pi, math.pi),
    )
    away = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    focal, fill = log_uniform(rng, config.focal_px), log_uniform(rng, config.fill, FILL_BIAS)
    roll = math.radians(rng.uniform(-1, 1) * config.roll_deg)
    K = intrinsics(focal, config.image_hw)
    K[0, 2] += rng.uniform(-1, 1) * config.principal_offset * config.image_hw[1]
    K[1, 2] += rng.uniform(-1, 1) * config.principal_offset * config.image_hw[0]
    corner = rng.uniform(0.05, 0.95, 2)
    side, outside, is_cut = (
        int(rng.integers(4)),
        rng.uniform(*_CUT),
        rng.random() < config.truncated,
    )
    if is_cut:
        corner[side % 2] = -outside if side < 2 else 1 + outside
    return _View(
        K=K,
        away=torch.tensor(away, dtype=torch.float64),
        roll=roll,
        fill=fill,
        corner=torch.from_numpy(corner),
        image_hw=config.image_hw,
    )


def _pointed(view: _View, distance: float, aim: Tensor) -> Tensor:
    """T_cam_world (4, 4) of a camera that sees the origin at a distance, at the pixel aim (2,)."""
    ray = torch.linalg.solve(view.K, torch.cat((aim, torch.ones_like(aim[:1]))))
    ray = ray / torch.linalg.vector_norm(ray)
    ahead = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    axis = torch.linalg.cross(ahead, ray)
    sine = torch.linalg.vector_norm(axis)
    turn = axis / sine.clamp_min(1e-300) * torch.atan2(sine, ray[2])
    R_look = look_at(view.away, torch.zeros(3, dtype=torch.float64), ahead)[:3, :3]
    R = rotation_from_axis_angle(turn) @ rotation_from_axis_angle(view.roll * ahead) @ R_look
    T = torch.eye(4, dtype=torch.float64)
    T[:3, :3], T[:3, 3] = R, distance * ray
    return T


def _bounds(K: Tensor, vertices_cam: Tensor) -> tuple[Tensor, Tensor, float]:
    """The least and the greatest pixel (2,) of a body, and its least depth."""
    depth = vertices_cam[:, 2]
    px = (vertices_cam @ K.T)[:, :2] / depth.clamp_min(1e-3)[:, None]
    return px.amin(0), px.amax(0), float(depth.amin())

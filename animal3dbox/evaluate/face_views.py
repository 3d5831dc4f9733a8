"""Cameras round one box by class of view: whole, cut, around the camera, from straight above."""

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.synthetic.world.cameras import draw_camera
from animal3dbox.datasets.synthetic.world.config import CLEAR, WorldConfig, world_generator
from animal3dbox.geometry.box_visibility import face_visibility, near_depth
from animal3dbox.geometry.camera import PinholeCamera, intrinsics, look_at
from animal3dbox.geometry.cuboid import Cuboid

_ANY = WorldConfig(truncated=0.0, uav=0.35)
_DRAWN = {
    "in frame": replace(_ANY, fill=(0.08, 0.7)),
    "truncated": replace(_ANY, truncated=1.0),
    "UAV nadir": replace(
        CLEAR,
        uav=1.0,
        elevation_deg=(80.0, 85.0),
        roll_deg=180.0,
        focal_px=(500.0, 5000.0),
        fill=(0.08, 0.8),
    ),
}
BEHIND = "corners behind the camera"
CLASSES = ("in frame", "truncated", BEHIND, "UAV nadir")
_TRIES = 50


def draw_view(
    view: str, cuboid_world: Cuboid, vertices: Tensor, *, seed: int, index: int
) -> PinholeCamera | None:
    """A camera of a class of view, always the same for the same seed and index.

    None if none of some tries has such a view.

    Args:
        view: of CLASSES.
        cuboid_world: the box, z up.
        vertices: (V, 3) of the animal in it.
        seed: any, not negative.
        index: likewise.

    """
    rng = world_generator(seed, index, f"evaluate-view-{view}")
    for _ in range(_TRIES):
        camera = (
            _close_camera(rng, cuboid_world)
            if view == BEHIND
            else draw_camera(rng, vertices, _DRAWN[view])
        )
        if _is(view, camera, cuboid_world):
            return camera
    return None


def _is(view: str, camera: PinholeCamera, cuboid_world: Cuboid) -> bool:
    """Whether the camera's view of the box is of that class."""
    box = cuboid_world.transformed(camera.T_cam_world)
    behind = bool((box.corners()[:, 2] <= near_depth(box)).any())
    if view == BEHIND or behind:
        faces = face_visibility(box, camera.K, camera.image_hw)
        return view == BEHIND and behind and bool(faces.share_in_image.any())
    cut = float(face_visibility(box, camera.K, camera.image_hw).truncation)
    return cut > 0.02 if view == "truncated" else cut == 0.0 if view == "in frame" else True


def _close_camera(rng: np.random.Generator, cuboid_world: Cuboid) -> PinholeCamera:
    """A camera just outside a box that looks past its middle: some corners lie behind it."""
    half = cuboid_world.size / 2
    axis, sign = int(rng.integers(3)), 1.0 if rng.random() < 0.5 else -1.0
    place = half * torch.from_numpy(rng.uniform(-1.1, 1.1, 3))
    place[axis] = sign * (half[axis] + float(rng.uniform(0.03, 0.25)) * cuboid_world.diagonal)
    goal = half * torch.from_numpy(rng.uniform(-0.9, 0.9, 3))
    image_hw = _ANY.image_hw
    eye, target = (cuboid_world.center + cuboid_world.rotation @ point for point in (place, goal))
    up = torch.tensor([math.sin(0.3), 0.1, 1.0], dtype=torch.float64)
    return PinholeCamera(
        intrinsics(float(rng.uniform(300, 900)), image_hw), look_at(eye, target, up), image_hw
    )

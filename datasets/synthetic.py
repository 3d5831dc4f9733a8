"""Posed quadrupeds under known cameras: pictures, keypoints and masks with exact truth."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.datasets.shading import meadow, shade
from animal3dbox.geometry.camera import intrinsics, look_at, project
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped import load_quadruped, preset_betas, quadruped_names
from animal3dbox.smal.quadruped_poses import POSES, ground_trans, named_pose
from animal3dbox.smal.vocabularies import VOCABULARIES
from animal3dbox.smal.vocabulary import Vocabulary

COATS = {
    "dog": (0.66, 0.47, 0.28), "cat": (0.58, 0.52, 0.46), "horse": (0.45, 0.27, 0.17), "cow": (0.82, 0.78, 0.72),
    "bear": (0.36, 0.25, 0.18), "deer": (0.62, 0.41, 0.24), "zebra": (0.80, 0.79, 0.77), "pig": (0.86, 0.66, 0.60),
    "hippo": (0.48, 0.42, 0.42), "lion": (0.75, 0.58, 0.35),
}  # fmt: skip
OTHER_COAT = (0.60, 0.50, 0.40)


@dataclass(frozen=True)
class SyntheticAnimal:
    """One picture of one posed quadruped, and everything that is true of it; float64, world is the body's frame.

    Attributes:
        sample_id: preset, pose and number.
        image: (H, W, 3) uint8 RGB.
        mask: (H, W) bool.
        vertices: (V, 3) world.
        R_world_joint: (J, 3, 3) global rotations of the skeleton's joints, for the trunk's truth.
        model: the body's template.
        landmarks: (J, 3) world.
        keypoints_2d: (J, 3) exact px and 1, or 0 outside the frame; hidden ones are not left out.
        K: (3, 3).
        R: (3, 3) R_cam_world.
        t: (3,) t_cam_world.
        image_hw: height and width.
        preset: the species.
        pose: the pose's name.
    """

    sample_id: str
    image: Tensor
    mask: Tensor
    vertices: Tensor
    R_world_joint: Tensor
    model: SmalModel
    landmarks: Tensor
    keypoints_2d: Tensor
    K: Tensor
    R: Tensor
    t: Tensor
    image_hw: tuple[int, int]
    preset: str
    pose: str


def uniform(generator: torch.Generator, low: float, high: float) -> float:
    """One number between low and high."""
    return low + (high - low) * float(torch.rand((), generator=generator, dtype=torch.float64))


def synthetic_animal(
    seed: int,
    index: int,
    image_hw: tuple[int, int] = (480, 640),
    vocabulary: Vocabulary = VOCABULARIES["animal3d26"],
    preset: str | None = None,
    pose: str | None = None,
) -> SyntheticAnimal:
    """A quadruped in a random preset, pose and view; the same for the same arguments.

    Args:
        seed: any.
        index: which of the seed's animals.
        image_hw: height and width.
        vocabulary: the keypoints wanted.
        preset: the species; None: the presets in turn.
        pose: one of POSES; None: drawn.

    Returns:
        The animal, standing on z = 0, filling a third to most of the frame and wholly in front of the camera.

    """
    generator = torch.Generator().manual_seed((seed * 1_000_003 + index) % (1 << 62))
    drawn = tuple(POSES)[int(torch.randint(len(POSES), (), generator=generator))]
    preset, pose = preset or quadruped_names().presets[index % len(quadruped_names().presets)], pose or drawn
    model = load_quadruped()
    body = model.posed(preset_betas(preset)[None], named_pose(pose)[None], torch.zeros(1, 3, dtype=torch.float64))
    vertices = body.vertices[0] + ground_trans(body.vertices[0])
    focal_px = uniform(generator, 0.9, 2.5) * max(image_hw)
    middle = (vertices.amax(0) + vertices.amin(0)) / 2
    K = intrinsics(focal_px, image_hw)
    T = _camera(generator, vertices - middle, K, image_hw)
    R, t = T[:3, :3], T[:3, 3] - T[:3, :3] @ middle
    colors = torch.tensor(COATS.get(preset, OTHER_COAT), dtype=torch.float64).expand(len(vertices), 3)
    image, mask = shade(vertices, model.faces, colors, R, t, K, image_hw, meadow(K, R, t, image_hw))
    landmarks = vocabulary.on_body(model.landmark_groups, vertices)
    keypoints = exact_keypoints(landmarks, K, R, t, image_hw)
    return SyntheticAnimal(
        f"{preset}-{pose}-{index}", image, mask, vertices, body.R_world_joint[0], model, landmarks, keypoints, K, R, t, image_hw, preset, pose
    )


def exact_keypoints(landmarks: Tensor, K: Tensor, R: Tensor, t: Tensor, image_hw: tuple[int, int]) -> Tensor:
    """Where landmarks are seen: (J, 3) x, y px and 1, or zeros outside the frame and where the body has none."""
    px, depth = project(K, landmarks @ R.mT + t)
    height, width = image_hw
    inside = (depth > 0) & (px >= -0.5).all(-1) & (px[:, 0] < width - 0.5) & (px[:, 1] < height - 0.5)
    keypoints = torch.cat((px, torch.ones_like(px[:, :1])), dim=1)
    return torch.where(inside[:, None], keypoints, torch.zeros_like(keypoints))


def noisy_keypoints(
    keypoints_2d: Tensor, sigma_px: float, generator: torch.Generator, outliers: float = 0.0, image_hw: tuple[int, int] = (480, 640)
) -> Tensor:
    """Keypoints (J, 3) with Gaussian noise on the visible ones, a part of them (outliers, 0 to 1) anywhere in the image instead."""
    count = len(keypoints_2d)
    px = keypoints_2d[:, :2] + sigma_px * torch.randn(count, 2, generator=generator, dtype=keypoints_2d.dtype)
    height, width = image_hw
    anywhere = torch.rand(count, 2, generator=generator, dtype=px.dtype) * torch.tensor([width, height], dtype=px.dtype) - 0.5
    wild = torch.rand(count, 1, generator=generator, dtype=px.dtype) < outliers
    shifted = torch.cat((torch.where(wild, anywhere, px), keypoints_2d[:, 2:]), dim=1)
    return torch.where(keypoints_2d[:, 2:] > 0, shifted, keypoints_2d)


def _camera(generator: torch.Generator, about_middle: Tensor, K: Tensor, image_hw: tuple[int, int]) -> Tensor:
    """T_cam_world of a camera from ahead, beside, behind or above, that fills the frame well without cutting the animal."""
    azimuth, elevation = math.radians(uniform(generator, 0, 360)), math.radians(uniform(generator, -3, 50))
    away = torch.tensor([math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)], dtype=torch.float64)
    up, fill = torch.tensor([0.0, 0, 1], dtype=torch.float64), uniform(generator, 0.6, 0.92)
    distance = float(torch.linalg.vector_norm(about_middle, dim=1).amax()) * 1.2
    half = torch.tensor([image_hw[1], image_hw[0]], dtype=torch.float64) / 2
    for _ in range(60):  # step back until the body fits
        T = look_at(away * distance, torch.zeros(3, dtype=torch.float64), up)
        px, depth = project(K, about_middle @ T[:3, :3].mT + T[:3, 3])
        if float(depth.amin()) > 0 and float(((px - K[:2, 2]).abs() / half).amax()) <= fill:
            return T
        distance *= 1.08
    raise AssertionError("the body does not fit into the frame")

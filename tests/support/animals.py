"""A toy animal in numbers a person can check.

26 landmarks and a mesh around them, x forward, y left, z up.
"""

import math

import torch
from torch import Tensor

from animal3dbox.geometry.camera import intrinsics, look_at, project
from animal3dbox.geometry.rigid_transforms import transform_points
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26

F64 = torch.float64
_HALF = {
    "eye": (0.78, 0.05, 0.72), "front_paw": (0.36, 0.12, 0.0), "back_paw": (-0.42, 0.12, 0.0),
    "front_elbow": (0.30, 0.13, 0.34),
    "back_knee": (-0.32, 0.14, 0.36), "shoulder": (0.38, 0.15, 0.52), "front_wrist": (0.34, 0.12,
        0.16), "back_hock": (-0.50, 0.12, 0.18),
    "ear": (0.66, 0.09, 0.80), "mouth": (0.86, 0.04, 0.62),
}  # fmt: skip
_MIDDLE = {
    "chin": (0.84, 0, 0.58), "tail_base": (-0.48, 0, 0.60), "neck": (0.44, 0, 0.64),
    "tail_tip": (-0.95, 0, 0.45),
    "nose": (0.95, 0, 0.66), "tail_middle": (-0.7, 0, 0.55),
}  # fmt: skip


def toy_landmarks() -> Tensor:
    """(26, 3) in Animal3D's order."""
    rows: list[tuple[float, float, float]] = []
    for name in ANIMAL3D_26:
        if name in _MIDDLE:
            rows.append(_MIDDLE[name])
        else:
            side, _, part = name.partition("_")
            x, y, z = _HALF[part]
            rows.append((x, y if side == "left" else -y, z))
    return torch.tensor(rows, dtype=F64)


def toy_mesh() -> tuple[Tensor, Tensor]:
    """Vertices (V, 3) and faces (F, 3).

    An octahedron round every landmark and round the middle of the trunk.
    """
    tips = torch.cat((torch.eye(3, dtype=F64), -torch.eye(3, dtype=F64)))
    centers = torch.cat((toy_landmarks(), torch.tensor([[0.0, 0, 0.5]], dtype=F64)))
    radii = torch.full((27, 1, 1), 0.06, dtype=F64)
    radii[26] = 0.3
    eight = torch.tensor(
        [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    )
    return (centers[:, None] + radii * tips).reshape(-1, 3), (
        eight[None] + 6 * torch.arange(27)[:, None, None]
    ).reshape(-1, 3)


def camera_round(
    azimuth_deg: float, elevation_deg: float, distance: float = 4.0
) -> tuple[Tensor, Tensor]:
    """(R, t) of a camera that looks at the animal from an azimuth (0 ahead, 90 its left) and an
    elevation."""
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    middle = torch.tensor([0.0, 0, 0.4], dtype=F64)
    eye = middle + distance * torch.tensor(
        [math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)], dtype=F64
    )
    T = look_at(eye, middle, torch.tensor([0.0, 0, 1], dtype=F64))
    return T[:3, :3], T[:3, 3]


IMAGE_HW = (480, 640)
K = intrinsics(700.0, IMAGE_HW)


def keypoints_seen(R: Tensor, t: Tensor, points: Tensor | None = None) -> Tensor:
    """(26, 3) exact keypoints of the toy animal, all visible."""
    T = torch.eye(4, dtype=F64)
    T[:3, :3], T[:3, 3] = R, t
    px, _ = project(K, transform_points(T, toy_landmarks() if points is None else points))
    return torch.cat((px, torch.ones_like(px[:, :1])), dim=1)

"""Boxes of one image by hand, as targets and as what a detector says of them."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle

F64 = torch.float64
FACING_RIGHT = torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=F64).T
"""R_cam_box of an animal that stands on the ground and faces to the right of the picture.

Its forward is the camera's x, its left the camera's forward z, its up the camera's -y; so it shows
its right flank.
"""
HEAD_FOR_TAIL = torch.tensor([-1.0, -1, 1], dtype=F64)
"""Multiplied to the columns of a rotation, it turns an animal round about its own up."""


def turned(degrees: float) -> Tensor:
    """R_cam_box (3, 3) of an animal that faces right and was then turned to its left."""
    about_up = torch.tensor([0.0, 0, torch.pi * degrees / 180], dtype=F64)
    return FACING_RIGHT @ rotation_from_axis_angle(about_up)


def animals(
    *centers: Sequence[float], size: Sequence[float] = (2, 1, 1), degrees: float = 0.0
) -> dict[str, Any]:
    """A target of animals of one size and heading, in metres."""
    count = len(centers)
    return {
        "center": torch.tensor(centers, dtype=F64).reshape(count, 3),
        "rotation": turned(degrees).expand(count, 3, 3),
        "size": torch.tensor(size, dtype=F64).expand(count, 3),
        "labels": torch.zeros(count, dtype=torch.int64),
        "scale_known": torch.ones(count, dtype=torch.bool),
        "K": torch.tensor([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]], dtype=F64),
    }


def detected(target: dict[str, Any], *scores: float, **fields: Any) -> dict[str, Any]:
    """A target as a detector's answer, with scores, and other fields in place of its own."""
    boxes = {name: target[name] for name in ("center", "rotation", "size", "labels")}
    return {**boxes, "scores": torch.tensor(scores, dtype=F64), **fields}

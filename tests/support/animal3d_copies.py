"""Altered copies of a synthetic Animal3D folder."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from animal3dbox.geometry.rigid_transforms import axis_angle_from_rotation, rotation_from_axis_angle
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Content = dict[str, Any]
TURN = torch.diag(torch.tensor([-1.0, -1.0, 1.0], dtype=torch.float64))
"""OpenCV's camera axes to PyTorch3D's."""


def copy_with(home: Path, target: Path, change: Callable[[Content], object]) -> Path:
    """The dataset home/animals with another train.json and no test.json, its pictures copied."""
    target.mkdir()
    for name in ("images", "masks", "rd_masks"):
        shutil.copytree(home / "animals" / name, target / name)
    content = json.loads((home / "animals" / "train.json").read_text())
    change(content)
    (target / "train.json").write_text(json.dumps(content))
    return target


def in_pytorch3d_frame(content: Content) -> None:
    """Turn each body, with its trans, into a camera frame with x to the left and y up."""
    model = load_quadruped()
    for entry in content["data"]:
        pose, betas = (
            torch.tensor(entry["pose"]),
            torch.tensor([entry["shape"] + entry["shape_extra"]], dtype=torch.float64),
        )
        root = model.J_regressor[0] @ model.shaped(betas)[0]
        entry["pose"][:3] = axis_angle_from_rotation(
            TURN @ rotation_from_axis_angle(pose[:3].double())
        ).tolist()
        entry["trans"] = (
            TURN @ (root + torch.tensor(entry["trans"], dtype=torch.float64)) - root
        ).tolist()

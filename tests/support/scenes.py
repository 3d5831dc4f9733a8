"""Targets of made-up scenes: boxes under a camera, with every field that the transforms know.

No animals.
"""

from typing import Any

import torch
from hypothesis import strategies as st
from strategies import vector
from torch import Tensor

from animal3dbox.geometry.box_visibility import corners_in_front, face_visibility
from animal3dbox.geometry.camera import intrinsics, project
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle

F64 = torch.float64
KEYPOINT_MIRROR = torch.tensor([1, 0, 2, 4, 3])


def target_of(
    box: Cuboid,
    K: Tensor,
    image_hw: tuple[int, int],
    dtype: torch.dtype = F64,
    distortion: Tensor | None = None,
) -> dict[str, Any]:
    """Every field of a target, made from boxes (N,) in the camera frame.

    Its keypoints lie in the boxes.
    """
    count = box.center.shape[0]
    seen = face_visibility(box, K, image_hw)
    corners_2d, _ = project(K, box.corners(), distortion)
    inner = torch.tensor(
        [[0.3, 0.3, 0.1], [0.3, -0.3, 0.1], [0.45, 0, 0.4], [-0.3, 0.2, -0.4], [-0.3, -0.2, -0.4]],
        dtype=F64,
    )
    world = (
        torch.stack(
            [
                rotation_from_axis_angle(torch.tensor([0.3, 0.2 * n, -0.5], dtype=F64))
                for n in range(count)
            ]
        )
        if count
        else torch.zeros(0, 3, 3, dtype=F64)
    )
    shift = box.center * 0.5
    points_cam = box.center[:, None] + (inner * box.size[:, None]) @ box.rotation.mT
    keypoints, depth = project(K, points_cam, distortion)
    target = {
        "corners_3d": box.corners(),
        "center": box.center,
        "rotation": box.rotation,
        "size": box.size,
        "distance": box.center.norm(dim=-1),
        "corners_2d": corners_2d,
        "corner_in_front": corners_in_front(box),
        "face_visible": seen.visible,
        "face_area": seen.area,
        "face_share": seen.share,
        "face_share_in_image": seen.share_in_image,
        "surface_share": seen.share.flip(-1),
        "flank": torch.where((box.rotation[:, :, 1] * box.center).sum(-1) < 0, 1, 2),
        "flank_confidence": torch.full((count,), 0.75, dtype=F64),
        "truncation": seen.truncation,
        "behind_camera": ~corners_in_front(box).all(-1),
        "K": K,
        "R": world,
        "t": shift,
        "labels": torch.arange(count),
        "keypoints": torch.cat((keypoints, (depth > 0).to(F64)[..., None]), dim=-1),
        "keypoints_3d": (points_cam - shift[:, None]) @ world,
        "vertices": (box.corners() - shift[:, None]) @ world,
        "boxes": torch.cat((corners_2d.amin(-2), corners_2d.amax(-2)), dim=-1),
        "keypoint_mirror": KEYPOINT_MIRROR,
        "image_id": "scene",
        "meta": {"quality": [{"number": n} for n in range(count)]},
    }
    if distortion is not None:
        target["distortion"] = distortion
    return {
        k: v.to(dtype) if isinstance(v, Tensor) and v.is_floating_point() else v
        for k, v in target.items()
    }


def scene(
    count: int = 2, image_hw: tuple[int, int] = (120, 160), seed: int = 0, dtype: torch.dtype = F64
) -> dict[str, Any]:
    """One scene with boxes well in front of the camera, off-centre principal point, fx != fy."""
    rng = torch.Generator().manual_seed(seed)
    center = torch.rand(count, 3, generator=rng, dtype=F64) * 2 - 1
    center[:, 2] = center[:, 2] + 6
    rotation = rotation_from_axis_angle(torch.randn(count, 3, generator=rng, dtype=F64))
    box = Cuboid(center, rotation, torch.rand(count, 3, generator=rng, dtype=F64) + 0.3)
    K = intrinsics((1.3 * image_hw[1], 1.2 * image_hw[1]), image_hw)
    K[0, 2] += 0.05 * image_hw[1]
    K[1, 2] -= 0.04 * image_hw[0]
    return target_of(box, K, image_hw, dtype)


@st.composite
def scenes(draw: st.DrawFn, anywhere: bool = False) -> tuple[dict[str, Any], tuple[int, int]]:
    """A target with up to three boxes in front of the camera, or (anywhere) before, behind and
    around it, and its image's size."""
    image_hw = (draw(st.integers(40, 600)), draw(st.integers(40, 600)))
    count = draw(st.integers(0, 3))
    size = draw(vector(0.1, 2, 3 * count)).reshape(count, 3)
    center = draw(vector(-2, 2, 3 * count)).reshape(count, 3)
    if not anywhere:
        center[:, 2] = center[:, 2] + 3.5 + size.norm(dim=-1)
    rotation = rotation_from_axis_angle(draw(vector(-3, 3, 3 * count)).reshape(count, 3))
    K = intrinsics((draw(st.floats(100, 2000)), draw(st.floats(100, 2000))), image_hw)
    K[0, 2] += draw(st.floats(-60, 60))
    K[1, 2] += draw(st.floats(-60, 60))
    return target_of(Cuboid(center, rotation, size), K, image_hw), image_hw


def training_target(
    count: int,
    image_hw: tuple[int, int],
    seed: int,
    *,
    masks: bool = False,
    dtype: torch.dtype = torch.float32,
) -> dict[str, Any]:
    """A scene as a Dataset gives it.

    Float32, boxes clipped to the frame, keypoints outside it not marked, masks inside the boxes.
    """
    target = scene(count, image_hw, seed)
    height, width = image_hw
    x, y, v = target["keypoints"].unbind(-1)
    inside = (x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5)
    target["keypoints"] = torch.stack((x, y, v * inside), dim=-1)
    low, high = (
        torch.tensor([-0.5] * 4, dtype=F64),
        torch.tensor([width - 0.5, height - 0.5] * 2, dtype=F64),
    )
    target["boxes"] = target["boxes"].clamp(low, high)
    target["image_id"] = f"scene{seed}.jpg"
    if masks:
        rows, columns = torch.arange(height)[:, None], torch.arange(width)[None]
        x1, y1, x2, y2 = (edge[:, None, None] for edge in target["boxes"].unbind(-1))
        target["masks"] = ((columns >= x1) & (columns <= x2) & (rows >= y1) & (rows <= y2)).to(
            torch.uint8
        )
    return {
        k: t.to(dtype) if isinstance(t, Tensor) and t.is_floating_point() else t
        for k, t in target.items()
    }

"""Everything that follows from the box and the camera: projections, faces, 2D box, quality; many animals at once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy, norm
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import CORNER_SIGNS, Cuboid
from animal3dbox.geometry.face_visibility import corners_visibility, near_depth_of_corners, visible_faces
from animal3dbox.labels.observation import Array, Observation
from animal3dbox.labels.pose_problem import PoseEstimate
from animal3dbox.labels.types import CuboidLabel, Quality

INLIER_PER_EXTENT = 0.1
"""A keypoint fits if it is off by less than this part of the longer side of the keypoints' box (PCK at 0.1)."""
SIGNS = np.array(CORNER_SIGNS, dtype=np.float64) / 2


@dataclass(frozen=True)
class ShownBody:
    """A body in its picture.

    Attributes:
        box: (4,) xyxy px, see CuboidLabel.box; None without a mask and vertices.
        mask_iou: None if it is not known or not asked for.
        surface_share: (6,); None likewise.
    """

    box: Tensor | None
    mask_iou: float | None
    surface_share: Tensor | None


@dataclass(frozen=True)
class Prepared:
    """An animal whose box and camera are known.

    Attributes:
        seen: the animal.
        cuboid_mesh: its box in the mesh's frame.
        pose: its camera.
        shown: what the picture shows of the body.
        orientation_rule: recorded.
        bounds_source: recorded.
        warnings: recorded.
    """

    seen: Observation
    cuboid_mesh: Cuboid
    pose: PoseEstimate
    shown: ShownBody
    orientation_rule: str
    bounds_source: str
    warnings: tuple[str, ...]


def mask_box(mask: Tensor | NDArray[np.bool_]) -> Tensor:
    """The box (4,) xyxy in px around a mask (H, W): pixels from min - 0.5 to max + 0.5."""
    inside = as_numpy(mask)
    rows = np.flatnonzero(inside.any(1))
    columns = np.flatnonzero(inside[rows[0] : rows[-1] + 1].any(0))
    return torch.tensor([columns[0] - 0.5, rows[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5], dtype=torch.float64)


def points_box(px: Tensor | Array, depth: Tensor | Array, image_hw: tuple[int, int]) -> Tensor:
    """The bounds (4,) xyxy of those of the pixels (N, 2) that are in front of the camera, held inside the frame; zeros if none is."""
    px = as_numpy(px)[as_numpy(depth) > 0]
    if not len(px):
        return torch.zeros(4, dtype=torch.float64)
    last = np.array([image_hw[1] - 0.5, image_hw[0] - 0.5])
    return torch.from_numpy(np.concatenate([np.clip(bound, -0.5, last) for bound in (px.min(0), px.max(0))]))


def assemble_labels(animals: Sequence[Prepared]) -> list[CuboidLabel]:
    """The labels of animals whose boxes and cameras are known; those of one size of image and one lens go together."""
    alike: dict[tuple[tuple[int, int], bytes | None], list[int]] = {}
    for i, animal in enumerate(animals):
        lens = animal.seen.distortion
        alike.setdefault((animal.seen.image_hw, None if lens is None else lens.tobytes()), []).append(i)
    labels: dict[int, CuboidLabel] = {}
    for indices in alike.values():
        labels |= zip(indices, _assemble_alike([animals[i] for i in indices]), strict=True)
    return [labels[i] for i in range(len(animals))]


def _assemble_alike(animals: Sequence[Prepared]) -> list[CuboidLabel]:
    """Labels of animals whose images have one size and one lens, batched (B, ...)."""
    image_hw, distortion = animals[0].seen.image_hw, animals[0].seen.distortion
    K = np.array([animal.seen.K for animal in animals])
    R, t = (np.array([x.numpy() for x in part]) for part in zip(*((a.pose.R, a.pose.t) for a in animals), strict=True))
    boxes = [animal.cuboid_mesh for animal in animals]
    size = np.array([box.size.numpy() for box in boxes])
    center = (R @ np.array([box.center.numpy() for box in boxes])[..., None])[..., 0] + t
    rotation = R @ np.array([box.rotation.numpy() for box in boxes])
    corners = center[:, None] + (SIGNS * size[:, None]) @ rotation.mT
    corners_2d, depth = project(K, corners, distortion)
    faces = corners_visibility(corners, K, image_hw, visible_faces(corners, np.zeros_like(center)), distortion)
    in_front = depth > near_depth_of_corners(corners)[:, None]
    fields = {
        "corners_3d": corners, "center": center, "rotation": rotation, "size": size, "corners_2d": corners_2d, "corner_in_front": in_front,
        "face_visible": faces.visible, "face_area": faces.area, "face_share": faces.share, "face_share_in_image": faces.share_in_image,
        "K": K, "R": R, "t": t,
    }  # fmt: skip
    return [
        CuboidLabel(
            **_own(fields, i),
            sample_id=one.seen.sample_id,
            image_hw=image_hw,
            box=one.shown.box if one.shown.box is not None else points_box(corners_2d[i], depth[i], image_hw),
            surface_share=one.shown.surface_share,
            truncation=float(faces.truncation[i]),
            behind_camera=not in_front[i].all(),
            keypoints=None if one.seen.keypoints_2d is None else torch.from_numpy(one.seen.keypoints_2d),
            cuboid_mesh=one.cuboid_mesh,
            quality=_quality(one),
            distortion=None if distortion is None else torch.from_numpy(distortion.copy()),
        )
        for i, one in enumerate(animals)
    ]


def _own(fields: Mapping[str, Any], i: int) -> dict[str, Any]:
    """One animal's fields as tensors of its own: views would keep, and pickle, the whole batch."""
    return {name: torch.from_numpy(values[i].copy()) for name, values in fields.items()}


def _quality(animal: Prepared) -> Quality:
    """How the label came about; distances are in px of the picture as it is, with its lens."""
    seen, pose = animal.seen, animal.pose
    used = seen.matched
    errors, extent = np.zeros(0), 0.0
    if seen.keypoints_2d is not None and seen.landmarks is not None and used.any():
        keypoints = seen.keypoints_2d[used, :2]
        projected, _ = project(seen.K, seen.landmarks[used] @ pose.R.numpy().T + pose.t.numpy(), seen.distortion)
        errors, extent = norm(projected - keypoints), float((keypoints.max(0) - keypoints.min(0)).max())
    return Quality(
        reprojection_error_px=float(errors.mean()) if len(errors) else None,
        n_keypoints=len(errors),
        n_inliers=int((errors < INLIER_PER_EXTENT * extent).sum()),
        mask_iou=animal.shown.mask_iou,
        orientation_rule=animal.orientation_rule,
        pose_source="estimated" if seen.pose is None else "given",
        pose_hypothesis=pose.hypothesis,
        bounds_source=animal.bounds_source,
        mask_source="none" if seen.mask is None else "dataset",
        K_source=seen.K_source,
        warnings=animal.warnings,
    )

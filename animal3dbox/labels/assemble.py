"""Everything that follows from the box and the camera: projections, faces, 2D box, quality.

Many animals at once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy, norm
from animal3dbox.geometry.box_visibility import (
    corners_visibility,
    near_depth_of_corners,
    visible_faces,
)
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import CORNER_SIGNS, Cuboid
from animal3dbox.labels.observation import Array, Observation
from animal3dbox.labels.pose.problem import PoseEstimate
from animal3dbox.labels.types import CuboidLabel, Quality

INLIER_PER_EXTENT = 0.1
"""A keypoint fits if it is off by less than this part of the longer side of the keypoints' box (PCK
at 0.1)."""
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
    inside = as_numpy(mask).view(np.uint8)
    if inside.flags.c_contiguous:
        top, bottom, left, right = _first_and_last(inside)
    else:  # such as of runs, which go down the columns
        left, right, top, bottom = _first_and_last(np.ascontiguousarray(inside.T))
    return torch.tensor([left - 0.5, top - 0.5, right + 0.5, bottom + 0.5], dtype=torch.float64)


def _first_and_last(inside: NDArray[np.uint8]) -> tuple[int, int, int, int]:
    """First and last row, first and last column of the pixels that are 1, of (H, W) 0 and 1, row by
    row in memory."""
    held, width = inside.tobytes(), inside.shape[1]
    first, last = held.find(1) // width, held.rfind(1) // width
    columns = np.bitwise_or.reduce(inside[first : last + 1], 0).tobytes()
    return first, last, columns.find(1), columns.rfind(1)


def points_box(px: Tensor | Array, depth: Tensor | Array, image_hw: tuple[int, int]) -> Tensor:
    """The bounds (4,) xyxy of those of the pixels (N, 2) that are in front of the camera, held
    inside the frame; zeros if none is."""
    px = as_numpy(px)[as_numpy(depth) > 0]
    if not len(px):
        return torch.zeros(4, dtype=torch.float64)
    last = np.array([image_hw[1] - 0.5, image_hw[0] - 0.5])
    return torch.from_numpy(
        np.concatenate([np.clip(bound, -0.5, last) for bound in (px.min(0), px.max(0))])
    )


def assemble_labels(animals: Sequence[Prepared]) -> list[CuboidLabel]:
    """The labels of animals whose boxes and cameras are known.

    Those of one size of image, one lens and as many keypoints go together.
    """
    alike: dict[tuple[tuple[int, int], bytes | None, int], list[int]] = {}
    for i, animal in enumerate(animals):
        seen, lens = animal.seen, animal.seen.distortion
        alike.setdefault(
            (seen.image_hw, None if lens is None else lens.tobytes(), len(seen.vocabulary)), []
        ).append(i)
    labels: dict[int, CuboidLabel] = {}
    for indices in alike.values():
        labels |= zip(indices, _assemble_alike([animals[i] for i in indices]), strict=True)
    return [labels[i] for i in range(len(animals))]


def _assemble_alike(animals: Sequence[Prepared]) -> list[CuboidLabel]:
    """Labels of animals whose images have one size and one lens, and that have as many keypoints,
    batched (B, ...)."""
    image_hw, distortion = animals[0].seen.image_hw, animals[0].seen.distortion
    K = np.array([animal.seen.K for animal in animals])
    R, t = (
        torch.stack(part).numpy()
        for part in zip(*((animal.pose.R, animal.pose.t) for animal in animals), strict=True)
    )
    boxes = [animal.cuboid_mesh for animal in animals]
    center, rotation, size = (
        torch.stack(part).numpy()
        for part in zip(*((box.center, box.rotation, box.size) for box in boxes), strict=True)
    )
    center, rotation = (R @ center[..., None])[..., 0] + t, R @ rotation
    corners = center[:, None] + (SIGNS * size[:, None]) @ rotation.mT
    corners_2d, depth = project(K, corners, distortion)
    faces = corners_visibility(
        corners, K, image_hw, visible_faces(corners, np.zeros_like(center)), distortion=distortion
    )
    in_front = depth > near_depth_of_corners(corners)[:, None]
    behind, truncation, fit = (
        (~in_front.all(1)).tolist(),
        faces.truncation.tolist(),
        _fit(animals, K, R, t, distortion),
    )
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
            box=(
                one.shown.box
                if one.shown.box is not None
                else points_box(corners_2d[i], depth[i], image_hw)
            ),
            surface_share=one.shown.surface_share,
            truncation=truncation[i],
            behind_camera=behind[i],
            keypoints=(
                None if one.seen.keypoints_2d is None else torch.from_numpy(one.seen.keypoints_2d)
            ),
            cuboid_mesh=one.cuboid_mesh,
            quality=_quality(one, fit.n_keypoints[i], fit.mean_px[i], fit.n_inliers[i]),
            distortion=None if distortion is None else torch.from_numpy(distortion.copy()),
        )
        for i, one in enumerate(animals)
    ]


def _own(fields: Mapping[str, Any], i: int) -> dict[str, Any]:
    """One animal's fields as tensors of its own: views would keep, and pickle, the whole batch."""
    return {name: torch.from_numpy(values[i].copy()) for name, values in fields.items()}


class _Fit(NamedTuple):
    """How well keypoints fit, of each animal (B,).

    How many count, their mean distance in px, and how many are near.
    """

    n_keypoints: list[int]
    mean_px: list[float]
    n_inliers: list[int]


def _fit(
    animals: Sequence[Prepared], K: Array, R: Array, t: Array, distortion: Array | None
) -> _Fit:
    """Distances of keypoints from their landmarks, in px of the picture as it is, with its lens."""
    nowhere = np.zeros((len(animals[0].seen.vocabulary), 3))
    used = np.array([animal.seen.matched for animal in animals])
    keypoints, landmarks = (
        np.where(
            used[..., None], np.array([nowhere if part is None else part for part in parts]), 0.0
        )
        for parts in zip(
            *((animal.seen.keypoints_2d, animal.seen.landmarks) for animal in animals), strict=True
        )
    )
    seen = keypoints[..., :2]
    projected, _ = project(K, landmarks @ R.mT + t[:, None], distortion)
    off, count = np.where(used, norm(projected - seen), 0.0), used.sum(1)
    greatest, least = (np.where(used[..., None], seen, edge) for edge in (-np.inf, np.inf))
    extent = (greatest.max(1) - least.min(1)).max(1)
    near = used & (off < INLIER_PER_EXTENT * extent[:, None])
    return _Fit(count.tolist(), (off.sum(1) / np.maximum(count, 1)).tolist(), near.sum(1).tolist())


def _quality(animal: Prepared, n_keypoints: int, mean_px: float, n_inliers: int) -> Quality:
    """How the label came about."""
    seen = animal.seen
    return Quality(
        reprojection_error_px=mean_px if n_keypoints else None,
        n_keypoints=n_keypoints,
        n_inliers=n_inliers,
        mask_iou=animal.shown.mask_iou,
        orientation_rule=animal.orientation_rule,
        pose_source="estimated" if seen.pose is None else "given",
        pose_hypothesis=animal.pose.hypothesis,
        bounds_source=animal.bounds_source,
        mask_source="none" if seen.mask is None else "dataset",
        K_source=seen.K_source,
        warnings=animal.warnings,
    )

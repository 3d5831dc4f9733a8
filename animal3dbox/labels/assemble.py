"""Everything that follows from the box and the camera: projections, faces, 2D box, quality."""

from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.face_visibility import corners_in_front, corners_visibility, near_depth, visible_faces
from animal3dbox.geometry.rigid import rigid
from animal3dbox.labels.observation import Observation
from animal3dbox.labels.pose_problem import PoseEstimate
from animal3dbox.labels.types import CuboidLabel, Quality

INLIER_PER_EXTENT = 0.1
"""A keypoint fits if it is off by less than this part of the longer side of the keypoints' box (PCK at 0.1)."""


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


def mask_box(mask: Tensor) -> Tensor:
    """The box (4,) xyxy in px around a mask (H, W): pixels from min - 0.5 to max + 0.5."""
    rows, columns = mask.any(1).nonzero()[:, 0], mask.any(0).nonzero()[:, 0]
    least = torch.stack((columns[0], rows[0])).double() - 0.5
    return torch.cat((least, torch.stack((columns[-1], rows[-1])).double() + 0.5))


def points_box(px: Tensor, depth: Tensor, image_hw: tuple[int, int]) -> Tensor:
    """The bounds (4,) xyxy of those of the pixels (N, 2) that are in front of the camera, held inside the frame; zeros if none is."""
    px = px[depth > 0]
    if not len(px):
        return torch.zeros(4, dtype=torch.float64)
    height, width = image_hw
    limit = torch.tensor([width - 0.5, height - 0.5], dtype=torch.float64)
    return torch.cat((torch.minimum(px.amin(0).clamp_min(-0.5), limit), torch.minimum(px.amax(0).clamp_min(-0.5), limit)))


def assemble_label(
    seen: Observation,
    cuboid_mesh: Cuboid,
    pose: PoseEstimate,
    shown: ShownBody,
    orientation_rule: str,
    bounds_source: str,
    warnings: tuple[str, ...],
) -> CuboidLabel:
    """The label of an animal whose box and camera are known.

    Args:
        seen: the animal.
        cuboid_mesh: its box in the mesh's frame.
        pose: its camera.
        shown: what the picture shows of the body.
        orientation_rule: recorded.
        bounds_source: recorded.
        warnings: recorded.

    """
    cuboid = cuboid_mesh.transformed(rigid(pose.R, pose.t))
    corners = cuboid.corners()
    corners_2d, depth = project(seen.K, corners, seen.distortion)
    faces = corners_visibility(corners, seen.K, seen.image_hw, visible_faces(corners, torch.zeros_like(cuboid.center)), seen.distortion)
    return CuboidLabel(
        sample_id=seen.sample_id,
        image_hw=seen.image_hw,
        corners_3d=corners,
        center=cuboid.center,
        rotation=cuboid.rotation,
        size=cuboid.size,
        corners_2d=corners_2d,
        corner_in_front=corners_in_front(cuboid),
        face_visible=faces.visible,
        face_area=faces.area,
        face_share=faces.share,
        face_share_in_image=faces.share_in_image,
        K=seen.K,
        R=pose.R,
        t=pose.t,
        box=shown.box if shown.box is not None else points_box(corners_2d, depth, seen.image_hw),
        surface_share=shown.surface_share,
        truncation=float(faces.truncation),
        behind_camera=bool((depth <= near_depth(cuboid)).any()),
        keypoints=seen.keypoints_2d,
        cuboid_mesh=cuboid_mesh,
        quality=_quality(seen, pose, shown.mask_iou, orientation_rule, bounds_source, warnings),
        distortion=seen.distortion,
    )


def _quality(
    seen: Observation, pose: PoseEstimate, mask_iou: float | None, orientation_rule: str, bounds_source: str, warnings: tuple[str, ...]
) -> Quality:
    """How the label came about; distances are in px of the picture as it is, with its lens."""
    used = seen.matched
    errors = extent = torch.zeros(0, dtype=torch.float64)
    if seen.keypoints_2d is not None and seen.landmarks is not None and bool(used.any()):
        keypoints = seen.keypoints_2d[used, :2]
        projected, _ = project(seen.K, seen.landmarks[used] @ pose.R.mT + pose.t, seen.distortion)
        errors, extent = torch.linalg.vector_norm(projected - keypoints, dim=-1), (keypoints.amax(0) - keypoints.amin(0)).amax()
    return Quality(
        reprojection_error_px=float(errors.mean()) if len(errors) else None,
        n_keypoints=len(errors),
        n_inliers=int((errors < INLIER_PER_EXTENT * extent).sum()) if len(errors) else 0,
        mask_iou=mask_iou,
        orientation_rule=orientation_rule,
        pose_source="estimated" if seen.pose is None else "given",
        pose_hypothesis=pose.hypothesis,
        bounds_source=bounds_source,
        mask_source="none" if seen.mask is None else "dataset",
        K_source=seen.K_source,
        warnings=warnings,
    )

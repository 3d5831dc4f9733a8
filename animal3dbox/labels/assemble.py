"""Everything that follows from the box and the camera: projections, faces, 2D box, quality."""

import torch
from torch import Tensor

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.face_visibility import corners_in_front, face_visibility, near_depth
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.geometry.rigid import rigid, transform_points
from animal3dbox.labels.observation import Observation
from animal3dbox.labels.pose_problem import PoseEstimate, PoseProblem, reprojection_errors
from animal3dbox.labels.seen_surface import surface_share
from animal3dbox.labels.types import CuboidLabel, Quality

INLIER_PER_EXTENT = 0.1
"""A keypoint fits if it is off by less than this part of the longer side of the keypoints' box (PCK at 0.1)."""


def mask_box(mask: Tensor) -> Tensor:
    """The box (4,) xyxy in px around a mask (H, W): pixels from min - 0.5 to max + 0.5."""
    rows, columns = mask.any(1).nonzero()[:, 0], mask.any(0).nonzero()[:, 0]
    least = torch.stack((columns[0], rows[0])).double() - 0.5
    return torch.cat((least, torch.stack((columns[-1], rows[-1])).double() + 0.5))


def _extent(points_px: Tensor) -> float:
    """The longer side of the points' box, in px; 0 without points."""
    return float((points_px.amax(0) - points_px.amin(0)).amax()) if len(points_px) else 0.0


def mask_overlap(a: Tensor, b: Tensor) -> float:
    """Intersection over union of two masks (H, W) bool; 0 if both are empty."""
    union = int((a | b).sum())
    return int((a & b).sum()) / union if union else 0.0


def assemble_label(
    seen: Observation,
    cuboid_mesh: Cuboid,
    pose: PoseEstimate,
    problem: PoseProblem,
    orientation_rule: str,
    bounds_source: str,
    warnings: tuple[str, ...],
) -> CuboidLabel:
    """The label of an animal whose box and camera are known.

    Args:
        seen: the animal.
        cuboid_mesh: its box in the mesh's frame.
        pose: its camera.
        problem: the visible keypoints and their landmarks, for the residuals.
        orientation_rule: recorded.
        bounds_source: recorded.
        warnings: recorded.

    """
    T_cam_world = rigid(pose.R, pose.t)
    cuboid = cuboid_mesh.transformed(T_cam_world)
    corners = cuboid.corners()
    corners_2d, depth = project(seen.K, corners)
    faces = face_visibility(cuboid, seen.K, seen.image_hw)
    drawn = shares = None
    if seen.vertices is not None and seen.faces is not None:
        vertices_cam = transform_points(T_cam_world, seen.vertices)
        drawn = silhouette(vertices_cam, seen.faces, seen.K, seen.image_hw)
        shares = surface_share(vertices_cam, seen.faces, cuboid.rotation, seen.K, seen.image_hw)
    errors = reprojection_errors(problem, pose.R, pose.t)[0]
    quality = Quality(
        reprojection_error_px=float(errors.mean()) if len(errors) else None,
        n_keypoints=len(errors),
        n_inliers=int((errors < INLIER_PER_EXTENT * _extent(problem.points_px)).sum()),
        mask_iou=None if drawn is None or seen.mask is None else mask_overlap(drawn, seen.mask),
        orientation_rule=orientation_rule,
        pose_source="estimated" if seen.pose is None else "given",
        pose_hypothesis=pose.hypothesis,
        bounds_source=bounds_source,
        mask_source="none" if seen.mask is None else "dataset",
        K_source=seen.K_source,
        warnings=warnings,
    )
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
        box=_box_2d(seen, T_cam_world, drawn, corners),
        surface_share=shares,
        truncation=float(faces.truncation),
        behind_camera=bool((depth <= near_depth(cuboid)).any()),
        keypoints=seen.keypoints_2d,
        cuboid_mesh=cuboid_mesh,
        quality=quality,
    )


def _box_2d(seen: Observation, T_cam_world: Tensor, drawn: Tensor | None, corners_cam: Tensor) -> Tensor:
    """The flat box (4,) xyxy px: of the mask, else of the mesh as drawn, else of the projected points inside the frame."""
    if seen.mask is not None:
        return mask_box(seen.mask)
    if drawn is not None and bool(drawn.any()):
        return mask_box(drawn)
    points_cam = corners_cam if seen.vertices is None else transform_points(T_cam_world, seen.vertices)
    px, depth = project(seen.K, points_cam)
    px = px[depth > 0]
    if not len(px):
        return torch.zeros(4, dtype=torch.float64)
    height, width = seen.image_hw
    limit = torch.tensor([width - 0.5, height - 0.5], dtype=torch.float64)
    return torch.cat((torch.minimum(px.amin(0).clamp_min(-0.5), limit), torch.minimum(px.amax(0).clamp_min(-0.5), limit)))

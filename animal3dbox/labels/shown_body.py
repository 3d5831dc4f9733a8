"""What the picture shows of the body itself under a camera: its flat box, its overlap with the mask, its visible surface."""

import torch
from torch import Tensor

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.distortion import bent_points
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.labels.assemble import ShownBody, mask_box, points_box
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.observation import Observation
from animal3dbox.labels.pose_problem import PoseEstimate
from animal3dbox.labels.seen_surface import surface_share


def mask_overlap(a: Tensor, b: Tensor) -> float:
    """Intersection over union of two masks (H, W) bool; 0 if both are empty."""
    union = int((a | b).sum())
    return int((a & b).sum()) / union if union else 0.0


def shown_body(seen: Observation, pose: PoseEstimate, R_box: Tensor, config: LabelConfig) -> ShownBody:
    """The body under a camera; nothing is drawn unless the configuration or a box that the frame cuts needs it.

    Args:
        seen: the animal.
        pose: its camera.
        R_box: (3, 3) its axes, R_world_box.
        config: surface_share and mask_iou.

    """
    box = None if seen.mask is None else mask_box(seen.mask)
    if seen.vertices is None:
        return ShownBody(box, None, None)
    vertices_cam = seen.vertices @ pose.R.mT + pose.t
    overlap = shares = None
    if seen.faces is not None:
        straight = bent_points(vertices_cam, seen.distortion)
        if seen.mask is not None and config.mask_iou:
            overlap = mask_overlap(silhouette(straight, seen.faces, seen.K, seen.image_hw), seen.mask)
        if config.surface_share:
            shares = surface_share(vertices_cam, seen.faces, pose.R @ R_box, seen.K, seen.image_hw, straight)
    return ShownBody(box if box is not None else _mesh_box(seen, vertices_cam), overlap, shares)


def _mesh_box(seen: Observation, vertices_cam: Tensor) -> Tensor:
    """The flat box (4,) xyxy px of a body without a mask: its bounds, as drawn where the frame cuts it."""
    px, depth = project(seen.K, vertices_cam, seen.distortion)
    beyond = torch.tensor([seen.image_hw[1] - 0.5, seen.image_hw[0] - 0.5], dtype=torch.float64)
    if seen.faces is not None and not bool(((px >= -0.5) & (px <= beyond) & (depth[:, None] > 0)).all()):
        drawn = silhouette(bent_points(vertices_cam, seen.distortion), seen.faces, seen.K, seen.image_hw)
        if bool(drawn.any()):
            return mask_box(drawn)
    return points_box(px, depth, seen.image_hw)

"""What the picture shows of the body itself under a camera: its flat box, its overlap with the mask, its visible surface."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.distortion import bent_points
from animal3dbox.geometry.mesh_bounds import bounds_in_frame, frame_box
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.labels.assemble import ShownBody, mask_box, points_box
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.observation import Array, Observation
from animal3dbox.labels.pose_problem import PoseEstimate
from animal3dbox.labels.seen_surface import surface_share


def mask_overlap(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    """Intersection over union of two masks (H, W); 0 if both are empty."""
    shared = np.count_nonzero(a & b)
    union = np.count_nonzero(a) + np.count_nonzero(b) - shared
    return float(shared / union) if union else 0.0


def shown_body(seen: Observation, pose: PoseEstimate, R_box: Tensor, box: Tensor | None, config: LabelConfig) -> ShownBody:
    """The body under a camera; nothing is drawn unless the configuration asks for it, or the body reaches behind the camera.

    Args:
        seen: the animal.
        pose: its camera.
        R_box: (3, 3) its axes, R_world_box.
        box: (4,) xyxy px of its mask; None without one.
        config: surface_share and mask_iou.

    """
    wants_overlap = seen.mask is not None and config.mask_iou
    draws = seen.faces is not None and (wants_overlap or config.surface_share)
    if seen.vertices is None or (box is not None and not draws):
        return ShownBody(box, None, None)
    vertices_cam = pose.R.numpy() @ seen.vertices.T
    vertices_cam += pose.t.numpy()[:, None]
    vertices_cam = vertices_cam.T
    overlap = shares = None
    if seen.faces is not None and draws:
        straight = bent_points(vertices_cam, seen.distortion)
        if seen.mask is not None and config.mask_iou:
            overlap = mask_overlap(_drawn(seen, straight, seen.faces), seen.mask)
        if config.surface_share:
            mesh = torch.from_numpy(vertices_cam), seen.faces
            shares = surface_share(*mesh, pose.R @ R_box, torch.from_numpy(seen.K), seen.image_hw, torch.from_numpy(straight))
    return ShownBody(box if box is not None else _mesh_box(seen, vertices_cam), overlap, shares)


def _drawn(seen: Observation, straight: Array, faces: Tensor) -> NDArray[np.bool_]:
    """The silhouette (H, W) of vertices (V, 3) where a pinhole shows them."""
    return silhouette(torch.from_numpy(straight), faces, torch.from_numpy(seen.K), seen.image_hw).numpy()


def _mesh_box(seen: Observation, vertices_cam: Array) -> Tensor:
    """The flat box (4,) xyxy px of a body without a mask: the bounds of what the frame shows of it."""
    straight, frame = bent_points(vertices_cam, seen.distortion).T, frame_box(seen.image_hw)
    if straight[2].min() > 0:
        px = seen.K[:2] @ straight
        px /= straight[2]
        bounds = np.concatenate((px.min(1), px.max(1)))
        if (bounds[:2] >= frame[:2]).all() and (bounds[2:] <= frame[2:]).all():
            return torch.from_numpy(bounds)
        if seen.faces is not None and (inside := bounds_in_frame(px, seen.faces, frame)) is not None:
            return torch.from_numpy(inside)
    elif seen.faces is not None and (drawn := _drawn(seen, straight.T, seen.faces)).any():
        return mask_box(drawn)
    return points_box(*project(seen.K, vertices_cam, seen.distortion), seen.image_hw)

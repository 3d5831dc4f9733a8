"""What the picture shows of the body itself under a camera.

Its flat box, its overlap with the mask, its visible surface.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.distortion import bent_points
from animal3dbox.geometry.frame import frame_box
from animal3dbox.geometry.mesh_bounds import bounds_in_frame
from animal3dbox.geometry.rasterizer import covered_part
from animal3dbox.labels.assemble import ShownBody, mask_box, points_box
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.observation import Array, Observation
from animal3dbox.labels.pose.problem import PoseEstimate
from animal3dbox.labels.visibility.visible_surface import surface_share


def mask_overlap(
    part: NDArray[np.bool_], place: tuple[slice, slice], mask: NDArray[np.bool_]
) -> float:
    """Intersection over union of a drawn part (h, w) at its place in the frame and a mask (H, W).

    0 if both are empty.
    """
    shared = np.count_nonzero(part & mask[place])
    union = np.count_nonzero(part) + np.count_nonzero(mask) - shared
    return float(shared / union) if union else 0.0


def shown_body(
    seen: Observation, pose: PoseEstimate, R_box: Tensor, box: Tensor | None, config: LabelConfig
) -> ShownBody:
    """The body under a camera.

    Nothing is drawn unless the configuration asks for it, or the body reaches behind the camera.

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
    overlap = shares = None
    if seen.faces is not None and draws:
        vertices_cam = _in_camera(pose.R.numpy(), pose.t.numpy(), seen.vertices)
        straight = bent_points(vertices_cam, seen.distortion)
        if seen.mask is not None and config.mask_iou:
            overlap = mask_overlap(
                *covered_part(straight, seen.faces, seen.K, seen.image_hw), seen.mask
            )
        if config.surface_share:
            mesh = torch.from_numpy(vertices_cam), seen.faces
            shares = surface_share(
                *mesh,
                pose.R @ R_box,
                torch.from_numpy(seen.K),
                seen.image_hw,
                torch.from_numpy(straight),
            )
    return ShownBody(
        box if box is not None else _mesh_box(seen, seen.vertices, pose), overlap, shares
    )


def _in_camera(R: Array, t: Array, vertices: Array) -> Array:
    """Vertices (V, 3) turned and moved; R may be K @ R and t K @ t."""
    moved: Array = R @ vertices.T
    moved += t[:, None]
    return moved.T


def _mesh_box(seen: Observation, vertices: Array, pose: PoseEstimate) -> Tensor:
    """The flat box (4,) xyxy px of a body (V, 3) without a mask.

    The bounds of what the frame shows of it.
    """
    K, R, t = seen.K, pose.R.numpy(), pose.t.numpy()
    if seen.distortion is None:
        scaled = _in_camera(K @ R, K @ t, vertices).T
    else:
        scaled = K @ bent_points(_in_camera(R, t, vertices), seen.distortion).T
    if scaled[2].min() > 0:
        px = scaled[:2]
        px /= scaled[2]
        bounds, frame = np.concatenate((px.min(1), px.max(1))), frame_box(seen.image_hw)
        (left, top, right, bottom), (first_x, first_y, last_x, last_y) = (
            bounds.tolist(),
            frame.tolist(),
        )
        if left >= first_x and top >= first_y and right <= last_x and bottom <= last_y:
            return torch.from_numpy(bounds)
        if (
            seen.faces is not None
            and (inside := bounds_in_frame(px, seen.faces, frame)) is not None
        ):
            return torch.from_numpy(inside)
    vertices_cam = _in_camera(R, t, vertices)
    if seen.faces is not None and scaled[2].min() <= 0:
        part, (rows, columns) = covered_part(
            bent_points(vertices_cam, seen.distortion), seen.faces, K, seen.image_hw
        )
        if part.any():
            return mask_box(part) + torch.tensor(
                [columns.start, rows.start, columns.start, rows.start]
            )
    return points_box(*project(K, vertices_cam, seen.distortion), seen.image_hw)

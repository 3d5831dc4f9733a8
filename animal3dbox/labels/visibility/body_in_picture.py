"""What the picture shows of the body itself under a camera.

Its flat box, its overlap with the mask, its visible surface.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.distortion import bent_points
from animal3dbox.geometry.frame import frame_box
from animal3dbox.geometry.mesh_bounds import bounds_in_frame
from animal3dbox.geometry.pixel_boxes import mask_box, points_box
from animal3dbox.geometry.rasterizer import covered_part
from animal3dbox.geometry.visible_surface import surface_share
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.observation import Observation
from animal3dbox.labels.pose.problem import PoseEstimate

Array = NDArray[np.float64]


class BodyInPicture(NamedTuple):
    """What the picture shows of a body under a camera.

    Attributes:
        box: (4,) xyxy px, see CuboidLabel.box; None without a mask and vertices.
        mask_iou: overlap of the drawn body with the mask; None if it is not known or not asked for.
        mask_coverage: part of the mask that the drawn body covers; None likewise.
        surface_share: (6,); None likewise.
    """

    box: Array | None
    mask_iou: float | None = None
    mask_coverage: float | None = None
    surface_share: Array | None = None


def mask_overlap(
    part: NDArray[np.bool_], place: tuple[slice, slice], mask: NDArray[np.bool_]
) -> float:
    """Intersection over union of a drawn part (h, w) at its place in the frame and a mask (H, W).

    0 if both are empty.
    """
    shared = np.count_nonzero(part & mask[place])
    union = np.count_nonzero(part) + np.count_nonzero(mask) - shared
    return float(shared / union) if union else 0.0


def mask_coverage(
    part: NDArray[np.bool_], place: tuple[slice, slice], mask: NDArray[np.bool_]
) -> float:
    """The part of a mask (H, W) that a drawn part (h, w) at its place in the frame covers.

    What hides an animal is cut out of its mask, and so lowers the overlap, but not the coverage. 1
    if the mask is empty.
    """
    count = np.count_nonzero(mask)
    return float(np.count_nonzero(part & mask[place]) / count) if count else 1.0


def body_in_picture(
    observation: Observation,
    pose: PoseEstimate,
    *,
    R_box: Array,
    box: Array | None,
    config: LabelConfig,
) -> BodyInPicture:
    """What the picture shows of a body under a camera.

    Nothing is drawn unless the configuration asks for it, or the body reaches behind the camera.

    Args:
        observation: the animal.
        pose: its camera.
        R_box: (3, 3) its axes, R_world_box.
        box: (4,) xyxy px of its mask; None without one.
        config: surface_share and mask_iou.

    """
    vertices, faces, mask = observation.body.vertices, observation.body.faces, observation.mask
    wants_overlap = mask is not None and config.mask_iou
    draws = faces is not None and (wants_overlap or config.surface_share)
    if vertices is None or (box is not None and not draws):
        return BodyInPicture(box)
    overlap = coverage = shares = None
    if faces is not None and draws:
        vertices_cam = _in_camera(pose.R, pose.t, vertices)
        straight = bent_points(vertices_cam, observation.distortion)
        K, image_hw = observation.K, observation.image_hw
        if mask is not None and config.mask_iou:
            drawn = covered_part(straight, faces, K, image_hw)
            overlap, coverage = mask_overlap(*drawn, mask), mask_coverage(*drawn, mask)
        if config.surface_share:
            shares = surface_share(
                vertices_cam, faces, pose.R @ R_box, K=K, image_hw=image_hw, bent=straight
            )
    if box is None:
        box = _mesh_box(observation, vertices, pose)
    return BodyInPicture(box, overlap, coverage, shares)


def _in_camera(R: Array, t: Array, vertices: Array) -> Array:
    """Vertices (V, 3) turned and moved; R may be K @ R and t K @ t."""
    moved: Array = R @ vertices.T
    moved += t[:, None]
    return moved.T


def _mesh_box(observation: Observation, vertices: Array, pose: PoseEstimate) -> Array:
    """The flat box (4,) xyxy px of a body (V, 3) without a mask.

    The bounds of what the frame shows of it.
    """
    K, R, t, faces = observation.K, pose.R, pose.t, observation.body.faces
    lens, image_hw = observation.distortion, observation.image_hw
    if lens is None:
        scaled = _in_camera(K @ R, K @ t, vertices).T
    else:
        scaled = K @ bent_points(_in_camera(R, t, vertices), lens).T
    if scaled[2].min() > 0:
        px = scaled[:2]
        px /= scaled[2]
        bounds, frame = np.concatenate((px.min(1), px.max(1))), frame_box(image_hw)
        (left, top, right, bottom), (first_x, first_y, last_x, last_y) = (
            bounds.tolist(),
            frame.tolist(),
        )
        if left >= first_x and top >= first_y and right <= last_x and bottom <= last_y:
            return bounds
        if faces is not None and (inside := bounds_in_frame(px, faces, frame)) is not None:
            return inside
    vertices_cam = _in_camera(R, t, vertices)
    if faces is not None and scaled[2].min() <= 0:
        part, (rows, columns) = covered_part(bent_points(vertices_cam, lens), faces, K, image_hw)
        if part.any():
            offset = np.array([columns.start, rows.start, columns.start, rows.start])
            box: Array = mask_box(part) + offset
            return box
    return points_box(*project(K, vertices_cam, lens), image_hw)

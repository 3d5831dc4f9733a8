"""The look of cuboids in their images: projections, upright boxes round them, truncation.

Readers check a file's 2D boxes with it, writers write them.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.readers.cuboid_conventions import Floats
from animal3dbox.datasets.records import CuboidRecord
from animal3dbox.geometry.box_visibility import (
    corners_visibility,
    near_depth_of_corners,
    projected_faces,
    visible_faces,
)
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import CORNER_SIGNS
from animal3dbox.geometry.polygon import clip_by_plane

AT_ONCE = 8192
"""Number of boxes whose faces are clipped together; each takes about 5 kB."""


@dataclass(frozen=True)
class VisibleBoxes:
    """The projections of N boxes into their N images, in our frames, corner order and pixels.

    Attributes:
        corners_3d: (N, 8, 3) camera frame.
        corners_2d: (N, 8, 2) px; meaningless where corner_in_front is false.
        corner_in_front: (N, 8).
        projected: (N, 4) xyxy px round the whole projection; NaN if a corner is not in front.
        in_frame: (N, 4) xyxy px round the part of the projection in the frame; NaN if there is
            none.
        truncation: (N,) part of the projected box outside the frame, 0 to 1.
    """

    corners_3d: Floats
    corners_2d: Floats
    corner_in_front: NDArray[np.bool_]
    projected: Floats
    in_frame: Floats
    truncation: Floats

    @property
    def behind_camera(self) -> NDArray[np.bool_]:
        """(N,) whether some corner of a box is not in front of the camera."""
        return np.asarray(~self.corner_in_front.all(-1))


def stacked_boxes(records: Sequence[CuboidRecord]) -> tuple[Floats, Floats, Floats]:
    """The centers (N, 3), rotations (N, 3, 3) and sizes (N, 3) of records."""
    if not records:
        return np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3))
    return (
        np.stack([r.center for r in records]),
        np.stack([r.rotation for r in records]),
        np.stack([r.size for r in records]),
    )


def visible_boxes(records: Sequence[CuboidRecord]) -> VisibleBoxes:
    """The projections of the boxes of records into their images."""
    count = len(records)
    center, rotation, size = stacked_boxes(records)
    offsets = np.array(CORNER_SIGNS) * size[:, None] / 2
    corners = center[:, None] + offsets @ rotation.swapaxes(-1, -2)
    K = np.stack([r.K for r in records]) if records else np.zeros((0, 3, 3))
    px = project(K, corners)[0] if count else np.zeros((0, 8, 2))
    in_front = corners[..., 2] > near_depth_of_corners(corners)[:, None]
    projected = np.concatenate((px.min(1), px.max(1)), axis=-1) if count else np.zeros((0, 4))
    projected[~in_front.all(-1)] = np.nan
    in_frame, truncation = np.full((count, 4), np.nan), np.zeros(count)
    for image_hw, members in _by_size(records):
        in_frame[members] = _bounds_in_frame(corners[members], K[members], image_hw)
        faces = visible_faces(corners[members], np.zeros((len(members), 3)))
        visibility = corners_visibility(corners[members], K[members], image_hw, faces)
        truncation[members] = visibility.truncation
    truncation[~in_front.any(-1)] = 1.0  # a box behind the camera is not in the picture
    return VisibleBoxes(
        corners_3d=corners,
        corners_2d=px,
        corner_in_front=in_front,
        projected=projected,
        in_frame=in_frame,
        truncation=truncation,
    )


def stated_truncation(record: CuboidRecord, visible: VisibleBoxes, index: int) -> float:
    """The truncation of a record by its dataset, else that of its projected box.

    Args:
        record: the box.
        visible: of several boxes.
        index: the record's place among them.

    """
    return float(visible.truncation[index]) if record.truncation is None else record.truncation


def _by_size(records: Sequence[CuboidRecord]) -> Iterator[tuple[tuple[int, int], list[int]]]:
    """Image sizes with the indices of their records, at most AT_ONCE at a time."""
    members: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    for index, record in enumerate(records):
        members[record.image_hw].append(index)
    for image_hw, indices in members.items():
        for start in range(0, len(indices), AT_ONCE):
            yield image_hw, indices[start : start + AT_ONCE]


def _bounds_in_frame(corners: Floats, K: Floats, image_hw: tuple[int, int]) -> Floats:
    """Upright boxes (n, 4) round the part of the faces in the frame, cut at the near plane.

    They are NaN where the frame shows nothing of a box.
    """
    faces = torch.from_numpy(projected_faces(corners, K))
    height, width = image_hw
    for axis, low, high in ((0, -0.5, width - 0.5), (1, -0.5, height - 0.5)):
        faces = clip_by_plane(faces, faces[..., axis] - low)
        faces = clip_by_plane(faces, high - faces[..., axis])
    points = faces.flatten(-3, -2).numpy()
    # A face that is clipped away, or not visible, has all its points at (0, 0).
    has_area = ~(faces == 0).all(-1).all(-1, keepdim=True)
    in_face = has_area.expand(faces.shape[:-1]).flatten(-2).numpy()[..., None]
    low_px = np.where(in_face, points, np.inf).min(-2)
    high_px = np.where(in_face, points, -np.inf).max(-2)
    bounds = np.concatenate((low_px, high_px), axis=-1)
    empty = ~in_face.any((-1, -2)) | ((high_px - low_px).min(-1) <= 0)
    bounds[empty] = np.nan
    return np.asarray(bounds)

"""How cuboids look in their images: projections, upright boxes round them, truncation.

What several formats ask for.
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
"""Boxes whose faces are clipped together: about 5 kB each."""


@dataclass(frozen=True)
class SeenBoxes:
    """What N cameras see of N boxes, in our frames, corner order and pixels.

    Attributes:
        corners_3d: (N, 8, 3) camera frame.
        corners_2d: (N, 8, 2) px; meaningless where corner_in_front is false.
        corner_in_front: (N, 8).
        projected: (N, 4) xyxy px round the whole projection; NaN if a corner is not in front.
        in_frame: (N, 4) xyxy px round what of the projection lies in the frame; NaN if nothing
            does.
        truncation: (N,) part of the projected box outside the frame.
    """

    corners_3d: Floats
    corners_2d: Floats
    corner_in_front: NDArray[np.bool_]
    projected: Floats
    in_frame: Floats
    truncation: Floats

    @property
    def behind_camera(self) -> NDArray[np.bool_]:
        """Whether some corner is not in front, (N,)."""
        return np.asarray(~self.corner_in_front.all(-1))


def stacked_boxes(records: Sequence[CuboidRecord]) -> tuple[Floats, Floats, Floats]:
    """Centers (N, 3), rotations (N, 3, 3) and sizes (N, 3) of records."""
    if not records:
        return np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3))
    return (
        np.stack([r.center for r in records]),
        np.stack([r.rotation for r in records]),
        np.stack([r.size for r in records]),
    )


def seen_boxes(records: Sequence[CuboidRecord]) -> SeenBoxes:
    """How the boxes of records look in their images."""
    count = len(records)
    center, rotation, size = stacked_boxes(records)
    corners = center[:, None] + (np.array(CORNER_SIGNS) * size[:, None] / 2) @ rotation.swapaxes(
        -1, -2
    )
    K = np.stack([r.K for r in records]) if records else np.zeros((0, 3, 3))
    px = project(K, corners)[0] if count else np.zeros((0, 8, 2))
    in_front = corners[..., 2] > near_depth_of_corners(corners)[:, None]
    projected = np.concatenate((px.min(1), px.max(1)), axis=-1) if count else np.zeros((0, 4))
    projected[~in_front.all(-1)] = np.nan
    in_frame, truncation = np.full((count, 4), np.nan), np.zeros(count)
    for image_hw, members in _by_size(records):
        in_frame[members] = _bounds_in_frame(corners[members], K[members], image_hw)
        visible = visible_faces(corners[members], np.zeros((len(members), 3)))
        truncation[members] = corners_visibility(
            corners[members], K[members], image_hw, visible
        ).truncation
    truncation[~in_front.any(-1)] = 1.0  # nothing of it is in the picture
    return SeenBoxes(corners, px, in_front, projected, in_frame, truncation)


def stated_truncation(record: CuboidRecord, seen: SeenBoxes, index: int) -> float:
    """The truncation that a dataset says, else that of the projected box."""
    return float(seen.truncation[index]) if record.truncation is None else record.truncation


def _by_size(records: Sequence[CuboidRecord]) -> Iterator[tuple[tuple[int, int], list[int]]]:
    """Records of images of one size together, at most AT_ONCE of them."""
    members: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
    for index, record in enumerate(records):
        members[record.image_hw].append(index)
    for image_hw, indices in members.items():
        for start in range(0, len(indices), AT_ONCE):
            yield image_hw, indices[start : start + AT_ONCE]


def _bounds_in_frame(corners: Floats, K: Floats, image_hw: tuple[int, int]) -> Floats:
    """Upright boxes (n, 4) round what the frame shows of the faces, cut at the near plane.

    NaN where it shows nothing.
    """
    faces = torch.from_numpy(projected_faces(corners, K))
    height, width = image_hw
    for axis, low, high in ((0, -0.5, width - 0.5), (1, -0.5, height - 0.5)):
        faces = clip_by_plane(faces, faces[..., axis] - low)
        faces = clip_by_plane(faces, high - faces[..., axis])
    points = faces.flatten(-3, -2).numpy()
    kept = (
        (~(faces == 0).all(-1).all(-1, keepdim=True))
        .expand(faces.shape[:-1])
        .flatten(-2)
        .numpy()[..., None]
    )
    nothing = ~kept.any((-1, -2))
    low_px, high_px = (
        np.where(kept, points, np.inf).min(-2),
        np.where(kept, points, -np.inf).max(-2),
    )
    bounds = np.concatenate((low_px, high_px), axis=-1)
    bounds[nothing | ((high_px - low_px).min(-1) <= 0)] = np.nan
    return np.asarray(bounds)

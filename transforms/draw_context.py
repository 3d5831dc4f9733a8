"""The picture as it is by then, which a transform may look at when it draws.

Its size, its camera and its boxes, after the steps that the transforms before it drew.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from animal3dbox.geometry.arrays import as_numpy, rows_at
from animal3dbox.geometry.box_visibility import (
    QUADS,
    near_depth_of_corners,
    projected_faces,
    visible_faces,
)
from animal3dbox.geometry.homography import CameraUpdate, update_camera
from animal3dbox.geometry.polygon import area_in_box, polygon_area
from animal3dbox.transforms.camera_law.fields import Fields
from animal3dbox.transforms.camera_law.law import cuboid_corners
from animal3dbox.transforms.steps import IDENTITY, Keep, Step, Warp


@dataclass(frozen=True)
class DrawContext:
    """The picture after the steps drawn so far; nothing has been rendered yet.

    Everything but the size is computed when it is first asked for: most transforms draw from the
    size alone.

    Attributes:
        image_hw: height and width by now.
        H_out_in: (3, 3) all maps so far.
        values: the target's camera and boxes as they came.
        alive: indices of the animals that no step has dropped.
        count: of all animals.
        first_hw: height and width of the picture before any step.
    """

    image_hw: tuple[int, int]
    H_out_in: np.ndarray
    values: Mapping[str, np.ndarray]
    alive: tuple[int, ...]
    count: int
    first_hw: tuple[int, int]

    @staticmethod
    def of(image_hw: tuple[int, int], fields: Fields) -> "DrawContext":
        """The picture before any step."""
        names = ("K", "corners_3d", "center", "rotation", "size", "face_visible")
        arrays = {name: as_numpy(fields.values[name]) for name in names if name in fields.values}
        return DrawContext(
            image_hw, IDENTITY, arrays, tuple(range(fields.count)), fields.count, image_hw
        )

    def before(self) -> "DrawContext":
        """The picture before any step, with the animals that no step has left out so far."""
        return replace(self, image_hw=self.first_hw, H_out_in=IDENTITY)

    def after(self, step: Step) -> "DrawContext":
        """The picture after one more step."""
        if isinstance(step, Warp):
            return replace(self, image_hw=step.image_hw, H_out_in=step.H_out_in @ self.H_out_in)
        return replace(self, alive=step.indices) if isinstance(step, Keep) else self

    @cached_property
    def camera(self) -> CameraUpdate[np.ndarray] | None:
        """The camera after the steps, and the turn Q of its frame; None without K."""
        return update_camera(self.H_out_in, self.values["K"]) if "K" in self.values else None

    @cached_property
    def K(self) -> np.ndarray | None:
        """Intrinsics (3, 3) by now, or None."""
        if "K" not in self.values:
            return None
        (a, b, _), (c, d, _), (e, f, _) = self.H_out_in.tolist()
        # A fast path, equal to the camera law's K: flips, crops and resizes keep the camera's axes
        # but for their signs, and need no RQ decomposition (benchmarks/augment.py, all targets).
        if b == c == e == f == 0:
            K: np.ndarray = (
                self.H_out_in
                @ self.values["K"]
                * np.array([math.copysign(1, a), math.copysign(1, d), 1])
            )
            K /= K[2, 2]
            return K
        return None if self.camera is None else self.camera.K

    @cached_property
    def corners_cam(self) -> np.ndarray | None:
        """Corners (N, 8, 3) in the camera frame by now, of the animals that are alive.

        None without boxes or camera. After a mirror they carry their old names, which no drawing
        depends on.
        """
        corners = self._first_corners()
        if corners is None or self.camera is None:
            return None
        in_new_camera: np.ndarray = corners @ self.camera.Q.mT
        return in_new_camera

    def in_front(self) -> np.ndarray:
        """Which animals lie entirely in front of the camera, (N,) bool; none without cuboids."""
        if self.corners_cam is None:
            return np.zeros(0, dtype=bool)
        return np.asarray(
            (self.corners_cam[..., 2] > near_depth_of_corners(self.corners_cam)[:, None]).all(-1)
        )

    @cached_property
    def _outlines(self) -> np.ndarray | None:
        """The hidden faces of the boxes in px (N, 6, P, 2), the visible ones collapsed to a point.

        Together they tile the silhouettes.
        """
        quads = self._projected_faces()
        if quads is None:
            return None
        if "face_visible" in self.values:  # the camera centre does not move
            visible = self.values["face_visible"][list(self.alive)] != 0
        else:
            corners = self._first_corners()
            visible = visible_faces(corners, np.zeros_like(corners[:, 0]))
        return np.where(visible[..., None, None], quads[..., :1, :], quads)

    def _projected_faces(self) -> np.ndarray | None:
        """The faces of the boxes in px (N, 6, P, 2) by now; None without cuboids or camera.

        With H K = k K' Q a corner X is projected to H K X, and its depth is w / k, w being the
        last coordinate and k the norm of the last row of H K: no decomposition is needed but where
        a box is cut by the near plane.
        """
        corners = self._first_corners()
        if corners is None or "K" not in self.values:
            return None
        HK = self.H_out_in @ self.values["K"]
        projected = corners @ HK.T
        w = projected[..., 2]
        if (w > near_depth_of_corners(corners)[:, None] * math.hypot(*HK[2].tolist())).all():
            faces: np.ndarray = rows_at(projected[..., :2] / w[..., None], QUADS)
            return faces
        if self.corners_cam is None or self.camera is None:
            return None
        return projected_faces(self.corners_cam, self.camera.K)

    def _first_corners(self) -> Any:
        """Corners (N, 8, 3) of the animals that are alive, in the frame of the camera before.

        None without cuboids.
        """
        corners = cuboid_corners(dict(self.values))
        return None if corners is None else corners[list(self.alive)]

    @property
    def _frame(self) -> np.ndarray:
        height, width = self.image_hw
        return np.array([-0.5, -0.5, width - 0.5, height - 0.5])

    def parts_in_picture(self) -> np.ndarray | None:
        """How much of each animal's silhouette lies in the picture, (N,) in [0, 1].

        0 without a silhouette; None without cuboids.
        """
        if self._outlines is None:
            return None
        whole = polygon_area(self._outlines).sum(-1)
        inside = area_in_box(self._outlines, self._frame).sum(-1)
        parts: np.ndarray = inside / (whole + (whole <= 0))
        return parts

    def visible_parts(self, boxes: np.ndarray) -> np.ndarray | None:
        """The part of each animal in the picture that some upright boxes show, such as crops.

        Args:
            boxes: (M, 4) px.

        Returns:
            (M, N) in [0, 1], NaN for animals of which nothing is in the picture; None without
            cuboids.
        """
        if self._outlines is None:
            return None
        frame = self._frame
        boxes_in_frame = np.concatenate(
            (np.maximum(boxes[:, :2], frame[:2]), np.minimum(boxes[:, 2:], frame[2:])), axis=1
        )
        areas = area_in_box(
            self._outlines, np.concatenate((frame[None], boxes_in_frame))[:, None, None]
        ).sum(-1)
        parts: np.ndarray = np.where(areas[0] > 0, areas[1:] / (areas[0] + (areas[0] <= 0)), np.nan)
        return parts

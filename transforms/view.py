"""What a transform may look at when it draws: the picture's size, its camera and its boxes as they are by then."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.face_visibility import near_depth_of_corners, projected_faces, visible_faces
from animal3dbox.geometry.homography import CameraUpdate, update_camera
from animal3dbox.geometry.polygon import clip_to_box, polygon_area
from animal3dbox.transforms.fields import Fields
from animal3dbox.transforms.law import corners_of
from animal3dbox.transforms.steps import IDENTITY, Keep, Step, Warp


@dataclass(frozen=True)
class View:
    """The picture after the steps drawn so far; nothing has been rendered yet.

    Attributes:
        image_hw: height and width by now.
        H_out_in: (3, 3) all maps so far.
        values: the target's fields as they came.
        alive: indices of the animals that no step has dropped.
    """

    image_hw: tuple[int, int]
    H_out_in: np.ndarray
    values: Mapping[str, Tensor]
    alive: tuple[int, ...]

    @staticmethod
    def of(image_hw: tuple[int, int], fields: Fields) -> "View":
        """The picture before any step."""
        return View(image_hw, IDENTITY, fields.values, tuple(range(fields.count)))

    def after(self, step: Step) -> "View":
        """The picture after one more step."""
        if isinstance(step, Warp):
            return replace(self, image_hw=step.image_hw, H_out_in=step.H_out_in @ self.H_out_in)
        return replace(self, alive=step.indices) if isinstance(step, Keep) else self

    @cached_property
    def camera(self) -> CameraUpdate | None:
        """What the steps did to the camera; None without K."""
        if "K" not in self.values:
            return None
        return update_camera(torch.from_numpy(self.H_out_in), self.values["K"].detach().cpu())

    @property
    def K(self) -> np.ndarray | None:
        """Intrinsics (3, 3) by now, or None."""
        if self.camera is None:
            return None
        array: np.ndarray = self.camera.K.numpy()
        return array

    @cached_property
    def corners_cam(self) -> Tensor | None:
        """Corners (N, 8, 3) in the camera frame by now, of the animals that are alive; None without boxes or camera.

        After a mirror they carry their old names, which no drawing depends on.
        """
        corners = corners_of(dict(self.values))
        if corners is None or self.camera is None:
            return None
        return (corners.detach().cpu() @ self.camera.Q.mT)[list(self.alive)]

    @cached_property
    def _outlines(self) -> Tensor | None:
        """The hidden faces of the boxes in px (N, 6, P, 2), the visible ones collapsed: together they tile the silhouettes."""
        if self.corners_cam is None or self.camera is None:
            return None
        hidden = ~visible_faces(self.corners_cam, torch.zeros_like(self.corners_cam[:, 0]))
        quads = projected_faces(self.corners_cam, self.camera.K)
        return torch.where(hidden[..., None, None], quads, quads[..., :1, :])

    def in_front(self) -> np.ndarray:
        """Which animals lie entirely in front of the camera, (N,) bool; none without cuboids."""
        if self.corners_cam is None:
            return np.zeros(0, dtype=bool)
        in_front: np.ndarray = (self.corners_cam[..., 2] > near_depth_of_corners(self.corners_cam)[:, None]).all(-1).numpy()
        return in_front

    def parts_in_picture(self) -> np.ndarray | None:
        """How much of each animal's silhouette lies in the picture, (N,) in [0, 1]; 0 without a silhouette; None without cuboids."""
        if self._outlines is None:
            return None
        height, width = self.image_hw
        frame = torch.tensor([-0.5, -0.5, width - 0.5, height - 0.5], dtype=torch.float64)
        whole, left = polygon_area(self._outlines).sum(-1), polygon_area(clip_to_box(self._outlines, frame)).sum(-1)
        parts: np.ndarray = torch.where(whole > 0, left / whole.clamp_min(1e-300), torch.zeros_like(left)).numpy()
        return parts

    def visible_parts(self, boxes: np.ndarray) -> np.ndarray | None:
        """How much of what the picture shows of each animal lies in each of some upright boxes.

        Args:
            boxes: (M, 4) px.

        Returns:
            (M, N) in [0, 1], 1 for animals of which nothing is in the picture; None without cuboids.

        """
        if self._outlines is None:
            return None
        height, width = self.image_hw
        frame = torch.tensor([-0.5, -0.5, width - 0.5, height - 0.5], dtype=torch.float64)
        outlines = self._outlines
        inside = bool(((outlines >= -0.5) & (outlines <= frame[2:])).all())
        shown = outlines if inside else clip_to_box(outlines, frame)
        whole = polygon_area(shown).sum(-1)
        left = polygon_area(clip_to_box(shown[None], torch.from_numpy(np.asarray(boxes, dtype=np.float64))[:, None, None])).sum(-1)
        parts: np.ndarray = torch.where(whole > 0, left / whole.clamp_min(1e-300), torch.ones_like(left)).numpy()
        return parts

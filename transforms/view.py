"""What a transform may look at when it draws: the picture's size, its camera and its boxes as they are by then."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.face_visibility import near_depth_of_corners, projected_faces, visible_faces
from animal3dbox.geometry.homography import CameraUpdate, update_camera
from animal3dbox.geometry.polygon import area_in_box, polygon_area
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
        memory: what was computed of the picture before any step, shared by all views of it.
    """

    image_hw: tuple[int, int]
    H_out_in: np.ndarray
    values: Mapping[str, Tensor]
    alive: tuple[int, ...]
    memory: dict[str, Tensor | None] = field(default_factory=dict, repr=False, compare=False)

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

    @cached_property
    def K(self) -> np.ndarray | None:
        """Intrinsics (3, 3) by now, or None."""
        if "K" not in self.values:
            return None
        (a, b, _), (c, d, _), (e, f, _) = self.H_out_in.tolist()
        K: np.ndarray
        if b == c == e == f == 0 or self.camera is None:  # flips, crops and resizes keep the camera's axes but for their signs
            K = self.H_out_in @ self.values["K"].detach().cpu().numpy() * np.array([np.sign(a), np.sign(d), 1])
            K /= K[2, 2]
            return K
        K = self.camera.K.numpy()
        return K

    @cached_property
    def corners_cam(self) -> Tensor | None:
        """Corners (N, 8, 3) in the camera frame by now, of the animals that are alive; None without boxes or camera.

        After a mirror they carry their old names, which no drawing depends on.
        """
        corners = corners_of(dict(self.values))
        if corners is None or self.camera is None:
            return None
        return (corners.detach().cpu() @ self.camera.Q.mT)[list(self.alive)]

    def in_front(self) -> np.ndarray:
        """Which animals lie entirely in front of the camera, (N,) bool; none without cuboids."""
        if self.corners_cam is None:
            return np.zeros(0, dtype=bool)
        in_front: np.ndarray = (self.corners_cam[..., 2] > near_depth_of_corners(self.corners_cam)[:, None]).all(-1).numpy()
        return in_front

    @cached_property
    def _outlines(self) -> Tensor | None:
        """The hidden faces of the boxes in px (N, 6, P, 2), the visible ones collapsed: together they tile the silhouettes."""
        if not self.H_out_in[2, :2].any():  # an affine map moves outlines as it moves pixels
            if self._source is None:
                return None
            H = torch.from_numpy(self.H_out_in / self.H_out_in[2, 2])
            return self._source[list(self.alive)] @ H[:2, :2].mT + H[:2, 2]
        if self.corners_cam is None or self.camera is None:
            return None
        return outlines(self.corners_cam, self.camera.K)

    @cached_property
    def _source(self) -> Tensor | None:
        """The outlines of all animals in the picture before any step."""
        if "outlines" not in self.memory:
            corners = corners_of(dict(self.values)) if "K" in self.values else None
            visible = self.values["face_visible"].bool().cpu() if "face_visible" in self.values else None
            self.memory["outlines"] = None if corners is None else outlines(corners.detach().cpu(), self.values["K"].detach().cpu(), visible)
        return self.memory["outlines"]

    def all_inside(self, box: np.ndarray) -> bool:
        """Whether every corner of every box is seen inside an upright box (4,) in the picture; False where that is not plain to see."""
        if self.H_out_in[2, :2].any() or not {"corners_2d", "corner_in_front", "K"} <= set(self.values):
            return False
        if not bool(self.values["corner_in_front"].all()):
            return False
        px: np.ndarray = (
            self.values["corners_2d"].detach().cpu().numpy()[list(self.alive)].reshape(-1, 2) @ self.H_out_in[:2, :2].T + self.H_out_in[:2, 2]
        )
        least, most = np.maximum(box[:2], self._frame[:2]), np.minimum(box[2:], self._frame[2:])
        return bool((px >= least).all() and (px <= most).all())

    @property
    def _frame(self) -> np.ndarray:
        height, width = self.image_hw
        return np.array([-0.5, -0.5, width - 0.5, height - 0.5])

    def parts_in_picture(self) -> np.ndarray | None:
        """How much of each animal's silhouette lies in the picture, (N,) in [0, 1]; 0 without a silhouette; None without cuboids."""
        if self._outlines is None:
            return None
        whole, left = polygon_area(self._outlines).sum(-1), _areas(self._outlines, self._frame)
        parts: np.ndarray = torch.where(whole > 0, left / whole.clamp_min(1e-300), torch.zeros_like(left)).numpy()
        return parts

    def visible_parts(self, boxes: np.ndarray) -> np.ndarray | None:
        """How much of what the picture shows of each animal lies in each of some upright boxes inside the picture.

        Args:
            boxes: (M, 4) px.

        Returns:
            (M, N) in [0, 1], 1 for animals of which nothing is in the picture; None without cuboids.

        """
        if self._outlines is None:
            return None
        shown = np.concatenate((np.maximum(boxes[:, :2], self._frame[:2]), np.minimum(boxes[:, 2:], self._frame[2:])), axis=1)
        areas = _areas(self._outlines, np.concatenate((self._frame[None], shown))[:, None])
        parts: np.ndarray = torch.where(areas[0] > 0, areas[1:] / areas[0].clamp_min(1e-300), torch.ones_like(areas[1:])).numpy()
        return parts


def outlines(corners_cam: Tensor, K: Tensor, visible: Tensor | None = None) -> Tensor:
    """The hidden faces of boxes in px (N, 6, P, 2), the visible ones collapsed: together they tile the silhouettes."""
    visible = visible_faces(corners_cam, torch.zeros_like(corners_cam[:, 0])) if visible is None else visible
    quads = projected_faces(corners_cam, K)
    return torch.where(visible[..., None, None], quads[..., :1, :], quads)


def _areas(polygons: Tensor, boxes: np.ndarray) -> Tensor:
    """Areas (..., N) of what lies in upright boxes (..., 4) of outlines (N, 6, P, 2)."""
    return area_in_box(polygons, torch.from_numpy(np.ascontiguousarray(boxes))[..., None, :]).sum(-1)

"""Checks of what a caller says about one animal: every fault is an error that names its place."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.checks import (
    check_finite,
    check_image_hw,
    check_rotation,
    check_shape,
)
from animal3dbox.labels.body import Array, ArrayLike
from animal3dbox.labels.pose.problem import PoseEstimate
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel


class ArgumentChecks:
    """The arguments of one animal turned into checked arrays, which may share the caller's memory.

    Every error names the sample and the argument.

    Args:
        sample_id: the caller's name for the sample.

    """

    def __init__(self, sample_id: str | None) -> None:
        self.sample_id = sample_id

    def fail(self, field: str, problem: str) -> SampleError:
        """The error of an argument, to be raised."""
        return SampleError(self.sample_id, field, problem)

    def raw(self, field: str, value: ArrayLike, spec: str) -> NDArray[Any]:
        """Numbers of any type, of a shape as check_shape reads it."""
        try:
            array: NDArray[Any] = (
                as_numpy(value)
                if isinstance(value, Tensor) and value.dtype != torch.bfloat16
                else np.asarray(value)
            )
            if array.dtype.kind not in "biuf":
                raise TypeError(f"its values are {array.dtype}")
            check_shape(field, array, spec)
        except ShapeError as error:
            raise self.fail(field, str(error)) from error
        except (TypeError, ValueError, RuntimeError) as error:
            raise self.fail(
                field,
                f"must be numbers in an array of shape ({', '.join(spec.split())}), got"
                f" {type(value).__name__}: {error}",
            ) from error
        return array

    def array(self, field: str, value: ArrayLike, spec: str) -> Array:
        """Numbers as float64, of a shape."""
        return self.raw(field, value, spec).astype(np.float64, copy=False)

    def finite(self, field: str, value: ArrayLike, spec: str) -> Array:
        """Finite numbers as float64, of a shape."""
        array = self.array(field, value, spec)
        self.check(check_finite, field, array)
        return array

    def check(self, check: Callable[[str, Array], None], field: str, array: Array) -> None:
        """One of geometry's checks, its error naming the sample."""
        try:
            check(field, array)
        except ShapeError as error:
            raise self.fail(field, str(error)) from error

    def pose(self, field: str, value: ArrayLike, name: str) -> PoseEstimate:
        """A camera pose, given as a pair (R, t)."""
        if not isinstance(value, (tuple, list)) or len(value) != 2:
            raise self.fail(field, "must be a pair (R, t) with X_cam = R X + t")
        R, t = self.array(f"{field} R", value[0], "3 3"), self.finite(f"{field} t", value[1], "3")
        self.check(check_rotation, f"{field} R", R)
        return PoseEstimate(R.copy(), t.copy(), name)

    def image_hw(self, image_hw: tuple[int, int]) -> tuple[int, int]:
        """Height and width of the image."""
        try:
            check_image_hw("image_hw", image_hw)
        except (ShapeError, TypeError, ValueError) as error:
            raise self.fail("image_hw", str(error)) from error
        return int(image_hw[0]), int(image_hw[1])

    def keypoints(
        self, value: ArrayLike, count: int, vocabulary: str, image_hw: tuple[int, int]
    ) -> tuple[Array, list[str]]:
        """Keypoints (J, 3) with missing ones zeroed, and warnings."""
        keypoints = self.array("keypoints_2d", value, "J 3")
        if len(keypoints) != count:
            raise self.fail(
                "keypoints_2d",
                f"has {len(keypoints)} keypoints, but vocabulary {vocabulary} has {count}: name the"
                " vocabulary they are in",
            )
        visible, limit = keypoints[:, 2] > 0, 10 * max(image_hw)
        if all(
            c == 0 or (0 < c <= 1 and abs(x) <= limit and abs(y) <= limit and (x or y))
            for x, y, c in keypoints.tolist()
        ):
            return np.where(visible[:, None], keypoints, 0.0), []
        return self._doubtful_keypoints(keypoints, visible, limit)

    def _doubtful_keypoints(
        self, keypoints: Array, visible: NDArray[np.bool_], limit: int
    ) -> tuple[Array, list[str]]:
        """Keypoints of which some visible ones are at (0, 0), or too far from it, or nowhere.

        Args:
            keypoints: (J, 3).
            visible: (J,).
            limit: in px.

        """
        if not ((keypoints[:, 2] >= 0) & (keypoints[:, 2] <= 1)).all():
            raise self.fail(
                "keypoints_2d",
                "visibility must be 0 or a confidence in (0, 1]; convert COCO's 0/1/2 and clear NaN"
                " first",
            )
        farther = np.abs(keypoints[:, :2]).max(1)
        bad = visible & ~np.isfinite(farther)
        if bad.any():
            raise self.fail(
                "keypoints_2d",
                f"keypoint {int(bad.argmax())} is visible but NaN or infinite; give it"
                " visibility 0",
            )
        at_zero = visible & (farther == 0)
        warnings = (
            [f"{int(at_zero.sum())} visible keypoints at exactly (0, 0) were taken as missing"]
            if at_zero.any()
            else []
        )
        marked = visible & ~at_zero
        outside = marked & (farther > limit)
        if outside.any():
            raise self.fail(
                "keypoints_2d",
                f"keypoint {int(outside.argmax())} is over ten image sizes away; are these pixels"
                " of this image?",
            )
        return np.where(marked[:, None], keypoints, 0.0), warnings

    def mask(self, value: ArrayLike, image_hw: tuple[int, int]) -> NDArray[np.bool_]:
        """A mask as bool: anything above 0 is the animal."""
        mask = self.raw("mask", value, "H W")
        if mask.dtype.kind == "f":
            self.check(check_finite, "mask", mask)
        if mask.shape != image_hw:
            raise self.fail(
                "mask",
                f"is {mask.shape}, but image_hw is {image_hw}: a mask must be of its image's size"
                " (height, width)",
            )
        inside: NDArray[np.bool_] = mask if mask.dtype == np.bool_ else mask > 0
        if not inside.any():
            raise self.fail("mask", "is empty: leave it out (mask=None) if there is none")
        return inside

    def down(self, value: ArrayLike) -> Array | None:
        """Gravity's direction (3,) in the camera frame, made unit; None if it is not known."""
        if value is None:
            return None
        down = self.finite("down_cam", value, "3")
        length = float(np.linalg.norm(down))
        if not 0.99 < length < 1.01:
            raise self.fail(
                "down_cam",
                "must be a unit vector, gravity's direction in the camera frame, got one"
                f" {length:.3g} long",
            )
        unit: Array = down / length
        return unit

    def sigma(self, value: ArrayLike, words: Vocabulary) -> Array:
        """Deviations of the landmarks, one a keypoint, not negative."""
        sigma = self.finite("landmark_sigma", value, "J")
        if len(sigma) != len(words) or (sigma < 0).any():
            raise self.fail(
                "landmark_sigma",
                f"must be {len(words)} numbers of at least 0, in the mesh's unit, for vocabulary"
                f" {words.name}",
            )
        return sigma

    def faces(self, value: ArrayLike, n_vertices: int, template: SmalModel | None) -> Tensor:
        """The triangles (F, 3) of a mesh as the rasteriser takes them: an int64 tensor."""
        if template is not None and value is template.faces:  # looked through once a model
            faces: Tensor = template.faces
            least, greatest = template.face_range
        else:
            array = self.raw("faces", value, "F 3")
            if array.dtype.kind == "f":
                self.check(check_finite, "faces", array)
            faces = torch.as_tensor(array.astype(np.int64))
            least, greatest = (int(faces.min()), int(faces.max())) if faces.numel() else (0, -1)
        if least < 0 or greatest >= n_vertices:
            raise self.fail(
                "faces", f"must index the {n_vertices} vertices, got {least} to {greatest}"
            )
        return faces

"""One animal as it comes in, checked.

Every fault is an error that names the sample and the field.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.checks import (
    check_finite,
    check_image_hw,
    check_intrinsics,
    check_rotation,
    check_shape,
)
from animal3dbox.geometry.distortion import check_distortion
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.problem import PoseEstimate
from animal3dbox.smal.keypoints.vocabularies import find_vocabulary
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel

Array = NDArray[np.float64]
ArrayLike = Any
"""A tensor, a NumPy array or nested lists of numbers."""
LEAST_FOCAL = 0.05
"""Of the longer side of the image: a field of view of 169 degrees."""


@dataclass(frozen=True)
class Observation:
    """One animal, checked: arrays in float64, which nothing may write to.

    Attributes:
        sample_id: named in every error.
        image_hw: height and width.
        vocabulary: what the keypoints are.
        keypoints_2d: (J, 3) x, y, confidence; x = y = 0 and confidence 0 where missing; None
            without keypoints.
        landmarks: (J, 3) the landmarks on the body, world; None without any.
        has_landmark: (J,) which of them the body has.
        landmark_sigma: (J,) how far each may be from where the body has it, in the body's unit; 0
            if it is exact.
        vertices: (V, 3) world, coordinate by coordinate in memory, or None.
        faces: (F, 3) int64, or None.
        template: what the vertices correspond to, or None.
        K: (3, 3).
        K_source: "given" or "guessed".
        pose: known exactly, or None.
        hypotheses: poses to try.
        mask: (H, W) bool, or None.
        warnings: what was seen on the way.
        distortion: the lens's coefficients, or None for a pinhole.
    """

    sample_id: str | None
    image_hw: tuple[int, int]
    vocabulary: Vocabulary
    keypoints_2d: Array | None
    landmarks: Array | None
    has_landmark: NDArray[np.bool_]
    landmark_sigma: Array
    vertices: Array | None
    faces: Tensor | None
    template: SmalModel | None
    K: Array
    K_source: str
    pose: PoseEstimate | None
    hypotheses: tuple[PoseEstimate, ...]
    mask: NDArray[np.bool_] | None
    warnings: tuple[str, ...]
    distortion: Array | None

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Which keypoints are seen, (J,)."""
        if self.keypoints_2d is None:
            return np.zeros(len(self.vocabulary), dtype=np.bool_)
        return self.keypoints_2d[:, 2] > 0

    @property
    def matched(self) -> NDArray[np.bool_]:
        """Which keypoints are seen and have a landmark on the body, (J,)."""
        return self.visible & self.has_landmark

    @property
    def known_landmarks(self) -> Array:
        """The landmarks that the body has, (N, 3) world."""
        return np.zeros((0, 3)) if self.landmarks is None else self.landmarks[self.has_landmark]


class _Reader:
    """Turns arguments into checked arrays, which may share the caller's memory.

    Its errors name the sample and the argument.
    """

    def __init__(self, sample_id: str | None) -> None:
        self.sample_id = sample_id

    def fail(self, field: str, problem: str) -> SampleError:
        return SampleError(self.sample_id, field, problem)

    def raw(self, field: str, value: ArrayLike, spec: str) -> NDArray[Any]:
        """Numbers of any type, of a shape."""
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
        return self.raw(field, value, spec).astype(np.float64, copy=False)

    def finite(self, field: str, value: ArrayLike, spec: str) -> Array:
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
        """A pair (R, t)."""
        if not isinstance(value, (tuple, list)) or len(value) != 2:
            raise self.fail(field, "must be a pair (R, t) with X_cam = R X + t")
        R, t = self.array(f"{field} R", value[0], "3 3"), self.finite(f"{field} t", value[1], "3")
        self.check(check_rotation, f"{field} R", R)
        return PoseEstimate(torch.from_numpy(R.copy()), torch.from_numpy(t.copy()), name)

    def keypoints(
        self, value: ArrayLike, count: int, vocabulary: str, image_hw: tuple[int, int]
    ) -> tuple[Array, list[str]]:
        """Keypoints with missing ones zeroed, and warnings."""
        keypoints = self.array("keypoints_2d", value, "J 3")
        if len(keypoints) != count:
            raise self.fail(
                "keypoints_2d",
                f"has {len(keypoints)} keypoints, but vocabulary {vocabulary} has {count}: name the"
                " vocabulary they are in",
            )
        seen, limit = keypoints[:, 2] > 0, 10 * max(image_hw)
        if all(
            c == 0 or (0 < c <= 1 and abs(x) <= limit and abs(y) <= limit and (x or y))
            for x, y, c in keypoints.tolist()
        ):
            return np.where(seen[:, None], keypoints, 0.0), []
        return self._doubtful_keypoints(keypoints, seen, limit)

    def _doubtful_keypoints(
        self, keypoints: Array, seen: NDArray[np.bool_], limit: int
    ) -> tuple[Array, list[str]]:
        """The same of keypoints (J, 3) of which some seen ones are at (0, 0), or farther from it
        than the limit in px, or nowhere."""
        if not ((keypoints[:, 2] >= 0) & (keypoints[:, 2] <= 1)).all():
            raise self.fail(
                "keypoints_2d",
                "visibility must be 0 or a confidence in (0, 1]; convert COCO's 0/1/2 and clear NaN"
                " first",
            )
        farther = np.abs(keypoints[:, :2]).max(1)
        bad = seen & ~np.isfinite(farther)
        if bad.any():
            raise self.fail(
                "keypoints_2d",
                f"keypoint {int(bad.argmax())} is visible but NaN or infinite; give it"
                " visibility 0",
            )
        at_zero = seen & (farther == 0)
        warnings = (
            [f"{int(at_zero.sum())} visible keypoints at exactly (0, 0) were taken as missing"]
            if at_zero.any()
            else []
        )
        kept = seen & ~at_zero
        outside = kept & (farther > limit)
        if outside.any():
            raise self.fail(
                "keypoints_2d",
                f"keypoint {int(outside.argmax())} is over ten image sizes away; are these pixels"
                " of this image?",
            )
        return np.where(kept[:, None], keypoints, 0.0), warnings

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


def observe(
    image_hw: tuple[int, int],
    keypoints_2d: ArrayLike,
    keypoints_3d: ArrayLike,
    landmark_sigma: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    template: SmalModel | None,
    K: ArrayLike,
    pose: ArrayLike,
    pose_hypotheses: ArrayLike,
    mask: ArrayLike,
    vocabulary: str | Vocabulary,
    sample_id: str | None,
    config: LabelConfig,
    distortion: ArrayLike = None,
) -> Observation:
    """Check the arguments of label_animal, which see.

    Raises:
        SampleError: naming the sample, the argument, what is wrong and the remedy.

    """
    read, words = _Reader(sample_id), find_vocabulary(vocabulary)
    try:
        check_image_hw("image_hw", image_hw)
    except (ShapeError, TypeError, ValueError) as error:
        raise read.fail("image_hw", str(error)) from error
    size = (int(image_hw[0]), int(image_hw[1]))
    body = None if vertices is None else np.asfortranarray(read.finite("vertices", vertices, "V 3"))
    _check_body(read, body, keypoints_3d, template)
    landmarks = _landmarks(read, keypoints_3d, body, template, words)
    seen, warnings = (
        (None, [])
        if keypoints_2d is None
        else read.keypoints(keypoints_2d, len(words), words.name, size)
    )
    matrix = (
        intrinsics(config.focal_guess * max(size), size).numpy()
        if K is None
        else read.array("K", K, "3 3")
    )
    read.check(check_intrinsics, "K", matrix)
    if min(matrix[0, 0], matrix[1, 1]) < LEAST_FOCAL * max(size):
        problem = (
            f"has focal lengths of {matrix[0, 0]:.3g} and {matrix[1, 1]:.3g} px for {size[1]} x"
            f" {size[0]} px, as no lens has"
        )
        raise read.fail(
            "K",
            f"{problem}: is it normalised? Multiply its first row by the width and its second by"
            " the height",
        )
    lens = None if distortion is None else read.array("distortion", distortion, "N")
    if lens is not None:
        read.check(check_distortion, "distortion", lens)
    has_landmark: Any = (
        np.zeros(len(words), dtype=np.bool_) if landmarks is None else np.isfinite(landmarks).all(1)
    )
    return Observation(
        sample_id=sample_id,
        image_hw=size,
        vocabulary=words,
        keypoints_2d=seen,
        landmarks=landmarks,
        landmark_sigma=(
            np.zeros(len(words)) if landmark_sigma is None else read.sigma(landmark_sigma, words)
        ),
        has_landmark=has_landmark,
        vertices=body,
        faces=None if faces is None or body is None else read.faces(faces, len(body), template),
        template=template,
        K=matrix,
        K_source="guessed" if K is None else "given",
        pose=None if pose is None else read.pose("pose", pose, "given"),
        hypotheses=tuple(
            read.pose(f"pose_hypotheses[{i}]", h, f"hypothesis_{i}")
            for i, h in enumerate(pose_hypotheses)
        ),
        mask=None if mask is None else read.mask(mask, size),
        warnings=tuple(warnings),
        distortion=lens,
    )


def _check_body(
    read: _Reader, body: Array | None, keypoints_3d: ArrayLike, template: SmalModel | None
) -> None:
    if body is None and keypoints_3d is None:
        raise read.fail(
            "vertices",
            "give vertices or keypoints_3d: without either there is nothing to put a box around",
        )
    if body is not None and len(body) < 4:
        raise read.fail("vertices", f"must be a body, got {len(body)} points")
    if template is not None and body is not None and len(body) != template.vertex_count:
        raise read.fail(
            "vertices",
            f"has {len(body)} vertices, but the template has {template.vertex_count}: leave"
            " template out unless they correspond one to one",
        )


def _landmarks(
    read: _Reader,
    keypoints_3d: ArrayLike,
    body: Array | None,
    template: SmalModel | None,
    words: Vocabulary,
) -> Array | None:
    """The landmarks as given, else read off the template's vertex groups.

    NaN rows are landmarks the body lacks.
    """
    if keypoints_3d is None:
        return None if template is None or body is None else template.read_keypoints(words, body)
    landmarks = read.array("keypoints_3d", keypoints_3d, "J 3")
    if len(landmarks) != len(words):
        raise read.fail(
            "keypoints_3d",
            f"has {len(landmarks)} landmarks, but vocabulary {words.name} has {len(words)}",
        )
    if not np.isfinite(landmarks).all() and np.isinf(landmarks).any():
        raise read.fail(
            "keypoints_3d",
            "must not be infinite; a landmark the body does not have is a row of NaN",
        )
    return landmarks

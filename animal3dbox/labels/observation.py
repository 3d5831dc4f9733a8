"""One animal as it comes in, checked: every fault is an error that names the sample and the field."""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.checks import check_finite, check_image_hw, check_intrinsics, check_rotation, check_shape
from animal3dbox.geometry.distortion import check_distortion
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose_problem import PoseEstimate
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.vocabularies import find_vocabulary
from animal3dbox.smal.vocabulary import Vocabulary

ArrayLike = Any
"""A tensor, a NumPy array or nested lists of numbers."""


@dataclass(frozen=True)
class Observation:
    """One animal, checked, in float64.

    Attributes:
        sample_id: named in every error.
        image_hw: height and width.
        vocabulary: what the keypoints are.
        keypoints_2d: (J, 3) x, y, confidence; x = y = 0 and confidence 0 where missing; None without keypoints.
        landmarks: (J, 3) the landmarks on the body, world; None without any.
        has_landmark: (J,) which of them the body has.
        landmark_sigma: (J,) how far each may be from where the body has it, in the body's unit; 0 if it is exact.
        vertices: (V, 3) world, or None.
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
    keypoints_2d: Tensor | None
    landmarks: Tensor | None
    has_landmark: Tensor
    landmark_sigma: Tensor
    vertices: Tensor | None
    faces: Tensor | None
    template: SmalModel | None
    K: Tensor
    K_source: str
    pose: PoseEstimate | None
    hypotheses: tuple[PoseEstimate, ...]
    mask: Tensor | None
    warnings: tuple[str, ...]
    distortion: Tensor | None

    @property
    def visible(self) -> Tensor:
        """Which keypoints are seen, (J,) bool."""
        if self.keypoints_2d is None:
            return torch.zeros(len(self.vocabulary), dtype=torch.bool)
        return self.keypoints_2d[:, 2] > 0

    @property
    def matched(self) -> Tensor:
        """Which keypoints are seen and have a landmark on the body, (J,) bool."""
        return self.visible & self.has_landmark

    @property
    def known_landmarks(self) -> Tensor:
        """The landmarks that the body has, (N, 3) world."""
        return torch.zeros((0, 3), dtype=torch.float64) if self.landmarks is None else self.landmarks[self.has_landmark]


class _Reader:
    """Turns arguments into checked float64 tensors; its errors name the sample and the argument."""

    def __init__(self, sample_id: str | None) -> None:
        self.sample_id = sample_id

    def fail(self, field: str, problem: str) -> SampleError:
        return SampleError(self.sample_id, field, problem)

    def tensor(self, field: str, value: ArrayLike, spec: str) -> Tensor:
        """A float64 copy on the CPU, of a shape."""
        try:
            tensor = torch.as_tensor(value, dtype=torch.float64, device="cpu").detach().clone()
            check_shape(field, tensor, spec)
        except ShapeError as error:
            raise self.fail(field, str(error)) from error
        except (TypeError, ValueError, RuntimeError) as error:
            raise self.fail(
                field, f"must be numbers in an array of shape ({', '.join(spec.split())}), got {type(value).__name__}: {error}"
            ) from error
        return tensor

    def finite(self, field: str, value: ArrayLike, spec: str) -> Tensor:
        tensor = self.tensor(field, value, spec)
        try:
            check_finite(field, tensor)
        except ShapeError as error:
            raise self.fail(field, str(error)) from error
        return tensor

    def pose(self, field: str, value: ArrayLike, name: str) -> PoseEstimate:
        """A pair (R, t)."""
        if not isinstance(value, (tuple, list)) or len(value) != 2:
            raise self.fail(field, "must be a pair (R, t) with X_cam = R X + t")
        R, t = self.finite(f"{field} R", value[0], "3 3"), self.finite(f"{field} t", value[1], "3")
        try:
            check_rotation(f"{field} R", R)
        except ShapeError as error:
            raise self.fail(field, str(error)) from error
        return PoseEstimate(R, t, name)

    def keypoints(self, value: ArrayLike, count: int, vocabulary: str, image_hw: tuple[int, int]) -> tuple[Tensor, list[str]]:
        """Keypoints with missing ones zeroed, and warnings."""
        keypoints = self.tensor("keypoints_2d", value, "J 3")
        if len(keypoints) != count:
            raise self.fail(
                "keypoints_2d", f"has {len(keypoints)} keypoints, but vocabulary {vocabulary} has {count}: name the vocabulary they are in"
            )
        confidence = keypoints[:, 2]
        if not bool(((confidence >= 0) & (confidence <= 1)).all()):
            raise self.fail("keypoints_2d", "visibility must be 0 or a confidence in (0, 1]; convert COCO's 0/1/2 and clear NaN first")
        seen = confidence > 0
        bad = seen & ~torch.isfinite(keypoints[:, :2]).all(1)
        if bool(bad.any()):
            raise self.fail("keypoints_2d", f"keypoint {int(bad.nonzero()[0])} is visible but NaN or infinite; give it visibility 0")
        at_zero = seen & (keypoints[:, :2] == 0).all(1)
        warnings = [f"{int(at_zero.sum())} visible keypoints at exactly (0, 0) were taken as missing"] if bool(at_zero.any()) else []
        height, width = image_hw
        outside = seen & ~at_zero & ((keypoints[:, :2].abs() > 10 * max(height, width)).any(1))
        if bool(outside.any()):
            raise self.fail("keypoints_2d", f"keypoint {int(outside.nonzero()[0])} is over ten image sizes away; are these pixels of this image?")
        return torch.where((seen & ~at_zero)[:, None], keypoints, torch.zeros_like(keypoints)), warnings

    def mask(self, value: ArrayLike, image_hw: tuple[int, int]) -> Tensor:
        """A mask as bool: anything above 0 is the animal."""
        mask = self.finite("mask", value, "H W")
        if tuple(mask.shape) != tuple(image_hw):
            raise self.fail("mask", f"is {tuple(mask.shape)}, but image_hw is {tuple(image_hw)}: a mask must be of its image's size (height, width)")
        if not bool((mask > 0).any()):
            raise self.fail("mask", "is empty: leave it out (mask=None) if there is none")
        return mask > 0

    def sigma(self, value: ArrayLike, words: Vocabulary) -> Tensor:
        """Deviations of the landmarks, one a keypoint, not negative."""
        sigma = self.finite("landmark_sigma", value, "J")
        if len(sigma) != len(words) or bool((sigma < 0).any()):
            raise self.fail("landmark_sigma", f"must be {len(words)} numbers of at least 0, in the mesh's unit, for vocabulary {words.name}")
        return sigma

    def distortion(self, value: ArrayLike) -> Tensor:
        """Coefficients of a lens."""
        coefficients = self.tensor("distortion", value, "N")
        try:
            check_distortion("distortion", coefficients)
        except ShapeError as error:
            raise self.fail("distortion", str(error)) from error
        return coefficients

    def faces(self, value: ArrayLike, n_vertices: int) -> Tensor:
        faces = self.finite("faces", value, "F 3").long()
        if faces.numel() and (int(faces.min()) < 0 or int(faces.max()) >= n_vertices):
            raise self.fail("faces", f"must index the {n_vertices} vertices, got {int(faces.min())} to {int(faces.max())}")
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
    body = None if vertices is None else read.finite("vertices", vertices, "V 3")
    _check_body(read, body, keypoints_3d, template)
    landmarks = _landmarks(read, keypoints_3d, body, template, words)
    seen, warnings = (None, []) if keypoints_2d is None else read.keypoints(keypoints_2d, len(words), words.name, size)
    matrix = intrinsics(config.focal_guess * max(size), size) if K is None else read.finite("K", K, "3 3")
    try:
        check_intrinsics("K", matrix)
    except ShapeError as error:
        raise read.fail("K", str(error)) from error
    return Observation(
        sample_id=sample_id,
        image_hw=size,
        vocabulary=words,
        keypoints_2d=seen,
        landmarks=landmarks,
        landmark_sigma=torch.zeros(len(words), dtype=torch.float64) if landmark_sigma is None else read.sigma(landmark_sigma, words),
        has_landmark=torch.zeros(len(words), dtype=torch.bool) if landmarks is None else torch.isfinite(landmarks).all(1),
        vertices=body,
        faces=None if faces is None or body is None else read.faces(faces, len(body)),
        template=template,
        K=matrix,
        K_source="guessed" if K is None else "given",
        pose=None if pose is None else read.pose("pose", pose, "given"),
        hypotheses=tuple(read.pose(f"pose_hypotheses[{i}]", h, f"hypothesis_{i}") for i, h in enumerate(pose_hypotheses)),
        mask=None if mask is None else read.mask(mask, size),
        warnings=tuple(warnings),
        distortion=None if distortion is None else read.distortion(distortion),
    )


def _check_body(read: _Reader, body: Tensor | None, keypoints_3d: ArrayLike, template: SmalModel | None) -> None:
    if body is None and keypoints_3d is None:
        raise read.fail("vertices", "give vertices or keypoints_3d: without either there is nothing to put a box around")
    if body is not None and len(body) < 4:
        raise read.fail("vertices", f"must be a body, got {len(body)} points")
    if template is not None and body is not None and len(body) != template.vertex_count:
        raise read.fail(
            "vertices",
            f"has {len(body)} vertices, but the template has {template.vertex_count}: leave template out unless they correspond one to one",
        )


def _landmarks(read: _Reader, keypoints_3d: ArrayLike, body: Tensor | None, template: SmalModel | None, words: Vocabulary) -> Tensor | None:
    """The landmarks as given, else read off the template's vertex groups; NaN rows are landmarks the body lacks."""
    if keypoints_3d is None:
        return None if template is None or body is None else words.on_body(template.landmark_groups, body)
    landmarks = read.tensor("keypoints_3d", keypoints_3d, "J 3")
    if len(landmarks) != len(words):
        raise read.fail("keypoints_3d", f"has {len(landmarks)} landmarks, but vocabulary {words.name} has {len(words)}")
    if bool(torch.isinf(landmarks).any()):
        raise read.fail("keypoints_3d", "must not be infinite; a landmark the body does not have is a row of NaN")
    return landmarks

"""What labelling an animal gives: a label, or a rejection with its reason.

Example:
    >>> REASONS["no_axes"]
    'nothing tells which way the body points'
    >>> VIEWPOINTS[2]
    'left'
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.cuboid import FACE_NAMES, Cuboid
from animal3dbox.labels.fit_parameters import FitParameters
from animal3dbox.labels.flank import FLANKS, Flank
from animal3dbox.labels.label_row import Array, row_field, with_fields

REASONS = {
    "too_few_keypoints": "fewer visible keypoints than min_keypoints",
    "coplanar_keypoints": (
        "the visible keypoints lie in one plane or coincide, so that the pose is ambiguous"
    ),
    "no_axes": "nothing tells which way the body points",
    "no_pose": "no camera pose explains the keypoints",
    "behind_camera": "the pose puts the animal behind the camera",
    "beyond_lens": (
        "the animal or its box reaches beyond the lens's field of view, where its projection means"
        " nothing"
    ),
    "degenerate_box": "the projected box is much smaller than the animal",
    "no_body": "there is no body for this animal",
}
"""Why an animal can be left without a label; the keys of every count of rejections."""

FLAGS = {
    "exchanged": "left and right keypoints were exchanged in the file, and are mended",
    "ambiguous": "another orientation explains the animal nearly as well",
    "from_below": "the camera would stand far below the animal's own plane",
    "rolled": "the camera would be rolled by more than 45 degrees against the animal",
    "uncertain": "the rotation's standard deviation is more than 15 degrees",
    "not_turned": "the picture's EXIF orientation was not applied: see that this is right",
    "misplaced": "the keypoints lie beside the frame, or the animal's own box or mask",
    "off_mask": "the body under its known camera lies beside the mask: one of them is wrong",
}
"""Words of Quality.flags, and what they say."""

VIEWPOINTS = (
    *("front", "front-left", "left", "back-left"),
    *("back", "back-right", "right", "front-right"),
)
"""Side of the animal that faces the camera, by eighths of a turn from its front towards its left.
"""


@dataclass(frozen=True)
class Quality:
    """How a label came about and how well it fits.

    Attributes:
        reprojection_error_px: mean distance of the visible keypoints from the projected landmarks;
            None without keypoints.
        n_keypoints: visible keypoints.
        n_inliers: of these, how many lie within a tenth of their box's longer side of the projected
            landmarks (PCK at 0.1).
        mask_iou: overlap of the projected mesh with the mask, 0 to 1; None without both, or if
            LabelConfig.mask_iou is off.
        orientation_rule: which rule gave the body's axes.
        pose_source: "given" or "estimated".
        pose_hypothesis: the start that won: "given", "epnp_ransac", "sqpnp", "view_<i>" or
            "hypothesis_<i>".
        bounds_source: "vertices" or "keypoints": what the box bounds.
        mask_source: "dataset", "rendered" (of the dataset's own fitted body, for want of another),
            or "none" when the pose was made without one.
        K_source: "given", "exif" (the picture's header), "dataset" (one for all of its images),
            "estimated" with the pose, or "guessed".
        warnings: what a careful person should know, in whole sentences.
        rotation_sd_deg: standard deviation of the estimated rotation about its least certain axis,
            by the curvature of the cost; None of a given pose and of methods basic and paper, as
            are the next four but labeling.
        runner_up: what the best pose of another orientation or labeling would cost more, in halves
            of a squared standard deviation; None, too, if there was none.
        labeling: the part of the body whose left and right keypoints were exchanged in the file
            and are mended in the label ("all", "legs", "fore", "hind", "head"), or "as given".
        hidden: part of the marked keypoints that the body itself hides.
        misfit: how many times larger the keypoints' distances are than their noise, at least 1.
        log_focal_sd: standard deviation of the natural logarithm of an estimated focal length.
        flags: the warnings that programs can count, a word each: see FLAGS.
        confidence: the probability that the cuboid is turned by less than 15 degrees from the
            trunk's truth, see labels/confidence.py; of a pose that was given, the axes' part alone.
            None of methods basic and paper.
        expected_corner_error: the mean distance of the corners from the true ones that is to be
            expected, as a part of the diagonal, beside distance and size; None of a pose that was
            given.
        calibration: the digest of the calibration that had a part in the label; None without.
        body: "given", "fit" of a body that was fitted to the picture with its camera, or "preset"
            of a rigid one where a fit was asked for but the animal has too few keypoints for one.

    Example:
        >>> from animal3dbox import label_animal
        >>> from animal3dbox.datasets.synthetic import synthetic_animal
        >>> animal = synthetic_animal(seed=0, index=2)
        >>> label = label_animal(
        ...     animal.image_hw, animal.keypoints_2d, vertices=animal.vertices,
        ...     template=animal.model, K=animal.K)
        >>> label.quality.pose_source, label.quality.K_source
        ('estimated', 'given')
    """

    reprojection_error_px: float | None
    n_keypoints: int
    n_inliers: int
    mask_iou: float | None
    orientation_rule: str
    pose_source: str
    pose_hypothesis: str
    bounds_source: str
    mask_source: str
    K_source: str
    warnings: tuple[str, ...]
    rotation_sd_deg: float | None = None
    runner_up: float | None = None
    labeling: str = "as given"
    hidden: float | None = None
    misfit: float | None = None
    log_focal_sd: float | None = None
    flags: tuple[str, ...] = ()
    confidence: float | None = None
    expected_corner_error: float | None = None
    calibration: str | None = None
    body: str = "given"


@dataclass(frozen=True, eq=False)
class CuboidLabel:
    """The label of one animal.

    Its numbers lie in one row of float64 (label_row.py), from which the properties below give
    tensors of their own: in the camera frame and the mesh's unit (metres where scale_m_per_unit is
    known), unless said otherwise.

    Attributes:
        sample_id: the caller's name for the sample.
        image_hw: height and width of the image.
        row: (WIDTH,) all numbers of the label.
        keypoints_2d: (J, 3) x, y, visibility as used; None without keypoints.
        quality: how the label came about and how well it fits.
        lens: (4,), (5,), (8,) or (12,) coefficients of OpenCV's lens as given; None for a pinhole.
        scale_m_per_unit: metres a unit of the mesh, with which corners_3d, center, size, distance
            and t were made metric; None: they are in its unit.
        scale_source: what tells the scale ("dataset", "user", "species:<name>", "altitude"), or
            "unknown".
        fit: the parameters of the body that was fitted to the picture; None of any other body.

    Example:
        >>> from animal3dbox.datasets.synthetic import synthetic_animal
        >>> from animal3dbox import label_animal
        >>> animal = synthetic_animal(seed=0, index=2)
        >>> label = label_animal(
        ...     image_hw=animal.image_hw, vertices=animal.vertices, template=animal.model,
        ...     K=animal.K, pose=(animal.R, animal.t))
        >>> label.side, label.viewpoint, label.corners_3d.shape
        ('right', 'front-right', torch.Size([8, 3]))
    """

    sample_id: str | None
    image_hw: tuple[int, int]
    row: Array
    keypoints_2d: Array | None
    quality: Quality
    lens: Array | None = None
    scale_m_per_unit: float | None = None
    scale_source: str = "unknown"
    fit: FitParameters | None = None

    def field(self, name: str) -> Array:
        """A field of label_row.LAYOUT in its shape, as NumPy: a view that nothing may write to."""
        return row_field(self.row, name)

    def with_fields(self, **values: object) -> "CuboidLabel":
        """The same label with some fields of its row replaced; what follows from them is not."""
        return replace(self, row=with_fields(self.row, **values))

    def _tensor(self, name: str) -> Tensor:
        return torch.from_numpy(self.field(name).copy())

    def _flags(self, name: str) -> Tensor:
        return torch.from_numpy(self.field(name).astype(np.bool_))

    @property
    def corners_3d(self) -> Tensor:
        """The corners (8, 3) in the documented order."""
        return self._tensor("corners_3d")

    @property
    def center(self) -> Tensor:
        """The centre of the box, (3,)."""
        return self._tensor("center")

    @property
    def rotation(self) -> Tensor:
        """R_cam_box (3, 3): columns forward, left, up."""
        return self._tensor("rotation")

    @property
    def size(self) -> Tensor:
        """Length, width, height, (3,)."""
        return self._tensor("size")

    @property
    def distance(self) -> float:
        """From the camera's centre to the box's."""
        return float(self.field("distance"))

    @property
    def corners_2d(self) -> Tensor:
        """Projected corners (8, 2) in px, of the distorted picture if there is a lens.

        Those that are not in front of the camera (corner_in_front) have no meaning.
        """
        return self._tensor("corners_2d")

    @property
    def corner_in_front(self) -> Tensor:
        """Which corners are in front of the camera, (8,) bool."""
        return self._flags("corner_in_front")

    @property
    def face_visible(self) -> Tensor:
        """Which faces the camera sees, (6,) bool: front, back, left, right, top, bottom."""
        return self._flags("face_visible")

    @property
    def face_area(self) -> Tensor:
        """Projected areas of the visible faces, (6,) px^2."""
        return self._tensor("face_area")

    @property
    def face_share(self) -> Tensor:
        """Parts of the visible area, (6,), summing to 1."""
        return self._tensor("face_share")

    @property
    def face_share_in_image(self) -> Tensor:
        """Parts of the visible area inside the frame, (6,)."""
        return self._tensor("face_share_in_image")

    @property
    def K(self) -> Tensor:
        """Intrinsics (3, 3) in px."""
        return self._tensor("K")

    @property
    def R(self) -> Tensor:
        """R_cam_world (3, 3), world being the mesh's frame."""
        return self._tensor("R")

    @property
    def t(self) -> Tensor:
        """t_cam_world (3,)."""
        return self._tensor("t")

    @property
    def box(self) -> Tensor:
        """The flat box (4,) xyxy px.

        Of the mask; else of what the frame shows of the projected mesh, exactly (pixel by pixel if
        it reaches behind the camera); else of the projected cuboid.
        """
        return self._tensor("box")

    @property
    def surface_share(self) -> Tensor | None:
        """Parts of the animal's own visible surface by the side it faces, (6,).

        None without a mesh's faces, or if LabelConfig.surface_share is off.
        """
        return None if self.field("surface_share")[0] < 0 else self._tensor("surface_share")

    @property
    def truncation(self) -> float:
        """Part of the projected cuboid outside the frame, 0 to 1."""
        return float(self.field("truncation"))

    @property
    def behind_camera(self) -> bool:
        """Whether some corner is nearer than the near plane."""
        return bool(self.field("behind_camera"))

    @property
    def keypoints(self) -> Tensor | None:
        """Keypoints (J, 3): x, y, visibility as used; None without keypoints."""
        return None if self.keypoints_2d is None else torch.from_numpy(self.keypoints_2d.copy())

    @property
    def distortion(self) -> Tensor | None:
        """The coefficients of OpenCV's lens; None for a pinhole."""
        return None if self.lens is None else torch.from_numpy(self.lens.copy())

    @property
    def cuboid(self) -> Cuboid:
        """The box in the camera frame."""
        return Cuboid(self.center, self.rotation, self.size)

    @property
    def cuboid_mesh(self) -> Cuboid:
        """The same box in the mesh's own frame and unit."""
        return Cuboid(*(self._tensor(f"mesh_{part}") for part in ("center", "rotation", "size")))

    @property
    def camera_in_box(self) -> Tensor:
        """Where the camera stands seen from the animal, (3,).

        x is how far ahead of it, y to its left, z above it.
        """
        return -self.rotation.mT @ self.center

    @property
    def azimuth_deg(self) -> float:
        """Direction of the camera round the animal, in degrees.

        0 is ahead of it, 90 to its left, -90 to its right, 180 behind.
        """
        x, y, _ = self.camera_in_box.tolist()
        return math.degrees(math.atan2(y, x))

    @property
    def elevation_deg(self) -> float:
        """Height of the camera over the animal's own horizontal plane, -90 to 90 degrees."""
        x, y, z = self.camera_in_box.tolist()
        return math.degrees(math.atan2(z, math.hypot(x, y)))

    @property
    def viewpoint(self) -> str:
        """The azimuth as one of VIEWPOINTS."""
        return VIEWPOINTS[round(self.azimuth_deg / 45) % 8]

    @property
    def side(self) -> str | None:
        """The face with the largest share; None from inside the box."""
        seen_from_outside = bool(self.field("face_visible").any())
        return FACE_NAMES[int(self.field("face_share").argmax())] if seen_from_outside else None

    @property
    def surface_side(self) -> str | None:
        """The side that most of the visible surface faces.

        None if it is not known or nothing is seen.
        """
        shares = self.field("surface_share")
        return FACE_NAMES[int(shares.argmax())] if shares.max() > 0 else None

    @property
    def flank(self) -> Flank:
        """The flank that is seen: "left", "right", or "undecided"."""
        return FLANKS[int(self.field("flank"))]

    @property
    def flank_confidence(self) -> float:
        """Probability of that flank, 0.5 to 1; of the likelier one if it is undecided."""
        return float(self.field("flank_confidence"))

    @property
    def confidence(self) -> float:
        """The probability that the box is right, see Quality.confidence.

        Of methods basic and paper and of boxes that come as they are it is no probability but a
        rank, 0 to 1: the part of the keypoints that fit times the mask's overlap, of those there
        are.
        """
        quality = self.quality
        if quality.confidence is not None:
            return quality.confidence
        inliers = quality.n_inliers / quality.n_keypoints if quality.n_keypoints else 1.0
        return inliers * (1.0 if quality.mask_iou is None else quality.mask_iou)


@dataclass(frozen=True)
class Rejection:
    """An animal that gets no label.

    Attributes:
        sample_id: the caller's name for the sample.
        reason: one of REASONS.
        detail: what was found, in one sentence.

    Example:
        >>> from animal3dbox.labels import Rejection
        >>> Rejection("dog.jpg", "too_few_keypoints", "3 visible, 6 needed").reason
        'too_few_keypoints'
    """

    sample_id: str | None
    reason: str
    detail: str

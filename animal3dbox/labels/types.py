"""What labelling an animal gives: a label, or a rejection with its reason."""

import math
from dataclasses import dataclass

from torch import Tensor

from animal3dbox.geometry.cuboid import FACE_NAMES, Cuboid

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

VIEWPOINTS = (
    "front",
    "front-left",
    "left",
    "back-left",
    "back",
    "back-right",
    "right",
    "front-right",
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
        K_source: "given", "exif" (the picture's header), "dataset" (one for all of its images) or
            "guessed".
        warnings: what a careful person should know, in whole sentences.
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


@dataclass(frozen=True)
class CuboidLabel:
    """The label of one animal.

    Tensors are float64, in the camera frame and the mesh's unit unless said otherwise.

    Attributes:
        sample_id: the caller's name for the sample.
        image_hw: height and width of the image.
        corners_3d: (8, 3) corners in the documented order.
        center: (3,) centre of the box.
        rotation: (3, 3) R_cam_box: columns forward, left, up.
        size: (3,) length, width, height.
        corners_2d: (8, 2) projected corners in px, of the distorted picture if there is a lens;
            meaningless where corner_in_front is false.
        corner_in_front: (8,) bool.
        face_visible: (6,) bool, order front, back, left, right, top, bottom.
        face_area: (6,) px^2.
        face_share: (6,) of the visible area, summing to 1.
        face_share_in_image: (6,) the same inside the frame.
        K: (3, 3) intrinsics in px.
        R: (3, 3) R_cam_world, world being the mesh's frame.
        t: (3,) t_cam_world.
        box: (4,) xyxy px: of the mask; else of what the frame shows of the projected mesh, exactly
            (pixel by pixel if it reaches behind the camera); else of the projected cuboid.
        surface_share: (6,) parts of the animal's own visible surface by the side it faces; None
            without a mesh's faces, or if LabelConfig.surface_share is off.
        truncation: part of the projected cuboid outside the frame, 0 to 1.
        behind_camera: some corner is nearer than the near plane.
        keypoints: (J, 3) x, y, visibility as used; None without keypoints.
        cuboid_mesh: the same box in the mesh's frame.
        quality: how it came about.
        distortion: (4,), (5,), (8,) or (12,) coefficients of OpenCV's lens as given; None for a
            pinhole.
        scale_m_per_unit: metres a unit of the mesh, with which corners_3d, center, size and t were
            made metric; None: they are in its unit.
        scale_source: what tells the scale ("dataset", "user", "species:<name>", "altitude"), or
            "unknown".
    """

    sample_id: str | None
    image_hw: tuple[int, int]
    corners_3d: Tensor
    center: Tensor
    rotation: Tensor
    size: Tensor
    corners_2d: Tensor
    corner_in_front: Tensor
    face_visible: Tensor
    face_area: Tensor
    face_share: Tensor
    face_share_in_image: Tensor
    K: Tensor
    R: Tensor
    t: Tensor
    box: Tensor
    surface_share: Tensor | None
    truncation: float
    behind_camera: bool
    keypoints: Tensor | None
    cuboid_mesh: Cuboid
    quality: Quality
    distortion: Tensor | None = None
    scale_m_per_unit: float | None = None
    scale_source: str = "unknown"

    @property
    def cuboid(self) -> Cuboid:
        """The box in the camera frame."""
        return Cuboid(self.center, self.rotation, self.size)

    @property
    def camera_in_box(self) -> Tensor:
        """Where the camera stands seen from the animal, (3,).

        X ahead of it, y to its left, z above.
        """
        return -self.rotation.mT @ self.center

    @property
    def azimuth_deg(self) -> float:
        """Direction of the camera round the animal.

        0 ahead of it, 90 to its left, -90 to its right, 180 behind.
        """
        x, y, _ = self.camera_in_box.tolist()
        return math.degrees(math.atan2(y, x))

    @property
    def elevation_deg(self) -> float:
        """Height of the camera over the animal's own horizontal plane, -90 to 90."""
        x, y, z = self.camera_in_box.tolist()
        return math.degrees(math.atan2(z, math.hypot(x, y)))

    @property
    def viewpoint(self) -> str:
        """The azimuth as one of VIEWPOINTS."""
        return VIEWPOINTS[round(self.azimuth_deg / 45) % 8]

    @property
    def side(self) -> str | None:
        """The face with the largest share; None from inside the box."""
        return FACE_NAMES[int(self.face_share.argmax())] if bool(self.face_visible.any()) else None

    @property
    def surface_side(self) -> str | None:
        """The side that most of the visible surface faces.

        None if it is not known or nothing is seen.
        """
        if self.surface_share is None or not bool(self.surface_share.any()):
            return None
        return FACE_NAMES[int(self.surface_share.argmax())]

    @property
    def confidence(self) -> float:
        """Rank of the fit, 0 to 1, not a probability.

        Inlier part of the keypoints times the mask's overlap, of those there are.
        """
        inliers = (
            self.quality.n_inliers / self.quality.n_keypoints if self.quality.n_keypoints else 1.0
        )
        return inliers * (1.0 if self.quality.mask_iou is None else self.quality.mask_iou)


@dataclass(frozen=True)
class Rejection:
    """An animal that gets no label.

    Attributes:
        sample_id: the caller's name for the sample.
        reason: one of REASONS.
        detail: what was found, in one sentence.
    """

    sample_id: str | None
    reason: str
    detail: str

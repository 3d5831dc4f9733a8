"""Every choice of the method in one place, each with its place in the paper."""

from dataclasses import dataclass
from typing import Literal, get_args

from animal3dbox.errors import ConfigError

Method = Literal["default", "paper", "basic"]
Residual = Literal["vector", "literal"]
Axes = Literal["default", "landmarks", "pca"]
Tail = Literal["keep", "drop"]
MaskBox = Literal["keypoints", "mesh", "none"]
Upright = Literal["prior", "none"]
Labelings = Literal["mend", "keep"]
Focal = Literal["estimate", "guess"]

POSITIVE = (
    "xtol", "ftol", "sigma_visible_px", "sigma_occluded_px", "confidence_floor", "edge_gain",
    "ransac_threshold_px", "ransac_iterations", "focal_guess",
)  # fmt: skip


@dataclass(frozen=True)
class LabelConfig:
    """How a label is made.

    ``method`` and ``axes`` name whole recipes; the other fields are their numbers. Where a field is
    None, the method decides: ``paper`` and ``basic`` as published, ``default`` with the published
    method's faults mended.

    Attributes:
        method: camera pose: "basic" (section 2.2), "paper" (then the joint refinement of section
            2.2.2), "default" (several starting poses, a robust joint refinement with the mesh's
            supports in the mask, see estimate_pose).
        axes: the body's axes: "landmarks" (section 2.1.1), "pca" (the baseline of section 3.1),
            "default" (torso vertices if the mesh is in template correspondence, else all trunk
            landmarks together).
        residual: how section 2.2.2's E_total is read: "vector" squares every residual as SciPy
            does, "literal" keeps the Mahalanobis distances unsquared as the paper prints them.
        min_keypoints: fewest visible keypoints that a pose is estimated from.
        margin: section 2.1.2's epsilon, in mesh units. None: 1e-5 for paper and basic, else 1e-6 of
            the box diagonal.
        tail: whether the tail's vertices count for the bounds; needs a template to know them.
        lambda_keypoints: weight of the keypoints against the mask (section 2.2.2, lambda).
        xtol: SciPy's tolerance, section 2.2.2.
        ftol: SciPy's tolerance, section 2.2.2.
        mask_box: what is compared with the mask's bounding box in d_bbox. None: "keypoints" for
            paper, "mesh" for default.
        upright: "prior" lets poses from under the ground and with a rolled camera cost a little
            more, so that keypoints decide wherever they tell; "none" does not. For method
            "default".
        labelings: "mend" tries whether left and right keypoints have been exchanged, where the
            labeling given is in doubt, and uses the better one; "keep" takes keypoints as they
            are. For method "default".
        focal: "estimate" finds the focal length with the pose where K is unknown, one for all
            animals of an image; "guess" takes focal_guess. For method "default".
        sigma_visible_px: section 2.2.1's sigma_base of a plainly visible keypoint (not given
            there).
        sigma_occluded_px: likewise for one that may be occluded.
        occluded_below: a keypoint whose confidence is lower counts as occluded.
        confidence_floor: least confidence that conf_factor = 1 / confidence uses (section 2.2.1).
        edge_band: width of the band along the image's border where edge_factor grows, as a part of
            the shorter side.
        edge_gain: edge_factor at the border; 1 inside the band's inner edge (section 2.2.1).
        ransac_threshold_px: reprojection error up to which RANSAC counts an inlier (OpenCV's
            default).
        ransac_iterations: RANSAC's most samples. OpenCV's default of 100 misses the answer with
            many outliers.
        ransac_confidence: RANSAC's wanted probability of a clean sample (OpenCV's default).
        ransac_seed: seeds OpenCV's generator, so that the same input gives the same label.
        focal_guess: focal length over the longer side of the image when K is unknown; 1.2 is a
            field of view of 45 degrees.
        degenerate_area: a projected box with less than this part of the mask's area is degenerate.
            The paper prints "0.01 %, i.e. less than 1 %" (section 3.2), which contradicts itself;
            this is the 1 %.
        surface_share: whether the visible surface is measured, side by side: by a z-buffer, the
            dearest part of a label whose pose is known. False: None in the label.
        mask_iou: whether the overlap with the mask is measured, by drawing the mesh. False: None in
            the quality, and `confidence` rests on the keypoints alone.

    Example:
        >>> from animal3dbox.labels import LabelConfig
        >>> LabelConfig(method="paper").method
        'paper'
    """

    method: Method = "default"
    axes: Axes = "default"
    residual: Residual = "vector"
    min_keypoints: int = 6
    margin: float | None = None
    tail: Tail = "keep"
    lambda_keypoints: float = 0.8
    xtol: float = 1e-8
    ftol: float = 1e-8
    mask_box: MaskBox | None = None
    upright: Upright = "prior"
    labelings: Labelings = "mend"
    focal: Focal = "estimate"
    sigma_visible_px: float = 2.0
    sigma_occluded_px: float = 6.0
    occluded_below: float = 0.5
    confidence_floor: float = 0.1
    edge_band: float = 0.05
    edge_gain: float = 4.0
    ransac_threshold_px: float = 8.0
    ransac_iterations: int = 1000
    ransac_confidence: float = 0.99
    ransac_seed: int = 0
    focal_guess: float = 1.2
    degenerate_area: float = 0.01
    surface_share: bool = True
    mask_iou: bool = True

    def __post_init__(self) -> None:
        choices = {
            "method": Method,
            "axes": Axes,
            "residual": Residual,
            "tail": Tail,
            "upright": Upright,
            "labelings": Labelings,
            "focal": Focal,
        }
        for field, kind in choices.items():
            if getattr(self, field) not in get_args(kind):
                raise ConfigError(
                    f"{field} must be one of {', '.join(get_args(kind))}, got"
                    f" {getattr(self, field)!r}"
                )
        if self.mask_box is not None and self.mask_box not in get_args(MaskBox):
            raise ConfigError(
                f"mask_box must be one of {', '.join(get_args(MaskBox))} or None, got"
                f" {self.mask_box!r}"
            )
        if self.min_keypoints < 4:
            raise ConfigError(
                "min_keypoints must be at least 4 (a pose has 6 unknowns and RANSAC needs one"
                f" point to judge by), got {self.min_keypoints}"
            )
        if not 0 <= self.lambda_keypoints <= 1:
            raise ConfigError(f"lambda_keypoints must lie in [0, 1], got {self.lambda_keypoints}")
        for field in POSITIVE:
            if not getattr(self, field) > 0:
                raise ConfigError(f"{field} must be positive, got {getattr(self, field)}")
        if self.margin is not None and not self.margin >= 0:
            raise ConfigError(f"margin must not be negative, got {self.margin}")

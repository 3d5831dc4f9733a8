"""Which labels are good enough to train on."""

from dataclasses import dataclass

from animal3dbox.errors import ConfigError
from animal3dbox.labels.types import CuboidLabel


@dataclass(frozen=True)
class LabelFilter:
    """Limits on labels; the defaults let pass every label of which the frame shows anything.

    A measure that a label lacks fails its limit.

    Attributes:
        min_mask_iou: overlap of the projected body with the mask, 0 to 1; the best judge of a pose
            (field notes).
        min_inlier_share: part of the visible keypoints that fit, 0 to 1.
        max_reprojection_error_px: mean distance of the visible keypoints from the projected
            landmarks.
        min_confidence: see CuboidLabel.confidence.
        max_truncation: part of the projected box outside the frame, 0 to 1.
        min_box_px: the longer side of the 2D box.
        allow_behind_camera: whether a corner may be nearer than the near plane.
        allow_unseen: whether the frame may show nothing of the animal, as of one that another of
            several cameras sees.

    Example:
        >>> from animal3dbox.datasets import LabelFilter, SyntheticDataset
        >>> filters = LabelFilter(max_truncation=0.3, min_box_px=20)
        >>> dataset = SyntheticDataset(1, seed=0, image_hw=(120, 160), filters=filters)
        >>> bool((dataset[0][1]["truncation"] <= 0.3).all())
        True
    """

    min_mask_iou: float | None = None
    min_inlier_share: float | None = None
    max_reprojection_error_px: float | None = None
    min_confidence: float | None = None
    max_truncation: float | None = None
    min_box_px: float | None = None
    allow_behind_camera: bool = True
    allow_unseen: bool = False

    def __post_init__(self) -> None:
        for name in ("min_mask_iou", "min_inlier_share", "min_confidence", "max_truncation"):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= 1:
                raise ConfigError(f"{name} must lie in 0 to 1, got {value}")
        for name in ("max_reprojection_error_px", "min_box_px"):
            value = getattr(self, name)
            if value is not None and not value >= 0:
                raise ConfigError(f"{name} must not be negative, got {value}")

    def problem(self, label: CuboidLabel) -> tuple[str, str] | None:
        """The first limit that a label misses, and how; None if it keeps them all."""
        left, top, right, bottom = label.field("box").tolist()
        if not self.allow_unseen and not (left < right and top < bottom):
            return (
                "allow_unseen",
                (
                    "the frame shows nothing of the animal: this camera does not see it, or K, R or"
                    " t are not this picture's"
                ),
            )
        if self == _AT_REST:
            return None
        quality = label.quality
        visible = quality.n_keypoints
        least = {
            "min_mask_iou": quality.mask_iou,
            "min_inlier_share": quality.n_inliers / visible if visible else None,
            "min_confidence": label.confidence,
            "min_box_px": max(right - left, bottom - top),
        }
        most = {
            "max_reprojection_error_px": quality.reprojection_error_px,
            "max_truncation": float(label.field("truncation")),
        }
        for sign, measures in ((1, least), (-1, most)):
            for name, value in measures.items():
                limit = getattr(self, name)
                if limit is not None and (value is None or sign * value < sign * limit):
                    return (
                        name,
                        (
                            f"{'is not known' if value is None else f'is {value:.3g}'}, the limit"
                            f" {limit:.3g}"
                        ),
                    )
        if not self.allow_behind_camera and bool(label.field("behind_camera")):
            return "allow_behind_camera", "a corner is nearer than the near plane"
        return None


_AT_REST = LabelFilter()

"""What a picture and a card say of a label in words: of the label, or of its row in a table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.report.labels_csv import FIELD_COLUMNS

LEAST_SHARE = 0.005
"""Smaller shares of faces would be shown as 0%."""


@dataclass(frozen=True, kw_only=True)
class LabelWords:
    """The facts of a label that are told in words.

    Attributes:
        side: the box's face with the largest share; None without one.
        viewpoint: by eighths of a turn.
        azimuth_deg: where the camera stands round the animal.
        elevation_deg: and how high.
        flank: that is seen.
        flank_confidence: its probability.
        shares: of the faces, in the order of FACE_NAMES.
        error_px: mean keypoint error; None without keypoints.
        n_inliers: keypoints that fit, of
        n_keypoints: so many.
        mask_iou: overlap with the mask; None if it was not measured.
        warnings: of the label's quality.
    """

    side: str | None
    viewpoint: str
    azimuth_deg: float
    elevation_deg: float
    flank: str
    flank_confidence: float
    shares: Sequence[float]
    error_px: float | None
    n_inliers: int
    n_keypoints: int
    mask_iou: float | None
    warnings: Sequence[str]

    @property
    def lines(self) -> list[str]:
        """The lines of text below a picture: side, viewpoint, shares, fit."""
        named = zip(self.shares, FACE_NAMES, strict=True)
        shown = [(share, name) for share, name in named if share >= LEAST_SHARE]
        shares = sorted(shown, reverse=True)
        fit = [] if self.error_px is None else [f"keypoints {self.error_px:.1f} px"]
        fit += [] if self.mask_iou is None else [f"mask IoU {self.mask_iou:.2f}"]
        return [
            f"side: {self.side or 'none'}   view: {self.viewpoint}",
            "  ".join(f"{name} {100 * share:.0f}%" for share, name in shares),
            "   ".join(fit),
        ]

    def facts(self, flags: Sequence[str]) -> tuple[str, ...]:
        """The lines of a gallery's card."""
        facts = [
            f"side {self.side or 'none'}, seen from {self.viewpoint}"
            f" (azimuth {self.azimuth_deg:.0f}°, elevation {self.elevation_deg:.0f}°)",
            f"flank {self.flank} ({self.flank_confidence:.0%})",
        ]
        if self.error_px is not None:
            facts.append(
                f"keypoints {self.error_px:.1f} px off, {self.n_inliers} of {self.n_keypoints} fit"
            )
        if self.mask_iou is not None:
            facts.append(f"mask overlap {self.mask_iou:.2f}")
        return (*facts, *(f"⚑ {flag}" for flag in flags), *self.warnings)


def words_of_label(label: CuboidLabel) -> LabelWords:
    """The facts of a label that a card of the gallery states, taken from the label itself."""
    quality = label.quality
    return LabelWords(
        side=label.side,
        viewpoint=label.viewpoint,
        azimuth_deg=label.azimuth_deg,
        elevation_deg=label.elevation_deg,
        flank=label.flank,
        flank_confidence=label.flank_confidence,
        shares=label.face_share.tolist(),
        error_px=quality.reprojection_error_px,
        n_inliers=quality.n_inliers,
        n_keypoints=quality.n_keypoints,
        mask_iou=quality.mask_iou,
        warnings=quality.warnings,
    )


def words_of_row(row: Mapping[str, Any]) -> LabelWords:
    """The same facts, taken from a labelled row of a table: column -> value."""
    return LabelWords(
        side=row["side"],
        viewpoint=row["viewpoint"],
        azimuth_deg=row["azimuth_deg"],
        elevation_deg=row["elevation_deg"],
        flank=row["flank"],
        flank_confidence=row["flank_confidence"],
        shares=[row[name] for name in FIELD_COLUMNS["face_share"]],
        error_px=row["reprojection_error_px"],
        n_inliers=row["n_inliers"],
        n_keypoints=row["n_keypoints"],
        mask_iou=row["mask_iou"],
        warnings=(row["warnings"] or "").split("; ") if row["warnings"] else (),
    )

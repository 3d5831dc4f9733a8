"""The counts of a run: every animal is kept, flagged, rejected or faulty, and why.

Example:
    >>> FLAGS["near_camera"]
    'a corner of the box is at or behind the camera'
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec

from animal3dbox.datasets.labelling.sample_checks import MASK_LEFT_OUT
from animal3dbox.errors import SampleError
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.report.label_files import AnimalRow, RejectedRow

FEW_INLIERS = 0.5
LOW_OVERLAP = 0.6
MUCH_TRUNCATED = 0.3

LEAST_CONFIDENCE = 0.5

FLAGS = {
    "low_confidence": f"the box is right with a probability of less than {LEAST_CONFIDENCE:.0%}",
    "exchanged": "left and right keypoints were exchanged in the file, and are mended",
    "few_inliers": f"fewer than {FEW_INLIERS:.0%} of the visible keypoints fit",
    "low_overlap": f"the projected mesh overlaps the mask by less than {LOW_OVERLAP}",
    "truncated": f"more than {MUCH_TRUNCATED:.0%} of the box lies outside the image",
    "near_camera": "a corner of the box is at or behind the camera",
    "unseen": "the image shows nothing of the animal",
    "not_turned": (
        "the picture's EXIF orientation was not applied: if the keypoints were made on the turned"
        " picture, apply it (--orientation apply)"
    ),
    "misplaced": "the keypoints lie beside the frame, or the animal's own box or mask",
    "off_mask": "the body under its known camera lies beside the mask: one of them is wrong",
}
"""Reasons why a label that is kept should be looked at.

Labels of methods basic and paper have no probability: their causes are told instead."""


class FaultRow(msgspec.Struct, kw_only=True):
    """A sample that could not be read at all."""

    sample_id: str
    field: str
    problem: str


class Summary(msgspec.Struct, kw_only=True):
    """The counts of a run, as report.json holds them.

    Every animal of the input is counted exactly once in kept, flagged, rejected or faulty.

    Example:
        >>> fault = SampleError("a.jpg", "joints", "must be 24 triples")
        >>> summary = summarize(
        ...     source="set", body="dog", method="default",
        ...     animals=(), flags=(), rejected=(), faults=[fault],
        ... )
        >>> summary.animals, summary.kept, summary.faulty, summary.faults[0].sample_id
        (1, 0, 1, 'a.jpg')
    """

    source: str
    body: str
    method: str
    animals: int
    kept: int
    flagged: int
    rejected: int
    faulty: int
    flags: dict[str, int]
    reasons: dict[str, int]
    sides: dict[str, int]
    median_reprojection_error_px: float | None
    median_mask_iou: float | None
    faults: list[FaultRow]
    masks_left_out: int = 0


def flags_of(label: CuboidLabel) -> tuple[str, ...]:
    """The FLAGS that a label raises, in their order.

    Example:
        >>> from animal3dbox import LabelConfig, label_animal
        >>> label = label_animal(
        ...     image_hw=(120, 160),
        ...     vertices=[[x, y, z] for x in (-1, 1) for y in (-0.5, 0.5) for z in (-0.4, 0.4)],
        ...     K=[[100, 0, 79.5], [0, 100, 59.5], [0, 0, 1]],
        ...     pose=([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 0, 5]),
        ...     config=LabelConfig(axes="pca"),
        ... )
        >>> flags_of(label)
        ()
    """
    quality = label.quality
    is_rated = quality.confidence is not None  # a probability says more than each of its causes
    raised = {
        "low_confidence": is_rated and label.confidence < LEAST_CONFIDENCE,
        "exchanged": quality.labeling != "as given",
        "few_inliers": (
            not is_rated
            and quality.n_keypoints > 0
            and quality.n_inliers < FEW_INLIERS * quality.n_keypoints
        ),
        "low_overlap": (
            not is_rated and quality.mask_iou is not None and quality.mask_iou < LOW_OVERLAP
        ),
        "truncated": label.truncation > MUCH_TRUNCATED,
        "near_camera": label.behind_camera,
        "unseen": label.truncation >= 1 or not bool((label.box[:2] < label.box[2:]).all()),
        "not_turned": "not_turned" in quality.flags,
        "misplaced": "misplaced" in quality.flags,
        "off_mask": "off_mask" in quality.flags,
    }
    return tuple(flag for flag in FLAGS if raised[flag])


def summarize(
    *,
    source: str,
    body: str,
    method: str,
    animals: Sequence[AnimalRow],
    flags: Sequence[tuple[str, ...]],
    rejected: Sequence[RejectedRow],
    faults: Sequence[SampleError],
) -> Summary:
    """Count what became of every animal.

    Args:
        source: the dataset.
        body: the body source's name.
        method: the configured method.
        animals: the labels.
        flags: for each label the flags it raised.
        rejected: animals without a label.
        faults: samples that could not be read.

    """
    counts = SummaryCounts()
    for row, raised in zip(animals, flags, strict=True):
        counts.add_label(row, raised)
    for refused in rejected:
        counts.add_rejected(refused)
    own_faults = [
        FaultRow(sample_id=fault.sample_id or "", field=fault.field, problem=fault.problem)
        for fault in faults
    ]
    return counts.summary(source=source, body=body, method=method, faults=own_faults)


@dataclass
class SummaryCounts:
    """The counts of a run while its animals come in, which need not be held for them."""

    kept: int = 0
    flagged: int = 0
    flags: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    sides: Counter[str] = field(default_factory=Counter)
    errors_px: list[float] = field(default_factory=list)
    mask_ious: list[float] = field(default_factory=list)
    masks_left_out: int = 0

    def add_label(self, row: AnimalRow, raised: Sequence[str]) -> None:
        """Count a label and the flags that it raised."""
        self.flagged += bool(raised)
        self.kept += not raised
        self.flags.update(raised)
        self.sides[row.side or "none"] += 1
        self.masks_left_out += _lost_its_mask(row)
        for values, name in (
            (self.errors_px, "reprojection_error_px"),
            (self.mask_ious, "mask_iou"),
        ):
            value = row.quality[name]
            if isinstance(value, int | float):
                values.append(float(value))

    def add_rejected(self, row: RejectedRow) -> None:
        """Count an animal without a label."""
        self.reasons[row.reason] += 1

    def summary(self, *, source: str, body: str, method: str, faults: list[FaultRow]) -> Summary:
        """The counts, and the faults; other arguments as summarize has them."""
        rejected = self.reasons.total()
        return Summary(
            source=source,
            body=body,
            method=method,
            animals=self.kept + self.flagged + rejected + len(faults),
            kept=self.kept,
            flagged=self.flagged,
            rejected=rejected,
            faulty=len(faults),
            flags=dict(self.flags),
            reasons=dict(self.reasons),
            sides=dict(self.sides),
            median_reprojection_error_px=_median(self.errors_px),
            median_mask_iou=_median(self.mask_ious),
            faults=faults,
            masks_left_out=self.masks_left_out,
        )


def _lost_its_mask(row: AnimalRow) -> bool:
    """Whether a label was made without the mask that its animal has."""
    warnings = row.quality.get("warnings")
    return isinstance(warnings, list) and any(one.startswith(MASK_LEFT_OUT) for one in warnings)


def _median(values: list[float]) -> float | None:
    """The middle value, or the mean of the two in the middle; None without any."""
    ordered = sorted(values)
    if not ordered:
        return None
    middle = len(ordered) // 2
    return ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2

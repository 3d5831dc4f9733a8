"""A detector's boxes beside labels: which are of one animal, and how far they differ."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment

from animal3dbox.datasets.readers.cuboid_checks import overlap
from animal3dbox.datasets.readers.cuboid_conventions import Floats
from animal3dbox.datasets.readers.visible_boxes import stacked_boxes, visible_boxes
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError, DatasetFormatError
from animal3dbox.evaluate.tables import Cell, Table, mean, percent, quantile, table_from_records
from animal3dbox.geometry.box_overlap import box_iou, pairwise_box_iou
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.progress import watched

LEAST_IOU_3D = 0.05
"""Overlap in space from which two boxes are one animal's, whatever their projections are."""
LEAST_IOU_2D = 0.3
"""Overlap of projections from which two boxes are one animal's though they are apart in space."""
LIKE_IOUS = (0.15, 0.25, 0.5)
"""Overlaps whose rate is told, those of Omni3D's AP15, AP25 and AP50."""
BOX_COLUMNS = (
    *("status", "image", "label", "detection", "label_category", "detection_category", "score"),
    *("iou_3d", "iou_3d_scaled", "iou_2d", "label_distance", "detection_distance", "apart"),
    *("size_ratio", "axis_deg", "heading_deg"),
)
"""Columns of the table of boxes, in its order."""
NOTES = (
    "iou_3d: of the boxes as they are, where both are in metres; iou_3d_scaled: after the detection"
    " was scaled about the camera to the label's distance, which does not change its projection.",
    "iou_2d: of the upright boxes round the projections in the frame. apart: of the centres, in the"
    " label's unit. size_ratio: the cube root of the volumes' ratio, detection to label.",
    "axis_deg: between the boxes' lengths, 0 to 90, whichever end is the front; heading_deg:"
    " between their fronts, 0 to 180, where both are known.",
)


@dataclass(frozen=True)
class ComparedBox:
    """A label with the detection of the same animal, or one of them alone.

    Attributes:
        label: the label's box; None of a detection that has none.
        detection: the detector's; None of a label that has none; one of both there is.
        iou_3d: intersection over union in space; None where a scale is not known, or of one alone.
        iou_2d: of the projections; None of one alone.

    Example:
        >>> record = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="dog",
        ...     K=np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]),
        ...     center=np.array([0.0, 0.0, 4.0]),
        ...     rotation=np.eye(3),
        ...     size=np.array([0.9, 0.3, 0.6]),
        ... )
        >>> ComparedBox(record, None).status, ComparedBox(record, record, 1.0, 1.0).row()["apart"]
        ('label only', 0.0)
    """

    label: CuboidRecord | None
    detection: CuboidRecord | None
    iou_3d: float | None = None
    iou_2d: float | None = None

    @property
    def status(self) -> Literal["matched", "label only", "detection only"]:
        """Whether the box has its counterpart."""
        if self.label is None:
            return "detection only"
        return "label only" if self.detection is None else "matched"

    @property
    def record(self) -> CuboidRecord:
        """The label's box, or else the detection's."""
        record = self.label or self.detection
        if record is None:
            raise ConfigError("a compared box needs a label or a detection")
        return record

    @property
    def image_id(self) -> str:
        """The image, as the truth names it."""
        return self.record.image_id

    def row(self) -> dict[str, Cell]:
        """The numbers of the table of boxes."""
        label, detection = self.label, self.detection
        row: dict[str, Cell] = {"status": self.status, "image": self.image_id}
        for name, record in (("label", label), ("detection", detection)):
            if record is not None:
                row[name] = record.sample_id
                row[f"{name}_category"] = record.category
                row[f"{name}_distance"] = float(np.linalg.norm(record.center))
        if detection is not None:
            row["score"] = detection.score
        if label is not None and detection is not None:
            row |= {"iou_3d": self.iou_3d, "iou_2d": self.iou_2d, **_differences(label, detection)}
        return row


def _differences(label: CuboidRecord, detection: CuboidRecord) -> dict[str, Cell]:
    """How far the boxes of one animal differ."""
    distances = [float(np.linalg.norm(one.center)) for one in (label, detection)]
    scale = distances[0] / max(distances[1], 1e-12)
    at_distance = replace(detection, center=detection.center * scale, size=detection.size * scale)
    scaled = float(box_iou(cuboids_of([label]), cuboids_of([at_distance]))[0])
    fronts = label.rotation[:, 0], detection.rotation[:, 0]
    sine = float(np.linalg.norm(np.cross(*fronts)))
    heading_deg = float(np.rad2deg(np.arctan2(sine, fronts[0] @ fronts[1])))
    has_heading = label.heading_known and detection.heading_known
    return {
        "iou_3d_scaled": scaled,
        "apart": float(np.linalg.norm(label.center - detection.center)),
        "size_ratio": float(np.cbrt(np.prod(detection.size / label.size))),
        "axis_deg": min(heading_deg, 180 - heading_deg),
        "heading_deg": heading_deg if has_heading else None,
    }


def cuboids_of(records: Sequence[CuboidRecord]) -> Cuboid:
    """The boxes (N,) of records, float64, in the camera frame."""
    return Cuboid(*(torch.from_numpy(np.ascontiguousarray(one)) for one in stacked_boxes(records)))


def compared_boxes(labels: CuboidSet, detections: CuboidSet) -> list[ComparedBox]:
    """The boxes of labels and detections, matched within each image, in the labels' order.

    Args:
        labels: whose images have the detections' names.
        detections: of a detector.

    Raises:
        DatasetFormatError: no image of the labels is one of the detections'.

    Example:
        >>> record = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="dog",
        ...     K=np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]),
        ...     center=np.array([0.0, 0.0, 4.0]),
        ...     rotation=np.eye(3),
        ...     size=np.array([0.9, 0.3, 0.6]),
        ... )
        >>> boxes = CuboidSet("labels", (record,), ())
        >>> [(one.status, one.iou_3d) for one in compared_boxes(boxes, boxes)]
        [('matched', 1.0)]
    """
    of_image = boxes_by_image(labels, detections)
    shared = {image.image_id for image in detections.listed_images()}
    if labels.records and not shared & {record.image_id for record in labels.records}:
        raise DatasetFormatError(
            f"no image of the labels ({labels.records[0].image_id}, ...) is one of the truth's"
            f" ({next(iter(shared), 'none')}, ...): give the truth that was made of these labels"
        )
    each = watched(of_image.values(), "matching", unit="image")
    return [box for members in each for box in _of_one_image(*members)]


def boxes_by_image(
    labels: CuboidSet, detections: CuboidSet
) -> dict[str, tuple[list[CuboidRecord], list[CuboidRecord]]]:
    """Image -> its labels and its detections, of all images that have one of either."""
    of_image: dict[str, tuple[list[CuboidRecord], list[CuboidRecord]]] = defaultdict(
        lambda: ([], [])
    )
    for side, boxes in enumerate((labels, detections)):
        for record in boxes.records:
            of_image[record.image_id][side].append(record)
    return of_image


def _of_one_image(
    labels: Sequence[CuboidRecord], detections: Sequence[CuboidRecord]
) -> list[ComparedBox]:
    """The matched boxes of an image, then labels alone, then detections alone."""
    iou_3d, iou_2d = _overlaps(labels, detections)
    is_metric = all(record.metric for record in (*labels, *detections))
    pairs = matched_pairs(iou_3d if is_metric else np.zeros_like(iou_3d), iou_2d)
    partner = dict(pairs)
    boxes = [
        ComparedBox(label, None)
        if number not in partner
        else ComparedBox(
            label,
            detections[partner[number]],
            iou_3d=float(iou_3d[number, partner[number]]) if is_metric else None,
            iou_2d=float(iou_2d[number, partner[number]]),
        )
        for number, label in enumerate(labels)
    ]
    taken = set(partner.values())
    alone = (one for number, one in enumerate(detections) if number not in taken)
    return [*boxes, *(ComparedBox(None, one) for one in alone)]


def matched_pairs(iou_3d: Floats, iou_2d: Floats) -> list[tuple[int, int]]:
    """The label and detection of each animal of an image: one to one, of the greatest overlap.

    Boxes that share space count before those that only cover each other in the picture: a
    detection at a wrong distance is still its animal's. Categories are not asked.

    Args:
        iou_3d: (N, M) of N labels and M detections; zeros where scales are not known.
        iou_2d: (N, M) of their projections.

    Example:
        >>> matched_pairs(np.array([[0.0, 0.6]]), np.array([[0.9, 0.5]]))
        [(0, 1)]
    """
    worth = np.where(
        iou_3d >= LEAST_IOU_3D, 1 + iou_3d, np.where(iou_2d >= LEAST_IOU_2D, iou_2d, 0.0)
    )
    rows, columns = linear_sum_assignment(-worth)
    return [
        (int(row), int(column))
        for row, column in zip(rows, columns, strict=True)
        if worth[row, column] > 0
    ]


def _overlaps(
    labels: Sequence[CuboidRecord], detections: Sequence[CuboidRecord]
) -> tuple[Floats, Floats]:
    """The overlaps (N, M) of boxes in space and of their projections in the frame."""
    if not labels or not detections:
        nothing = np.zeros((len(labels), len(detections)))
        return nothing, nothing
    iou_3d = pairwise_box_iou(cuboids_of(labels), cuboids_of(detections)).numpy()
    in_frame = [visible_boxes(records).in_frame for records in (labels, detections)]
    iou_2d = [[overlap(one, other) for other in in_frame[1]] for one in in_frame[0]]
    return iou_3d, np.array(iou_2d, dtype=np.float64)


def comparison_tables(boxes: Sequence[ComparedBox]) -> tuple[Table, Table]:
    """The table of all boxes together, and that with a row a box.

    Example:
        >>> record = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="dog",
        ...     K=np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]),
        ...     center=np.array([0.0, 0.0, 4.0]),
        ...     rotation=np.eye(3),
        ...     size=np.array([0.9, 0.3, 0.6]),
        ... )
        >>> summary, every = comparison_tables([ComparedBox(record, record, 1.0, 1.0)])
        >>> summary.rows[0], len(every.rows)
        (('matched', 1), 1)
    """
    rows = [box.row() for box in boxes]
    every = table_from_records("boxes", "Boxes", rows, notes=NOTES, columns=BOX_COLUMNS)
    return _summary(rows), every


def _summary(rows: Sequence[dict[str, Cell]]) -> Table:
    """Counts, middles and rates of the matched boxes, a row each."""
    matched = [row for row in rows if row["status"] == "matched"]
    columns: dict[str, list[float | None]] = {
        name: [_number(row.get(name)) for row in matched] for name in BOX_COLUMNS[7:]
    }
    known = [value for value in columns["iou_3d"] if value is not None]
    headings = [value for value in columns["heading_deg"] if value is not None]
    facts: list[tuple[str, Cell]] = [
        (status, sum(row["status"] == status for row in rows))
        for status in ("matched", "label only", "detection only")
    ]
    facts += [
        (f"{name}, {kind}", of(columns[name]))
        for name in ("iou_3d", "iou_3d_scaled", "iou_2d", "apart", "size_ratio", "axis_deg")
        for kind, of in (("mean", mean), ("median", lambda values: quantile(values, 0.5)))
    ]
    facts += [
        (f"iou_3d >= {least}, % of matched", percent([value >= least for value in known]))
        for least in LIKE_IOUS
    ]
    facts += [
        ("headings known in both", len(headings)),
        ("heading_deg, median", quantile(headings, 0.5)),
        ("head for tail (heading_deg > 90), %", percent([value > 90 for value in headings])),
    ]
    return Table("summary", "Detections beside labels", (), ("of the boxes", "value"), tuple(facts))


def _number(cell: Cell) -> float | None:
    return float(cell) if isinstance(cell, int | float) else None

"""The metrics of detection of a comparison: average precision with the labels as the truth."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch

from animal3dbox.datasets.readers.visible_boxes import stacked_boxes
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.evaluate.comparison import boxes_by_image
from animal3dbox.evaluate.tables import Table
from animal3dbox.progress import watched
from animal3dbox.training.metrics.box_metrics import BoxMetrics

SCALE_FREE = ("rel_ap_3d", "rel_scale", "images", "truths", "predictions")
"""Metrics that mean something where the scale of labels or detections is not known."""
IN_BRIEF = ("ap_3d", "ap_3d_25", "ap_3d_50", "ap_3d_h45", "rel_ap_3d", "flip_rate")
"""Metrics that the command prints."""
NOTES = (
    "Labels are taken for the truth, so errors of labels count against the detector. ap_3d: mean"
    " average precision over 3D IoU of 0.05 to 0.5, or at 0.15, 0.25, 0.50; ap_3d_h30, h45:"
    " headings within 30, 45 degrees too; rel_ap_3d: at the best one scale.",
    "Matching is COCO's, by score within each category, not that of the table of boxes. low, high:"
    " 95 %, by resampling images.",
)


def metrics_table(labels: CuboidSet, detections: CuboidSet) -> Table:
    """The table of metrics, a row each; of unknown scales only those that ask for none.

    Args:
        labels: whose images have the detections' names.
        detections: of a detector; a score that is not known counts as 1.

    Example:
        >>> import numpy as np
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
        >>> {row[0]: row[1] for row in metrics_table(boxes, boxes).rows}["ap_3d"]
        1.0
    """
    records = (*labels.records, *detections.records)
    classes = tuple(sorted({_class_name(record) for record in records}))
    is_metric = all(record.metric for record in records)
    metrics = BoxMetrics(classes=classes, relative=True, metric=is_metric)
    of_image = boxes_by_image(labels, detections).items()
    for image_id, members in watched(of_image, "measuring", unit="image"):
        target, prediction = (metric_fields(one, classes) for one in members)
        metrics.update([prediction], [{**target, "image_id": image_id}])
    values = metrics.compute()
    ends = tuple(f"{name}{end}" for name in values for end in ("_low", "_high"))
    rows = tuple(
        (name, value, values.get(f"{name}_low"), values.get(f"{name}_high"))
        for name, value in values.items()
        if name not in ends and (is_metric or name in SCALE_FREE)
    )
    return Table("metrics", "Metrics of detection", NOTES, ("metric", "value", "low", "high"), rows)


def in_brief(table: Table) -> Table:
    """The table of metrics with the rows of IN_BRIEF alone."""
    rows = tuple(row for row in table.rows if row[0] in IN_BRIEF)
    return replace(table, rows=rows, notes=())


def _class_name(record: CuboidRecord) -> str:
    """A box's category, whatever its case is."""
    return record.category.strip().lower()


def metric_fields(records: Sequence[CuboidRecord], classes: tuple[str, ...]) -> dict[str, Any]:
    """The boxes of an image as BoxMetrics takes them.

    Args:
        records: the boxes; a score that is not known counts as 1.
        classes: names in lower case, by whose places boxes are labelled.

    """
    center, rotation, size = (torch.from_numpy(one) for one in stacked_boxes(records))
    K = torch.from_numpy(records[0].K) if records else None
    scores = [1.0 if record.score is None else record.score for record in records]
    fields = {
        "center": center,
        "rotation": rotation,
        "size": size,
        "labels": torch.tensor(
            [classes.index(_class_name(one)) for one in records], dtype=torch.int64
        ),
        "scores": torch.tensor(scores, dtype=torch.float64),
        "heading_known": torch.tensor([one.heading_known for one in records], dtype=torch.bool),
    }
    return fields if K is None else {**fields, "K": K}

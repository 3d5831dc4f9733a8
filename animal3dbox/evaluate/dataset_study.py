"""Labels of any dataset against its annotations, and against the truth where it lies beside."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import torch

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.labelling.sample_checks import Outcome
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import DatasetFormatError, SampleError
from animal3dbox.evaluate.config import METHODS
from animal3dbox.evaluate.tables import Cell, Table, mean, percent, quantile, table_from_records
from animal3dbox.geometry.box_overlap import box_iou
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.progress import watched

TRUTH = "truth.json"


class TrueBox(msgspec.Struct):
    """The fields of one animal in truth.json that are used here; camera frame."""

    sample_id: str
    center: tuple[float, float, float]
    rotation: tuple[
        tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]
    ]
    size: tuple[float, float, float]


class TruthFile(msgspec.Struct):
    """The part of truth.json that is used here."""

    animals: list[TrueBox]


@dataclass(frozen=True)
class DatasetRow:
    """One animal by one method.

    Attributes:
        sample_id: the animal.
        method: of METHODS.
        reason: why there is no label ("faulty" if the record is unusable), or None.
        annotated_px: mean distance of the projected landmarks from the annotated keypoints.
        mask_iou: of the projected body with the mask.
        rotation_deg: of the box from the true one; None without truth.
        corner_percent: mean distance of corners from the true ones, in % of the true diagonal; None
            without truth.
        iou3d: with the true box; None without truth.

    Example:
        >>> row = DatasetRow("a.jpg", "default", reason=None, annotated_px=3.5)
        >>> row.annotated_px, row.iou3d  # a fit is known, an accuracy is not
        (3.5, None)
    """

    sample_id: str
    method: str
    reason: str | None
    annotated_px: float | None = None
    mask_iou: float | None = None
    rotation_deg: float | None = None
    corner_percent: float | None = None
    iou3d: float | None = None


def true_boxes(path: Path) -> dict[str, Cuboid] | None:
    """sample_id -> the true box, of truth.json in a dataset's folder or beside its file.

    None if there is none.

    Raises:
        DatasetFormatError: it is not as docs/formats.md says.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     print(true_boxes(Path(folder)))
        None
    """
    file = (path if path.is_dir() else path.parent) / TRUTH
    if not file.is_file():
        return None
    boxes = {}
    for animal in decode_json(file, TruthFile).animals:
        center, rotation, size = (
            torch.tensor(value, dtype=torch.float64)
            for value in (animal.center, animal.rotation, animal.size)
        )
        try:
            boxes[animal.sample_id] = Cuboid(center, rotation, size)
        except ValueError as error:
            raise DatasetFormatError(f"{file}: {animal.sample_id}: {error}") from error
    return boxes


def dataset_rows(
    records: RecordSet, bodies: BodySource, truths: Mapping[str, Cuboid] | None
) -> list[DatasetRow]:
    """Every record by every method.

    Poses that come with the dataset are not given to any method.

    Example:
        >>> from animal3dbox.datasets.bodies.sources import preset_body
        >>> fault = SampleError("a.jpg", "joints", "must be 24 triples")
        >>> records = RecordSet("coco", records=(), faults=(fault,))
        >>> rows = dataset_rows(records, preset_body("dog"), truths=None)
        >>> rows[0].method, rows[0].reason  # a faulty record counts for every method
        ('basic', 'faulty')
    """
    rows = [
        DatasetRow(fault.sample_id or "", method, "faulty")
        for fault in records.faults
        for method in METHODS
    ]
    for record in watched(records.records, "evaluating", unit="animal"):
        for method, config in METHODS.items():
            outcome = _outcome(replace(record, stored_pose=None), bodies, config)
            if isinstance(outcome, SampleError):
                rows.append(DatasetRow(record.sample_id, method, "faulty"))
                continue
            rows.append(
                _row(record.sample_id, method, outcome, (truths or {}).get(record.sample_id))
            )
    return rows


def _outcome(record: AnimalRecord, bodies: BodySource, config: LabelConfig) -> Outcome:
    """What becomes of one animal."""
    try:
        return label_records([request_of_record(record, bodies)], config)[0]
    except SampleError as error:
        return error


def _row(
    sample_id: str, method: str, outcome: CuboidLabel | Rejection, truth: Cuboid | None
) -> DatasetRow:
    if isinstance(outcome, Rejection):
        return DatasetRow(sample_id, method, outcome.reason)
    row = DatasetRow(
        sample_id, method, None, outcome.quality.reprojection_error_px, outcome.quality.mask_iou
    )
    if truth is None:
        return row
    corner_errors = torch.linalg.vector_norm(outcome.corners_3d - truth.corners(), dim=-1)
    return replace(
        row,
        rotation_deg=float(torch.rad2deg(rotation_angle(outcome.rotation, truth.rotation))),
        corner_percent=100 * float(corner_errors.mean() / truth.diagonal),
        iou3d=float(box_iou(outcome.cuboid, truth)),
    )


def dataset_table(rows: Sequence[DatasetRow]) -> Table:
    """Every method over the dataset.

    Example:
        >>> table = dataset_table([DatasetRow("a.jpg", "default", None, annotated_px=3.5)])
        >>> row = table.records()[-1]
        >>> row["method"], row["labelled"], row["annotated mean px"]
        ('default', 1, 3.5)
    """
    records: list[dict[str, Cell]] = []
    for method in METHODS:
        of_method = [row for row in rows if row.method == method]
        reasons = [row.reason for row in of_method]
        px, iou = [row.annotated_px for row in of_method], [row.mask_iou for row in of_method]
        records.append(
            {
                "method": method,
                "animals": len(of_method),
                "labelled": sum(reason is None for reason in reasons),
                "annotated mean px": mean(px),
                "annotated median px": quantile(px, 0.5),
                "annotated p95 px": quantile(px, 0.95),
                "mask IoU median": quantile(iou, 0.5),
                "mask IoU p5": quantile(iou, 0.05),
                "rejected %": percent([reason not in (None, "faulty") for reason in reasons]),
                "degenerate %": percent([reason == "degenerate_box" for reason in reasons]),
                "behind camera %": percent([reason == "behind_camera" for reason in reasons]),
                "faulty": sum(reason == "faulty" for reason in reasons),
                "rotation median deg": quantile([row.rotation_deg for row in of_method], 0.5),
                "corners median % diag": quantile([row.corner_percent for row in of_method], 0.5),
                "IoU3D median": quantile([row.iou3d for row in of_method], 0.5),
            }
        )
    notes = (
        "annotated: distance to the keypoints given: a fit, not an accuracy. mask IoU: of the"
        " projected body with the dataset's mask.",
        "degenerate: the projected box has less than 1 % of the mask's area. faulty: records that"
        " cannot be used.",
        f"rotation, corners, IoU3D: against {TRUTH} beside the annotations, where there is one."
        " Stored poses are given to no method.",
    )
    title = "Labels against what is annotated"
    return table_from_records("dataset", title, records, notes=notes)

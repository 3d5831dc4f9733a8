"""The boxes of labels.json as a set of cuboids, which any exchange format can be written from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.checks import check_intrinsics
from animal3dbox.report.label_files import AnimalRow, LabelFile, labels_file
from animal3dbox.report.label_reading import read_label_rows

ROTATION_TOLERANCE = 1e-6


def read_label_cuboids(path: Path) -> CuboidSet:
    """The boxes of a labels.json.

    Args:
        path: the file, or the folder that ``animal3dbox label`` wrote.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not of the schema.

    Example:
        >>> import tempfile
        >>> from animal3dbox.report import LabelFile, RejectedRow, write_labels_json
        >>> row = RejectedRow(sample_id="a", image="a.jpg", animal=0, reason="no_pose", detail="")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     out = Path(folder) / "labels.json"
        ...     write_labels_json(out, LabelFile(body="dog", config={}, animals=[], rejected=[row]))
        ...     cuboids = read_label_cuboids(Path(folder))
        >>> len(cuboids.records)  # a rejected animal has no box
        0
    """
    labels, faults = read_label_rows(labels_file(path))
    cuboids = cuboids_of_labels(labels)
    return replace(cuboids, faults=(*faults, *cuboids.faults))


def cuboids_of_labels(labels: LabelFile) -> CuboidSet:
    """The boxes of labels.

    Metric where a row states its scale, with image paths as the labels have them.

    Images that hold no labelled animal are not listed: labels.json knows neither their size nor
    that they are empty.
    """
    records, faults = [], []
    for row in labels.animals:
        try:
            records.append(_record(row))
        except SampleError as error:
            faults.append(error)
    notes = []
    if labels.rejected:
        partly = len({row.image for row in labels.rejected} & {row.image for row in labels.animals})
        notes.append(
            f"{len(labels.rejected)} animals have no label; {partly} of the images written show"
            " some of them, unannotated"
        )
    return CuboidSet("labels", tuple(records), tuple(faults), tuple(notes))


def _check_row(
    row: AnimalRow,
    *,
    K: NDArray[np.float64],
    rotation: NDArray[np.float64],
    size: NDArray[np.float64],
) -> None:
    """Raise a SampleError for a row whose box other tools could not take, or would misread."""
    try:
        check_intrinsics("K", K)
    except ShapeError as error:
        raise SampleError(row.sample_id, "K", str(error)) from error
    if (
        np.abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE
        or np.linalg.det(rotation) < 0
    ):
        raise SampleError(
            row.sample_id,
            "rotation",
            "is no rotation (orthogonal, determinant +1): the file was changed after labelling",
        )
    if row.distortion is not None and any(row.distortion):
        raise SampleError(
            row.sample_id,
            "distortion",
            "is a lens, which no exchange format has: straighten the image and label it again",
        )
    if row.scale_m_per_unit is not None and not row.scale_m_per_unit > 0:
        raise SampleError(
            row.sample_id,
            "scale_m_per_unit",
            f"must be positive, or null if it is not known; got {row.scale_m_per_unit}",
        )
    if size.min() <= 0:
        raise SampleError(row.sample_id, "size", f"must be positive, got {size.tolist()}")


def _record(row: AnimalRow) -> CuboidRecord:
    K, center, rotation, size, box = (
        _numbers(row, field, shape)
        for field, shape in (
            ("K", (3, 3)),
            ("center", (3,)),
            ("rotation", (3, 3)),
            ("size", (3,)),
            ("box", (4,)),
        )
    )
    _check_row(row, K=K, rotation=rotation, size=size)
    return CuboidRecord(
        sample_id=row.sample_id,
        image_id=row.image,
        image_path=Path(row.image),
        image_hw=row.image_hw,
        category=row.category,
        K=K,
        center=center,
        rotation=rotation,
        size=size,
        metric=row.scale_m_per_unit is not None,
        heading_known=True,
        box=box if (box[2:] > box[:2]).all() else None,
        truncation=row.truncation,
        sighting=row.sighting,
        upright=row.upright,
    )


def _numbers(row: AnimalRow, field: str, shape: tuple[int, ...]) -> np.ndarray:
    try:
        values = np.array(getattr(row, field), dtype=np.float64)
    except ValueError as error:
        raise SampleError(row.sample_id, field, "has rows of different lengths") from error
    if values.shape != shape:
        raise SampleError(
            row.sample_id,
            field,
            f"must be {' x '.join(map(str, shape))} numbers, got shape {values.shape}",
        )
    return values

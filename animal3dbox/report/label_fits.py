"""The fitted bodies of labels.json, which exports of fits are written from."""

from pathlib import Path

import numpy as np

from animal3dbox.datasets.exchange.fitted_animals import FittedAnimal
from animal3dbox.errors import SampleError
from animal3dbox.report.label_files import AnimalRow, FitRow, labels_file
from animal3dbox.report.label_reading import read_label_rows


def read_label_fits(path: Path) -> tuple[tuple[FittedAnimal, ...], tuple[SampleError, ...], int]:
    """The fitted bodies of a labels.json, in their own unit where labels are metric.

    Args:
        path: the file, or the folder that ``animal3dbox label`` wrote.

    Returns:
        The animals; an error for each row that cannot be used; and how many animals have labels
        of other bodies, such as the rigid ones of those with few keypoints.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not of the schema.

    Example:
        >>> import tempfile
        >>> from animal3dbox.report import LabelFile, write_labels_json
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     out = Path(folder) / "labels.json"
        ...     write_labels_json(out, LabelFile(body="dog", config={}, animals=[], rejected=[]))
        ...     read_label_fits(out)
        ((), (), 0)
    """
    file, faults = read_label_rows(labels_file(path))
    fitted = [(row, row.fit) for row in file.animals if isinstance(row.fit, FitRow)]
    animals = tuple(_animal(row, fit) for row, fit in fitted)
    return animals, faults, len(file.animals) - len(animals)


def _animal(row: AnimalRow, fit: FitRow) -> FittedAnimal:
    """The fitted body of a row."""
    return FittedAnimal(
        sample_id=row.sample_id,
        image_id=row.image,
        image_hw=row.image_hw,
        category=row.category,
        parameters=fit.parameters,
        K=np.array(row.K),
        R=np.array(row.R),
        t=np.array(row.t) / (row.scale_m_per_unit or 1.0),
        keypoints_2d=np.array(fit.keypoints).reshape(-1, 3),
        box=np.array(row.box),
    )

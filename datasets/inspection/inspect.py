"""The inspection of a dataset: one call for every format."""

from collections import Counter
from pathlib import Path

import msgspec

from animal3dbox.datasets.formats import bodies_for, read_dataset
from animal3dbox.datasets.inspection.animal3d import animal3d_facts
from animal3dbox.datasets.inspection.answers import answers
from animal3dbox.datasets.inspection.labelings import labeling_facts
from animal3dbox.datasets.inspection.records import (
    body_facts,
    camera_facts,
    confidences,
    fault_facts,
    image_facts,
    keypoint_facts,
    marked_median,
    mask_facts,
)
from animal3dbox.datasets.inspection.result import Inspection
from animal3dbox.datasets.inspection.stored_fits import stored_fit_facts
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.readers.animal3d import reader as animal3d


def inspect_dataset(
    path: Path, format: str = "auto", options: ReadOptions | None = None, *, fits: bool = False
) -> Inspection:
    """Count and measure a user's own copy of a dataset, before anything is labelled.

    Args:
        path: the dataset's folder or annotation file.
        format: of formats.FORMATS, or "auto".
        options: as for reading; a model, if there is one, tells the most.
        fits: whether stored bodies are compared with bodies fitted here, a fifth of a second each.

    Returns:
        The facts, and sentences on what follows from them.

    Raises:
        ConfigError: an option that the format has no use for.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    Example:
        >>> import tempfile
        >>> from animal3dbox.datasets import SyntheticSet
        >>> from animal3dbox.datasets.synthetic import WorldConfig, write_stanfordextra
        >>> from animal3dbox.smal import VOCABULARIES
        >>> config = WorldConfig((120, 160), VOCABULARIES["stanfordextra24"])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = write_stanfordextra(SyntheticSet(0, 2, config), Path(folder))
        ...     inspection = inspect_dataset(Path(folder))
        >>> inspection.format, inspection.animals
        ('stanfordextra', 2)

    """
    dataset = read_dataset(path, format, options)
    records, bodies = dataset.records.records, dataset.bodies
    is_animal3d = dataset.records.name == animal3d.FORMAT
    own = animal3d_facts(path, records, bodies) if is_animal3d else None
    by_image = Counter(record.image_id for record in records)
    inspection = Inspection(
        path=str(path),
        format=dataset.records.name,
        images=len(by_image),
        animals=len(records),
        largest_group=max(by_image.values(), default=0),
        splits={} if own is None else own.entries,
        vocabularies=dict(Counter(record.vocabulary.name for record in records).most_common()),
        categories=dict(Counter(record.category for record in records).most_common()),
        keypoints_marked=marked_median(records),
        confidences=confidences(records),
        image_files=image_facts(records),
        masks=mask_facts(records),
        bodies=body_facts(records, bodies),
        cameras=camera_facts(records, bodies),
        keypoint_places=keypoint_facts(records),
        labelings=labeling_facts(records, bodies_for(dataset, None)),
        faults=fault_facts(dataset.records),
        animal3d=own,
        notes=list(dataset.records.notes),
        answers=[],
        stored_fits=stored_fit_facts(records, bodies) if fits else None,
    )
    return msgspec.structs.replace(inspection, answers=answers(inspection))

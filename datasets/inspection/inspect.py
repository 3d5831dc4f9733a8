"""A dataset inspected: one call for every format."""

from collections import Counter
from pathlib import Path

import msgspec

from animal3dbox.datasets.formats import ReadOptions, read_dataset
from animal3dbox.datasets.inspection.animal3d import animal3d_facts
from animal3dbox.datasets.inspection.answers import answers
from animal3dbox.datasets.inspection.records import (
    body_facts,
    camera_facts,
    confidences,
    fault_facts,
    image_facts,
    marked_median,
    mask_facts,
)
from animal3dbox.datasets.inspection.result import Inspection
from animal3dbox.datasets.readers.animal3d import reader as animal3d


def inspect_dataset(
    path: Path, format: str = "auto", options: ReadOptions | None = None
) -> Inspection:
    """What is in a copy of a dataset.

    Args:
        path: its folder or annotation file.
        format: of reading.FORMATS, or "auto".
        options: as for reading; a model, if there is one, tells the most.

    Raises:
        ConfigError: an option that the format has no use for.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    """
    read = read_dataset(path, format, options)
    records = read.records.records
    own = (
        animal3d_facts(path, records, read.bodies) if read.records.name == animal3d.FORMAT else None
    )
    by_image = Counter(record.image_id for record in records)
    found = Inspection(
        path=str(path),
        format=read.records.name,
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
        bodies=body_facts(records, read.bodies),
        cameras=camera_facts(records, read.bodies),
        faults=fault_facts(read.records),
        animal3d=own,
        notes=list(read.records.notes),
        answers=[],
    )
    return msgspec.structs.replace(found, answers=answers(found))

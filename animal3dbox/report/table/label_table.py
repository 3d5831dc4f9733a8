"""The rows of the table of labels: one for every animal, whatever became of it."""

from collections.abc import Sequence

from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.animal_outcomes import AnimalOutcome
from animal3dbox.errors import SampleError
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.report.label_files import animal_row
from animal3dbox.report.summary import flags_of
from animal3dbox.report.table.columns import (
    KINDS,
    Status,
    Table,
    Value,
    label_values,
    unlabelled_values,
)
from animal3dbox.report.table.keys import UnreadAnimal, animal_key, table_length, unread_animal


def label_table(dataset: LabelDataset, indices: Sequence[int]) -> Table:
    """The table of some images of a dataset: a row for every animal, labelled or not.

    The labels of all these images are made together, or come from the Dataset's cache. Pictures are
    not decoded (`checked_facts` in datasets/images/photos.py has what is looked at).

    Args:
        dataset: opened with ``on_bad="skip"``, if its annotations have faults.
        indices: of images; from ``len(dataset)`` on of the annotations that cannot be read, each of
            which has a row, too. There are `table_length(dataset)` of both.

    Returns:
        Column -> values, as `columns.COLUMNS` lists them; None where nothing is known.

    Raises:
        IndexError: there is no such image or annotation.

    Example:
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> table = label_table(SyntheticDataset(2, seed=0, image_hw=(120, 160)), [0, 1])
        >>> table["status"], table["side"], len(table["corners_3d_7_2"])
        (['labelled', 'labelled'], ['left', 'top'], 2)
    """
    count = len(dataset)
    for index in indices:
        if not 0 <= index < table_length(dataset):
            raise IndexError(f"index {index} of {table_length(dataset)} rows' images")
    images = [index for index in indices if index < count]
    digest = dataset.labels_digest
    rows = [_animal_values(one, digest) for one in dataset.outcomes(images)]
    unread = (unread_animal(dataset, index) for index in indices if index >= count)
    rows += [_unread_values(one, digest) for one in unread]
    if not rows:
        return {name: [] for name in KINDS}
    return dict(zip(KINDS, map(list, zip(*rows, strict=True)), strict=True))


def _animal_values(animal: AnimalOutcome, labels_digest: str) -> list[Value]:
    """The row of an animal whose annotation could be read."""
    key = animal_key(labels_digest, animal.image_id, animal.number, animal.entry)
    outcome, entry = animal.outcome, animal.entry
    if isinstance(outcome, CuboidLabel):
        row = animal_row(
            outcome,
            image=animal.image_id,
            animal=animal.number,
            category=entry.category,
            sighting=animal.sighting,
            upright=animal.facts.upright,
        )
        status: Status = "labelled" if animal.refused_by is None else "filtered"
        reason, problem = animal.refused_by or (None, None)
        values = label_values(row, flags_of(outcome))
    elif isinstance(outcome, SampleError):
        status, reason, problem = "faulty", outcome.field, outcome.problem
        values = unlabelled_values(_known(animal))
    else:
        status, reason, problem = "rejected", outcome.reason, outcome.detail
        values = unlabelled_values(_known(animal))
    return [key, labels_digest, animal.image_index, status, reason, problem, *values]


def _known(animal: AnimalOutcome) -> dict[str, Value]:
    """Column -> what the annotation of an animal without a label says."""
    entry = animal.entry
    height, width = entry.image_hw
    return {
        "image": animal.image_id,
        "animal": animal.number,
        "sample_id": entry.sample_id,
        "category": entry.category,
        "image_height": height,
        "image_width": width,
        "upright": animal.facts.upright,
        **animal.sighting.known,
    }


def _unread_values(animal: UnreadAnimal, labels_digest: str) -> list[Value]:
    """The row of an animal whose annotation cannot be read."""
    fault = animal.fault
    annotated: dict[str, Value] = {
        "image": animal.image_id,
        "animal": animal.number,
        "sample_id": fault.sample_id,
    }
    values: list[Value] = [animal.key(labels_digest), labels_digest, animal.index, "faulty"]
    return [*values, fault.field, fault.problem, *unlabelled_values(annotated)]

"""From the labels of an image's animals to its target: which go in, and why others do not."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.labelling.filters import LabelFilter
from animal3dbox.datasets.labelling.image_samples import ImageSample
from animal3dbox.datasets.labelling.label_store import fault_case, rejected_case
from animal3dbox.datasets.labelling.load_report import Case
from animal3dbox.datasets.labelling.sample_checks import Outcome
from animal3dbox.datasets.labelling.skipped import Target
from animal3dbox.datasets.labelling.targets import check_one_camera, masks_of, target_of
from animal3dbox.errors import SampleError
from animal3dbox.labels.types import CuboidLabel, Rejection


def chosen_labels(
    sample: ImageSample, outcomes: Sequence[Outcome], *, filters: LabelFilter, raise_errors: bool
) -> tuple[dict[int, CuboidLabel], list[Case]]:
    """The labels of an image that go into its target.

    Args:
        sample: the image.
        outcomes: of its animals, in order.
        filters: limits that a label must keep.
        raise_errors: whether an animal without a label is an error, not a case.

    Returns:
        labels: by the places of their animals.
        cases: why the others have none.

    Raises:
        SampleError: an animal has no label, and raise_errors is set.

    """
    labels: dict[int, CuboidLabel] = {}
    cases: list[Case] = []
    for place, (entry, outcome) in enumerate(zip(sample.animals, outcomes, strict=True)):
        if isinstance(outcome, CuboidLabel):
            limit = filters.problem(outcome)
            if limit is None:
                labels[place] = outcome
            else:
                cases.append(_filtered_case(entry.sample_id, *limit))
        elif isinstance(outcome, SampleError):
            if raise_errors:
                raise outcome
            cases.append(fault_case(outcome))
        else:
            if raise_errors:
                raise _rejected_error(entry.sample_id, outcome)
            cases.append(rejected_case(entry.sample_id, outcome))
    return labels, cases


def image_target(
    sample: ImageSample,
    labels: Mapping[int, CuboidLabel],
    *,
    masks: Sequence[NDArray[np.bool_] | None],
    taken: str | None,
    class_numbers: Mapping[str, int],
    named_faces: bool,
) -> Target:
    """The target of an image with labels.

    Args:
        sample: the image.
        labels: at least one, by the places of their animals.
        masks: (H, W) of these animals, None of one without; empty if targets hold none.
        taken: when, by the picture's own header; None if it does not tell.
        class_numbers: category -> number.
        named_faces: whether forward and left mean something.

    Raises:
        SampleError: the animals do not share one camera.

    """
    check_one_camera(sample.image_id, list(labels.values()))
    entries = [sample.animals[place] for place in labels]
    all_masks = [mask for mask in masks if mask is not None]
    vocabularies = {
        entry.vocabulary.name: entry.vocabulary for entry in entries if entry.vocabulary is not None
    }
    is_one_vocabulary = len(vocabularies) == 1  # else animals are marked differently
    return target_of(
        sample.image_id,
        list(labels.values()),
        [class_numbers[entry.category] for entry in entries],
        masks=masks_of(all_masks) if len(all_masks) == len(labels) else None,
        vocabulary=next(iter(vocabularies.values())) if is_one_vocabulary else None,
        named_faces=named_faces,
        sightings=[entry.sighting.with_picture_time(taken) for entry in entries],
    )


def partial_case(sample_id: str) -> Case:
    """The case of an animal whose image is left out, since others of its animals have no label."""
    problem = "has a label, but others of its image have none: partial='skip' leaves the image out"
    return _filtered_case(sample_id, "partial", problem)


def _filtered_case(sample_id: str, field: str, problem: str) -> Case:
    return Case(kind="filtered", sample_id=sample_id, field=field, problem=problem)


def _rejected_error(sample_id: str, rejection: Rejection) -> SampleError:
    """The error of an animal without a label, where none may be left out."""
    problem = (
        f"cannot be made, {rejection.reason}: {rejection.detail}; on_bad='skip' leaves such animals"
        " out and reports them"
    )
    return SampleError(sample_id, "label", problem)

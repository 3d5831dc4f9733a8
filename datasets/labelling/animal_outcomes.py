"""What becomes of each animal of some images: a label, or why it has none.

A Dataset makes targets of the labels that pass, a table makes a row of every outcome. Both ask the
same store (label_store.py).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.labelling.filters import LabelFilter
from animal3dbox.datasets.labelling.image_index import AnimalEntry
from animal3dbox.datasets.labelling.image_samples import ImageSample, SampleSource
from animal3dbox.datasets.labelling.label_store import LabelStore, fault_case, rejected_case
from animal3dbox.datasets.labelling.load_report import Case
from animal3dbox.datasets.labelling.open_samples import RequestOrError, requests_of_sample
from animal3dbox.datasets.labelling.sample_checks import Outcome
from animal3dbox.datasets.sightings import Sighting
from animal3dbox.errors import SampleError
from animal3dbox.labels.types import CuboidLabel, Rejection

_NO_FACTS = PhotoFacts()


@dataclass(frozen=True, eq=False)
class AnimalOutcome:
    """What became of one animal.

    Attributes:
        image_index: its image's place in the Dataset.
        image_id: its image.
        number: which of the image's animals it is, from 0; see animal_number.
        entry: what the dataset says of it without its numbers.
        outcome: its label, or why it has none.
        refused_by: the field of the filter that refuses its label and how it is missed; None of a
            label that passes, and without a label.
        facts: of its picture's header.
        pixels: (H, W, 3) uint8 RGB of its picture, if pictures were asked for and this one could be
            read; the animals of an image share them.
    """

    image_index: int
    image_id: str
    number: int
    entry: AnimalEntry
    outcome: Outcome
    refused_by: tuple[str, str] | None
    facts: PhotoFacts
    pixels: NDArray[np.uint8] | None = None

    @property
    def sighting(self) -> Sighting:
        """When, where and of whom the picture is, its header's time included."""
        return self.entry.sighting.with_picture_time(self.facts.time)

    @property
    def case(self) -> Case | None:
        """The case of an animal without a label; None with one."""
        if isinstance(self.outcome, SampleError):
            return fault_case(self.outcome)
        if isinstance(self.outcome, Rejection):
            return rejected_case(self.entry.sample_id, self.outcome)
        return None


def animal_outcomes(
    source: SampleSource,
    store: LabelStore,
    indices: Sequence[int],
    *,
    classes: Mapping[str, int],
    filters: LabelFilter,
    pictures: bool = False,
) -> tuple[list[AnimalOutcome], list[Case]]:
    """What becomes of each animal of some images; their labels are made together.

    Args:
        source: of the images.
        store: gives the labels.
        indices: of the images.
        classes: the categories that animals may be of.
        filters: limits that labels may miss.
        pictures: whether pictures are decoded; else only their headers are read, and one that is
            damaged behind its header is not noticed.

    Returns:
        The outcomes, images in the order of their indices, animals in that of their image; and what
        was wrong with the cache.

    """
    samples = [source.sample(index) for index in indices]
    opened = [_opened(source, sample, classes, store, pictures=pictures) for sample in samples]
    requests = [request for one in opened for request in one.requests]
    outcomes, cases = store.labels(requests)
    remaining = iter(outcomes)
    animals: list[AnimalOutcome] = []
    for index, sample, one in zip(indices, samples, opened, strict=True):
        animals += _of_image(index, sample, one, remaining, filters=filters)
    return animals, cases


@dataclass(frozen=True, eq=False)
class _Opened:
    """An image's header, its pixels if they were asked for, and the requests for its labels."""

    facts: PhotoFacts
    pixels: NDArray[np.uint8] | None
    requests: list[RequestOrError]


def _opened(
    source: SampleSource,
    sample: ImageSample,
    classes: Mapping[str, int],
    store: LabelStore,
    *,
    pictures: bool,
) -> _Opened:
    """What is read of an image before its animals are labelled.

    Of one that cannot be read, an error for each of its animals.
    """
    if not sample.animals:
        return _Opened(_NO_FACTS, None, [])
    pixels = None
    try:
        if pictures:
            photo = source.photo(sample)
            facts, pixels = photo.facts, photo.pixels
        else:
            facts = source.facts(sample)
    except SampleError as error:
        errors = (
            SampleError(entry.sample_id, error.field, error.problem) for entry in sample.animals
        )
        return _Opened(_NO_FACTS, None, [*errors])
    return _Opened(facts, pixels, requests_of_sample(sample, facts, classes, store))


def _of_image(
    index: int,
    sample: ImageSample,
    opened: _Opened,
    outcomes: Iterator[Outcome],
    *,
    filters: LabelFilter,
) -> Iterator[AnimalOutcome]:
    """The animals of an image with their outcomes, of which it takes as many as it has animals."""
    outcomes_of_image = islice(outcomes, len(sample.animals))
    for place, (entry, outcome) in enumerate(zip(sample.animals, outcomes_of_image, strict=True)):
        yield AnimalOutcome(
            image_index=index,
            image_id=sample.image_id,
            number=animal_number(entry.sample_id, sample.image_id, place),
            entry=entry,
            outcome=outcome,
            refused_by=filters.problem(outcome) if isinstance(outcome, CuboidLabel) else None,
            facts=opened.facts,
            pixels=opened.pixels,
        )


def animal_number(sample_id: str | None, image_id: str, place: int) -> int:
    """Which of its image's animals a sample is, from 0.

    The number that its sample_id says ("image#k"), so that an unreadable neighbour shifts none;
    else its place.

    Example:
        >>> animal_number("a.jpg#2", "a.jpg", 1), animal_number("a.jpg", "a.jpg", 0)
        (2, 0)
    """
    number = (sample_id or "").removeprefix(f"{image_id}#")
    return int(number) if number.isdecimal() else place

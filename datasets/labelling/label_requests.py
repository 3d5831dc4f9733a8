"""Animals that need a label."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.own_or_fitted import OwnOrFittedBodies
from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.photos import checked_facts
from animal3dbox.datasets.labelling.image_index import AnimalEntry
from animal3dbox.datasets.labelling.image_samples import (
    ImageSample,
    Record,
    sample_of_record,
    sample_of_records,
)
from animal3dbox.errors import SampleError


@dataclass(frozen=True, eq=False)
class LabelRequest:
    """One animal that needs a label.

    The key is taken before anything is decoded, so that a file replaced while we label cannot store
    a stale label.

    Attributes:
        sample: what is annotated in its image.
        place: which of the sample's animals it is.
        facts: of the image's header. An EXIF orientation, applied or not, is among the label's
            warnings.
        key: names what its label is made from, for a cache; empty without one.
        mask_problem: why a mask that cannot be used is left out; None of any other.

    Example:
        >>> from animal3dbox.datasets import SyntheticSet, preset_body, request_of_record
        >>> records = SyntheticSet(seed=0, images=1).records().records
        >>> request = request_of_record(records[0], preset_body("dog"))
        >>> request.record.category, request.place
        ('dog', 0)
    """

    sample: ImageSample
    place: int
    facts: PhotoFacts
    key: bytes = b""
    mask_problem: SampleError | None = None

    @property
    def entry(self) -> AnimalEntry:
        """What is said of the animal without its numbers."""
        return self.sample.animals[self.place]

    @property
    def record(self) -> Record:
        """What the dataset says of the animal."""
        return self.sample.records[self.place]

    @cached_property
    def mask(self) -> NDArray[np.bool_] | None:
        """The animal's mask (H, W), decoded when it is first asked for; None without.

        Raises:
            SampleError: the mask's file cannot be read, or is of another size.

        """
        return self.sample.mask(self.place) if self.mask_problem is None else None

    @property
    def bodies(self) -> BodySource:
        """Where its body comes from; raises SampleError if nothing is known of that."""
        if self.sample.bodies is None:
            raise SampleError(self.entry.sample_id, "body", "there is no source of bodies")
        if isinstance(self.sample.bodies, OwnOrFittedBodies):
            return self.sample.bodies.of(self.entry.sample_id)
        return self.sample.bodies


def requests_of_image(
    records: Sequence[Record], bodies: BodySource | None, facts: Sequence[PhotoFacts]
) -> list[LabelRequest]:
    """The requests for the labels of an image's animals, which share its camera.

    Args:
        records: the animals.
        bodies: the source of their bodies.
        facts: of the picture's header, as read for each.

    Example:
        >>> from animal3dbox.datasets import SyntheticSet, preset_body
        >>> records = SyntheticSet(seed=0, images=1).records().records
        >>> requests = requests_of_image(records, preset_body("dog"), [PhotoFacts()] * len(records))
        >>> len(requests) == len(records)
        True
    """
    sample = sample_of_records(tuple(records), bodies)
    return [LabelRequest(sample, place, one) for place, one in enumerate(facts)]


def request_of_record(
    record: Record, bodies: BodySource | None, facts: PhotoFacts | None = None
) -> LabelRequest:
    """The request for the label of one record alone.

    Args:
        record: the animal.
        bodies: the source of its body.
        facts: of its picture's header; None: read here, if the record names a picture.

    Raises:
        SampleError: see facts_of_record.

    Example:
        >>> from animal3dbox.datasets import SyntheticSet, preset_body, request_of_record
        >>> records = SyntheticSet(seed=0, images=1).records().records
        >>> request = request_of_record(records[0], preset_body("dog"))
        >>> request.entry.sample_id == records[0].sample_id
        True
    """
    if facts is None:
        facts = facts_of_record(record)
    return LabelRequest(sample_of_record(record, bodies), 0, facts)


def facts_of_record(record: Record) -> PhotoFacts:
    """The facts of the header of a record's picture; none are known of a picture in memory.

    Raises:
        SampleError: the picture cannot be read, is cut off, or has another size than annotated.

    Example:
        >>> from animal3dbox.datasets import SyntheticSet
        >>> facts_of_record(SyntheticSet(seed=0, images=1).records().records[0]).focal_px is None
        True
    """
    if record.image_path is None:
        return PhotoFacts()
    return checked_facts(
        record.image_path, record.sample_id, record.image_hw, upright=record.upright
    )

"""What is annotated in one image, and where such samples come from."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.masks import record_mask
from animal3dbox.datasets.images.photos import Photo
from animal3dbox.datasets.labelling.image_index import AnimalEntry, entry_of
from animal3dbox.datasets.records import AnimalRecord, CuboidImage, CuboidRecord
from animal3dbox.errors import SampleError

Record = AnimalRecord | CuboidRecord


@dataclass(frozen=True, eq=False)
class ImageSample:
    """What is annotated in one image.

    Attributes:
        image_id: the image, as its dataset names it.
        image_path: its file; "" of an image that is only in memory.
        has_unread: whether it has further animals whose annotations cannot be read.
        animals: what is said of each without its numbers; none of an image that is listed alone.
        unpack: makes the animals' records.
        bodies: where the animals' bodies come from; None for boxes that come as they are.
        listed: what is known of an image without records; None of others.
    """

    image_id: str
    image_path: str
    has_unread: bool
    animals: tuple[AnimalEntry, ...]
    unpack: Callable[[], tuple[Record, ...]]
    bodies: BodySource | None
    listed: CuboidImage | None = None

    @cached_property
    def records(self) -> tuple[Record, ...]:
        """Its animals, made when they are asked for: a cached label needs their entries only."""
        return self.unpack()

    @property
    def image_hw(self) -> tuple[int, int]:
        """Height and width that the annotations are for."""
        return self.animals[0].image_hw if self.listed is None else self.listed.image_hw

    @property
    def upright(self) -> bool:
        """Whether the picture is turned as its header says; else its pixels are as stored."""
        return self.animals[0].upright if self.listed is None else self.listed.upright

    def mask(self, animal: int) -> NDArray[np.bool_] | None:
        """An animal's mask (H, W), None without; see AnimalRecord."""
        entry = self.animals[animal]
        record = self.records[animal] if entry.mask_in_runs else None
        return record_mask(
            record.mask_runs if isinstance(record, AnimalRecord) else None,
            entry.mask_path or None,
            sample_id=entry.sample_id,
            image_hw=entry.image_hw,
            upright=entry.upright,
        )


def sample_of_record(record: Record, bodies: BodySource | None) -> ImageSample:
    """A sample of one animal alone, of its record."""
    return sample_of_records((record,), bodies)


def sample_of_records(records: tuple[Record, ...], bodies: BodySource | None) -> ImageSample:
    """A sample of the animals of one image, of their records, at least one."""
    return ImageSample(
        image_id=records[0].image_id,
        image_path=str(records[0].image_path or ""),
        has_unread=False,
        animals=tuple(entry_of(record, b"") for record in records),
        unpack=lambda: records,
        bodies=bodies,
    )


class SampleSource(Protocol):
    """Gives samples by number, and their pictures."""

    @property
    def name(self) -> str:
        """The dataset's name in reports."""
        ...

    @property
    def categories(self) -> tuple[str, ...]:
        """Every category: as the dataset lists them, then those that it does not list, sorted."""
        ...

    @property
    def faults(self) -> tuple[SampleError, ...]:
        """The errors of entries that could not be read at all."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks about the dataset, in whole sentences."""
        ...

    @property
    def named_faces(self) -> bool:
        """Whether the boxes' forward and left mean something."""
        ...

    @property
    def has_cameras(self) -> bool:
        """Whether it comes with camera poses, stored or known."""
        ...

    @property
    def fingerprint(self) -> bytes:
        """Names everything that labels depend on besides the samples' contents: the bodies."""
        ...

    def __len__(self) -> int:
        """How many images."""
        ...

    def image_id(self, index: int) -> str:
        """The image's name."""
        ...

    def animals(self, index: int) -> int:
        """How many records an image has."""
        ...

    def sample(self, index: int) -> ImageSample:
        """What is annotated in an image."""
        ...

    def photo(self, sample: ImageSample) -> Photo:
        """The image; raises SampleError."""
        ...

    def facts(self, sample: ImageSample) -> PhotoFacts:
        """What the image's header says, without decoding it.

        Raises SampleError if there is no such image.
        """
        ...

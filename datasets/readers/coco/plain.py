"""Annotations of a COCO file read one by one: the plain definition of what the reader gives.

Large files are read faster, and alike, where nothing is unusual (clean_elements.py).
"""

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from animal3dbox.datasets.readers.coco.animal import (
    AnimalReading,
    AnnotatedAnimal,
    CocoEntry,
    sample_name,
)
from animal3dbox.datasets.readers.coco.file import CocoElements, CocoImage, take_apart
from animal3dbox.datasets.readers.distinct_animals import distinct_animals, has_evident_corners
from animal3dbox.datasets.readers.elements import decoded
from animal3dbox.errors import SampleError


@dataclass
class CocoCounts:
    """What a careful person should know of a file, counted.

    Attributes:
        images: usable ones.
        bare: images without an annotation of an animal.
        animals: those whose annotation is sound.
        empty: animals without a marked keypoint.
        miscounted: animals whose num_keypoints is not the number of marked keypoints.
        crowds: annotations of groups, which are left out.
        graded: animals with a keypoint of the visibility 2.
        left_out: category -> how many of its annotations are not read.
    """

    images: int = 0
    bare: int = 0
    animals: int = 0
    empty: int = 0
    miscounted: int = 0
    crowds: int = 0
    graded: int = 0
    left_out: Counter[str] = field(default_factory=Counter)

    def add(self, other: "CocoCounts") -> None:
        """Count what another part of the file has, too."""
        for name in ("images", "bare", "animals", "empty", "miscounted", "crowds", "graded"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.left_out.update(other.left_out)


@dataclass(frozen=True)
class PlainAnimals:
    """The animals of some of a file's elements.

    Attributes:
        animals: the sound ones that are nobody else's, those of an image together.
        faults: one error for each element that is not usable.
        counts: of the elements.
        has_evident_corners: whether a box evidently is two corners, if others may be, too.
    """

    animals: tuple[AnnotatedAnimal, ...]
    faults: tuple[SampleError, ...]
    counts: CocoCounts
    has_evident_corners: bool


def read_plainly(
    elements: CocoElements,
    reading: AnimalReading,
    read: frozenset[str],
    *,
    others_may_be_corners: bool | None = None,
) -> PlainAnimals:
    """The animals of elements that no other animal's keypoints, image or box spoil.

    Args:
        elements: of a file; images with all their annotations.
        reading: how they are read.
        read: names of the categories that are.
        others_may_be_corners: see distinct_animals; None: there are no others.

    """
    parts = take_apart(elements)
    images = [_named(image, reading) for image in parts.images]
    animals, faults = list[AnnotatedAnimal](), list[SampleError]()
    counts = CocoCounts(
        images=len(images),
        bare=sum(not image.annotations for image in images),
        crowds=parts.crowds,
    )
    for image in images:
        for number, (i, raw) in enumerate(image.annotations):
            try:
                entry = decoded(raw, CocoEntry, sample_name(image.name, number))
                kind = reading.species.get(str(entry.category_id))
                if kind is not None and kind.name not in read:
                    counts.left_out[kind.name] += 1
                    continue
                animals.append(reading.animal(entry, image, number, i))
            except SampleError as error:
                problem = f"{error.problem} (annotation {i})"
                faults.append(SampleError(error.sample_id, error.field, problem))
    _count(animals, counts)
    every_record = [animal.record for animal in animals]
    records, copies = distinct_animals(
        every_record, reading.tolerance, others_may_be_corners=others_may_be_corners is not False
    )
    by_name = {animal.record.sample_id: animal for animal in animals}
    return PlainAnimals(
        tuple(by_name[record.sample_id].changed_to(record) for record in records),
        (*parts.faults, *faults, *copies),
        counts,
        others_may_be_corners is True and has_evident_corners(every_record),
    )


def _named(image: CocoImage, reading: AnimalReading) -> CocoImage:
    """An image under its name as outputs may hold it."""
    name = reading.pictures.name(image.name)
    return image if name == image.name else replace(image, name=name)


def _count(animals: list[AnnotatedAnimal], counts: CocoCounts) -> None:
    """Count what animals have."""
    counts.animals = len(animals)
    counts.miscounted = sum(animal.miscounted for animal in animals)
    for animal in animals:
        keypoints = animal.record.keypoints_2d
        counts.empty += not keypoints.any()
        counts.graded += bool(np.any(keypoints[:, 2] > 1))

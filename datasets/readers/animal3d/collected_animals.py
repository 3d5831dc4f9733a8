"""The animals of Animal3D's files, and of those written like them, collected entry by entry."""

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.named_files import portable_name
from animal3dbox.datasets.readers.animal3d import many_animals
from animal3dbox.datasets.readers.animal3d.entries import (
    Animal3DEntry,
    AnimalOfMany,
    EntryOfMany,
    SplitFile,
    find_splits,
    numbered_id,
    parameters_of_entry,
    record_of_entry,
    stored_landmarks,
)
from animal3dbox.datasets.readers.elements import decoded, plain_value
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import DatasetNotFoundError, SampleError
from animal3dbox.smal.parameters import SmalParameters

MOST_ANGLE = 2 * math.pi + 0.1
"""Greatest angle in radians of a joint; what is greater looks like degrees."""
_SCALED_LIMBS = (
    "scales the limbs, as dog models do and SMAL does not: the body would be wrong. Leave --model"
    " out, or remove the key to pose it without"
)


@dataclass(frozen=True)
class CollectedAnimals:
    """The animals of the splits, collected one by one.

    Attributes:
        records: the sound ones, in the files' order.
        faults: the others, in the files' order.
        parameters: sample id -> the body's parameters.
        keypoints_3d: sample id -> the stored landmarks (26, 3).
        without_tail: sample ids of bodies that were fitted without a tail.
        body_faults: sample id -> the error that an animal's parameters are to a model.
        image_counts: image -> number of its entries.
        without_parameters: sample ids of animals whose pose is all zero.
        places: content of an entry -> where it stands.
        without_animals: places of entries that say that no animal is in their image.
        merged_masks: images whose mask is of several animals together.
        assumed_focals: images that fit many_animals.ASSUMED_FOCAL.
        unknown_focals: images of several animals whose focal length nothing tells.
    """

    records: list[AnimalRecord] = field(default_factory=list)
    faults: list[SampleError] = field(default_factory=list)
    parameters: dict[str, SmalParameters] = field(default_factory=dict)
    keypoints_3d: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    without_tail: set[str] = field(default_factory=set)
    body_faults: dict[str, SampleError] = field(default_factory=dict)
    image_counts: Counter[str] = field(default_factory=Counter)
    without_parameters: list[str] = field(default_factory=list)
    places: dict[bytes, str] = field(default_factory=dict)
    without_animals: list[str] = field(default_factory=list)
    merged_masks: list[str] = field(default_factory=list)
    assumed_focals: list[str] = field(default_factory=list)
    unknown_focals: list[str] = field(default_factory=list)

    def add(
        self, record: AnimalRecord, entry: Animal3DEntry, parameters: SmalParameters | None
    ) -> None:
        """Add a sound animal with the rest of what its entry says."""
        sample_id = record.sample_id
        self.records.append(record)
        if parameters is not None and not bool(parameters.pose.any()):
            self.without_parameters.append(sample_id)
        elif parameters is not None:
            self.parameters[sample_id] = parameters
            if not entry.with_tail:
                self.without_tail.add(sample_id)
            if any(entry.bone or ()):
                self.body_faults[sample_id] = SampleError(sample_id, "bone", _SCALED_LIMBS)
            if problem := _angle_problem(parameters):
                self.body_faults[sample_id] = SampleError(sample_id, "pose", problem)
        elif isinstance(entry, AnimalOfMany) and entry.has_zero_pose:
            self.without_parameters.append(sample_id)
        landmarks = stored_landmarks(entry)
        if landmarks is not None:
            self.keypoints_3d[sample_id] = landmarks

    def assume_focal(self, first: int) -> None:
        """Give the animals from a place on, those of one image, the focal length that fits them."""
        of_image = self.records[first:]
        if not of_image or of_image[0].K is not None:
            return
        K = many_animals.assumed_intrinsics(of_image, self.keypoints_3d, self.parameters)
        (self.unknown_focals if K is None else self.assumed_focals).append(of_image[0].image_id)
        if K is not None:
            self.records[first:] = [replace(one, K=K, K_source="dataset") for one in of_image]


def read_splits(
    path: Path, images: Path | None, tolerance: Tolerance
) -> tuple[list[SplitFile], CollectedAnimals]:
    """The files of a dataset and all their animals; see read_animal3d."""
    splits, animals = list[SplitFile](), CollectedAnimals()
    for file in find_splits(path):
        root = images or file.parent
        if not root.is_dir():
            raise DatasetNotFoundError(f"there is no folder of images {root}")
        splits.append(decode_json(file, SplitFile))
        _read_split(splits[-1], file.name, root, animals, tolerance=tolerance)
    return splits, animals


def _read_split(
    split: SplitFile, name: str, root: Path, animals: CollectedAnimals, *, tolerance: Tolerance
) -> None:
    """Add the animals of a split; those of one image after its first get "#1", "#2", ...

    Args:
        split: the file's content.
        name: the file's name.
        root: the folder that img_path is relative to.
        animals: the collection that they are added to.
        tolerance: how bad parts are taken.

    """
    for i, raw in enumerate(split.data):
        place, first = f"{name} entry {i}", len(animals.records)
        first_place = animals.places.setdefault(bytes(raw), place)
        try:
            elements = elements_of(raw, place, root)
        except SampleError as error:
            animals.faults.append(error)
            continue
        kind = AnimalOfMany if elements.of_many else Animal3DEntry
        if not elements.animals:
            animals.without_animals.append(place)
        for element in elements.animals:
            try:
                sample_id = numbered_id(element, place, animals.image_counts, root)
                if first_place != place:
                    raise SampleError(
                        sample_id,
                        "entry",
                        f"{place} is {first_place} once more: remove one, or it counts twice",
                    )
                entry = decoded(element, kind, sample_id)
                record = record_of_entry(entry, sample_id, root, split, tolerance=tolerance)
                animals.add(record, entry, parameters_of_entry(entry, sample_id))
            except SampleError as error:
                animals.faults.append(error)
        if elements.has_merged_mask and len(animals.records) > first:
            animals.merged_masks.append(animals.records[first].image_id)
        if elements.of_many and split.flength is None:
            animals.assume_focal(first)


class Elements(NamedTuple):
    """The animals of an entry, each in the form of an entry of its own.

    Attributes:
        animals: one element an animal.
        of_many: whether the entry says how many animals it is of; else it is its own element.
        has_merged_mask: whether its mask is of several animals together.
    """

    animals: list[msgspec.Raw]
    of_many: bool = False
    has_merged_mask: bool = False


def elements_of(raw: msgspec.Raw, place: str, root: Path) -> Elements:
    """The elements of an entry's animals.

    Args:
        raw: the entry.
        place: the file and the entry's number, named in errors of an entry without an image.
        root: the folder of images, from which on absolute paths are taken.

    Raises:
        SampleError: an entry of several animals that cannot be taken apart.

    """
    if many_animals.COUNT.encode() not in bytes(raw):
        return Elements([raw])
    entry = decoded(raw, EntryOfMany, place)
    if entry.num_animals is msgspec.UNSET:
        return Elements([raw])
    name = portable_name(root, entry.img_path)
    content = plain_value(raw, name)
    animals = many_animals.animals_of_entry(content, name)
    is_merged = many_animals.has_merged_mask(content)
    return Elements(list(map(many_animals.encoded, animals)), True, is_merged)


def _angle_problem(parameters: SmalParameters) -> str | None:
    """What is wrong with a pose in degrees, which has joints turned by more than once round."""
    angles = parameters.pose.reshape(-1, 3).norm(dim=-1)
    greatest = float(angles.max())
    if greatest <= MOST_ANGLE:
        return None
    return (
        f"turns joint {int(angles.argmax())} by {greatest:.4g} radians, more than once round: these"
        f" look like degrees; multiply pose by pi / 180"
    )

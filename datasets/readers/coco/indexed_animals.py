"""The animals of a COCO file by an index: each is decoded where it lies, when it is asked for."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from animal3dbox.datasets.images.named_files import plain_name
from animal3dbox.datasets.images.picture_folder import LOOKED_AT, PictureFolder
from animal3dbox.datasets.images.remote_files import PicturePath, PictureUrl, is_remote
from animal3dbox.datasets.readers.coco.animal import AnimalReading, CocoEntry, with_confidence
from animal3dbox.datasets.readers.coco.file import (
    Category,
    CocoImage,
    ImageElement,
    species_by_id,
)
from animal3dbox.datasets.readers.coco.opening import CocoRanges, OpenedCoco
from animal3dbox.datasets.readers.distinct_animals import is_elsewhere, not_taken, taken_twice
from animal3dbox.datasets.readers.elements import decoded
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.sightings import NO_SIGHTING, sighting_of
from animal3dbox.datasets.storage.array_bytes import StoredArrays, packed_arrays
from animal3dbox.datasets.storage.json_ranges import ElementRanges, RangeReader
from animal3dbox.datasets.storage.records_on_demand import Change, RecordsOnDemand, RecordSummary
from animal3dbox.errors import SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary


class IndexHeader(msgspec.Struct):
    """What an index says of its file as a whole.

    Attributes:
        categories: the file's own.
        first_image: name of the file's first image.
        listed: names of the categories that are read, in the file's order.
        used: names of those that animals have.
        faults: sample, field and problem of each.
        notes: in whole sentences.
        with_place: how many animals' places the file says.
        graded: whether any keypoint has the visibility 2.
        has_corners: whether boxes are two corners, as AnimalPose's are.
    """

    categories: list[Category]
    first_image: str | None
    listed: list[str]
    used: list[str]
    faults: list[tuple[str | None, str | None, str | None]]
    notes: list[str]
    with_place: int
    graded: bool
    has_corners: bool


def index_bytes(
    header: IndexHeader, opened: OpenedCoco, ranges: CocoRanges, *, skipped: int
) -> bytes:
    """The index of an opened file: the same bytes for the same content.

    Args:
        header: of the file as a whole.
        opened: its animals.
        ranges: where its elements lie.
        skipped: bytes of the file before those that the ranges count from.

    """
    names = [name.encode("utf-8", "surrogatepass") for name in opened.names.values()]
    places = np.array([*opened.names], dtype=np.int64)
    arrays: dict[str, Any] = {
        "at": ranges.annotations.begins[opened.annotation] + skipped,
        "length": ranges.annotations.lengths[opened.annotation].astype(np.int32),
        "number": opened.number.astype(np.int32),
        "without_box": opened.without_box,
        "first": np.append(np.searchsorted(opened.image, places), len(opened.image)),
        "name_end": np.cumsum([len(name) for name in names], dtype=np.int64),
        "names": np.frombuffer(b"".join(names), dtype=np.uint8),
        "image_hw": opened.image_hw,
    }
    if isinstance(ranges.images, ElementRanges):
        arrays["image_at"] = ranges.images.begins[places] + skipped
        arrays["image_length"] = ranges.images.lengths[places].astype(np.int32)
    return packed_arrays(msgspec.msgpack.encode(header), arrays)


@dataclass(frozen=True)
class IndexedFile:
    """An annotation file beside its index, and how it is read.

    Attributes:
        index: of the file.
        reader: of the file's bytes.
        root: the folder of pictures.
        vocabulary: the user's own; None: by the categories' names.
        tolerance: how bad parts are taken.
    """

    index: StoredArrays
    reader: RangeReader
    root: Path
    vocabulary: Vocabulary | None
    tolerance: Tolerance


class IndexedAnimals(RecordsOnDemand):
    """The animals of a COCO file, by its index.

    Args:
        file: the file.
        changes: what is changed of each record after it was read.

    """

    def __init__(self, file: IndexedFile, changes: tuple[Change, ...] = ()) -> None:
        self.file, self.changes = file, changes
        self.header = msgspec.msgpack.decode(file.index.header, type=IndexHeader)
        self._species = species_by_id(self.header.categories, file.vocabulary)
        self._pictures = PictureFolder(file.root, checks=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return IndexedAnimals, (self.file, self.changes)

    def __len__(self) -> int:
        return len(self.file.index["at"])

    @property
    def image_count(self) -> int:
        """How many images have animals."""
        return len(self.file.index["name_end"])

    @cached_property
    def summary(self) -> RecordSummary:
        """What is known of all animals."""
        used = frozenset(self.header.used)
        matches = (kind.match for kind in self._species.values() if kind.name in used)
        vocabularies = {match.vocabulary.name: match.vocabulary for match in matches if match}
        return RecordSummary(used, tuple(vocabularies.values()), self.header.with_place)

    def image_name(self, image: int) -> str:
        """The name of an image, by its number."""
        ends = self.file.index["name_end"]
        begin = int(ends[image - 1]) if image else 0
        name = self.file.index["names"][begin : int(ends[image])].tobytes()
        return name.decode("utf-8", "surrogatepass")

    def image_names(self) -> Iterable[str]:
        """The names of all images, in order."""
        return map(self.image_name, range(self.image_count))

    def some_names(self) -> list[str]:
        """The names of a few images, from the first to the last."""
        step = max(self.image_count // LOOKED_AT, 1)
        return [self.image_name(image) for image in range(0, self.image_count, step)]

    def members(self, image: int) -> range:
        """The places of an image's animals among all."""
        first = self.file.index["first"]
        return range(int(first[image]), int(first[image + 1]))

    def record(self, place: int) -> AnimalRecord:
        """The animal at a place."""
        index = self.file.index
        image = int(index["first"].searchsorted(place, "right")) - 1
        return self._record(place, self._image(image))

    def records_of(self, image: int) -> tuple[AnimalRecord, ...]:
        """The animals of an image."""
        its_image = self._image(image)
        return tuple(self._record(place, its_image) for place in self.members(image))

    def _image(self, image: int) -> CocoImage:
        """What the file says of an image."""
        index, name = self.file.index, self.image_name(image)
        height, width = index["image_hw"][image].tolist()
        sighting = NO_SIGHTING
        if "image_at" in index:
            at, length = int(index["image_at"][image]), int(index["image_length"][image])
            raw = msgspec.Raw(self.file.reader.read(at, length))
            sighting = sighting_of(decoded(raw, ImageElement, name))
        return CocoImage(image, name, (height, width), [], sighting)

    def _record(self, place: int, image: CocoImage) -> AnimalRecord:
        index, number = self.file.index, int(self.file.index["number"][place])
        content = self.file.reader.read(int(index["at"][place]), int(index["length"][place]))
        entry = decoded(msgspec.Raw(content), CocoEntry, image.name)
        tolerance = replace(self.file.tolerance, left_out=[], minus_ones=[])
        reading = AnimalReading(
            self._species, self._pictures, tolerance, has_corners=self.header.has_corners
        )
        record = reading.animal(entry, image, number, place).record
        if tolerance.visibility == "flags":
            record = with_confidence(record, self.header.graded)
        if index["without_box"][place]:
            record = replace(record, box=None)
        for change in self.changes:
            record = change(record)
        return record

    def picture(self, name: str) -> PicturePath:
        """The file of an image's picture, or its URL, which is not looked up.

        Raises:
            SampleError: there is none of its name, or it is another image's.

        """
        if is_remote(name):  # nobody's that is in the folder has such a name
            return PictureUrl(name)
        path = PictureFolder(self.file.root).path(name, name)
        if isinstance(path, PictureUrl) or path == self._pictures.home / name:
            return path
        if is_elsewhere(name, path):
            raise SampleError(name, "image", not_taken(path))
        relative = plain_name(path.relative_to(self._pictures.home).as_posix())
        if self._spellings.get(relative, 0) > 1 and not path.as_posix().endswith(name):
            alike = (one for one in self.image_names() if plain_name(one) == relative)
            other = next(one for one in alike if one != name)
            raise SampleError(name, "image", taken_twice(other))
        return path

    @cached_property
    def _spellings(self) -> dict[str, int]:
        """How many names of images are alike but for letter case and Unicode form."""
        counts: dict[str, int] = {}
        for name in map(plain_name, self.image_names()):
            counts[name] = counts.get(name, 0) + 1
        return counts

    def changed(self, change: Change) -> "IndexedAnimals":
        """The same animals, each as a function makes it of what the file says."""
        return IndexedAnimals(self.file, (*self.changes, change))

"""The annotations of a dataset, image by image: packed in memory, or read from their file.

A FileSource has one of these, which gives it samples.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Protocol

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.remote_files import PicturePath, picture_path
from animal3dbox.datasets.labelling.image_index import (
    AnimalEntry,
    IndexRow,
    PackedImageIndex,
    entry_of,
)
from animal3dbox.datasets.labelling.image_samples import ImageSample, Record
from animal3dbox.datasets.records import (
    AnimalRecord,
    CuboidImage,
    CuboidRecord,
    CuboidSet,
    RecordSet,
)
from animal3dbox.datasets.sightings import NO_SIGHTING
from animal3dbox.datasets.storage.codec import Codec
from animal3dbox.datasets.storage.fingerprint import content_digest, digest
from animal3dbox.datasets.storage.packed import PackedList
from animal3dbox.datasets.storage.records_on_demand import RecordsOnDemand
from animal3dbox.errors import SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary


class RecordStore(Protocol):
    """The annotations of a dataset by the number of their image."""

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
        """What is said of an image."""
        ...

    def picture(self, sample: ImageSample) -> PicturePath | None:
        """The file of a sample's picture, None of one in memory; raises SampleError."""
        ...


class PackedRecords:
    """Records that are all there, packed (storage/packed.py).

    Args:
        records: animals, or boxes that come as they are.
        bodies: of the animals.
        unread: images of which something could not be read.

    """

    def __init__(
        self, records: RecordSet | CuboidSet, bodies: BodySource | None, unread: frozenset[str]
    ) -> None:
        every_record: Sequence[Any] = records.records
        self.bodies = bodies
        listed = records.listed_images() if isinstance(records, CuboidSet) else ()
        groups: dict[str, list[int]] = {image.image_id: [] for image in listed}
        for i, record in enumerate(every_record):
            groups.setdefault(record.image_id, []).append(i)
        order = [i for members in groups.values() for i in members]
        kind = CuboidRecord if isinstance(records, CuboidSet) else AnimalRecord
        vocabularies = {id(v): v for v in map(_vocabulary, every_record) if v}
        words = tuple(vocabularies.values())
        self._records = PackedList(kind, (_label_content(every_record[i]) for i in order), words)
        without_paths = (replace(image, image_path=None) for image in listed)
        self._listed = PackedList(CuboidImage, without_paths)
        paths = {image.image_id: image.image_path for image in listed}
        paths |= {record.image_id: record.image_path for record in every_record}
        rows = self._index_rows(every_record, groups, paths, unread)
        self._index = PackedImageIndex(rows, words)

    def _index_rows(
        self,
        records: Sequence[Any],
        groups: dict[str, list[int]],
        paths: dict[str, PicturePath | None],
        unread: frozenset[str],
    ) -> Iterator[IndexRow]:
        """The rows of the index of all images, of the places of their records."""
        first = 0
        for name, members in groups.items():
            entries = tuple(
                entry_of(
                    records[i],
                    record_content(records[i], self._records.packed(first + k), self.bodies),
                )
                for k, i in enumerate(members)
            )
            yield str(name), str(paths[name] or ""), name in unread, first, entries
            first += len(members)

    def __len__(self) -> int:
        return len(self._index)

    def image_id(self, index: int) -> str:
        """The image's name."""
        return self._index[index][0]

    def animals(self, index: int) -> int:
        """How many records an image has."""
        return len(self._index[index][4])

    def sample(self, index: int) -> ImageSample:
        """What is said of an image; its records are made anew when they are asked for."""
        image_id, path, has_unread, first, animals = self._index[index]
        return ImageSample(
            image_id=image_id,
            image_path=path,
            has_unread=has_unread,
            animals=animals,
            unpack=partial(self._unpacked, path, first, animals),
            bodies=self.bodies,
            listed=None if animals else replace(self._listed[index], image_path=picture_path(path)),
        )

    def picture(self, sample: ImageSample) -> PicturePath | None:
        """The file of a sample's picture, as its reader found it; None of one in memory."""
        return picture_path(sample.image_path)

    def _unpacked(
        self, image_path: str, first: int, animals: tuple[AnimalEntry, ...]
    ) -> tuple[Record, ...]:
        path = picture_path(image_path)
        masks = (
            {"mask_path": Path(animal.mask_path)} if animal.mask_path else {} for animal in animals
        )
        return tuple(
            self._records.unpacked(first + k, image_path=path, sighting=animals[k].sighting, **mask)
            for k, mask in enumerate(masks)
        )


class StoredRecords:
    """Records that are decoded from their annotation file when a sample is asked for.

    Args:
        records: of the file.
        bodies: of the animals.
        unread: images of which something could not be read.

    """

    def __init__(
        self, records: RecordsOnDemand, bodies: BodySource | None, unread: frozenset[str]
    ) -> None:
        self.records, self.bodies, self._unread = records, bodies, unread
        self._codec = Codec(records.summary.vocabularies)

    def __len__(self) -> int:
        return self.records.image_count

    def image_id(self, index: int) -> str:
        """The image's name."""
        return self.records.image_name(index)

    def animals(self, index: int) -> int:
        """How many records an image has."""
        return len(self.records.members(index))

    def sample(self, index: int) -> ImageSample:
        """What is said of an image; its picture may not be there."""
        records = self.records.records_of(index)
        packed = (self._codec.pack(_label_content(record)) for record in records)
        return ImageSample(
            image_id=records[0].image_id,
            image_path=str(records[0].image_path or ""),
            has_unread=records[0].image_id in self._unread,
            animals=tuple(
                entry_of(record, record_content(record, content, self.bodies))
                for record, content in zip(records, packed, strict=True)
            ),
            unpack=partial(tuple, records),
            bodies=self.bodies,
        )

    def picture(self, sample: ImageSample) -> PicturePath | None:
        """The file of a sample's picture; raises SampleError unless there is one, and one only."""
        return self.records.picture(sample.image_id)


def record_content(record: Record, packed: bytes, bodies: BodySource | None) -> bytes:
    """Names what a label of a record is made from, but for what is in files.

    Args:
        record: an animal or a box.
        packed: the bytes of all that the record says, but which vocabulary it is.
        bodies: their content counts if it is lasting.

    """
    if isinstance(record, CuboidRecord) or bodies is None:
        return digest(packed)
    try:
        body = bodies.content(record.sample_id) if bodies.lasting else b""
    except SampleError:  # said when its label is asked for
        body = b""
    return digest(packed, _vocabulary_digest(record.vocabulary), body)


@lru_cache(maxsize=16)
def _vocabulary_digest(vocabulary: Vocabulary) -> bytes:
    return content_digest(vocabulary)


def _label_content(record: Any) -> Any:
    """A record with what its label depends on: not where its files lie, nor when it was seen."""
    paths = {"image_path": None, "sighting": NO_SIGHTING}
    if isinstance(record, AnimalRecord):
        paths["mask_path"] = None
    return replace(record, **paths)


def _vocabulary(record: Any) -> Any:
    return getattr(record, "vocabulary", None)

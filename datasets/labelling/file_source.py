"""A dataset in files as samples: its annotations packed, its pictures read when asked for."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.photos import Photo, checked_facts, read_photo
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
from animal3dbox.datasets.storage.fingerprint import content_digest, digest
from animal3dbox.datasets.storage.packed import PackedList
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary


class FileSource:
    """A dataset in files, its annotations packed (storage/packed.py).

    Args:
        records: animals with the source of their bodies, or boxes that come as they are.
        bodies: needed for animals.

    Example:
        >>> from animal3dbox.datasets import FileSource, LabelDataset, SyntheticSet, preset_body
        >>> source = FileSource(SyntheticSet(seed=0, images=2).records(), preset_body("dog"))
        >>> len(LabelDataset(source))
        2
    """

    def __init__(self, records: RecordSet | CuboidSet, bodies: BodySource | None = None) -> None:
        every_record: Sequence[Any] = records.records
        _check_bodies(records, bodies)
        self.name, self.faults, self.notes = records.name, records.faults, records.notes
        self.bodies = bodies
        self.named_faces = all(getattr(record, "heading_known", True) for record in every_record)
        self.has_cameras = any(has_camera(record) for record in every_record)
        used = {record.category for record in every_record}
        listed_categories = dict.fromkeys(records.categories)
        self.categories = (*listed_categories, *sorted(used.difference(records.categories)))
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
        self._index = PackedImageIndex(self._index_rows(every_record, groups, paths), words)

    def _index_rows(
        self,
        records: Sequence[Any],
        groups: dict[str, list[int]],
        paths: dict[str, Path | None],
    ) -> Iterator[IndexRow]:
        """The rows of the index of all images, of the places of their records."""
        unread = frozenset(
            name for fault in self.faults for name in images_of(fault.sample_id or "")
        )
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

    @property
    def fingerprint(self) -> bytes:
        """Names the content of the bodies."""
        return b"" if self.bodies is None else self.bodies.fingerprint

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
            listed=None if animals else replace(self._listed[index], image_path=_path(path)),
        )

    def photo(self, sample: ImageSample) -> Photo:
        """The image file, which must be as large as its annotations say."""
        if not sample.image_path:
            raise SampleError(
                sample.image_id,
                "image",
                "is only in memory: give a source that has its pictures, or write the dataset"
                " first",
            )
        return read_photo(
            sample.image_path, sample.image_id, sample.image_hw, upright=sample.upright
        )

    def facts(self, sample: ImageSample) -> PhotoFacts:
        """The facts of the image file's header; none are known without a file."""
        if not sample.image_path:
            return PhotoFacts()
        path = Path(sample.image_path)
        return checked_facts(path, sample.image_id, sample.image_hw, upright=sample.upright)

    def _unpacked(
        self, image_path: str, first: int, animals: tuple[AnimalEntry, ...]
    ) -> tuple[Record, ...]:
        path = _path(image_path)
        masks = (
            {"mask_path": Path(animal.mask_path)} if animal.mask_path else {} for animal in animals
        )
        return tuple(
            self._records.unpacked(first + k, image_path=path, sighting=animals[k].sighting, **mask)
            for k, mask in enumerate(masks)
        )


def _check_bodies(records: RecordSet | CuboidSet, bodies: BodySource | None) -> None:
    """Raise a ConfigError unless animals come with a whole source of bodies."""
    if isinstance(records, RecordSet) and bodies is None:
        raise ConfigError(
            f"a dataset of animals ({records.name}) needs a source of their bodies, such as"
            " preset_body('dog')"
        )
    needed = ("fingerprint", "lasting", "content", "body")
    missing = [] if bodies is None else [name for name in needed if not hasattr(bodies, name)]
    if missing:
        raise ConfigError(
            f"{type(bodies).__name__} is no source of bodies: it lacks {', '.join(missing)} (see"
            " datasets.bodies.sources.BodySource)"
        )


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


def _path(name: str) -> Path | None:
    return Path(name) if name else None


def has_camera(record: Record) -> bool:
    """Whether a record comes with its camera's pose, stored or known; a box always does."""
    return (
        isinstance(record, CuboidRecord)
        or record.pose is not None
        or record.stored_pose is not None
    )


def images_of(sample_id: str) -> tuple[str, ...]:
    """The images that a sample may be of: the one of its name, and of "a.jpg#1" also a.jpg.

    A file's name may hold a # itself.
    """
    name, mark, number = sample_id.rpartition("#")
    return (sample_id, name) if mark and number.isdecimal() else (sample_id,)


def _label_content(record: Any) -> Any:
    """A record with what its label depends on: not where its files lie, nor when it was seen."""
    paths = {"image_path": None, "sighting": NO_SIGHTING}
    if isinstance(record, AnimalRecord):
        paths["mask_path"] = None
    return replace(record, **paths)


def _vocabulary(record: Any) -> Any:
    return getattr(record, "vocabulary", None)

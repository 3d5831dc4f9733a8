"""Where a Dataset's samples come from: annotated animals, image by image."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.photos import Photo, checked_facts, read_mask, read_photo
from animal3dbox.datasets.labelling.image_index import AnimalHead, ImageHead, PackedHeads, head_of
from animal3dbox.datasets.records import (
    AnimalRecord,
    CuboidImage,
    CuboidRecord,
    CuboidSet,
    RecordSet,
)
from animal3dbox.datasets.storage.fingerprint import content_digest, digest
from animal3dbox.datasets.storage.packed import PackedList
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

Record = AnimalRecord | CuboidRecord


@dataclass(frozen=True, eq=False)
class ImageSample:
    """What is annotated in one image.

    Attributes:
        head: what is said of the image and its animals without their numbers.
        unpack: makes the records.
        bodies: where the animals' bodies come from; None for boxes that come as they are.
        image: what is known of an image without records; None of others.
    """

    head: ImageHead
    unpack: Callable[[], tuple[Record, ...]]
    bodies: BodySource | None
    image: CuboidImage | None = None

    @property
    def image_id(self) -> str:
        """The image, as its dataset names it."""
        return self.head.image_id

    @property
    def animals(self) -> tuple[AnimalHead, ...]:
        """The heads of its animals; none of an image that is listed without any."""
        return self.head.animals

    @cached_property
    def records(self) -> tuple[Record, ...]:
        """Its animals, made when they are asked for.

        A label in the cache needs their heads only.
        """
        return self.unpack()

    def mask(self, animal: int) -> NDArray[np.bool_] | None:
        """An animal's mask (H, W), None without; see AnimalRecord."""
        head = self.head.animals[animal]
        if head.in_runs:
            record = self.records[animal]
            return record.mask if isinstance(record, AnimalRecord) else None
        return read_mask(head.mask_path, head.sample_id, head.image_hw) if head.mask_path else None


class SampleSource(Protocol):
    """Gives samples by number, and their pictures."""

    @property
    def name(self) -> str:
        """What to call it in reports."""
        ...

    @property
    def categories(self) -> tuple[str, ...]:
        """Every category: as the dataset lists them, then those that it does not list, sorted."""
        ...

    @property
    def faults(self) -> tuple[SampleError, ...]:
        """What could not be read at all."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found out about the dataset."""
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


class FileSource:
    """A dataset in files, its annotations packed (packed.py).

    Args:
        records: animals with the source of their bodies, or boxes that come as they are.
        bodies: needed for animals.

    """

    def __init__(self, records: RecordSet | CuboidSet, bodies: BodySource | None = None) -> None:
        found: Sequence[Any] = records.records
        if isinstance(records, RecordSet) and bodies is None:
            raise ConfigError(
                f"a dataset of animals ({records.name}) needs a source of their bodies, such as"
                " preset_body('dog')"
            )
        missing = (
            []
            if bodies is None
            else [
                name
                for name in ("fingerprint", "lasting", "content", "body")
                if not hasattr(bodies, name)
            ]
        )
        if missing:
            raise ConfigError(
                f"{type(bodies).__name__} is no source of bodies: it lacks {', '.join(missing)}"
                " (see datasets.bodies.sources.BodySource)"
            )
        self.name, self.faults, self.notes, self.bodies = (
            records.name,
            records.faults,
            records.notes,
            bodies,
        )
        self.named_faces = all(getattr(record, "heading_known", True) for record in found)
        self.has_cameras = any(has_camera(record) for record in found)
        used = {record.category for record in found}
        self.categories = (
            *dict.fromkeys(records.categories),
            *sorted(used.difference(records.categories)),
        )
        listed = records.listed_images() if isinstance(records, CuboidSet) else ()
        groups: dict[str, list[int]] = {image.image_id: [] for image in listed}
        for i, record in enumerate(found):
            groups.setdefault(record.image_id, []).append(i)
        order = [i for members in groups.values() for i in members]
        kind = CuboidRecord if isinstance(records, CuboidSet) else AnimalRecord
        words = tuple({id(v): v for v in map(_words, found) if v}.values())
        self._records = PackedList(kind, (_without_paths(found[i]) for i in order), words)
        self._listed = PackedList(
            CuboidImage, (replace(image, image_path=None) for image in listed)
        )
        paths = {image.image_id: image.image_path for image in listed} | {
            record.image_id: record.image_path for record in found
        }
        self._heads = PackedHeads(self._found_heads(found, groups, paths), words)

    def _found_heads(
        self, found: Sequence[Any], groups: dict[str, list[int]], paths: dict[str, Path | None]
    ) -> Iterator[ImageHead]:
        """The heads of all images, of the places of their records."""
        unread = frozenset(
            name for fault in self.faults for name in images_of(fault.sample_id or "")
        )
        first = 0
        for name, members in groups.items():
            contents = (
                record_content(found[i], self._records.packed(first + k), self.bodies)
                for k, i in enumerate(members)
            )
            animals = tuple(
                head_of(found[i], content) for i, content in zip(members, contents, strict=True)
            )
            yield ImageHead(str(name), str(paths[name] or ""), name in unread, first, animals)
            first += len(members)

    def __len__(self) -> int:
        return len(self._heads)

    @property
    def fingerprint(self) -> bytes:
        """Of the bodies."""
        return b"" if self.bodies is None else self.bodies.fingerprint

    def image_id(self, index: int) -> str:
        """The image's name."""
        return self._heads[index].image_id

    def animals(self, index: int) -> int:
        """How many records an image has."""
        return len(self._heads[index].animals)

    def sample(self, index: int) -> ImageSample:
        """What is said of an image; its records are made anew when they are asked for."""
        head = self._heads[index]
        alone = (
            None
            if head.animals
            else replace(self._listed[index], image_path=_path(head.image_path))
        )
        return ImageSample(head, partial(self._unpacked, head), self.bodies, alone)

    def photo(self, sample: ImageSample) -> Photo:
        """The image file, which must be as large as its annotations say."""
        head = sample.head
        if not head.image_path:
            raise SampleError(
                head.image_id,
                "image",
                "is only in memory: give a source that has its pictures, or write the dataset"
                " first",
            )
        return read_photo(
            head.image_path, head.image_id, (sample.image or head.animals[0]).image_hw
        )

    def facts(self, sample: ImageSample) -> PhotoFacts:
        """Of the image file, if there is one."""
        head = sample.head
        if not head.image_path:
            return PhotoFacts()
        return checked_facts(
            Path(head.image_path), head.image_id, (sample.image or head.animals[0]).image_hw
        )

    def _unpacked(self, head: ImageHead) -> tuple[Record, ...]:
        path = _path(head.image_path)
        masks = (
            {"mask_path": Path(animal.mask_path)} if animal.mask_path else {}
            for animal in head.animals
        )
        return tuple(
            self._records.unpacked(head.first + k, image_path=path, **mask)
            for k, mask in enumerate(masks)
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
    return digest(packed, _words_digest(record.vocabulary), body)


@lru_cache(maxsize=16)
def _words_digest(vocabulary: Vocabulary) -> bytes:
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


def _without_paths(record: Any) -> Any:
    """A record that says the same wherever its files lie."""
    return (
        replace(record, image_path=None, mask_path=None)
        if isinstance(record, AnimalRecord)
        else replace(record, image_path=None)
    )


def _words(record: Any) -> Any:
    return getattr(record, "vocabulary", None)

"""Where a Dataset's samples come from: annotated animals, image by image."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch

from animal3dbox.datasets.bodies import BodySource
from animal3dbox.datasets.exif import PhotoFacts, header_facts
from animal3dbox.datasets.images import Photo, read_photo
from animal3dbox.datasets.packed import PackedList, PackedNames
from animal3dbox.datasets.records import AnimalRecord, CuboidImage, CuboidRecord, CuboidSet, RecordSet
from animal3dbox.errors import ConfigError, SampleError

Record = AnimalRecord | CuboidRecord


@dataclass(frozen=True, eq=False)
class ImageSample:
    """What is annotated in one image.

    Attributes:
        image_id: the image, as its dataset names it.
        records: its animals; none of an image that is listed without any.
        image: what is known of an image without records; None of others.
        unread: whether the image has further animals whose annotations cannot be read.
        contents: for each the bytes that name what is said of it, the same in every process and place.
        bodies: where the animals' bodies come from; None for boxes that come as they are.
    """

    image_id: str
    records: tuple[Record, ...]
    unread: bool
    contents: tuple[bytes, ...]
    bodies: BodySource | None
    image: CuboidImage | None = None


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
        """What the image's header says, without decoding it."""
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
            raise ConfigError(f"a dataset of animals ({records.name}) needs a source of their bodies, such as preset_body('dog')")
        self.name, self.faults, self.notes, self.bodies = records.name, records.faults, records.notes, bodies
        self.named_faces = all(getattr(record, "heading_known", True) for record in found)
        self.has_cameras = any(has_camera(record) for record in found)
        used = {record.category for record in found}
        self.categories = (*dict.fromkeys(records.categories), *sorted(used.difference(records.categories)))
        listed = records.listed_images() if isinstance(records, CuboidSet) else ()
        groups: dict[str, list[int]] = {image.image_id: [] for image in listed}
        for i, record in enumerate(found):
            groups.setdefault(record.image_id, []).append(i)
        order = [i for members in groups.values() for i in members]
        kind = CuboidRecord if isinstance(records, CuboidSet) else AnimalRecord
        self._records = PackedList(kind, (_without_paths(found[i]) for i in order), tuple({id(v): v for v in map(_words, found) if v}.values()))
        self._ends = torch.from_numpy(np.cumsum([0, *(len(members) for members in groups.values())], dtype=np.int64))
        self._images = PackedNames(groups)
        self._listed = PackedList(CuboidImage, (replace(image, image_path=None) for image in listed))
        self._unread = frozenset(name for fault in records.faults for name in _images_of(fault.sample_id or ""))
        paths = {image.image_id: image.image_path for image in listed} | {record.image_id: record.image_path for record in found}
        self._paths = PackedNames(str(paths[name] or "") for name in groups)
        self._masks = PackedNames(str(getattr(found[i], "mask_path", None) or "") for i in order)

    def __len__(self) -> int:
        return len(self._images)

    @property
    def fingerprint(self) -> bytes:
        """Of the bodies."""
        return b"" if self.bodies is None else self.bodies.fingerprint

    def image_id(self, index: int) -> str:
        """The image's name."""
        name: str = self._images[index]
        return name

    def animals(self, index: int) -> int:
        """How many records an image has."""
        return int(self._ends[index + 1] - self._ends[index])

    def sample(self, index: int) -> ImageSample:
        """The records of an image, made anew."""
        start, stop = self._ends[index : index + 2].tolist()
        path = Path(self._paths[index]) if self._paths[index] else None
        records = tuple(self._records.unpacked(i, image_path=path, **self._mask(i)) for i in range(start, stop))
        name, contents = self.image_id(index), tuple(self._records.packed(i) for i in range(start, stop))
        alone = None if records else replace(self._listed[index], image_path=path)
        return ImageSample(name, records, name in self._unread, contents, self.bodies, alone)

    def photo(self, sample: ImageSample) -> Photo:
        """The image file, which must be as large as its annotations say."""
        known = sample.image or sample.records[0]
        if known.image_path is None:
            raise SampleError(sample.image_id, "image", "is only in memory: give a source that has its pictures, or write the dataset first")
        return read_photo(known.image_path, sample.image_id, known.image_hw)

    def facts(self, sample: ImageSample) -> PhotoFacts:
        """Of the image file."""
        path = (sample.image or sample.records[0]).image_path
        return PhotoFacts() if path is None else header_facts(path)

    def _mask(self, place: int) -> dict[str, Path]:
        name = self._masks[place]
        return {"mask_path": Path(name)} if name else {}


def has_camera(record: Record) -> bool:
    """Whether a record comes with its camera's pose, stored or known; a box always does."""
    return isinstance(record, CuboidRecord) or record.pose is not None or record.stored_pose is not None


def _images_of(sample_id: str) -> tuple[str, ...]:
    """The images that a sample may be of: the one of its name, and of "a.jpg#1" also a.jpg; a file's name may hold a # itself."""
    name, mark, number = sample_id.rpartition("#")
    return (sample_id, name) if mark and number.isdecimal() else (sample_id,)


def _without_paths(record: Any) -> Any:
    """A record that says the same wherever its files lie."""
    return replace(record, image_path=None, mask_path=None) if isinstance(record, AnimalRecord) else replace(record, image_path=None)


def _words(record: Any) -> Any:
    return getattr(record, "vocabulary", None)

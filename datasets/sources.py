"""Where a Dataset's samples come from: annotated animals, image by image."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch

from animal3dbox.datasets.bodies import BodySource
from animal3dbox.datasets.images import Photo, read_photo
from animal3dbox.datasets.packed import PackedList, PackedNames
from animal3dbox.datasets.records import AnimalRecord, CuboidRecord, CuboidSet, RecordSet
from animal3dbox.errors import ConfigError, SampleError

Record = AnimalRecord | CuboidRecord


@dataclass(frozen=True, eq=False)
class ImageSample:
    """What is annotated in one image.

    Attributes:
        image_id: the image, as its dataset names it.
        records: its animals.
        unread: whether the image has further animals whose annotations cannot be read.
        contents: for each the bytes that name what is said of it, the same in every process and place.
        bodies: where the animals' bodies come from; None for boxes that come as they are.
    """

    image_id: str
    records: tuple[Record, ...]
    unread: bool
    contents: tuple[bytes, ...]
    bodies: BodySource | None


class SampleSource(Protocol):
    """Gives samples by number, and their pictures."""

    @property
    def name(self) -> str:
        """What to call it in reports."""
        ...

    @property
    def categories(self) -> tuple[str, ...]:
        """Every category, sorted."""
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
    def fingerprint(self) -> bytes:
        """Names everything that labels depend on besides the samples' contents: the bodies."""
        ...

    def __len__(self) -> int:
        """How many images."""
        ...

    def image_id(self, index: int) -> str:
        """The image's name."""
        ...

    def sample(self, index: int) -> ImageSample:
        """What is annotated in an image."""
        ...

    def photo(self, sample: ImageSample) -> Photo:
        """The image; raises SampleError."""
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
        self.categories = tuple(sorted({record.category for record in found}))
        groups: dict[str, list[int]] = {}
        for i, record in enumerate(found):
            groups.setdefault(record.image_id, []).append(i)
        order = [i for members in groups.values() for i in members]
        kind = CuboidRecord if isinstance(records, CuboidSet) else AnimalRecord
        self._records = PackedList(kind, (_without_paths(found[i]) for i in order), tuple({id(v): v for v in map(_words, found) if v}.values()))
        self._ends = torch.from_numpy(np.cumsum([0, *(len(members) for members in groups.values())], dtype=np.int64))
        self._images = PackedNames(groups)
        self._unread = frozenset((fault.sample_id or "").partition("#")[0] for fault in records.faults)
        self._paths = PackedNames(str(found[members[0]].image_path or "") for members in groups.values())
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

    def sample(self, index: int) -> ImageSample:
        """The records of an image, made anew."""
        start, stop = self._ends[index : index + 2].tolist()
        path = Path(self._paths[index])
        records = tuple(replace(self._records[i], image_path=path, **self._mask(i)) for i in range(start, stop))
        image = self.image_id(index)
        return ImageSample(image, records, image in self._unread, tuple(self._records.packed(i) for i in range(start, stop)), self.bodies)

    def photo(self, sample: ImageSample) -> Photo:
        """The image file, which must be as large as its annotations say."""
        record = sample.records[0]
        if record.image_path is None or str(record.image_path) == ".":
            raise SampleError(sample.image_id, "image", "is only in memory: give a source that has its pictures, or write the dataset first")
        return read_photo(record.image_path, sample.image_id, record.image_hw)

    def _mask(self, place: int) -> dict[str, Path]:
        name = self._masks[place]
        return {"mask_path": Path(name)} if name else {}


def _without_paths(record: Any) -> Any:
    """A record that says the same wherever its files lie."""
    return replace(record, image_path=None, mask_path=None) if isinstance(record, AnimalRecord) else replace(record, image_path=None)


def _words(record: Any) -> Any:
    return getattr(record, "vocabulary", None)

"""What each image of a dataset says without its numbers, in one piece of bytes an image.

It is all that a label in the cache needs: the records themselves stay packed.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import msgspec

from animal3dbox.datasets.records import AnimalRecord, CuboidRecord
from animal3dbox.datasets.sightings import Sighting
from animal3dbox.datasets.storage.packed import Arena
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

_FlatEntry = tuple[str, str, tuple[int, int], int, bool, bytes, Sighting, bytes, bool]
_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(tuple[str, bytes, bool, int, tuple[_FlatEntry, ...]])


class AnimalEntry(NamedTuple):
    """The part of a record that stays unpacked: all but its keypoints, mask and camera.

    Attributes:
        sample_id: the image, and which of its animals.
        category: what the dataset calls the animal.
        image_hw: height and width that the annotations are for.
        vocabulary: what the keypoints are; None of a box.
        mask_in_runs: whether the mask comes as runs.
        mask_path: the mask as a picture; "" without.
        sighting: when, where and of whom the picture is.
        content: bytes that name what is said of the animal and of a lasting body, the same in every
            process and place.
        upright: whether picture and mask are turned as their headers say.
    """

    sample_id: str
    category: str
    image_hw: tuple[int, int]
    vocabulary: Vocabulary | None
    mask_in_runs: bool
    mask_path: str
    sighting: Sighting
    content: bytes
    upright: bool = False


IndexRow = tuple[str, str, bool, int, tuple[AnimalEntry, ...]]
"""An image's name, its file ("" of one that is only in memory), whether it has further animals
whose annotations cannot be read, the place of its first animal among all, and the entries of its
animals.
"""


def entry_of(record: AnimalRecord | CuboidRecord, content: bytes) -> AnimalEntry:
    """The entry of a record, of a content as record_content names it."""
    height, width = record.image_hw
    known = str(record.sample_id), str(record.category), (int(height), int(width))
    if isinstance(record, CuboidRecord):
        return AnimalEntry(*known, None, False, "", record.sighting, content, record.upright)
    in_runs, mask_path = record.mask_runs is not None, str(record.mask_path or "")
    mask = in_runs, mask_path
    return AnimalEntry(*known, record.vocabulary, *mask, record.sighting, content, record.upright)


class PackedImageIndex(Sequence[IndexRow]):
    """The rows of an index of images as bytes; each is made anew when it is asked for.

    Args:
        rows: one an image.
        vocabularies: every vocabulary of the animals.

    """

    def __init__(self, rows: Iterable[IndexRow], vocabularies: Sequence[Vocabulary]) -> None:
        self._vocabularies = (*vocabularies, None)
        numbers = {id(vocabulary): n for n, vocabulary in enumerate(self._vocabularies)}
        self._arena = Arena(_ENCODER.encode(_flat(row, numbers)) for row in rows)

    def __len__(self) -> int:
        return len(self._arena)

    def __getitem__(self, index: int) -> IndexRow:  # type: ignore[override]  # no slices
        image_id, path, has_unread, first, animals = _DECODER.decode(self._arena[index])
        entries = [
            AnimalEntry(
                i, category, hw, self._vocabularies[n], runs, _name(mask), seen, content, upright
            )
            for i, category, hw, n, runs, mask, seen, content, upright in animals
        ]
        return image_id, _name(path), has_unread, first, tuple(entries)


def _flat(row: IndexRow, numbers: dict[int, int]) -> tuple[object, ...]:
    image_id, path, has_unread, first, entries = row
    animals = [
        (*e[:3], numbers[id(e.vocabulary)], e.mask_in_runs, _name_bytes(e.mask_path), *e[6:])
        for e in entries
    ]
    return image_id, _name_bytes(path), has_unread, first, animals


def _name_bytes(path: str) -> bytes:
    """A file's name, whatever bytes the file system gave it."""
    return path.encode("utf-8", "surrogatepass")


def _name(path: bytes) -> str:
    return path.decode("utf-8", "surrogatepass")

"""What each image of a dataset says without its numbers.

All that a label in the cache needs of it, in one piece of bytes an image.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import msgspec

from animal3dbox.datasets.records import AnimalRecord, CuboidRecord
from animal3dbox.datasets.storage.packed import Arena
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

_Head = tuple[str, str, tuple[int, int], int, bool, bytes, bytes]
_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(tuple[str, bytes, bool, int, tuple[_Head, ...]])


class AnimalHead(NamedTuple):
    """What a record says without its numbers; see AnimalRecord and CuboidRecord.

    Attributes:
        sample_id: the image, and which of its animals.
        category: what the dataset calls the animal.
        image_hw: height and width that the annotations are for.
        vocabulary: what the keypoints are; None of a box.
        in_runs: whether the mask comes as runs.
        mask_path: the mask as a picture; "" without.
        content: bytes that name what is said of the animal and of a lasting body, the same in every
            process and place.
    """

    sample_id: str
    category: str
    image_hw: tuple[int, int]
    vocabulary: Vocabulary | None
    in_runs: bool
    mask_path: str
    content: bytes


class ImageHead(NamedTuple):
    """What is said of an image.

    Attributes:
        image_id: the image, as its dataset names it.
        image_path: its file; "" of an image that is only in memory.
        unread: whether it has further animals whose annotations cannot be read.
        first: place of its first animal among all.
        animals: their heads, in order.
    """

    image_id: str
    image_path: str
    unread: bool
    first: int
    animals: tuple[AnimalHead, ...]


def head_of(record: AnimalRecord | CuboidRecord, content: bytes) -> AnimalHead:
    """The head of a record."""
    height, width = record.image_hw
    known = str(record.sample_id), str(record.category), (int(height), int(width))
    if isinstance(record, CuboidRecord):
        return AnimalHead(*known, None, False, "", content)
    return AnimalHead(
        *known,
        record.vocabulary,
        record.mask_runs is not None,
        str(record.mask_path or ""),
        content,
    )


class PackedHeads(Sequence[ImageHead]):
    """Heads of images as bytes; each is made anew when it is asked for.

    Args:
        heads: them.
        words: every vocabulary of theirs.

    """

    def __init__(self, heads: Iterable[ImageHead], words: Sequence[Vocabulary]) -> None:
        self._words = (*words, None)
        numbers = {id(vocabulary): number for number, vocabulary in enumerate(self._words)}
        self._arena = Arena(_ENCODER.encode(_flat(head, numbers)) for head in heads)

    def __len__(self) -> int:
        return len(self._arena)

    def __getitem__(self, index: int) -> ImageHead:  # type: ignore[override]  # no slices
        image_id, path, unread, first, animals = _DECODER.decode(self._arena[index])
        heads = [
            AnimalHead(i, category, hw, self._words[n], runs, _name(mask), content)
            for i, category, hw, n, runs, mask, content in animals
        ]
        return ImageHead(image_id, _name(path), unread, first, tuple(heads))


def _flat(head: ImageHead, numbers: dict[int, int]) -> tuple[object, ...]:
    animals = [
        (*a[:3], numbers[id(a.vocabulary)], a.in_runs, _name_bytes(a.mask_path), a.content)
        for a in head.animals
    ]
    return head.image_id, _name_bytes(head.image_path), head.unread, head.first, animals


def _name_bytes(path: str) -> bytes:
    """A file's name, whatever bytes the file system gave it."""
    return path.encode("utf-8", "surrogatepass")


def _name(path: bytes) -> str:
    return path.decode("utf-8", "surrogatepass")

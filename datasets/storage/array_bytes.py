"""Named arrays and a header in one piece of bytes, which a file can hold.

The same arrays give the same bytes. A digest of all that follows it stands at the beginning, so
that a file that was cut or changed is told from a whole one.
"""

import mmap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.storage.fingerprint import digest
from animal3dbox.errors import DatasetFormatError

MAGIC = b"A3DBARR\x01"
"""The bytes that such a piece begins with; the last is the version of this layout."""
_ALIGNMENT = 8
_DIGEST = slice(len(MAGIC), len(MAGIC) + 16)
_HEAD = _DIGEST.stop + 8
"""Bytes before the table of contents: magic, digest, and the table's length."""
_Place = tuple[str, str, tuple[int, ...], int]


class _Contents(msgspec.Struct):
    """What the arrays are, where they lie, and whatever else belongs to them."""

    header: bytes
    places: list[_Place]
    length: int


def packed_arrays(header: bytes, arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """A header and arrays as bytes, the same for the same content.

    Args:
        header: any bytes.
        arrays: name -> array, of numbers.

    Example:
        >>> stored = StoredArrays(packed_arrays(b"two", {"a": np.arange(2)}))
        >>> stored.header, stored["a"].tolist()
        (b'two', [0, 1])
    """
    places, end = list[_Place](), 0
    for name, array in arrays.items():
        places.append((name, array.dtype.str, array.shape, end))
        end = _aligned(end + array.nbytes)
    table = msgspec.msgpack.encode(_Contents(header, places, end))
    body = bytearray(_aligned(_HEAD + len(table)) - _HEAD + end)
    body[: len(table)] = table
    first = len(body) - end
    for (_, _, _, begin), array in zip(places, arrays.values(), strict=True):
        content = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
        body[first + begin : first + begin + array.nbytes] = content.data
    size = len(table).to_bytes(8, "little")
    return MAGIC + digest(size, body) + size + bytes(body)


class StoredArrays(Mapping[str, NDArray[Any]]):
    """Arrays and their header, read where they lie: in memory, or in the map of a file.

    A forked worker shares them; a spawned one is sent the path and the digest of a file alone.

    Args:
        source: the bytes, or the file that holds them.
        expected: the digest that they must have; None: any that fits them.

    Raises:
        DatasetFormatError: the bytes are not whole, or are not what packed_arrays made.
        OSError: the file cannot be read.

    """

    def __init__(self, source: bytes | Path, expected: bytes | None = None) -> None:
        self.source = source
        view = memoryview(source) if isinstance(source, bytes) else _file_view(source)
        contents, first = _contents(view, source)
        self.digest = bytes(view[_DIGEST])
        if expected is not None and self.digest != expected:
            raise DatasetFormatError(f"{source!r} is not the index that was opened")
        self.header = contents.header
        self._arrays: dict[str, NDArray[Any]] = {
            name: np.ndarray(shape, np.dtype(dtype), view, first + begin)
            for name, dtype, shape, begin in contents.places
        }

    def __reduce__(self) -> tuple[Any, ...]:
        return StoredArrays, (self.source, self.digest)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)


def _aligned(place: int) -> int:
    return -(-place // _ALIGNMENT) * _ALIGNMENT


def _file_view(path: Path) -> memoryview:
    """The bytes of a file, which stay where they are."""
    with path.open("rb") as file:
        try:
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        except ValueError as error:  # an empty file
            raise DatasetFormatError(f"{path} is empty") from error


def _contents(view: memoryview, source: object) -> tuple[_Contents, int]:
    """The table of contents, and where the first array begins; raises DatasetFormatError."""
    damaged = f"{source if isinstance(source, Path) else 'an index'} is cut or changed"
    if len(view) < _HEAD or bytes(view[: len(MAGIC)]) != MAGIC:
        raise DatasetFormatError(damaged)
    size, body = view[_DIGEST.stop : _HEAD], view[_HEAD:]
    if digest(bytes(size), body) != view[_DIGEST]:
        raise DatasetFormatError(damaged)
    length = int.from_bytes(size, "little")
    contents = msgspec.msgpack.decode(body[:length], type=_Contents)
    return contents, len(view) - contents.length

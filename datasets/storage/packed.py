"""Annotations held in a few tensors instead of Python objects.

A forked worker that only looks at a Python object writes its reference count, and with it copies
its page: a list of dicts grows by hundreds of megabytes a worker. Bytes in a tensor are never
written, and spawned workers get them through shared memory.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.storage.codec import Codec

T = TypeVar("T")


class Arena:
    """A sequence of pieces of bytes, laid one after the other in a tensor that workers share.

    Args:
        parts: the pieces, in their order.

    """

    def __init__(self, parts: Iterable[bytes]) -> None:
        pieces = list(parts)
        offsets = np.cumsum([0, *(len(piece) for piece in pieces)], dtype=np.int64)
        content = np.frombuffer(bytearray(b"".join(pieces)), dtype=np.uint8)
        self._hold(torch.from_numpy(offsets), torch.from_numpy(content.copy()))

    def _hold(self, offsets: Tensor, content: Tensor) -> None:
        """Keep two tensors: piece i lies in content[offsets[i] : offsets[i + 1]].

        Their memory is read through memoryviews: a slice of a tensor costs seven times as much
        (benchmarks/loader.py, "label, from the cache").
        """
        self._offsets, self._content = offsets, content
        self._offsets_view, self._content_view = offsets.numpy().data, content.numpy().data
        self._addresses = offsets.data_ptr(), content.data_ptr()

    def __getstate__(self) -> tuple[Tensor, Tensor]:
        return self._offsets, self._content

    def __setstate__(self, state: tuple[Tensor, Tensor]) -> None:
        self._hold(*state)

    def __len__(self) -> int:
        return self._offsets.shape[0] - 1

    def __getitem__(self, index: int) -> bytes:
        if (self._offsets.data_ptr(), self._content.data_ptr()) != self._addresses:
            # Torch moves the memory of tensors that it sends to a spawned worker.
            self._hold(self._offsets, self._content)
        count = len(self._offsets_view) - 1
        if not -count <= index < count:
            raise IndexError(f"index {index} of {count}")
        index %= count
        return bytes(self._content_view[self._offsets_view[index] : self._offsets_view[index + 1]])

    @property
    def nbytes(self) -> int:
        """Bytes of memory that the pieces and their offsets take."""
        return int(self._content.nbytes + self._offsets.nbytes)


class PackedList(Sequence[T], Generic[T]):
    """A sequence of frozen dataclasses of one class, held as bytes.

    Each value is built anew whenever it is asked for.

    Args:
        kind: the values' class.
        values: the dataclasses, in their order.
        shared: objects that many of the values refer to, which are kept as they are.

    """

    def __init__(self, kind: type[T], values: Iterable[T], shared: Sequence[object] = ()) -> None:
        self.kind, self.codec = kind, Codec(shared)
        self._arena = Arena(self.codec.pack(value) for value in values)

    def __len__(self) -> int:
        return len(self._arena)

    def packed(self, index: int) -> bytes:
        """The bytes of the value at an index, the same for the same content."""
        return self._arena[index]

    def unpacked(self, index: int, **changes: Any) -> T:
        """The value at an index, with some of its fields replaced."""
        return self.kind(**{**self.codec.unpack(self._arena[index]), **changes})

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return self.unpacked(index)

    @property
    def nbytes(self) -> int:
        """Bytes of memory that the packed values take."""
        return self._arena.nbytes


class PackedMapping(Mapping[str, T], Generic[T]):
    """A mapping of names to frozen dataclasses of one class, held as bytes.

    A dictionary of a million names would be copied to every worker, page by page; here the names
    are found by a search among their sorted hashes.

    Args:
        kind: the values' class.
        values: name -> dataclass.

    """

    def __init__(self, kind: type[T], values: Mapping[str, T]) -> None:
        hashes = {name: _hash(name) for name in values}
        order = sorted(values, key=lambda name: hashes[name])
        self._hashes = torch.tensor([hashes[name] for name in order], dtype=torch.int64)
        self._names = PackedNames(order)
        self._values = PackedList(kind, (values[name] for name in order))

    def __len__(self) -> int:
        return len(self._values)

    def __iter__(self) -> Iterator[str]:
        return (self._names[i] for i in range(len(self)))

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._place(name) is not None

    def packed(self, name: str) -> bytes:
        """The bytes of a name's value, the same for the same content; raises KeyError."""
        return self._values.packed(self._index(name))

    def __getitem__(self, name: str) -> T:
        value: T = self._values[self._index(name)]
        return value

    def _index(self, name: str) -> int:
        """The place of a name among the values; raises KeyError if there is none."""
        place = self._place(name)
        if place is None:
            raise KeyError(name)
        return place

    def _place(self, name: str) -> int | None:
        """The place of a name among the values; None if there is none."""
        name_hash, hashes = _hash(name), self._hashes.numpy()
        place = int(hashes.searchsorted(name_hash))
        while place < len(hashes) and hashes[place] == name_hash:
            if self._names[place] == name:
                return place
            place += 1
        return None


class PackedNames(Sequence[str]):
    """A sequence of strings, held as bytes.

    Args:
        names: the strings, in their order; surrogates of bytes that are no UTF-8 are kept.

    """

    def __init__(self, names: Iterable[str]) -> None:
        self._arena = Arena(name.encode("utf-8", "surrogatepass") for name in names)

    def __len__(self) -> int:
        return len(self._arena)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return self._arena[index].decode("utf-8", "surrogatepass")


def _hash(name: str) -> int:
    """A hash of a name in 64 bits, the same in every process, as Python's own is not."""
    return int.from_bytes(
        hashlib.blake2b(name.encode("utf-8", "surrogatepass"), digest_size=8).digest(),
        "little",
        signed=True,
    )

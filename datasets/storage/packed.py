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
    """Pieces of bytes one after the other, in two tensors that workers share.

    Args:
        parts: the pieces.

    """

    def __init__(self, parts: Iterable[bytes]) -> None:
        held = list(parts)
        ends = np.cumsum([0, *(len(part) for part in held)], dtype=np.int64)
        self._take(
            torch.from_numpy(ends),
            torch.from_numpy(np.frombuffer(bytearray(b"".join(held)), dtype=np.uint8).copy()),
        )

    def _take(self, ends: Tensor, content: Tensor) -> None:
        self._ends, self._content = ends, content
        self._starts, self._view = (
            ends.numpy().data,
            content.numpy().data,
        )  # the same memory: cheaper to look at than tensors
        self._places = ends.data_ptr(), content.data_ptr()

    def __getstate__(self) -> tuple[Tensor, Tensor]:
        return self._ends, self._content

    def __setstate__(self, state: tuple[Tensor, Tensor]) -> None:
        self._take(*state)

    def __len__(self) -> int:
        return self._ends.shape[0] - 1

    def __getitem__(self, index: int) -> bytes:
        if (
            self._ends.data_ptr(),
            self._content.data_ptr(),
        ) != self._places:  # torch moves what it sends to a spawned worker
            self._take(self._ends, self._content)
        count = len(self._starts) - 1
        if not -count <= index < count:
            raise IndexError(f"index {index} of {count}")
        index %= count
        return bytes(self._view[self._starts[index] : self._starts[index + 1]])

    @property
    def nbytes(self) -> int:
        """What it holds in memory."""
        return int(self._content.nbytes + self._ends.nbytes)


class PackedList(Sequence[T], Generic[T]):
    """A sequence of frozen dataclasses of one kind, as bytes.

    Each is made anew when it is asked for.

    Args:
        kind: their class.
        values: them.
        shared: objects that many of them refer to, which are kept as they are.

    """

    def __init__(self, kind: type[T], values: Iterable[T], shared: Sequence[object] = ()) -> None:
        self.kind, self.codec = kind, Codec(shared)
        self._arena = Arena(self.codec.pack(value) for value in values)

    def __len__(self) -> int:
        return len(self._arena)

    def packed(self, index: int) -> bytes:
        """The bytes of one, the same for the same content."""
        return self._arena[index]

    def unpacked(self, index: int, **changes: Any) -> T:
        """One, with some of its fields replaced."""
        return self.kind(**{**self.codec.unpack(self._arena[index]), **changes})

    def __getitem__(self, index: Any) -> Any:
        return (
            [self[i] for i in range(*index.indices(len(self)))]
            if isinstance(index, slice)
            else self.unpacked(index)
        )

    @property
    def nbytes(self) -> int:
        """What it holds in memory."""
        return self._arena.nbytes


class PackedMapping(Mapping[str, T], Generic[T]):
    """A mapping of names to frozen dataclasses of one kind, as bytes.

    Args:
        kind: their class.
        values: by name.

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
        """The bytes of one, the same for the same content; raises KeyError."""
        return self._values.packed(self._found(name))

    def __getitem__(self, name: str) -> T:
        value: T = self._values[self._found(name)]
        return value

    def _found(self, name: str) -> int:
        place = self._place(name)
        if place is None:
            raise KeyError(name)
        return place

    def _place(self, name: str) -> int | None:
        wanted, hashes = _hash(name), self._hashes.numpy()
        place = int(hashes.searchsorted(wanted))
        while place < len(hashes) and hashes[place] == wanted:
            if self._names[place] == name:
                return place
            place += 1
        return None


class PackedNames(Sequence[str]):
    """A sequence of strings, as bytes."""

    def __init__(self, names: Iterable[str]) -> None:
        self._arena = Arena(name.encode("utf-8", "surrogatepass") for name in names)

    def __len__(self) -> int:
        return len(self._arena)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        return self._arena[index].decode("utf-8", "surrogatepass")


def _hash(name: str) -> int:
    """64 bits of a name, the same in every process, as Python's own are not."""
    return int.from_bytes(
        hashlib.blake2b(name.encode("utf-8", "surrogatepass"), digest_size=8).digest(),
        "little",
        signed=True,
    )

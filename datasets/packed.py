"""Annotations held in a few tensors instead of Python objects.

A forked worker that only looks at a Python object writes its reference count, and with it copies its page: a list of dicts grows by
hundreds of megabytes a worker. Bytes in a tensor are never written, and spawned workers get them through shared memory.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from torch import Tensor

from animal3dbox.datasets.codec import Codec

T = TypeVar("T")


class PackedList(Sequence[T], Generic[T]):
    """A sequence of frozen dataclasses of one kind, as bytes; each is made anew when it is asked for.

    Args:
        kind: their class.
        values: them.
        shared: objects that many of them refer to, which are kept as they are.

    """

    def __init__(self, kind: type[T], values: Iterable[T], shared: Sequence[object] = ()) -> None:
        self.kind, self.codec = kind, Codec(shared)
        parts = [self.codec.pack(value) for value in values]
        self._ends = torch.from_numpy(np.cumsum([0, *(len(part) for part in parts)], dtype=np.int64))
        self._bytes: Tensor = torch.from_numpy(np.frombuffer(bytearray(b"".join(parts)), dtype=np.uint8).copy())

    def __len__(self) -> int:
        return len(self._ends) - 1

    def packed(self, index: int) -> bytes:
        """The bytes of one, the same for the same content."""
        start, stop = self._ends[index : index + 2].tolist()
        return self._bytes[start:stop].numpy().tobytes()

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"index {index} of {len(self)}")
        return self.kind(**self.codec.unpack(self.packed(index % len(self))))

    @property
    def nbytes(self) -> int:
        """What it holds in memory."""
        return int(self._bytes.nbytes + self._ends.nbytes)


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
        for place in range(int(np.searchsorted(hashes, wanted)), int(np.searchsorted(hashes, wanted, side="right"))):
            if self._names[place] == name:
                return place
        return None


class PackedNames(Sequence[str]):
    """A sequence of strings, as bytes."""

    def __init__(self, names: Iterable[str]) -> None:
        parts = [name.encode("utf-8", "surrogatepass") for name in names]
        self._ends = torch.from_numpy(np.cumsum([0, *(len(part) for part in parts)], dtype=np.int64))
        self._bytes = torch.from_numpy(np.frombuffer(bytearray(b"".join(parts)), dtype=np.uint8).copy())

    def __len__(self) -> int:
        return len(self._ends) - 1

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"index {index} of {len(self)}")
        start, stop = self._ends[index % len(self) :][:2].tolist()
        return self._bytes[start:stop].numpy().tobytes().decode("utf-8", "surrogatepass")


def _hash(name: str) -> int:
    """64 bits of a name, the same in every process, as Python's own are not."""
    return int.from_bytes(hashlib.blake2b(name.encode("utf-8", "surrogatepass"), digest_size=8).digest(), "little", signed=True)

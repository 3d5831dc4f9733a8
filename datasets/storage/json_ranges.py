"""Where the elements of a JSON file's lists lie in it, so that each can be read again alone."""

import os
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import DatasetFormatError

FileState = tuple[int, int, int, int]
"""Size, times of change (ns) and inode of a file: equal as long as nobody changed it."""
_BLANKS = np.frombuffer(b" \t\r\n,", dtype=np.uint8)


@dataclass(frozen=True)
class ElementRanges:
    """The places of a list's elements in a file.

    Attributes:
        begins: (N,) int64, the first byte of each.
        lengths: (N,) int64, in bytes.
    """

    begins: NDArray[np.int64]
    lengths: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.begins)

    def element(self, data: bytes, place: int) -> msgspec.Raw:
        """An element, undecoded."""
        begin = int(self.begins[place])
        return msgspec.Raw(data[begin : begin + int(self.lengths[place])])

    def part(self, data: bytes, first: int, last: int) -> bytes:
        """The elements from the first to before the last as a JSON list."""
        end = int(self.begins[last - 1] + self.lengths[last - 1])
        return b"[" + data[int(self.begins[first]) : end] + b"]"


def element_ranges(data: bytes, elements: Sequence[msgspec.Raw]) -> ElementRanges:
    """The places of a list's elements in the bytes that they were decoded from.

    Args:
        data: the bytes of the file.
        elements: of one list, each still undecoded and in place, as msgspec gives them.

    """
    count = len(elements)
    lengths = np.fromiter((memoryview(one).nbytes for one in elements), np.int64, count)
    start = _address(data)
    if count > 1:
        gap = _address(elements[1]) - _address(elements[0]) - int(lengths[0])
        steps = np.append(_address(elements[0]) - start, lengths[:-1] + gap)
        begins = np.cumsum(steps, dtype=np.int64)
        if _are_even(data, begins, gap):
            return ElementRanges(begins, lengths)
    # Asking for each address costs ten times as much (benchmarks/opening.py, "first opening").
    addresses = np.fromiter((_address(one) - start for one in elements), np.int64, count)
    return ElementRanges(addresses, lengths)


def _are_even(data: bytes, begins: NDArray[np.int64], gap: int) -> bool:
    """Whether elements begin where they do if the same bytes stand before each."""
    if begins[-1] >= len(data):
        return False
    content = np.frombuffer(data, dtype=np.uint8)
    separator = content[begins[1] - gap : begins[1]]
    is_even = all(bool((content[begins[1:] - gap + k] == separator[k]).all()) for k in range(gap))
    return is_even and not bool(np.isin(content[begins], _BLANKS).any())


def _address(data: bytes | msgspec.Raw) -> int:
    return int(np.frombuffer(data, dtype=np.uint8).__array_interface__["data"][0])


def file_state(path: Path | int) -> FileState:
    """What tells that a file has not been changed; of a path, or of an open descriptor."""
    stat = os.stat(path)  # noqa: PTH116  # a descriptor has no Path
    return stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino


class RangeReader:
    """Reads pieces of a file that must be as it was when their places were found.

    Safe to use from forked and spawned workers: a spawned one opens the file anew.

    Args:
        path: the file.
        state: of the file when it was read.

    """

    def __init__(self, path: Path, state: FileState) -> None:
        self.path, self.state = path, state
        self._descriptor: int | None = None

    def __reduce__(self) -> tuple[object, ...]:
        return RangeReader, (self.path, self.state)

    def read(self, begin: int, length: int) -> bytes:
        """Some bytes of the file.

        Raises:
            DatasetFormatError: it is not there any more, or has been changed.

        """
        if self._descriptor is None:
            try:
                self._descriptor = os.open(self.path, os.O_RDONLY)
            except OSError as error:
                raise DatasetFormatError(f"{self.path} cannot be read any more: {error}") from error
            weakref.finalize(self, os.close, self._descriptor)
        # A copy on another machine has other times than those of its content, and another inode.
        if file_state(self._descriptor)[:2] != self.state[:2]:
            raise DatasetFormatError(
                f"{self.path} has been changed since it was opened: open the dataset anew"
            )
        return os.pread(self._descriptor, length, begin)

"""Files of cached entries.

Each written by one process only, by appending, and read by all through memory maps.

An entry is a header (magic, length, key, checksum) and its payload. A process that is killed leaves
at most one half entry, at the end of its own file; a flipped bit spoils one entry, which its
checksum tells. Neither hides the entries beside it.
"""

import mmap
import os
import struct
import time
import uuid
import weakref
import zlib
from collections.abc import Iterator
from pathlib import Path

MAGIC = b"A3L\x01"
_HEADER = struct.Struct("<4sI16sI")
KEY_BYTES = 16
SUFFIX = ".labels"
STILL_WRITING_S = 2.0
"""A file that changed more recently may end within an entry because that is being written."""


def entry_bytes(key: bytes, payload: bytes) -> bytes:
    """An entry as it stands in a file."""
    return _HEADER.pack(MAGIC, len(payload), key, zlib.crc32(payload, zlib.crc32(key))) + payload


class SegmentWriter:
    """The one file that this process appends to.

    Args:
        folder: of the cache.

    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / f"{uuid.uuid4().hex}{SUFFIX}"
        self.process = os.getpid()
        self._descriptor = os.open(
            self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL, 0o644
        )
        self.close = weakref.finalize(
            self, os.close, self._descriptor
        )  # by hand, else when nobody refers to the writer any more
        self._size = 0

    def append(self, key: bytes, payload: bytes) -> int:
        """Write one entry and return its offset.

        Raises:
            OSError: it could not be written whole; the file is as it was before.

        """
        data, start = entry_bytes(key, payload), self._size
        try:
            written = os.write(self._descriptor, data)
        except OSError:
            os.ftruncate(self._descriptor, start)
            raise
        if written != len(data):
            os.ftruncate(self._descriptor, start)
            raise OSError(
                28, f"only {written} of {len(data)} bytes could be written", str(self.path)
            )
        self._size = start + written
        return start


class SegmentReader:
    """A file of entries, mapped into memory.

    Attributes:
        path: of a file that another process may still be appending to.
        damaged: complete entries, or stretches between sound ones, whose checksum is wrong.
        unfinished: whether the file ends within an entry and has done so for a while: its process
            was killed, or the file was cut.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damaged = 0
        self.unfinished = False
        self._scanned = 0
        self._map: mmap.mmap | None = None

    def new_entries(self) -> Iterator[tuple[bytes, int]]:
        """Key and offset of the sound entries since the last time.

        What is not sound is passed over, and counted.
        """
        told = self.path.stat()
        if told.st_size <= self._scanned:
            return
        mapped = self._mapped(told.st_size)
        at, self.unfinished = self._scanned, False
        while at < told.st_size:
            if _payload(mapped, at) is not None:
                _, length, key, _ = _HEADER.unpack_from(mapped, at)
                yield key, at
                at += _HEADER.size + length
                continue
            following = _next_sound(mapped, at + 1)
            if following is None and not _complete(mapped, at):
                self.unfinished = (
                    time.time() - told.st_mtime > STILL_WRITING_S
                )  # else looked at again when the file has grown
                break
            self.damaged += 1
            at = told.st_size if following is None else following
        self._scanned = at

    def payload(self, offset: int, key: bytes) -> bytes | None:
        """The payload of an entry; None if its checksum, or its key, does not fit.

        Raises OSError if the file cannot be opened.
        """
        return _payload(self._map or self._mapped(0), offset, key)

    def release(self) -> None:
        """Close the map, which holds a file descriptor; the next look opens it again."""
        self._map = None

    def _mapped(self, size: int) -> mmap.mmap:
        """The file in memory, all of it if size is 0."""
        with self.path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ)
        return self._map


def _payload(mapped: mmap.mmap, offset: int, key: bytes | None = None) -> bytes | None:
    """The payload of an entry.

    None if its checksum, or the key that it should have, does not fit.
    """
    start = offset + _HEADER.size
    if start > len(mapped):
        return None
    magic, length, found, checksum = _HEADER.unpack_from(mapped, offset)
    if magic != MAGIC or start + length > len(mapped) or (key is not None and found != key):
        return None
    data = mapped[start : start + length]
    return data if zlib.crc32(data, zlib.crc32(found)) == checksum else None


def _complete(mapped: mmap.mmap, offset: int) -> bool:
    """Whether an entry seems to be there in its full length."""
    if offset + _HEADER.size > len(mapped):
        return False
    magic, length, _, _ = _HEADER.unpack_from(mapped, offset)
    return magic != MAGIC or offset + _HEADER.size + int(length) <= len(mapped)


def _next_sound(mapped: mmap.mmap, start: int) -> int | None:
    """Where the next entry with a right checksum begins."""
    at = mapped.find(MAGIC, start)
    while at >= 0:
        if _payload(mapped, at) is not None:
            return at
        at = mapped.find(MAGIC, at + 1)
    return None

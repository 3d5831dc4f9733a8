"""Files of cached entries, each appended to by one process and read by all through memory maps.

An entry is a header (magic, length, key, checksum) and its payload. A process that is killed leaves
at most one half entry, at the end of its own file; a flipped bit spoils one entry, whose checksum
shows it. Neither hides the entries beside it.
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
"""The bytes that an entry begins with; the last is the version of this layout."""
_HEADER = struct.Struct("<4sI16sI")
SUFFIX = ".labels"
"""Suffix of a segment's file."""
STILL_WRITING_S = 2.0
"""A file that changed more recently may end within an entry because that is being written."""


def entry_bytes(key: bytes, payload: bytes) -> bytes:
    """An entry as it stands in a segment's file: header and payload."""
    return _HEADER.pack(MAGIC, len(payload), key, zlib.crc32(payload, zlib.crc32(key))) + payload


class SegmentWriter:
    """The one segment of a cache that this process appends to.

    Args:
        folder: the cache's, made if it is not there; the file gets a name of its own.

    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / f"{uuid.uuid4().hex}{SUFFIX}"
        self.process = os.getpid()
        self._descriptor = os.open(
            self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL, 0o644
        )
        # Called by hand, or else when nobody refers to the writer any more.
        self.close = weakref.finalize(self, os.close, self._descriptor)
        self._size = 0

    def append(self, key: bytes, payload: bytes) -> int:
        """Write one entry and return its offset.

        Raises:
            OSError: it could not be written whole; the file is as it was before.

        """
        data, start = entry_bytes(key, payload), self._size
        try:
            count = os.write(self._descriptor, data)
        except OSError:
            os.ftruncate(self._descriptor, start)
            raise
        if count != len(data):
            os.ftruncate(self._descriptor, start)
            raise OSError(28, f"only {count} of {len(data)} bytes could be written", str(self.path))
        self._size = start + count
        return start


class SegmentReader:
    """The entries of one segment, read through a map of the file into memory.

    Attributes:
        path: the file, which another process may still be appending to.
        damaged: number of complete entries, or stretches between sound ones, whose checksum is
            wrong.
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
        """Keys and offsets of the sound entries that were appended since the last call.

        Bytes that are no sound entry are passed over, and counted in `damaged`.
        """
        stat = self.path.stat()
        if stat.st_size <= self._scanned:
            return
        file_map = self._open_map(stat.st_size)
        at, self.unfinished = self._scanned, False
        while at < stat.st_size:
            if _payload(file_map, at) is not None:
                _, length, key, _ = _HEADER.unpack_from(file_map, at)
                yield key, at
                at += _HEADER.size + length
                continue
            following = _next_sound(file_map, at + 1)
            if following is None and not _complete(file_map, at):
                # A file that is still being written is scanned again when it has grown.
                self.unfinished = time.time() - stat.st_mtime > STILL_WRITING_S
                break
            self.damaged += 1
            at = stat.st_size if following is None else following
        self._scanned = at

    def payload(self, offset: int, key: bytes) -> bytes | None:
        """The payload of the entry at an offset; None if its checksum, or its key, does not fit.

        Raises OSError if the file cannot be opened.
        """
        return _payload(self._map or self._open_map(0), offset, key)

    def release(self) -> None:
        """Close the map, which holds a file descriptor; the next reading opens it again."""
        self._map = None

    def _open_map(self, size: int) -> mmap.mmap:
        """Map the first bytes of the file into memory, all of it if size is 0."""
        with self.path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ)
        return self._map


def _payload(file_map: mmap.mmap, offset: int, key: bytes | None = None) -> bytes | None:
    """The payload of the entry at an offset.

    None if its checksum, or the key that it should have, does not fit.
    """
    start = offset + _HEADER.size
    if start > len(file_map):
        return None
    magic, length, stored_key, checksum = _HEADER.unpack_from(file_map, offset)
    if magic != MAGIC or start + length > len(file_map) or key not in (None, stored_key):
        return None
    data = file_map[start : start + length]
    return data if zlib.crc32(data, zlib.crc32(stored_key)) == checksum else None


def _complete(file_map: mmap.mmap, offset: int) -> bool:
    """Whether the entry at an offset seems to be there in its full length."""
    if offset + _HEADER.size > len(file_map):
        return False
    magic, length, _, _ = _HEADER.unpack_from(file_map, offset)
    return magic != MAGIC or offset + _HEADER.size + int(length) <= len(file_map)


def _next_sound(file_map: mmap.mmap, start: int) -> int | None:
    """The offset of the first entry with a right checksum from an offset on; None if none is."""
    at = file_map.find(MAGIC, start)
    while at >= 0:
        if _payload(file_map, at) is not None:
            return at
        at = file_map.find(MAGIC, at + 1)
    return None

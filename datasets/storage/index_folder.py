"""A folder of indexes of annotation files, each found by the content that it was made from."""

import hashlib
import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec

from animal3dbox.datasets.storage.array_bytes import StoredArrays
from animal3dbox.datasets.storage.fingerprint import code_digest, digest
from animal3dbox.datasets.storage.json_ranges import FileState, file_state
from animal3dbox.errors import DatasetFormatError
from animal3dbox.files import write_whole

SETTLED_S = 2.0
"""A file that changed more recently may change again within one tick of its file system's clock."""


class _KnownDigest(msgspec.Struct):
    """The digest of a file's content, and the file's state when it was taken."""

    state: FileState
    digest: bytes


@dataclass(frozen=True)
class IndexFolder:
    """The indexes of annotation files in a folder, and how the files' digests are remembered.

    An index is found by the digest of its file's content, of the installed code and of the options
    that it was made with, so a changed file, or another version, finds none and makes its own.

    Attributes:
        path: the folder, made when something is written to it.
    """

    path: Path

    def key(self, file: Path, options: bytes) -> bytes:
        """Names the index of an annotation file, read with some options; raises OSError."""
        return digest(self.file_digest(file), code_digest(), options)

    def has(self, key: bytes) -> bool:
        """Whether there is an index of a key, be it whole or damaged."""
        return self._file(key).is_file()

    def load(self, key: bytes) -> StoredArrays | None:
        """The index of a key; None without.

        Raises:
            DatasetFormatError: it was cut or changed.

        """
        try:
            return StoredArrays(self._file(key))
        except FileNotFoundError:
            return None
        except OSError as error:
            raise DatasetFormatError(f"{self._file(key)} cannot be read: {error}") from error

    def save(self, key: bytes, data: bytes) -> StoredArrays:
        """Write an index whole, and open it; raises OSError if it cannot be written.

        Processes that write the same index at once write the same bytes, and the last one stays.
        """
        write_whole(self._file(key), data)
        return StoredArrays(self._file(key))

    def file_digest(self, file: Path) -> bytes:
        """Names the content of a file; raises OSError.

        It is taken once for each state (size, times of change, inode) in which the file is
        found, and remembered in the folder: a shard need not read all annotations to know them.
        """
        state = file_state(file)
        memory = self.path / f"{digest(os.fsencode(file.resolve())).hex()}.state"
        try:
            remembered = msgspec.msgpack.decode(memory.read_bytes(), type=_KnownDigest)
            if remembered.state == state:
                return remembered.digest
        except (OSError, msgspec.DecodeError):  # never seen, or a damaged memory
            pass
        with file.open("rb") as content:
            content_digest = hashlib.file_digest(
                content, lambda: hashlib.blake2b(digest_size=16)
            ).digest()
        is_settled = time.time_ns() - max(state[1:3]) > SETTLED_S * 1e9
        if is_settled and file_state(file) == state:
            with suppress(OSError):  # a folder that cannot be written to costs time, no more
                write_whole(memory, msgspec.msgpack.encode(_KnownDigest(state, content_digest)))
        return content_digest

    def _file(self, key: bytes) -> Path:
        return self.path / f"{key.hex()}.index"

"""The rows of a run on disk, while it goes on: they need no memory, and survive a kill."""

import shutil
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from animal3dbox.errors import DatasetFormatError
from animal3dbox.files import write_whole
from animal3dbox.report.run_rows import RunRow

ROWS_AT_ONCE = 64
"""Rows of a file, at least."""
_CHECKSUM = 4
"""Bytes of the CRC-32 of its rows with which a file begins."""
_ENCODER = msgspec.msgpack.Encoder()
_DECODER = msgspec.msgpack.Decoder(tuple[RunRow, ...])


class RowSpool:
    """A folder of files of rows, each written whole or not at all, in the order of the rows.

    Args:
        folder: made for the first file.

    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._waiting: list[RunRow] = []

    def add(self, rows: Sequence[RunRow]) -> None:
        """Take rows; files are written when there are enough."""
        self._waiting += rows
        if len(self._waiting) >= ROWS_AT_ONCE:
            self.flush()

    def flush(self) -> None:
        """Write what is waiting."""
        rows, self._waiting = self._waiting, []
        if rows:
            files = self._files()
            number = int(files[-1].stem) + 1 if files else 0  # some before it may be missing
            content = _ENCODER.encode(rows)
            write_whole(self.folder / f"{number:09d}.rows", _checksum(content) + content)

    def __iter__(self) -> Iterator[RunRow]:
        """All rows that are written.

        Raises:
            DatasetFormatError: a file is damaged.

        """
        for path in self._files():
            try:
                yield from _rows_of(path.read_bytes())
            except (msgspec.DecodeError, msgspec.ValidationError) as error:
                raise DatasetFormatError(
                    f"{path} is damaged ({error}): label again without --resume"
                ) from error

    def clear(self) -> None:
        """Remove all rows, but not the folder, which may be locked.

        The last go first: a kill leaves the first rows of the run.
        """
        shutil.rmtree(self._removed, ignore_errors=True)  # which a killed run left
        for path in reversed(self._files()):
            path.unlink()

    def remove(self) -> None:
        """Remove the folder with all its rows in one step: a kill leaves all of them or none."""
        shutil.rmtree(self._removed, ignore_errors=True)
        try:
            self.folder.rename(self._removed)
        except OSError:  # there is none, or on Windows its lock's file is open
            self.clear()
            shutil.rmtree(self.folder, ignore_errors=True)
        shutil.rmtree(self._removed, ignore_errors=True)

    @property
    def _removed(self) -> Path:
        """Where the folder is while its files are deleted; nobody reads rows there."""
        return self.folder.with_name(f"{self.folder.name}-removed")

    def _files(self) -> list[Path]:
        return sorted(self.folder.glob("[0-9]*.rows"))


def _checksum(content: bytes) -> bytes:
    return zlib.crc32(content).to_bytes(_CHECKSUM, "big")


def _rows_of(data: bytes) -> tuple[RunRow, ...]:
    """The rows of a file's bytes; raises a DecodeError if they are not those that were written."""
    checksum, content = data[:_CHECKSUM], data[_CHECKSUM:]
    if checksum != _checksum(content):
        raise msgspec.DecodeError("its checksum is another")
    rows: tuple[RunRow, ...] = _DECODER.decode(content)
    return rows

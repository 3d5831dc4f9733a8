"""Plain values out of the .pth files of detectors, of which nothing is imported or run.

torch's own weights-only load refuses them, for they hold NumPy's scalars; its other load would run
whatever they name. Here their bytes go through the reader of model pickles, which knows only plain
values and NumPy's records. A .pth is a zip archive (torch since 1.6), five pickles one after the
other (torch before), or one pickle (pickle.dump).
"""

import io
import pickletools
import struct
import zipfile
import zlib
from pathlib import Path

from animal3dbox.datasets.storage.json_files import read_json_bytes
from animal3dbox.errors import DatasetFormatError, ModelFileError
from animal3dbox.smal.safe_pickle.arrays import Place, read_array
from animal3dbox.smal.safe_pickle.reader import parse_pickle
from animal3dbox.smal.safe_pickle.stream import NOT_A_MODEL, Call, Global, PickleLimits

LIMITS = PickleLimits(file_bytes=2**31, opcodes=50_000_000)
"""How much a file may ask for: a box takes some 150 opcodes, so 300,000 boxes."""
NOT_DETECTIONS = (
    "detections need none of this: save them again as lists of plain numbers (tensor.tolist()), and"
    " do not open this file with pickle or torch.load itself"
)
_OLD_TORCH = b"\x8a\x0a" + 0x1950A86A20F9469CFC6C.to_bytes(10, "little") + b"."
"""The number in the first pickle of files of torch before 1.6, after the pickle's protocol."""
_PROTOCOL = 2
"""Bytes of a pickle's protocol."""
_OLD_HEADS = 3
"""Pickles before the content in such files: that number, a version, the machine's sizes."""


class Unreadable:
    """Stands for an object that no file of detections holds: a fault of its own detection alone."""


def read_pickled(path: Path) -> object:
    """The value in a .pth or pickle file, as plain lists, dictionaries, numbers and words.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: damaged, too large, or with what no file of detections holds.

    """
    data = read_json_bytes(path)
    try:
        value = parse_pickle(_content(data, path), str(path), LIMITS)
        return _PlainValues(path).of(value)[0]
    except ModelFileError as error:
        raise DatasetFormatError(str(error).replace(NOT_A_MODEL, NOT_DETECTIONS)) from error


def _content(data: bytes, path: Path) -> bytes:
    """The bytes of the pickle that has the content."""
    if data[:4] == b"PK\x03\x04":
        return _from_archive(data, path)
    if not data[_PROTOCOL:].startswith(_OLD_TORCH):
        return data
    try:
        start = 0
        for _ in range(_OLD_HEADS):
            start = _end_of_pickle(data, start)
        return data[start : _end_of_pickle(data, start)]
    except ValueError as error:  # of pickletools, which names the opcode
        raise DatasetFormatError(
            f"{path} is damaged or cut short ({error}): copy it again, in binary mode"
        ) from error


def _end_of_pickle(data: bytes, start: int) -> int:
    """The place after the pickle that begins at a place; raises ValueError if it has no end."""
    stream = io.BytesIO(data)
    stream.seek(start)
    for _ in pickletools.genops(stream):
        pass
    return stream.tell()


def _from_archive(data: bytes, path: Path) -> bytes:
    """The bytes of data.pkl in the zip archive of torch.save."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            inside = [one for one in archive.infolist() if one.filename.endswith("/data.pkl")]
            if len(inside) != 1:
                raise DatasetFormatError(f"{path} is an archive without one data.pkl of torch.save")
            if inside[0].file_size > LIMITS.file_bytes:
                raise DatasetFormatError(f"{path}: its data.pkl has {inside[0].file_size} bytes")
            return archive.read(inside[0])
    except (
        *(zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, OSError),
        *(UnicodeDecodeError, NotImplementedError, struct.error),
    ) as error:
        raise DatasetFormatError(
            f"{path} is a damaged archive ({error}): copy it again, in binary mode"
        ) from error


class _PlainValues:
    """Makes plain values of what the stack machine left, each part that is shared once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.place = Place(str(path), "detections", LIMITS)
        self.known: dict[int, tuple[object, int]] = {}

    def of(self, value: object) -> tuple[object, int]:
        """A value as plain ones, and of how many it consists with shared parts counted each time.

        Raises:
            DatasetFormatError: of more than the file can have written: a part is named very often.

        """
        if not isinstance(value, list | tuple | dict | Call | Global):
            return value, 1
        if id(value) not in self.known:
            made, count = self._made(value)
            if count > LIMITS.opcodes:
                raise DatasetFormatError(
                    f"{self.path} holds {count} values, more than a file can have written; "
                    + NOT_DETECTIONS
                )
            self.known[id(value)] = made, count
        return self.known[id(value)]

    def _made(self, value: object) -> tuple[object, int]:
        if isinstance(value, dict):
            items = {key: self.of(one) for key, one in value.items()}
            made = {key: one for key, (one, _) in items.items()}
            return made, 1 + sum(count for _, count in items.values())
        if isinstance(value, list | tuple):
            parts = [self.of(one) for one in value]
            return [one for one, _ in parts], 1 + sum(count for _, count in parts)
        try:
            array = read_array(value, self.place)
        except ModelFileError:
            return Unreadable(), 1
        return array.tolist(), max(1, array.size)

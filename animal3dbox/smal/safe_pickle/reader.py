"""Reading a SMAL model pickle without trusting it: nothing that it names is imported or called.

The bytes run through a stack machine of our own (opcodes.py), which knows only plain values and
inert records; then arrays.py recognises the few records that honest files hold, and builds arrays
from their bytes.
"""

import stat
from collections.abc import Iterator
from pathlib import Path

from animal3dbox.errors import ModelFileError
from animal3dbox.smal.safe_pickle.opcodes import run_pickle
from animal3dbox.smal.safe_pickle.stream import NOT_A_MODEL, ByteStream, Call, PickleLimits, refusal

DEFAULT_LIMITS = PickleLimits()


def read_pickle(path: Path, limits: PickleLimits = DEFAULT_LIMITS) -> object:
    """The value in a pickle file of protocol 0 to 5.

    Where Python would import or call something, the value has an inert record: Global or Call.

    Args:
        path: the file.
        limits: how much it may ask for.

    Raises:
        ModelFileError: the file is not there, damaged, too large, recursive, or holds what no model
            file holds.

    """
    return parse_pickle(_read_bytes(path, limits), str(path), limits)


def parse_pickle(data: bytes, source: str, limits: PickleLimits = DEFAULT_LIMITS) -> object:
    """The value in the bytes of a pickle, as read_pickle; source names them in errors."""
    _check_line_ends(data, source)
    value = run_pickle(ByteStream(data, source), limits)
    _check_nesting(value, source, limits.nesting)
    return value


def _read_bytes(path: Path, limits: PickleLimits) -> bytes:
    """The bytes of a regular file that is not too large, also if it grows meanwhile."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise ModelFileError(f"{path} is no file; give the path of the model file itself")
        if status.st_size > limits.file_bytes:
            raise _too_large(path, limits)
        with path.open("rb") as file:
            data = file.read(
                limits.file_bytes + 1 if status.st_size == limits.file_bytes else status.st_size + 1
            )
    except OSError as error:
        raise ModelFileError(
            f"{path} cannot be read: {error.strerror or error}; check the path"
        ) from error
    if len(data) > limits.file_bytes:
        raise _too_large(path, limits)
    return data


def _too_large(path: Path, limits: PickleLimits) -> ModelFileError:
    return ModelFileError(
        f"{path} has more than {limits.file_bytes} bytes; if it is an honest model file, raise"
        " PickleLimits.file_bytes"
    )


def _check_line_ends(data: bytes, source: str) -> None:
    """Refuse a text pickle (protocol 0) whose line ends were made CRLF.

    Its names and strings are all wrong by a byte.
    """
    if data[:1] == b"\x80" or b"\r\n" not in data[: 2**16]:
        return
    if data.count(b"\n") == data.count(b"\r\n"):
        remedy = (
            "copy it again in binary mode (git: -text, FTP: binary), or run `dos2unix` on a copy"
            " of it"
        )
        raise refusal(
            source,
            data.index(b"\r\n"),
            "the line ends of this text pickle were changed from LF to CRLF",
            remedy,
        )


def _check_nesting(root: object, source: str, deepest: int) -> None:
    """Refuse recursive and deep values.

    By a depth-first walk without recursion, which visits a shared part once.
    """
    # Of the parts that the walk is through with: how many levels they are, themselves included
    heights: dict[int, int] = {}
    path = [(root, _parts(root))]
    below = [0]
    entered = {id(root)}
    while path:
        value, parts = path[-1]
        part = next(parts, None)
        if part is None:
            path.pop()
            entered.discard(id(value))
            heights[id(value)] = 1 + below.pop()
            below[-1:] = [max(below[-1], heights[id(value)])] if below else []
            continue
        if id(part) in entered:
            raise refusal(source, None, "the value contains itself", NOT_A_MODEL)
        height = heights.get(id(part), 1)
        if len(path) + height > deepest:
            raise refusal(
                source, None, f"containers within containers, more than {deepest} deep", NOT_A_MODEL
            )
        below[-1] = max(below[-1], height)
        if id(part) not in heights:
            path.append((part, _parts(part)))
            below.append(0)
            entered.add(id(part))


def _parts(value: object) -> Iterator[object]:
    """The parts of a value that have parts themselves."""
    parts: list[object] | tuple[object, ...] = []
    if isinstance(value, list | tuple):
        parts = value
    elif isinstance(value, dict):
        parts = list(value.values())
    elif isinstance(value, Call):
        parts = [value.func, value.args, value.state, value.added]
    return (part for part in parts if isinstance(part, list | tuple | dict | Call))

"""Files: paths as users write them, and writing so that nobody ever finds half of a file."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


def user_path(path: Path | str) -> Path:
    """A path as a user means it: "~" at its beginning is a home folder, as shells have it.

    Example:
        >>> user_path("~/cache") == Path.home() / "cache"
        True
    """
    try:
        return Path(path).expanduser()
    except RuntimeError:  # "~name" of nobody here: a file may be called so
        return Path(path)


def portable_path(path: Path) -> str:
    """A path as outputs may hold it: as it was given, of an absolute one the name alone.

    Example:
        >>> portable_path(Path("/home/me/animals")), portable_path(Path("sets/animals"))
        ('animals', 'sets/animals')
    """
    return path.name if path.is_absolute() else str(path)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file whole or not at all: into a neighbour first, then renamed over the old one.

    Raises:
        OSError: it cannot be written; the error names this file, not the neighbour.

    """
    with whole_file(path) as file:
        file.write(data)


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Give a file to write to piece by piece, which has its name once it is whole.

    Raises:
        OSError: it cannot be written; the error names this file, not the neighbour.

    """
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        temporary = Path(name)
        with os.fdopen(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except BaseException as error:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            reason = f"cannot be written ({error.strerror or error})"
            raise OSError(error.errno, reason, str(path)) from error
        raise


def _umask() -> int:
    """The process's umask, which only setting it tells."""
    mask = os.umask(0)
    os.umask(mask)
    return mask

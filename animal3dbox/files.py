"""Files: paths as users write them, and writing so that nobody ever finds half of a file."""

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
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


@dataclass(frozen=True)
class OwnFiles:
    """The pictures that runs of one command write into a folder, which may hold others' files too.

    A hidden list in the folder has their names, each put there before its file is written, so that
    it has those of a killed run, too. By it the next run removes what does not belong to its own
    results, and nothing that somebody else put there.

    Attributes:
        folder: of the command's results.
        command: whose files they are.
    """

    folder: Path
    command: str

    def write(self, name: str, data: bytes) -> None:
        """Write a file, by its path from the folder; raises OSError."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with self._list.open(
            "ab"
        ) as names:  # begun by an end of line: a kill may leave half of one
            names.write(f"\n{name}".encode())
        write_whole(self.folder / name, data)

    def keep_only(self, names: Iterable[str]) -> None:
        """Remove the files of earlier runs, but those of these names.

        Raises:
            OSError: a file cannot be removed.

        """
        kept = [*names]
        plain = {name.casefold() for name in kept}  # the same file where case does not matter
        for name in self._listed():
            if name.casefold() not in plain:
                (self.folder / name).unlink(missing_ok=True)
        if kept:
            write_whole(self._list, "\n".join(kept).encode())
        else:
            self._list.unlink(missing_ok=True)

    def _listed(self) -> list[str]:
        """The names in the list that lead to a place below the folder."""
        try:
            lines = self._list.read_text("utf-8", errors="replace").split("\n")
        except FileNotFoundError:
            return []
        paths = ((line, PurePosixPath(line)) for line in lines if line)
        return [
            line
            for line, path in paths
            if not path.is_absolute() and ".." not in path.parts and (self.folder / path).is_file()
        ]

    @property
    def _list(self) -> Path:
        return self.folder / f".{self.command}-pictures"

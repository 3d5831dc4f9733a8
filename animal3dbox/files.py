"""Files: paths as users write them, and writing so that nobody ever finds half of a file."""

import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from animal3dbox.errors import ConfigError


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
class ListedFiles:
    """The pictures that runs of one command write into a folder, which may hold others' files too.

    A hidden list in the folder has their names, each put there before its file is written, so that
    it has those of a killed run, too. By it the next run removes what does not belong to its own
    results, and nothing that somebody else put there. The list may come from somebody else, with
    the folder, or be damaged: only lines that are names as the command writes them count.

    Attributes:
        folder: of the command's results.
        command: whose files they are.
        pattern: a regular expression of all names that the command writes, by their paths from the
            folder. It bounds their lengths, and admits no folder that the command does not make.
    """

    folder: Path
    command: str
    pattern: str

    def check_list(self) -> None:
        """Refuse a list that could not be read and written at the end of the work.

        A link is refused too: what it leads to would be read and written as the list.

        Raises:
            ConfigError: it is no file, a link, or may not be read or written.

        """
        path, remedy = self._list, f"(the list of pictures that {self.command} wrote): delete it"
        try:
            if path.is_symlink():
                raise ConfigError(f"{path} is a link {remedy}")
            if not path.exists():
                return
            if not path.is_file():
                raise ConfigError(f"{path} is not a file {remedy}")
            path.open("r+b").close()
        except OSError as error:
            reason = error.strerror or error
            raise ConfigError(f"{path} cannot be read and written: {reason} {remedy}") from error

    def write(self, name: str, data: bytes) -> None:
        """Write a file, by its path from the folder.

        Raises:
            ValueError: the pattern does not admit the name.
            OSError: the file cannot be written.

        """
        if not re.fullmatch(self.pattern, name):
            raise ValueError(f"{name!r} is no name of the files of {self.command}: {self.pattern}")
        self.folder.mkdir(parents=True, exist_ok=True)
        with self._list.open("ab") as names:
            names.write(f"\n{name}".encode())  # the end of line first: a kill may leave half a line
        write_whole(self.folder / name, data)

    def keep_only(self, names: Iterable[str]) -> None:
        """Remove the files of earlier runs, but those of these names.

        Raises:
            OSError: a file cannot be removed.

        """
        current = [*names]
        folded = {name.casefold() for name in current}  # the same file where case does not matter
        for name in self._listed():
            if name.casefold() not in folded:
                (self.folder / name).unlink(missing_ok=True)
        if current:
            write_whole(self._list, "\n".join(current).encode())
        else:
            self._list.unlink(missing_ok=True)

    def _listed(self) -> list[str]:
        """The names in the list that the command can have written, of files that are there."""
        try:
            lines = self._list.read_text("utf-8", errors="replace").split("\n")
        except FileNotFoundError:
            return []
        names = (line for line in lines if re.fullmatch(self.pattern, line))
        return [name for name in names if (self.folder / name).is_file()]

    @property
    def _list(self) -> Path:
        return self.folder / f".{self.command}-pictures"

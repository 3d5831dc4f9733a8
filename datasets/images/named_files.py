"""The file that an annotation names, whatever system, archive or folder the name was written on.

A name that leads nowhere as it stands is tried as other programs mean it: with backslashes, as a
URL or an absolute path of another machine, with a folder too many, in another letter case or
Unicode form. It is taken where that leads to one file under the root; else the error names what
comes nearest.
"""

import difflib
import unicodedata
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from animal3dbox.errors import SampleError

NEAR = 0.6
"""Likeness of two names, by difflib's ratio, from which on one is named as a near miss."""
LISTED = 2000
"""Most names of a folder that are looked through."""


def resolve_inside(
    root: Path, relative: str, sample_id: str, field: str, *, home: Path | None = None
) -> Path:
    """The path of the file that an annotation names, which must lie under root.

    Args:
        root: the folder.
        relative: as the annotation has it.
        sample_id: named in every error.
        field: likewise.
        home: root.resolve(), which costs as much as the rest, where it is known already.

    Raises:
        SampleError: the path leads out of root (through "..", or a link), is no file, or may be
            several.

    """
    home = home or root.resolve()
    if not relative or "\0" in relative:
        raise SampleError(sample_id, field, f"is {relative!r}, which names no file")
    try:
        path = (home / relative).resolve()
        if path.is_file() and path.is_relative_to(home):
            return path
        with suppress(FileNotFoundError, NotADirectoryError):
            path.stat()  # raises of a loop of links, which resolve() accepts from Python 3.13 on
        other = _as_others_mean_it(home, relative)
    except (OSError, RuntimeError, ValueError) as error:
        # Too long a name, a loop of links, or a character that no file's name has.
        raise SampleError(sample_id, field, f"{relative!r} names no file: {error}") from error
    if len(other) == 1:
        return other[0]
    if len(other) > 1:
        names = " and ".join(repr(path.relative_to(home).as_posix()) for path in other[:2])
        raise SampleError(
            sample_id, field, f"{relative!r} may be {names} under {root}: name the one that it is"
        )
    if not path.is_relative_to(home):
        raise SampleError(
            sample_id,
            field,
            f"{relative!r} leads out of {root}: paths must stay inside the images' root (see"
            " --images)",
        )
    raise SampleError(
        sample_id, field, f"there is no file {relative!r} under {root}{near_miss(home, relative)}"
    )


def portable_name(root: Path, name: str) -> str:
    """A file's name as outputs may hold it: absolute ones, URLs and Windows' from the root on.

    One that leads to no file stays, for the error that says so.

    Args:
        root: the folder of images.
        name: as the annotation has it.

    """
    is_absolute = is_absolute_name(name)
    if not is_absolute and "\\" not in name:
        return name
    home = root.resolve()
    if not is_absolute and (home / name).is_file():
        return name
    found = _as_others_mean_it(home, name)
    return found[0].relative_to(home).as_posix() if len(found) == 1 else name


def is_end_of_path(name: str, path: str) -> bool:
    """Whether a path ends in all the folders of a name, however these are written."""
    parts = [plain_name(part) for part in path.split("/")]
    return any(
        parts[-len(reading) :] == [plain_name(part) for part in reading]
        for reading in _readings(name)
        if reading
    )


def is_absolute_name(name: str) -> bool:
    """Whether a name begins at the root of some machine: /a, C:/a, or a URL."""
    plain = name.replace("\\", "/")
    return plain.startswith("/") or "://" in plain or plain[1:3] == ":/"


def _as_others_mean_it(home: Path, name: str) -> list[Path]:
    """The files under home that a name of another system, archive or folder may mean."""
    for parts in _readings(name):
        if ".." in parts:
            return []
        for first in range(len(parts)):  # folders too many in front
            found = _in_any_case(home, parts[first:])
            if found:
                return [path for path in found if path.resolve().is_relative_to(home)]
    return []


def _readings(name: str) -> Iterator[tuple[str, ...]]:
    """The parts of a name as it stands and as others write it, without what is before its root."""
    plain = name.replace("\\", "/")
    for text in dict.fromkeys((plain, unquote(plain))):
        path = urlsplit(text).path if "://" in text else text
        parts = PurePosixPath(path).parts
        yield tuple(part for part in parts if part not in ("/", ".") and not part.endswith(":"))


def _in_any_case(home: Path, parts: tuple[str, ...]) -> list[Path]:
    """The files of a path below home: as it is, else in any letter case and Unicode form."""
    exact = home.joinpath(*parts)
    if exact.is_file():
        return [exact]
    folders = [home]
    for part in parts:
        exact_folders = [folder / part for folder in folders if (folder / part).exists()]
        folders = exact_folders or [
            child
            for folder in folders
            if folder.is_dir()
            for child in folder.iterdir()
            if plain_name(child.name) == plain_name(part)
        ]
    return sorted(path for path in folders if path.is_file())


def plain_name(name: str) -> str:
    """A name by which two are alike that differ in letter case or Unicode form alone."""
    return unicodedata.normalize("NFC", name).casefold()


def near_miss(home: Path, name: str) -> str:
    """Words that name the nearest file of the folder that a name leads into; "" if none is near."""
    parts = next(_readings(name))
    folder = home.joinpath(*parts[:-1])
    folder = folder if folder.is_dir() else home
    if not parts or not folder.is_dir():
        return ""
    names = [path.name for path in islice(folder.iterdir(), LISTED) if path.is_file()]
    near = difflib.get_close_matches(parts[-1], names, n=1, cutoff=NEAR)
    return f"; the nearest there is {near[0]!r}" if near else ""

"""Where the golden record finds each name of the package, before and after its modules move.

The record (golden_record.py) runs on the code of two commits. Whatever it takes from the package,
it takes by the old dotted name, and this map leads to the new place: the new name is tried first,
then the rooms into which modules move, then the old name itself. When a name changes, add it here.
"""

import re
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

OLD_TO_NEW: dict[str, tuple[str, ...]] = {
    "animal3dbox.datasets.exchange.omni3d_reader.read_omni3d": (
        "animal3dbox.datasets.read_omni3d",
        "animal3dbox.datasets.readers.omni3d.reader.read_omni3d",
        "animal3dbox.datasets.readers.cuboids.omni3d_reader.read_omni3d",
    ),
}
"""Old dotted name -> new ones, the newest first, for names that change in more than their room."""

ROOMS: dict[str, tuple[str, ...]] = {
    "animal3dbox.datasets": (
        "readers",
        "bodies",
        "images",
        "labelling",
        "storage",
        "synthetic",
        "exchange",
        "inspection",
    ),
    "animal3dbox.smal": ("files", "keypoints", "quadruped"),
}
"""Package -> the rooms in which its modules may lie now; one that is not there is passed over."""

KEYWORDS: dict[str, str] = {"pose": "stored_cameras"}
"""Keyword of a Dataset -> its new name."""

OPTIONS: dict[str, str] = {"--stored-pose": "--stored-camera"}
"""Option of the command line -> its new name."""

ATTRIBUTES: dict[str, tuple[str, ...]] = {"source.notes": ("notes", "source.notes")}
"""Old path of an attribute -> the paths that are tried, first to last."""

META = "meta"
"""The part of a target into which words move; the record takes them out of it again."""

_NOT_THERE = object()


def in_old_words(text: str) -> str:
    """A text of the package, such as advice, with the old names of options and keywords."""
    for old, new in OPTIONS.items():
        text = text.replace(new, old)
    for old, new in KEYWORDS.items():
        text = text.replace(f"{new}=", f"{old}=").replace(f"{new} '", f"{old} '")
    return text


def named(old: str) -> Any:
    """The object of an old dotted name, from its new place if it has moved; raises LookupError."""
    tried = list(places_of(old))
    for dotted in tried:
        found = _found(dotted)
        if found is not _NOT_THERE:
            return found
    raise LookupError(f"{old} is at none of {', '.join(tried)}: add it to OLD_TO_NEW")


def places_of(old: str) -> Iterator[str]:
    """The dotted names under which an object may be found, the newest first."""
    yield from OLD_TO_NEW.get(old, ())
    for package, rooms in ROOMS.items():
        inner = old.removeprefix(f"{package}.")
        if inner != old and "." in inner:
            yield from (f"{package}.{room}.{inner}" for room in rooms)
    yield old


def _found(dotted: str) -> object:
    """The object of a dotted name; only a missing module of that very name counts as missing."""
    module, _, name = dotted.rpartition(".")
    try:
        return getattr(import_module(module), name, _NOT_THERE)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise
        return _NOT_THERE


def made(kind: Callable[..., Any], *values: Any, **options: Any) -> Any:
    """What a Dataset's class makes of options under their old keywords, which may be renamed."""
    old_of = {KEYWORDS.get(name, name): name for name in options}
    current = {KEYWORDS.get(name, name): value for name, value in options.items()}
    while True:
        try:
            return kind(*values, **current)
        except TypeError as error:
            refused = re.search(r"unexpected keyword argument '(\w+)'", str(error))
            new = refused[1] if refused else ""
            if new not in current or old_of[new] == new:
                raise
            current[old_of[new]] = current.pop(new)
            old_of[old_of[new]] = old_of[new]


def attribute(thing: Any, path: str) -> Any:
    """The attribute at an old path, from the first of its present paths that is there."""
    for dotted in ATTRIBUTES.get(path, (path,)):
        value = thing
        for name in dotted.split("."):
            value = getattr(value, name, _NOT_THERE)
            if value is _NOT_THERE:
                break
        else:
            return value
    raise AttributeError(f"{type(thing).__name__} has no {path}: add its new path to ATTRIBUTES")


def without_meta(target: dict[str, Any]) -> dict[str, Any]:
    """A target with the words of its "meta" beside the other fields, where they used to be."""
    words = target.get(META)
    if not isinstance(words, dict):
        return target
    return {**{name: value for name, value in target.items() if name != META}, **words}

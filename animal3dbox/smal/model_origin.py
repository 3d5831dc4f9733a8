"""Where a body model came from, so that other processes are sent that, and not its arrays.

A SMAL model is tens of megabytes. A Dataset that goes to ten workers would carry it ten times, and
each would hold a copy for every Dataset; instead each process loads it once, from its file, and
refuses a file that is not the one that was loaded.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakValueDictionary

from animal3dbox.errors import ModelFileError

Model = Any
"""A SmalModel, whose module imports this one."""
_SomeModel = TypeVar("_SomeModel")
MOST_LOADED = 4
"""So many models that were sent to a process stay loaded in it, besides those that it uses."""


@dataclass(frozen=True)
class ModelOrigin:
    """How a model is loaded again, and what must be the same then.

    Attributes:
        load: a function of a module, or a partial of one with values that have a hash.
        arguments: what it is called with.
        path: the file that it reads; None of what comes with the package.
        content: digest of the file; empty without one.
    """

    load: Callable[..., Model]
    arguments: tuple[object, ...] = ()
    path: Path | None = None
    content: bytes = b""


_KNOWN: WeakValueDictionary[ModelOrigin, Model] = WeakValueDictionary()
"""The models of this process that still are as they were loaded."""


def model_content(path: Path) -> bytes:
    """16 bytes that name the content of a model's file.

    Raises:
        ModelFileError: it cannot be read.

    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).digest()
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read: {error}") from error


def remember(model: _SomeModel, origin: ModelOrigin) -> _SomeModel:
    """The model, which from now on is sent to other processes as its origin.

    Args:
        model: as its origin gives it, unchanged.
        origin: of the model.

    """
    object.__setattr__(model, "origin", origin)
    _KNOWN[origin] = model
    return model


def model_of(origin: ModelOrigin) -> Model:
    """The model of an origin, the same object for all that ask in a process.

    Raises:
        ModelFileError: its file is not there, or is not the one that was loaded.

    """
    model = _KNOWN.get(origin)
    return _loaded(origin) if model is None else model


@lru_cache(maxsize=MOST_LOADED)
def _loaded(origin: ModelOrigin) -> Model:
    """The model of an origin, loaded."""
    if origin.path is not None and model_content(origin.path) != origin.content:
        raise ModelFileError(
            f"{origin.path} is not the file any more that this model was loaded from: open the"
            " dataset anew"
        )
    return origin.load(*origin.arguments)

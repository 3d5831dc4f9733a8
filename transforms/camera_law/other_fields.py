"""Fields of a target that the package does not know, and its book-keeping.

A field that holds a camera or pixels would be left stale by a map of pixels. So whatever could is
refused, unless its user says that it has nothing to do with either.
"""

from collections.abc import Mapping
from enum import Enum
from pathlib import PurePath
from typing import Any, Literal

import numpy as np
from torch import Tensor

from animal3dbox.errors import SampleError
from animal3dbox.target_schema import META_PER_ANIMAL
from animal3dbox.transforms.camera_law.fields import EITHER, PER_ANIMAL, PER_IMAGE, Declared

Belonging = Literal["animal", "image", "unclear"]

_REMEDY = (
    "it would be left stale by a map of pixels. Give it under a name that the transforms know"
    f" ({', '.join((*PER_IMAGE, *EITHER, *PER_ANIMAL))}), put it into target['meta'] if it is"
    " book-keeping, or say that it has nothing to do with pixels or cameras:"
    " Compose(per_image=[...])"
)


def checked_meta(meta: object, count: int, sample_id: str | None) -> dict[str, Any]:
    """A target's book-keeping as a dict of our own.

    Args:
        meta: a mapping; whatever lies in it is passed on, and what META_PER_ANIMAL names follows
            when animals are dropped.
        count: of the animals.
        sample_id: for messages.

    Raises:
        SampleError: it is no mapping, or a list of it has not one entry an animal.
    """
    if not isinstance(meta, Mapping):
        raise SampleError(sample_id, "meta", f"must be a dict, got {type(meta).__name__}")
    for name in META_PER_ANIMAL:
        if name in meta:
            _check_count(f"meta: {name}", meta[name], count, sample_id)
    return dict(meta)


def belonging(
    name: str, value: object, *, count: int, sample_id: str | None, declared: Declared
) -> Belonging:
    """Whether an unknown field has one entry an "animal", belongs to the "image", or is "unclear".

    Args:
        name: of the field.
        value: its value.
        count: of the animals.
        sample_id: for messages.
        declared: the user's own fields.

    Raises:
        SampleError: it could hold a camera or pixels, or has not one entry an animal.
    """
    if name in declared.per_image or name == "mirrored":
        return "image"
    if name in declared.per_animal:
        _check_count(name, value, count, sample_id)
        return "animal"
    if not _is_plain(value):
        kind = (
            f"of shape {tuple(value.shape)}"
            if isinstance(value, Tensor | np.ndarray)
            else f"({type(value).__name__})"
        )
        raise SampleError(
            sample_id, name, f"unknown field {kind}, which could hold a camera or pixels; {_REMEDY}"
        )
    return "unclear" if count > 0 and _entries(value) == count else "image"


def _entries(value: object) -> int | None:
    """How many entries a list, a tuple or an array has; None if it is none of these."""
    if isinstance(value, Tensor | np.ndarray):
        return int(value.shape[0]) if value.ndim else None
    return len(value) if isinstance(value, list | tuple) else None


def _check_count(name: str, value: object, count: int, sample_id: str | None) -> None:
    entries = _entries(value)
    if entries is None:
        raise SampleError(
            sample_id, name, f"must hold one record an animal, got {type(value).__name__}"
        )
    if entries != count:
        raise SampleError(sample_id, name, f"holds {entries} records for {count} animals")


def _is_plain(value: object, *, inside: bool = False) -> bool:
    """Whether a value can hold no camera and no pixels.

    Words, whole numbers, single numbers, and lists of words and whole numbers.
    """
    if value is None or isinstance(value, str | bytes | bool | int | PurePath | Enum | np.integer):
        return True
    if isinstance(value, float | np.floating):
        return not inside
    if isinstance(value, Tensor | np.ndarray):
        inexact = (
            value.is_floating_point()
            if isinstance(value, Tensor)
            else np.issubdtype(value.dtype, np.inexact)
        )
        return value.ndim == 0 or (not inexact and value.ndim == 1)
    if isinstance(value, Mapping):
        return all(_is_plain(item, inside=True) for item in value.values())
    return isinstance(value, list | tuple | set) and all(
        _is_plain(item, inside=True) for item in value
    )

"""The fields of a target, opened: arrays of one library, and everything that is passed on.

A target is a plain dict about one image with N animals (or any other boxes). Which fields there are
and how a map of pixels changes each is said once, in animal3dbox.target_schema; the tables here are
derived from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import SampleError
from animal3dbox.target_schema import FIELDS, META_PER_ANIMAL, names_of

PER_ANIMAL = {field.name: field.spec for field in FIELDS if field.per == "animal"}
"""Fields with one entry an animal, and their shapes as check_shape reads them: "N 8 3"."""
PER_IMAGE = {field.name: field.spec for field in FIELDS if field.per == "image"}
"""Fields with one entry an image, likewise: "3 3"."""
EITHER = {field.name: field.shape for field in FIELDS if field.per == "either"}
"""Fields with one entry an animal, or one for all animals of the image: the shape of an entry."""
KNOWN = frozenset(field.name for field in FIELDS)
CAMERA_FRAME = tuple(field.name for field in FIELDS if field.camera_frame)
"""Fields that mean nothing without the intrinsics K of their camera."""
WHOLE = frozenset((*names_of(kind="whole"), *names_of(kind="flag")))
"""Fields that may hold whole numbers or booleans."""


@dataclass(frozen=True)
class Declared:
    """The user's own fields, which the package does not know.

    Attributes:
        per_animal: names of fields with one entry an animal.
        per_image: names of fields to pass on as they are.
    """

    per_animal: tuple[str, ...] = ()
    per_image: tuple[str, ...] = ()


class FieldForm(NamedTuple):
    """How a field came, so that it can leave the same way; see form_of.

    Attributes:
        tensor: a torch tensor, not an array.
        dtype: of the field as it came.
        floating: whether that is a floating-point type.
    """

    tensor: bool
    dtype: torch.dtype | np.dtype[np.generic]
    floating: bool


@lru_cache
def form_of(tensor: bool, dtype: torch.dtype | np.dtype[np.generic]) -> FieldForm:
    """The form of tensors, or of arrays, of this dtype."""
    floating = dtype.is_floating_point if isinstance(dtype, torch.dtype) else dtype.kind == "f"
    return FieldForm(tensor, dtype, floating)


@dataclass(frozen=True)
class Fields:
    """A target, opened and checked.

    Attributes:
        values: the known array fields, all NumPy or all torch (see read_target); floats but the
            depth picture's are float64, the rest keeps its dtype.
        forms: how each came.
        others: everything else, passed on; "meta" among it is a copy.
        per_animal: the names in others that hold one entry an animal.
        unclear: the names in others that could hold one entry an animal, or not.
        count: N.
        sample_id: for messages.
    """

    values: dict[str, Any]
    forms: dict[str, FieldForm]
    others: dict[str, object]
    per_animal: tuple[str, ...]
    unclear: tuple[str, ...]
    count: int
    sample_id: str | None

    @property
    def meta(self) -> Mapping[str, Any]:
        """The target's book-keeping; empty if it has none."""
        return cast(Mapping[str, Any], self.others.get("meta", {}))

    @property
    def sample_key(self) -> tuple[int, ...] | None:
        """The key of the sample's draws, (epoch, index), if its book-keeping holds one."""
        return tuple(self.meta["sample_key"]) if "sample_key" in self.meta else None

    def updated(self, **values: Any) -> "Fields":
        """The same target with some fields replaced or added."""
        return replace(self, values={**self.values, **values})

    def without(self, *names: str) -> "Fields":
        """The same target without some fields."""
        return replace(
            self, values={name: value for name, value in self.values.items() if name not in names}
        )

    def selected(self, indices: tuple[int, ...]) -> "Fields":
        """The target with the animals of these indices only.

        Raises:
            SampleError: an unknown field has as many entries as there are animals, and nobody says
                whether it follows them.
        """
        if self.unclear and len(indices) < self.count:
            name = self.unclear[0]
            raise SampleError(
                self.sample_id,
                name,
                f"has {self.count} entries, as many as there are animals, and some animals are"
                f" dropped: say whether it follows them, Compose(per_animal=[{name!r}]), or not,"
                f" Compose(per_image=[{name!r}])",
            )
        rows = list(indices)
        values = {
            name: value[rows] if has_entry_per_animal(name, value) else value
            for name, value in self.values.items()
        }
        others = {
            name: entries_at(value, indices) if name in self.per_animal else value
            for name, value in self.others.items()
        }
        if self.meta:
            others["meta"] = {
                name: entries_at(value, indices) if name in META_PER_ANIMAL else value
                for name, value in self.meta.items()
            }
        return replace(self, values=values, others=others, count=len(indices))


def has_entry_per_animal(name: str, value: Any) -> bool:
    """Whether a known field holds one entry an animal, (N, ...)."""
    if name in EITHER:
        return bool(value.ndim == 1 + len(EITHER[name].split()))
    return name in PER_ANIMAL


def entries_at(entries: Any, indices: tuple[int, ...]) -> object:
    """The entries of these indices in a container of the same type: tensor, array, list, tuple."""
    if isinstance(entries, Tensor | np.ndarray):
        return entries[list(indices)]
    return type(entries)(entries[index] for index in indices)

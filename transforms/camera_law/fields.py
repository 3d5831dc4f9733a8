"""The fields of a target.

Which are known, what shape each has, and how a dict of them is read and written.

A target is a plain dict about one image with N animals (or any other boxes). A field that is about
pixels or cameras and is not in this list would be left stale by a map of pixels, so it is refused.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import PurePath
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.arrays import as_numpy, namespace
from animal3dbox.geometry.checks import check_intrinsics, check_shape
from animal3dbox.geometry.distortion import check_distortion

PER_ANIMAL = {
    "corners_3d": "N 8 3", "center": "N 3", "rotation": "N 3 3", "size": "N 3", "corners_2d": "N 8 2", "corner_in_front": "N 8",
    "face_visible": "N 6", "face_area": "N 6", "face_share": "N 6", "face_share_in_image": "N 6", "surface_share": "N 6",
    "truncation": "N", "behind_camera": "N", "occlusion": "N", "scores": "N", "boxes": "N 4",
    "scale_known": "N", "scale_m_per_unit": "N",
    "labels": "N", "iscrowd": "N", "track_ids": "N", "keypoints": "N J 3", "keypoints_3d": "N J 3",
    "vertices": "N V 3", "masks": "N H W",
}  # fmt: skip
PER_IMAGE = {
    "K": "3 3",
    "H_out_in": "3 3",
    "distortion": "D",
    "depth": "H W",
    "keypoint_mirror": "J",
}
CAMERA_FRAME = ("corners_3d", "center", "rotation", "R", "t")
LISTS = ("quality", "scale_source", "sample_ids")
UNREADABLE = ("float16", "bfloat16", "uint32", "uint64", "complex64", "complex128")
WHOLE = (
    "labels",
    "masks",
    "corner_in_front",
    "face_visible",
    "behind_camera",
    "keypoint_mirror",
    "iscrowd",
    "track_ids",
    "scale_known",
)
"""Fields that may hold whole numbers or booleans."""


@dataclass(frozen=True)
class Declared:
    """What the user says of fields that are not known here.

    Attributes:
        per_animal: names of fields with one entry an animal.
        per_image: names of fields to pass on as they are.
    """

    per_animal: tuple[str, ...] = ()
    per_image: tuple[str, ...] = ()


@dataclass(frozen=True)
class Form:
    """How a field came: a tensor or an array, and of which dtype."""

    tensor: bool
    dtype: torch.dtype | np.dtype[np.generic]


@dataclass(frozen=True)
class Fields:
    """A target opened up.

    Attributes:
        values: the known array fields, all NumPy or all torch (see read_target); floats are
            float64, the rest keeps its dtype.
        forms: how each came.
        others: everything else, passed on.
        per_animal: the names in others that hold one entry an animal.
        unclear: the names in others that could hold one entry an animal, or not.
        count: N.
        sample_id: for messages.
    """

    values: dict[str, Any]
    forms: dict[str, Form]
    others: dict[str, object]
    per_animal: tuple[str, ...]
    unclear: tuple[str, ...]
    count: int
    sample_id: str | None

    def updated(self, **values: Any) -> "Fields":
        """The same target with some fields replaced or added."""
        return replace(self, values={**self.values, **values})

    def without(self, *names: str) -> "Fields":
        """The same target without some fields."""
        return replace(
            self, values={name: value for name, value in self.values.items() if name not in names}
        )

    def selected(self, keep: tuple[int, ...]) -> "Fields":
        """The animals of these indices only."""
        if self.unclear and len(keep) < self.count:
            name = self.unclear[0]
            raise SampleError(
                self.sample_id,
                name,
                f"has {self.count} entries, as many as there are animals, and some animals are"
                f" dropped: say whether it follows them, Compose(per_animal=[{name!r}]), or not,"
                f" Compose(per_image=[{name!r}])",
            )
        index = list(keep)
        shared = {
            name
            for name in ("R", "t")
            if name in self.values and self.values[name].ndim == {"R": 2, "t": 1}[name]
        }
        chosen = {
            name: (
                value[index]
                if name in PER_ANIMAL or (name in ("R", "t") and name not in shared)
                else value
            )
            for name, value in self.values.items()
        }
        others = {
            name: _choose(value, keep) if name in self.per_animal else value
            for name, value in self.others.items()
        }
        return replace(self, values=chosen, others=others, count=len(keep))


def _choose(value: Any, keep: tuple[int, ...]) -> object:
    return (
        value[list(keep)]
        if isinstance(value, Tensor | np.ndarray)
        else type(value)(value[index] for index in keep)
    )


def read_target(
    target: Mapping[str, object], image_hw: tuple[int, int], declared: Declared | None = None
) -> Fields:
    """Open a target and check it.

    Gradients and devices are kept: if any field needs one or lives on one, all are worked on in
    torch; otherwise in NumPy, which costs a worker a third of the time for the few numbers of one
    image (geometry/arrays.py).

    Args:
        target: plain dict of tensors, arrays and small values.
        image_hw: of the image it belongs to.
        declared: what the user says of unknown fields.

    Raises:
        SampleError: a field has a wrong shape or value, contradicts another, or is unknown and
            could hold a camera or pixels.

    """
    sample_id = str(target["image_id"]) if "image_id" in target else None
    values: dict[str, Any] = {}
    forms: dict[str, Form] = {}
    others: dict[str, object] = {}
    for name, value in target.items():
        if name in PER_ANIMAL or name in PER_IMAGE or name in ("R", "t"):
            values[name], forms[name] = _open(value, sample_id, name)
        else:
            others[name] = value
    if any(
        isinstance(value, Tensor) and (value.requires_grad or value.device.type != "cpu")
        for value in values.values()
    ):
        values = {
            name: (
                torch.from_numpy(np.ascontiguousarray(value))
                if isinstance(value, np.ndarray)
                else value
            )
            for name, value in values.items()
        }
    else:
        values = {name: as_numpy(value) for name, value in values.items()}
    _check_finite(values, sample_id)
    try:
        count = _check_shapes(values, image_hw, sample_id)
        if "K" in values:
            check_intrinsics("K", values["K"])
        if "distortion" in values:
            check_distortion("distortion", values["distortion"])
    except ShapeError as error:
        raise SampleError(sample_id, str(error).split()[0], str(error)) from error
    missing = [name for name in CAMERA_FRAME if name in values]
    if missing and "K" not in values:
        raise SampleError(
            sample_id,
            missing[0],
            "a target with camera-frame fields needs the intrinsics K (3, 3) of its image",
        )
    declared = Declared() if declared is None else declared
    told = {
        name: _entries(value, name, count, sample_id, declared) for name, value in others.items()
    }
    per_animal, unclear = (
        tuple(name for name, kind in told.items() if kind == wanted)
        for wanted in ("animal", "unclear")
    )
    return Fields(values, forms, others, per_animal, unclear, count, sample_id)


def _open(value: object, sample_id: str | None, name: str) -> tuple[Tensor | np.ndarray, Form]:
    if not isinstance(value, Tensor | np.ndarray):
        raise SampleError(
            sample_id, name, f"must be a tensor or an array, got {type(value).__name__}"
        )
    form = Form(isinstance(value, Tensor), value.dtype)
    floating = (
        value.is_floating_point()
        if isinstance(value, Tensor)
        else np.issubdtype(value.dtype, np.floating)
    )
    if not floating and name not in WHOLE:
        raise SampleError(sample_id, name, f"must be floating point, got {value.dtype}")
    if name in ("masks", "depth"):
        if str(value.dtype).removeprefix("torch.") in UNREADABLE:
            raise SampleError(
                sample_id,
                name,
                f"has dtype {value.dtype}, which OpenCV cannot read; convert it to uint8 or"
                " float32",
            )
        return value, form
    if isinstance(value, Tensor):  # copies, so that nothing of the result is the caller's memory
        return value.to(torch.float64 if floating else value.dtype, copy=True), form
    return value.astype(np.float64 if floating else value.dtype), form


def _check_finite(values: dict[str, Any], sample_id: str | None) -> None:
    for name, value in values.items():
        if (
            name not in WHOLE
            and not math.isfinite(float(value.sum()))
            and not bool(namespace(value).isfinite(value).all())
        ):
            raise SampleError(
                sample_id,
                name,
                "must be finite, but holds NaN or infinite values; what is unknown has no field",
            )


def _check_shapes(values: dict[str, Any], image_hw: tuple[int, int], sample_id: str | None) -> int:
    for name, value in values.items():
        if name in ("R", "t"):
            spec = {"R": "3 3", "t": "3"}[name]
            check_shape(name, value, spec if value.ndim == len(spec.split()) else f"N {spec}")
        else:
            check_shape(name, value, PER_ANIMAL.get(name) or PER_IMAGE[name])
    counts = {name: value.shape[0] for name, value in values.items() if name in PER_ANIMAL}
    counts |= {
        name: values[name].shape[0]
        for name in ("R", "t")
        if name in values and values[name].ndim == {"R": 3, "t": 2}[name]
    }
    if len(set(counts.values())) > 1:
        raise SampleError(
            sample_id, next(iter(counts)), f"fields disagree on the number of animals: {counts}"
        )
    for name in ("masks", "depth"):
        if name in values and tuple(values[name].shape[-2:]) != tuple(image_hw):
            came = tuple(values[name].shape[-2:])
            raise SampleError(
                sample_id,
                name,
                f"is stale: it covers {came} (height, width), the image {tuple(image_hw)}; map both"
                " by one transform",
            )
    return next(iter(counts.values()), 0)


def _entries(value: Any, name: str, count: int, sample_id: str | None, declared: Declared) -> str:
    """Whether an unknown field has one entry an "animal", belongs to the "image", or is "unclear".

    Refuses what could be left stale.
    """
    if name in declared.per_image or name in ("sample_key", "mirrored"):
        return "image"
    if name in declared.per_animal or (name in LISTS and isinstance(value, list | tuple)):
        entries = len(value) if isinstance(value, list | tuple | Tensor | np.ndarray) else None
        if entries != count:
            raise SampleError(sample_id, name, f"holds {entries} records for {count} animals")
        return "animal"
    if name not in LISTS and not _is_plain(value):
        what = (
            f"of shape {tuple(value.shape)}"
            if isinstance(value, Tensor | np.ndarray)
            else f"({type(value).__name__})"
        )
        raise SampleError(
            sample_id, name, f"unknown field {what}, which could hold a camera or pixels; {_REMEDY}"
        )
    sized = isinstance(value, list | tuple) or (
        isinstance(value, Tensor | np.ndarray) and value.ndim == 1
    )
    return "unclear" if sized and count > 0 and len(value) == count else "image"


def _is_plain(value: object, *, inside: bool = False) -> bool:
    """Whether a value can hold no camera and no pixels.

    Words, whole numbers, single numbers, and lists of words and whole numbers.
    """
    if value is None or isinstance(value, str | bytes | bool | int | PurePath | Enum):
        return True
    if isinstance(value, float | np.floating):
        return not inside
    if isinstance(value, Tensor | np.ndarray):
        whole = not (
            value.is_floating_point()
            if isinstance(value, Tensor)
            else np.issubdtype(value.dtype, np.inexact)
        )
        return value.ndim == 0 or (whole and value.ndim == 1)
    if isinstance(value, Mapping):
        return all(_is_plain(item, inside=True) for item in value.values())
    return isinstance(value, list | tuple | set | np.integer) and (
        isinstance(value, np.integer) or all(_is_plain(item, inside=True) for item in value)
    )


_REMEDY = (
    "it would be left stale by a map of pixels. Give it under a name that the transforms know"
    f" ({', '.join((*PER_IMAGE, 'R', 't', *PER_ANIMAL))}), or say that it has nothing to do with"
    " pixels or cameras: Compose(per_image=[...])"
)


def _is_float(dtype: Any) -> bool:
    return (
        dtype.is_floating_point
        if isinstance(dtype, torch.dtype)
        else np.issubdtype(dtype, np.floating)
    )


def write_target(fields: Fields) -> dict[str, object]:
    """The target as a plain dict again, every field in the form in which it came."""
    written: dict[str, object] = dict(fields.others)
    given = [form for form in fields.forms.values() if _is_float(form.dtype)]
    some = next(iter(fields.forms.values()), Form(True, torch.float32))
    default = fields.forms.get("K") or next(
        iter(given), Form(some.tensor, torch.float32 if some.tensor else np.dtype(np.float32))
    )
    for name, value in fields.values.items():
        form = fields.forms.get(name, default)
        if form.tensor:
            tensor = (
                torch.from_numpy(np.ascontiguousarray(value))
                if isinstance(value, np.ndarray)
                else value
            )
            written[name] = tensor.to(form.dtype) if isinstance(form.dtype, torch.dtype) else tensor
        else:
            array = as_numpy(value)
            written[name] = (
                array
                if isinstance(form.dtype, torch.dtype)
                else array.astype(form.dtype, copy=False)
            )
    return written

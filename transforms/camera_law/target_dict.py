"""A target as a plain dict: opened into fields with all its checks, and written again.

A field that is about pixels or cameras and is not known would be left stale by a map of pixels, so
it is refused (other_fields.py).
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.arrays import as_numpy, namespace
from animal3dbox.geometry.checks import check_intrinsics, check_shape
from animal3dbox.geometry.distortion import check_distortion
from animal3dbox.transforms.camera_law.fields import (
    CAMERA_FRAME,
    EITHER,
    KNOWN,
    PER_ANIMAL,
    PER_IMAGE,
    WHOLE,
    Declared,
    FieldForm,
    Fields,
    form_of,
    has_entry_per_animal,
)
from animal3dbox.transforms.camera_law.other_fields import belonging, checked_meta

PIXELS = ("masks", "depth")
"""Fields of pixels: OpenCV reads them as they are, and copying them costs."""
UNREADABLE = ("float16", "bfloat16", "uint32", "uint64", "complex64", "complex128")
"""Types of masks and depth that OpenCV cannot read."""


def read_target(
    target: Mapping[str, object], image_hw: tuple[int, int], declared: Declared | None = None
) -> Fields:
    """A target opened and checked.

    Gradients and devices are kept: if any field needs one or lives on one, all are worked on in
    torch; otherwise in NumPy, which costs a worker a third of the time for the few numbers of one
    image (geometry/arrays.py).

    Args:
        target: plain dict of tensors, arrays and small values; it is left as it was.
        image_hw: of the image it belongs to.
        declared: the user's own fields.

    Raises:
        SampleError: a field has a wrong shape or value, contradicts another, or is unknown and
            could hold a camera or pixels.

    Example:
        >>> fields = read_target({"size": torch.ones(2, 3), "meta": {"sample_key": (0, 7)}}, (4, 6))
        >>> fields.count, fields.sample_key, type(fields.values["size"]).__name__
        (2, (0, 7), 'ndarray')
    """
    declared = Declared() if declared is None else declared
    sample_id = str(target["image_id"]) if "image_id" in target else None
    known: dict[str, Any] = {name: value for name, value in target.items() if name in KNOWN}
    others = {name: value for name, value in target.items() if name not in KNOWN}
    forms = {name: _checked_form(name, value, sample_id) for name, value in known.items()}
    in_torch = any(map(_needs_torch, known.values()))
    opened = _as_tensor if in_torch else _as_array
    values = {name: opened(name, value, forms[name]) for name, value in known.items()}
    _check_finite(values, sample_id, in_torch=in_torch)
    count = _checked_count(values, image_hw, sample_id)
    owners = {
        name: belonging(name, value, count=count, sample_id=sample_id, declared=declared)
        for name, value in others.items()
        if name != "meta"
    }
    if "meta" in others:
        others["meta"] = checked_meta(others["meta"], count, sample_id)
    return Fields(
        values,
        forms,
        others,
        per_animal=tuple(name for name, owner in owners.items() if owner == "animal"),
        unclear=tuple(name for name, owner in owners.items() if owner == "unclear"),
        count=count,
        sample_id=sample_id,
    )


def _needs_torch(value: Tensor | np.ndarray) -> bool:
    """Whether a field has gradients or a device that NumPy does not know."""
    return isinstance(value, Tensor) and (value.requires_grad or not value.is_cpu)


def _as_array(name: str, value: Tensor | np.ndarray, form: FieldForm) -> np.ndarray:
    """A field as an array; a copy, so that nothing of the result is the caller's memory."""
    if form.dtype == torch.bfloat16 and isinstance(value, Tensor):  # NumPy has no such type
        value = value.float()
    array = as_numpy(value)
    if name in PIXELS:
        return array
    return array.astype(np.float64 if form.floating else array.dtype)


def _as_tensor(name: str, value: Tensor | np.ndarray, form: FieldForm) -> Tensor:
    """A field as a tensor, likewise; differentiable."""
    if not isinstance(value, Tensor):
        return torch.from_numpy(np.ascontiguousarray(_as_array(name, value, form)))
    if name in PIXELS:
        return value
    return value.to(torch.float64 if form.floating else value.dtype, copy=True)


def _checked_count(values: dict[str, Any], image_hw: tuple[int, int], sample_id: str | None) -> int:
    """The number of animals, after shapes, counts and the camera have been checked."""
    try:
        _check_shapes(values)
        if "K" in values:
            check_intrinsics("K", values["K"])
        if "distortion" in values:
            check_distortion("distortion", values["distortion"])
    except ShapeError as error:
        raise SampleError(sample_id, str(error).split()[0], str(error)) from error
    needs_camera = [name for name in CAMERA_FRAME if name in values]
    if needs_camera and "K" not in values:
        raise SampleError(
            sample_id,
            needs_camera[0],
            "a target with camera-frame fields needs the intrinsics K (3, 3) of its image",
        )
    _check_pixels(values, image_hw, sample_id)
    counts = {
        name: value.shape[0] for name, value in values.items() if has_entry_per_animal(name, value)
    }
    if len(set(counts.values())) > 1:
        raise SampleError(
            sample_id, next(iter(counts)), f"fields disagree on the number of animals: {counts}"
        )
    return next(iter(counts.values()), 0)


def _check_shapes(values: dict[str, Any]) -> None:
    for name, value in values.items():
        if name in EITHER:
            spec = EITHER[name]
            check_shape(name, value, spec if value.ndim == len(spec.split()) else f"N {spec}")
        else:
            check_shape(name, value, PER_ANIMAL.get(name) or PER_IMAGE[name])


def _check_pixels(values: dict[str, Any], image_hw: tuple[int, int], sample_id: str | None) -> None:
    """Raise a SampleError unless masks and depth cover the image."""
    for name in PIXELS:
        if name in values and tuple(values[name].shape[-2:]) != tuple(image_hw):
            field_hw = tuple(values[name].shape[-2:])
            raise SampleError(
                sample_id,
                name,
                f"is stale: it covers {field_hw} (height, width), the image {tuple(image_hw)};"
                " map both by one transform",
            )


def _checked_form(name: str, value: object, sample_id: str | None) -> FieldForm:
    """How a field came; a SampleError if it is of no type that can be worked on."""
    if not isinstance(value, Tensor | np.ndarray):
        raise SampleError(
            sample_id, name, f"must be a tensor or an array, got {type(value).__name__}"
        )
    form = form_of(isinstance(value, Tensor), value.dtype)
    if not form.floating and name not in WHOLE:
        raise SampleError(sample_id, name, f"must be floating point, got {value.dtype}")
    if name in PIXELS and str(value.dtype).removeprefix("torch.") in UNREADABLE:
        raise SampleError(
            sample_id,
            name,
            f"has dtype {value.dtype}, which OpenCV cannot read; convert it to uint8 or float32",
        )
    return form


def _check_finite(values: dict[str, Any], sample_id: str | None, *, in_torch: bool) -> None:
    """Raise a SampleError naming the first field that holds NaN or infinite values.

    Arrays are summed all together, which tells at once if all is well; a sum may be too large
    though no value is. Pictures of depth are looked at by themselves, without being copied.
    """
    numbers = {name: value for name, value in values.items() if name not in WHOLE}
    if not in_torch:
        few = [value for name, value in numbers.items() if name not in PIXELS]
        with np.errstate(over="ignore", invalid="ignore"):
            if few and math.isfinite(np.concatenate(few, axis=None).sum()):
                numbers = {name: numbers[name] for name in PIXELS if name in numbers}
    for name, value in numbers.items():
        if not bool(namespace(value).isfinite(value).all()):
            raise SampleError(
                sample_id,
                name,
                "must be finite, but holds NaN or infinite values; what is unknown has no field",
            )


def write_target(fields: Fields) -> dict[str, object]:
    """The target as a plain dict again, every field in the form in which it came.

    Fields that were not there before, such as H_out_in, get the form of K, else of the first
    floating-point field, else float32.
    """
    default = _default_form(fields.forms)
    return fields.others | {
        name: _in_form(value, fields.forms.get(name, default))
        for name, value in fields.values.items()
    }


def _default_form(forms: dict[str, FieldForm]) -> FieldForm:
    if "K" in forms:
        return forms["K"]
    floating = (form for form in forms.values() if form.floating)
    first = next(iter(forms.values()), form_of(True, torch.float32))
    float32 = torch.float32 if first.tensor else np.dtype(np.float32)
    return next(floating, form_of(first.tensor, float32))


def _in_form(value: Tensor | np.ndarray, form: FieldForm) -> Tensor | np.ndarray:
    """A value as a tensor or an array of the type that its field had."""
    if not isinstance(form.dtype, torch.dtype):
        return as_numpy(value).astype(form.dtype, copy=False)
    if isinstance(value, np.ndarray):
        # NumPy rounds the few numbers of a field in less than torch's time for a call
        # (benchmarks/augment.py, all targets).
        if form.dtype == torch.float32:
            return torch.from_numpy(value.astype(np.float32, order="C"))
        value = torch.from_numpy(np.ascontiguousarray(value))
    return value.to(form.dtype)

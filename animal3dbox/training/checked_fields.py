"""The fields of a target that checks look at, by their forms; derived from target_schema."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from animal3dbox.target_schema import FIELDS, names_of

Target = Mapping[str, Any]

CHECKED = tuple(
    field
    for field in FIELDS
    if field.label_name is not None or field.name in ("labels", "H_out_in", "keypoints", "masks")
)
"""The fields that checks look at: those of a label, and what a training loss reads beside them."""
FIXED = {field.name: field.entry_shape for field in CHECKED if field.entry_shape is not None}
"""Fields of a fixed form: the shape of an entry."""
FLOATS = {
    field.name: FIXED[field.name]
    for field in CHECKED
    if field.kind == "float" and field.per != "image" and field.name in FIXED
}
"""Floating-point fields with one entry an animal, likewise."""
FLAGS = {field.name: FIXED[field.name] for field in CHECKED if field.kind == "flag"}
WHOLE = {name: FIXED[name] for name in names_of(kind="whole") if name in FIXED}
PER_IMAGE = {field.name: FIXED[field.name] for field in CHECKED if field.per == "image"}
SHARED = {field.name: FIXED[field.name] for field in CHECKED if field.per == "either"}
"""Fields that may be one for all animals of an image."""
FREE = {field.name: len(field.shape.split()) for field in CHECKED if field.entry_shape is None}
"""Fields with one entry an animal whose size is the dataset's: how many dimensions an entry has."""
FLAGGED = {**dict.fromkeys(FLAGS, np.bool_), **dict.fromkeys(WHOLE, np.int64)}
"""The types in which flags and whole numbers are worked on."""
FLOATING = (torch.float32, torch.float64)
BITS = (torch.bool, torch.uint8)
FORMS: dict[str, tuple[tuple[int, ...], tuple[torch.dtype, ...]]] = {
    **{name: (shape, FLOATING) for name, shape in {**FLOATS, **PER_IMAGE}.items()},
    **{name: (shape, BITS) for name, shape in FLAGS.items()},
    **{name: (shape, (torch.int64,)) for name, shape in WHOLE.items()},
}
"""Of fields of a fixed form: the shape of an entry, and the types it may have."""
TYPES = {
    **{name: types for name, (_, types) in FORMS.items()},
    "masks": BITS,
    "keypoints": FLOATING,
}
"""The types that each field may have."""
KNOWN = frozenset(TYPES)


def meta_of(target: Target) -> Mapping[str, Any]:
    """A target's book-keeping; empty if it has none."""
    meta = target.get("meta")
    return meta if isinstance(meta, Mapping) else {}

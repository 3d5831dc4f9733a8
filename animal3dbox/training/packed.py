"""The targets of a batch as a few NumPy arrays, so that each check is a handful of calls for all
animals at once."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy, norm
from animal3dbox.geometry.cuboid import FACES
from animal3dbox.target_schema import FIELDS, names_of

Target = Mapping[str, Any]
Floats = NDArray[np.float64]

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
KNOWN = frozenset((*FORMS, *FREE))

DIAGONALS = np.array([[face[2], face[3], face[0], face[1]] for face in FACES.values()])
"""Of each face: where its two diagonals end, and where they start."""


@dataclass(frozen=True)
class Packed:
    """The fields of targets that have the same fields, of N animals in B targets.

    Attributes:
        targets: the targets themselves.
        index: which of the batch they are.
        block: (N, F), all floats beside each other.
        floats: field -> (N, ...) float64, views of block.
        others: field -> (N, ...) flags and whole numbers.
        per_image: field -> (B, ...) float64.
        keypoints: (N, J, 3) float64, filled up with absent ones where targets have fewer; None if
            there are none.
        owner: (N,) which of targets an animal belongs to.
        first: (B,) the first animal of each target.
        image_hw: (B, 2) height and width; None if it is not known.
        step: which turn it is of what is checked in turns.
    """

    targets: Sequence[Target]
    index: Sequence[int]
    block: Floats
    floats: dict[str, Floats]
    others: dict[str, NDArray[Any]]
    per_image: dict[str, Floats]
    keypoints: Floats | None
    owner: NDArray[np.intp]
    first: NDArray[np.intp]
    image_hw: NDArray[np.intp] | None
    step: int

    @property
    def count(self) -> int:
        """N."""
        return len(self.owner)

    @cached_property
    def K(self) -> Floats | None:
        """Intrinsics of each animal's image, (N, 3, 3)."""
        return np.asarray(self.per_image["K"][self.owner]) if "K" in self.per_image else None

    @cached_property
    def far_corners(self) -> Floats | None:
        """Where the frame of each image ends, (B, 2): x, y = W - 0.5, H - 0.5."""
        return None if self.image_hw is None else np.asarray(self.image_hw[:, ::-1] - 0.5)

    @cached_property
    def frame(self) -> Floats | None:
        """Where the frame of each animal's image ends, (N, 2): x, y = W - 0.5, H - 0.5."""
        return None if self.far_corners is None else np.asarray(self.far_corners[self.owner])

    @cached_property
    def has_box(self) -> bool:
        """Whether center, rotation and size are all there."""
        return "center" in self.floats and "rotation" in self.floats and "size" in self.floats

    @cached_property
    def all_in_front(self) -> NDArray[np.bool_] | None:
        """Whether every corner of a box is said to be in front of the camera, (N,)."""
        return (
            np.asarray(self.others["corner_in_front"].all(1))
            if "corner_in_front" in self.others
            else None
        )

    @cached_property
    def outline(self) -> tuple[Floats, Floats] | None:
        """The least and the greatest x, y of corners_2d, (N, 2) each."""
        px = self.floats.get("corners_2d")
        return None if px is None else (px.min(1), px.max(1))

    @cached_property
    def quad_areas(self) -> Floats | None:
        """Areas (N, 6) of the faces between corners_2d, px^2.

        Half the cross product of the diagonals; right for boxes in front.
        """
        if "corners_2d" not in self.floats:
            return None
        ends = self.floats["corners_2d"][:, DIAGONALS]  # (N, 6, 4, 2)
        across = ends[:, :, :2] - ends[:, :, 2:]
        return np.asarray(
            0.5
            * np.abs(
                across[:, :, 0, 0] * across[:, :, 1, 1] - across[:, :, 0, 1] * across[:, :, 1, 0]
            )
        )

    @cached_property
    def reach(self) -> Floats:
        """Largest coordinate of each box and its diagonal together, (N,).

        What float32 rounds by is a part of it.
        """
        if "corners_3d" in self.floats:
            return np.asarray(np.abs(self.floats["corners_3d"]).max((1, 2)))
        return np.asarray(np.abs(self.floats["center"]).max(1) + self.diagonal)

    @cached_property
    def diagonal(self) -> Floats:
        """Diagonal of each box, (N,)."""
        if "size" in self.floats:
            return norm(self.floats["size"])
        return norm(self.floats["corners_3d"][:, 6] - self.floats["corners_3d"][:, 0])


def meta_of(target: Target) -> Mapping[str, Any]:
    """A target's book-keeping; empty if it has none."""
    meta = target.get("meta")
    return meta if isinstance(meta, Mapping) else {}


def groups_of(targets: Sequence[Target]) -> list[list[int]]:
    """Targets by which known fields they have; almost always all of them together."""
    if all(target.keys() == targets[0].keys() for target in targets):
        return [list(range(len(targets)))] if targets else []
    groups: dict[frozenset[str], list[int]] = {}
    for number, target in enumerate(targets):
        groups.setdefault(frozenset(KNOWN.intersection(target)), []).append(number)
    return list(groups.values())


def pack(
    targets: Sequence[Target],
    index: Sequence[int],
    image_hw: Sequence[tuple[int, int]] | None,
    step: int,
) -> Packed | None:
    """The fields of targets with the same fields.

    None if their types, shapes or counts do not fit together.

    Args:
        targets: at least one.
        index: which of the batch they are.
        image_hw: height and width of each one's image; None if it is not known.
        step: which turn it is.

    """
    names = [name for name in targets[0] if name in KNOWN and name != "masks"]
    try:
        per_image = {
            name
            for name in names
            if name in PER_IMAGE or (name in SHARED and targets[0][name].ndim == len(SHARED[name]))
        }
        columns = {
            name: (
                joined_keypoints([target[name] for target in targets])
                if name == "keypoints"
                else joined([target[name] for target in targets], stacked=name in per_image)
            )
            for name in names
        }
        counting = next(
            (name for name in (*names, "masks") if name in targets[0] and name not in per_image),
            None,
        )
        counts = [0 if counting is None else target[counting].shape[0] for target in targets]
    except (RuntimeError, TypeError, ValueError, AttributeError, KeyError, IndexError):
        return None  # form_findings says which of them is wrong
    total = sum(counts)
    if not all(
        _fits(name, column, len(targets) if name in per_image else total)
        for name, column in columns.items()
    ):
        return None
    block, floats = _as_float64(
        {
            name: column
            for name, column in columns.items()
            if name in FLOATS and name not in per_image
        },
        total,
    )
    return Packed(
        targets,
        index,
        block,
        floats,
        {
            name: _values(columns[name]).astype(FLAGGED[name], copy=False)
            for name in FLAGGED
            if name in columns
        },
        {name: _values(columns[name].double()) for name in names if name in per_image},
        _values(columns["keypoints"].double()) if "keypoints" in columns else None,
        np.repeat(np.arange(len(targets)), counts),
        np.cumsum([0, *counts[:-1]]),
        None if image_hw is None else np.array(image_hw),
        step,
    )


def joined_keypoints(values: list[Any]) -> Tensor:
    """Keypoints (N, J, 3) of all targets, with absent ones up to the greatest J.

    Animals of one batch may have other vocabularies.
    """
    try:
        return joined(values, stacked=False)
    except RuntimeError:  # first: to ask each tensor for its shape costs more than to join them
        if not isinstance(values[0], Tensor):
            values = [torch.as_tensor(value) for value in values]
        most = max(value.shape[1] for value in values)
        return joined(
            [torch.nn.functional.pad(value, (0, 0, 0, most - value.shape[1])) for value in values],
            stacked=False,
        )


def joined(values: list[Any], *, stacked: bool) -> Tensor:
    """One tensor of a field's values in all targets: stacked, or along the animals."""
    if not isinstance(values[0], Tensor):
        values = [torch.as_tensor(value) for value in values]
    return torch.stack(values) if stacked else torch.cat(values)


def _values(column: Tensor) -> NDArray[Any]:
    """The column's numbers on the host; as_numpy without its detours for tensors that need none."""
    return (
        as_numpy(column) if column.requires_grad or column.device.type != "cpu" else column.numpy()
    )


def _fits(name: str, column: Tensor, entries: int) -> bool:
    """Whether a field has so many entries, and each the right shape and type."""
    size = column.shape
    if name in FREE:
        return (
            size[0] == entries
            and len(size) == 1 + FREE[name]
            and size[-1] == 3
            and column.dtype in FLOATING
        )
    shape, kinds = FORMS[name]
    return size == (entries, *shape) and column.dtype in kinds


def _as_float64(columns: dict[str, Tensor], count: int) -> tuple[Floats, dict[str, Floats]]:
    """Columns converted together: one float64 block, and views of it."""
    if not columns:
        return np.zeros((count, 0)), {}
    widths = [math.prod(FLOATS[name]) for name in columns]
    block = np.concatenate(
        [
            _values(column).reshape(count, width)
            for column, width in zip(columns.values(), widths, strict=True)
        ],
        1,
        dtype=np.float64,
    )
    found, end = {}, 0
    for name, width in zip(columns, widths, strict=True):
        found[name] = block[:, end : end + width].reshape(count, *FLOATS[name])
        end += width
    return block, found

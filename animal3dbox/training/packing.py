"""From target dicts to packed arrays."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.training.checked_fields import (
    FLAGGED,
    FLOATING,
    FLOATS,
    FORMS,
    FREE,
    KNOWN,
    PER_IMAGE,
    SHARED,
    Target,
)
from animal3dbox.training.packed import Floats, Packed


def groups_of(targets: Sequence[Target]) -> list[list[int]]:
    """The targets of a batch by the known fields that they have; almost always one group."""
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
    step: int | None,
) -> Packed | None:
    """The fields of targets that have the same fields, as a few arrays.

    Args:
        targets: at least one.
        index: which of the batch they are.
        image_hw: height and width of each one's image; None if it is not known.
        step: number of the training step, by which costly checks take turns; None: all.

    Returns:
        The arrays; None if types, shapes or counts do not fit together (form_findings says which).
    """
    names = [name for name in targets[0] if name in KNOWN and name != "masks"]
    try:
        per_image = {name for name in names if is_shared(name, targets[0][name])}
        columns = {name: _column(targets, name, stacked=name in per_image) for name in names}
        counts = _counts(targets, names, per_image)
    except (RuntimeError, TypeError, ValueError, AttributeError, KeyError, IndexError):
        return None
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
        targets=targets,
        index=index,
        block=block,
        floats=floats,
        others={
            name: _values(columns[name]).astype(dtype, copy=False)
            for name, dtype in FLAGGED.items()
            if name in columns
        },
        per_image={name: _values(columns[name].double()) for name in names if name in per_image},
        keypoints=_values(columns["keypoints"].double()) if "keypoints" in columns else None,
        owner=np.repeat(np.arange(len(targets)), counts),
        first=np.cumsum([0, *counts[:-1]]),
        image_hw=None if image_hw is None else np.array(image_hw),
        step=step,
    )


def is_shared(name: str, value: Any) -> bool:
    """Whether a field has one entry for all animals of its image."""
    return name in PER_IMAGE or (name in SHARED and value.ndim == len(SHARED[name]))


def _column(targets: Sequence[Target], name: str, *, stacked: bool) -> Tensor:
    """One field of all targets: stacked, or along the animals."""
    values = [target[name] for target in targets]
    return joined_keypoints(values) if name == "keypoints" else joined(values, stacked=stacked)


def _counts(targets: Sequence[Target], names: Sequence[str], per_image: set[str]) -> list[int]:
    """How many animals each target has, by the first field with an entry an animal."""
    counting = (name for name in (*names, "masks") if name in targets[0] and name not in per_image)
    name = next(counting, None)
    return [0 if name is None else target[name].shape[0] for target in targets]


def joined_keypoints(values: list[Any]) -> Tensor:
    """Keypoints (N, J, 3) of all targets, with absent ones up to the greatest J.

    Animals of one batch may have other vocabularies.
    """
    try:  # first: to ask each tensor for its shape costs more than to join them
        return joined(values, stacked=False)
    except RuntimeError:
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
    """The column's numbers on the host: as_numpy, without its detours where none is needed."""
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
    shape, types = FORMS[name]
    return size == (entries, *shape) and column.dtype in types


def _as_float64(columns: dict[str, Tensor], count: int) -> tuple[Floats, dict[str, Floats]]:
    """One float64 block of columns beside each other, and views of it by their names.

    One conversion of all columns costs less than one of each.
    """
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
    views, end = {}, 0
    for name, width in zip(columns, widths, strict=True):
        views[name] = block[:, end : end + width].reshape(count, *FLOATS[name])
        end += width
    return block, views

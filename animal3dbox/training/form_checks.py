"""Types, shapes and counts of one target's fields.

Slow and thorough, for the targets that could not be packed.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.target_schema import META_PER_ANIMAL
from animal3dbox.training.checked_fields import (
    FORMS,
    FREE,
    KNOWN,
    TYPES,
    Target,
    meta_of,
)
from animal3dbox.training.findings import Finding
from animal3dbox.training.packing import is_shared


def form_findings(targets: Sequence[Target], index: Sequence[int]) -> list[Finding]:
    """The faults that keep targets from being one array: in each by itself, else between them."""
    findings = [
        finding
        for target, number in zip(targets, index, strict=True)
        for finding in target_form(target, number)
    ]
    return findings or list(_unlike(targets, index))


def target_form(target: Target, number: int) -> Iterator[Finding]:
    """Types, shapes and counts of the fields of one target."""
    counts: dict[str, int] = {}
    for name, value in target.items():
        if name not in KNOWN:
            continue
        if not isinstance(value, Tensor | np.ndarray):
            problem = f"must be a tensor, got {type(value).__name__}"
            yield Finding("dtype", number, None, name, problem)
            continue
        shared = is_shared(name, value)
        wrong = _wrong_shape(name, value, shared=shared)
        if wrong is not None:
            yield Finding("shape", number, None, name, wrong)
        elif not shared:
            counts[name] = int(value.shape[0])
        types = TYPES[name]
        if value.dtype not in types and _type_name(value) not in map(_type_name, types):
            problem = f"must be {' or '.join(map(_type_name, types))}, got {_type_name(value)}"
            yield Finding("dtype", number, None, name, problem)
    yield from _meta_form(target, number, counts)
    if len(set(counts.values())) > 1:
        usual = max(counts.values(), key=list(counts.values()).count)
        name = next(name for name, count in counts.items() if count != usual)
        problem = f"has {counts[name]} entries, but other fields are of {usual} animals: {counts}"
        yield Finding("count", number, None, name, problem)


def _meta_form(target: Target, number: int, counts: dict[str, int]) -> Iterator[Finding]:
    """Types of a target's book-keeping; what has one entry an animal is added to the counts."""
    if not isinstance(target.get("meta", {}), Mapping):
        problem = f"must be a dict, got {type(target['meta']).__name__}"
        yield Finding("dtype", number, None, "meta", problem)
    meta = meta_of(target)
    for name in META_PER_ANIMAL:
        if name in meta:
            records, field = meta[name], f"meta: {name}"
            if isinstance(records, list | tuple | Tensor | np.ndarray):
                counts[field] = len(records)
            else:
                problem = f"must be a list, got {type(records).__name__}"
                yield Finding("dtype", number, None, field, problem)


def _wrong_shape(name: str, value: Tensor | np.ndarray, *, shared: bool) -> str | None:
    shape = tuple(value.shape)
    if name in FREE:
        last_is_wrong = name == "keypoints" and len(shape) == 3 and shape[2] != 3
        return (
            None
            if len(shape) == 1 + FREE[name] and not last_is_wrong
            else f"must have {1 + FREE[name]} dimensions (N, ...), got shape {shape}"
        )
    entry, _ = FORMS[name]
    if shared:
        return None if shape == entry else f"must have shape {entry}, got {shape}"
    return (
        None
        if len(shape) > 0 and shape[1:] == entry
        else f"must have shape (N, {', '.join(map(str, entry))}), got {shape}"
    )


def _type_name(value: Any) -> str:
    return str(getattr(value, "dtype", value)).removeprefix("torch.")


def _unlike(targets: Sequence[Target], index: Sequence[int]) -> Iterator[Finding]:
    """Fields that are right in each target and do not fit together: another device or library."""
    for name, value in targets[0].items():
        if name not in KNOWN or name == "masks":
            continue
        for target, number in zip(targets[1:], index[1:], strict=True):
            first, other = _likeness(value), _likeness(target[name])
            if first != other:
                yield Finding(
                    "batch",
                    number,
                    None,
                    name,
                    f"is {other}, but {first} in the first target of the batch: they cannot be one"
                    " batch",
                )


def _likeness(value: Any) -> str:
    where = f"a tensor on {value.device}" if isinstance(value, torch.Tensor) else "an array"
    return f"{where} of {value.ndim} dimensions"

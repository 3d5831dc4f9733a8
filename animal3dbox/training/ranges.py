"""Ranges of what animals and cameras of a data set measure, stated by the user or learned."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import ConfigError
from animal3dbox.training.box_places import box_place_measures, learned_reach
from animal3dbox.training.checked_fields import Target
from animal3dbox.training.findings import Finding
from animal3dbox.training.keypoint_fit import learned_places, place_measures
from animal3dbox.training.measures import (
    FIELD_OF,
    INTRINSICS,
    MISFITS,
    RATIOS,
    SIZES,
    measures_of,
)
from animal3dbox.training.packed import Floats, Packed
from animal3dbox.training.packing import groups_of, pack
from animal3dbox.training.places import animal_findings

Range = tuple[float, float]
Labels = NDArray[np.int64]
TAIL_PERCENT, TAIL_FACTOR = 2.0, 2.0
"""A learned range ends beyond its extreme value by TAIL_FACTOR times the way from there to the
value that TAIL_PERCENT of the targets pass: what is seldom may be seen a little farther out."""
TAIL_FACTOR_OF_MISFITS = 1.0
"""The same of MISFITS, whose tails are thin."""
FEWEST_IN_TAIL = 5
"""So many values are passed at least, whatever part of the targets they are."""
OF_SPAN_OF_CLASS = 0.5
"""The range of a class, of which fewer were seen, is widened by this part of it at least."""
LEAST_WIDENING, OF_INTRINSICS = 0.01, 3e-4
"""By how much a range is widened at least; of intrinsics, which are often one number exactly."""
FEWEST_LEARNED = 30
"""Animals below which no range of a measure is learned."""


@dataclass(frozen=True, kw_only=True)
class TargetRanges:
    """The ranges in which measures of right targets lie (docs/checks.md lists the measures).

    Attributes:
        stated: measure -> (least, greatest) that the user knows: outside is a fault.
        learned: likewise from targets that are known to be right: outside is a warning.
        places: (J, 3) learned places of keypoints in their cuboid; None if none were learned.
        reach: (F,) how far bodies reach in their cuboids (box_places); None if it was not learned.
        stated_by_class: class number -> stated ranges of the animals with this label.
        learned_by_class: likewise learned ones, of the measures of SIZES.

    Raises:
        ConfigError: a measure that is not known, or a range that ends before it begins.

    Example:
        >>> import torch
        >>> from animal3dbox.training import check_targets
        >>> dog = TargetRanges(stated={"length": (0.2, 2.0), "depth": (0.5, 60.0)})
        >>> target = {"size": torch.tensor([[30.0, 8.0, 16.0]])}
        >>> print(check_targets([target], ranges=dog, on_fault="count").counts)
        Counter({'range': 1})
        >>> dog = TargetRanges(stated_by_class={0: {"length": (0.2, 2.0)}})
        >>> target = {"size": torch.tensor([[3.0, 0.8, 1.6]] * 2), "labels": torch.tensor([0, 1])}
        >>> print(check_targets([target], ranges=dog, on_fault="count"))  # doctest: +ELLIPSIS
        1 target, 2 animals: 1 fault
          1 x range
          range: target 0 of the batch#0: size: length of class 0 is 3, outside the stated ...
    """

    stated: Mapping[str, Range] = field(default_factory=dict)
    learned: Mapping[str, Range] = field(default_factory=dict)
    places: Floats | None = None
    reach: Floats | None = None
    stated_by_class: Mapping[int, Mapping[str, Range]] = field(default_factory=dict)
    learned_by_class: Mapping[int, Mapping[str, Range]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for label in (*self.stated_by_class, *self.learned_by_class):
            if not isinstance(label, int) or isinstance(label, bool) or label < 0:
                raise ConfigError(
                    "ranges by class go by the class's number in a target's labels, 0 or more (its"
                    f" place in dataset.classes), got {label!r}"
                )
        by_class = (*self.stated_by_class.values(), *self.learned_by_class.values())
        for ranges in (self.learned, self.stated, *by_class):
            for name, (low, high) in ranges.items():
                _check_range(name, low, high)


def _check_range(name: str, low: float, high: float) -> None:
    """Raise a ConfigError for a measure that is not known, or a range that ends too early."""
    if name not in FIELD_OF:
        known = ", ".join(FIELD_OF)
        raise ConfigError(f"no measure of a target is named {name!r}: known are {known}")
    if not low <= high:
        raise ConfigError(f"the range of {name!r} must not end before it begins: {low, high}")


def learn_ranges(
    targets: Iterable[Target],
    images: Sequence[tuple[int, int]] | None = None,
    *,
    stated: Mapping[str, Range] | None = None,
    stated_by_class: Mapping[int, Mapping[str, Range]] | None = None,
) -> TargetRanges:
    """Learn the ranges of targets that are known to be right, as the training loop gets them.

    Learn from augmented targets if the checked ones are augmented: a pipeline that only flips keeps
    the camera's ranges narrow, one that crops does not.

    Args:
        targets: some hundred of them; measures of fewer than 30 animals are not learned, nor are
            the sizes of a class with fewer.
        images: (height, width) of each one's image; None if unknown.
        stated: ranges that are known besides.
        stated_by_class: likewise of the animals of single classes.

    Returns:
        The ranges, for check_targets.

    Raises:
        ConfigError: see TargetRanges.

    Example:
        >>> import torch
        >>> sizes = torch.linspace(0.9, 1.1, 40)[:, None] * torch.tensor([1.0, 0.3, 0.6])
        >>> ranges = learn_ranges([{"size": sizes}])
        >>> low, high = ranges.learned["length"]
        >>> round(low, 2), round(high, 2)
        (0.84, 1.16)
    """
    own = list(targets)
    batches = []
    for group in groups_of(own):
        sizes = None if images is None else [images[number] for number in group]
        packed = pack([own[number] for number in group], group, sizes, None)
        if packed is not None and packed.count:
            batches.append(packed)
    places, reach = learned_places(batches), learned_reach(batches)
    values: dict[str, list[Any]] = {}
    labels: list[Any] = []
    for packed in batches:
        labels.append(packed.others.get("labels", np.full(packed.count, -1)))
        for name, column in _all_measures(packed, places, reach).items():
            values.setdefault(name, []).append(column)
    columns = {name: np.concatenate(parts) for name, parts in values.items()}
    return TargetRanges(
        stated=dict(stated or {}),
        learned=_learned(columns),
        places=places,
        reach=reach,
        stated_by_class=dict(stated_by_class or {}),
        learned_by_class=_learned_by_class(columns, np.concatenate(labels)) if labels else {},
    )


def _learned(columns: Mapping[str, Floats]) -> dict[str, Range]:
    """The ranges of measures' values, of those that enough animals have."""
    ranges = {name: _learned_range(name, values) for name, values in columns.items()}
    return {name: ends for name, ends in ranges.items() if ends is not None}


def _learned_by_class(columns: Mapping[str, Floats], labels: Labels) -> dict[int, dict[str, Range]]:
    """The ranges of SIZES of the animals of each class number (N,), 0 or more."""
    learned = {}
    for label in np.unique(labels[labels >= 0]).tolist():
        own = labels == label
        sizes = {
            name: columns[name][own]
            for name in SIZES
            if name in columns and len(columns[name]) == len(labels)
        }
        if ranges := _learned(sizes):
            learned[int(label)] = {
                name: _with_wide_ends(ends, sizes[name]) for name, ends in ranges.items()
            }
    return learned


def _with_wide_ends(ends: Range, values: Floats) -> Range:
    """A range of SIZES that reaches beyond its values (N,) by a part of their span, as a factor."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    factor = (high / low) ** OF_SPAN_OF_CLASS
    return min(ends[0], low / factor), max(ends[1], high * factor)


def range_findings(packed: Packed, ranges: TargetRanges) -> list[Finding]:
    """Animals (N,) of which a measure lies outside its stated or learned range."""
    measures = _all_measures(packed, ranges.places, ranges.reach)
    labels = packed.others.get("labels")
    findings: list[Finding] = []
    for check, known, by_class in (
        ("range", ranges.stated, ranges.stated_by_class),
        ("unusual", ranges.learned, ranges.learned_by_class),
    ):
        for name, ends in known.items():
            if name in measures:
                findings += _outside(packed, check, name, values=measures[name], ends=ends)
        for label, of_class in by_class.items() if labels is not None else ():
            for name, ends in of_class.items():
                if name in measures:
                    own = np.where(labels == label, measures[name], np.nan)
                    findings += _outside(packed, check, name, values=own, ends=ends, label=label)
    return findings


def _outside(
    packed: Packed,
    check: str,
    name: str,
    *,
    values: Floats,
    ends: Range,
    label: int | None = None,
) -> Iterable[Finding]:
    """The animals of which a measure (N,) lies outside a range; what is unknown lies in it."""
    wrong = (values < ends[0]) | (values > ends[1])
    if not wrong.any():
        return ()
    source = "stated" if check == "range" else "learned"
    measure = name if label is None else f"{name} of class {label}"
    return animal_findings(
        packed,
        wrong,
        check=check,
        field=FIELD_OF[name],
        problem=lambda n: (
            f"{measure} is {values[n]:.4g}, outside the {source} range {ends[0]:.4g} to"
            f" {ends[1]:.4g}: is it in another unit or frame, or of another animal or camera?"
        ),
    )


def _all_measures(packed: Packed, places: Floats | None, reach: Floats | None) -> dict[str, Floats]:
    """The measures of targets, and those that need what was learned."""
    measures = measures_of(packed)
    if places is not None:
        measures |= place_measures(packed, places)
    return measures if reach is None else measures | box_place_measures(packed, reach)


def _learned_range(name: str, values: Floats) -> Range | None:
    """The range of values that were seen, widened by what their tails say; None of too few."""
    values = values[np.isfinite(values)]
    if name in RATIOS:
        values = np.log(values[values > 0])
    if len(values) < FEWEST_LEARNED:
        return None
    least = OF_INTRINSICS if name in INTRINSICS else LEAST_WIDENING
    tail = max(TAIL_PERCENT, 100 * FEWEST_IN_TAIL / len(values))
    low, before, behind, high = np.percentile(values, (0, tail, 100 - tail, 100)).tolist()
    factor = TAIL_FACTOR_OF_MISFITS if name in MISFITS else TAIL_FACTOR
    low -= least + factor * (before - low)
    high += least + factor * (high - behind)
    if name in MISFITS:
        return -np.inf, high
    return (float(np.exp(low)), float(np.exp(high))) if name in RATIOS else (low, high)

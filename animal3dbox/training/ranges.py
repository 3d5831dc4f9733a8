"""Ranges of what animals and cameras of a data set measure, stated by the user or learned."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.training.checked_fields import Target
from animal3dbox.training.findings import Finding
from animal3dbox.training.keypoint_fit import learned_places, place_measures
from animal3dbox.training.measures import FIELD_OF, RATIOS, measures_of
from animal3dbox.training.packed import Floats, Packed
from animal3dbox.training.packing import groups_of, pack
from animal3dbox.training.places import animal_findings

Range = tuple[float, float]
TAIL_PERCENT, TAIL_FACTOR = 2.0, 2.0
"""A learned range ends beyond its extreme value by TAIL_FACTOR times the way from there to the
value that TAIL_PERCENT of the targets pass: what is seldom may be seen a little farther out."""
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

    Raises:
        ConfigError: a measure that is not known, or a range that ends before it begins.

    Example:
        >>> import torch
        >>> from animal3dbox.training import check_targets
        >>> dog = TargetRanges(stated={"length": (0.2, 2.0), "depth": (0.5, 60.0)})
        >>> target = {"size": torch.tensor([[30.0, 8.0, 16.0]])}
        >>> print(check_targets([target], ranges=dog, on_fault="count").counts)
        Counter({'range': 1})
    """

    stated: Mapping[str, Range] = field(default_factory=dict)
    learned: Mapping[str, Range] = field(default_factory=dict)
    places: Floats | None = None

    def __post_init__(self) -> None:
        for name, (low, high) in {**self.learned, **self.stated}.items():
            if name not in FIELD_OF:
                known = ", ".join(FIELD_OF)
                raise ConfigError(f"no measure of a target is named {name!r}: known are {known}")
            if not low <= high:
                raise ConfigError(
                    f"the range of {name!r} must not end before it begins: {low, high}"
                )


def learn_ranges(
    targets: Iterable[Target],
    images: Sequence[tuple[int, int]] | None = None,
    *,
    stated: Mapping[str, Range] | None = None,
) -> TargetRanges:
    """Learn the ranges of targets that are known to be right, as the training loop gets them.

    Learn from augmented targets if the checked ones are augmented: a pipeline that only flips keeps
    the camera's ranges narrow, one that crops does not.

    Args:
        targets: some hundred of them; measures of fewer than 30 animals are not learned.
        images: (height, width) of each one's image; None if unknown.
        stated: ranges that are known besides.

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
        (0.88, 1.12)
    """
    own = list(targets)
    batches = []
    for group in groups_of(own):
        sizes = None if images is None else [images[number] for number in group]
        packed = pack([own[number] for number in group], group, sizes, None)
        if packed is not None and packed.count:
            batches.append(packed)
    places = learned_places(batches)
    values: dict[str, list[Any]] = {}
    for packed in batches:
        for name, column in _all_measures(packed, places).items():
            values.setdefault(name, []).append(column)
    learned = {name: _learned_range(name, np.concatenate(v)) for name, v in values.items()}
    return TargetRanges(
        stated=dict(stated or {}),
        learned={name: ends for name, ends in learned.items() if ends is not None},
        places=places,
    )


def range_findings(packed: Packed, ranges: TargetRanges) -> list[Finding]:
    """Animals (N,) of which a measure lies outside its stated or learned range."""
    findings: list[Finding] = []
    measures = _all_measures(packed, ranges.places)
    for check, ends in (("range", ranges.stated), ("unusual", ranges.learned)):
        for name, (low, high) in ends.items():
            if name in measures:
                findings += _outside(packed, check, name, values=measures[name], ends=(low, high))
    return findings


def _outside(
    packed: Packed, check: str, name: str, *, values: Floats, ends: Range
) -> Iterable[Finding]:
    """The animals of which a measure (N,) lies outside a range; what is unknown lies in it."""
    wrong = (values < ends[0]) | (values > ends[1])
    if not wrong.any():
        return ()
    source = "stated" if check == "range" else "learned"
    return animal_findings(
        packed,
        wrong,
        check=check,
        field=FIELD_OF[name],
        problem=lambda n: (
            f"{name} is {values[n]:.4g}, outside the {source} range {ends[0]:.4g} to {ends[1]:.4g}:"
            " is it in another unit or frame, or of another animal or camera?"
        ),
    )


def _all_measures(packed: Packed, places: Floats | None) -> dict[str, Floats]:
    measures = measures_of(packed)
    return measures if places is None else measures | place_measures(packed, places)


def _learned_range(name: str, values: Floats) -> Range | None:
    """The range of values that were seen, widened by what their tails say; None of too few."""
    values = values[np.isfinite(values)]
    if name in RATIOS:
        values = np.log(values[values > 0])
    if len(values) < FEWEST_LEARNED:
        return None
    least = OF_INTRINSICS if FIELD_OF[name] == "K" else LEAST_WIDENING
    low, before, behind, high = np.percentile(
        values, (0, TAIL_PERCENT, 100 - TAIL_PERCENT, 100)
    ).tolist()
    low -= least + TAIL_FACTOR * (before - low)
    high += least + TAIL_FACTOR * (high - behind)
    return (float(np.exp(low)), float(np.exp(high))) if name in RATIOS else (low, high)

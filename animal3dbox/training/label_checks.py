"""Checks of a target's animals as a list: their class numbers, and whether one is there twice."""

from collections.abc import Iterator

import numpy as np

from animal3dbox.training.findings import Finding
from animal3dbox.training.packed import Packed
from animal3dbox.training.places import animal_findings

SAME_PLACE = 1e-5
"""A part of a box's largest coordinate: two boxes that are nearer in all corners are one box."""

FROM_ONE = (
    "; these labels are {} to {}: if they count from 1, as where 0 is the background, subtract 1"
    " here or pass classes=N + 1"
)
"""What is added where no label is 0 and the greatest is the number of classes."""


def label_findings(packed: Packed, classes: int | None) -> Iterator[Finding]:
    """Class numbers below 0, or not below the number of classes if that is given."""
    labels = packed.others.get("labels")
    if labels is None:
        return
    wrong = labels < 0 if classes is None else (labels < 0) | (labels >= classes)
    if wrong.any():
        rule = "must count from 0" + ("" if classes is None else f" and be below {classes} classes")
        remedy = ""
        if classes is not None and labels.min() >= 1 and labels.max() == classes:
            remedy = FROM_ONE.format(labels.min(), classes)
        yield from animal_findings(
            packed,
            wrong,
            check="labels",
            field="labels",
            problem=lambda n: f"{rule}, got {labels[n]}{remedy}",
        )


def double_findings(packed: Packed) -> Iterator[Finding]:
    """Animals of one target whose cuboids are the same.

    Sorted by target and depth, an animal and its double are neighbours. In a training loop every
    fourth step looks for them.
    """
    if packed.count < 2 or packed.corners is None or (packed.step or 0) % 4:
        return
    center = packed.floats["center"] if packed.has_box else packed.corners.mean(1)
    order = np.lexsort((center[:, 2], packed.owner))
    before, after = order[:-1], order[1:]
    near = np.abs(center[after] - center[before]).max(1) <= SAME_PLACE * packed.reach[after]
    if not near.any():
        return
    off = np.abs(packed.corners[after] - packed.corners[before]).max((1, 2))
    near &= (off <= SAME_PLACE * packed.reach[after]) & (
        packed.owner[after] == packed.owner[before]
    )
    wrong = np.zeros(packed.count, dtype=np.bool_)
    wrong[np.maximum(before, after)[near]] = True
    field = "center" if packed.has_box else "corners_3d"
    problem = "is that of another animal of this target too: leave one of them out"
    yield from animal_findings(packed, wrong, check="twice", field=field, problem=lambda _: problem)

"""What a dataset's fits taught, in words: offsets by keypoint, classes by their presets."""

from collections.abc import Sequence

import numpy as np

from animal3dbox.datasets.labelling.learned_bodies import LearnedBodies
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.labels.calibration import ClassShape, KeypointPlaces
from animal3dbox.labels.fit.learning.rounds import LEAST_OF_CLASS, LEAST_TAUGHT
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

LARGEST = 5
"""So many offsets are told."""
WAYS = (("forward", "back"), ("to its left", "to its right"), ("up", "down"))
"""What a positive and a negative offset along each axis of the body is called."""
LEAST_TOLD = 0.005
"""Smaller offsets along an axis are not worth a word, in trunk lengths."""


def print_bodies(learned: LearnedBodies) -> None:
    """Say what was learned from which animals, and from which nothing."""
    for name, count in sorted(learned.used.items()):
        print(f"{name}: learned from {count} animals")
    for name, count in sorted(learned.few.items()):
        print(f"{name}: {count} animals teach nothing, {LEAST_TAUGHT} are needed")
    if learned.left_out:
        print(f"{learned.left_out} animals left out: too few keypoints, or a lens")
    for fault in learned.faults:
        print(f"  fault: {fault}")
    for places in learned.calibration.places:
        print(f"  places of {places.vocabulary}, % of the trunk's length: {largest(places)}")
    for shape in learned.calibration.shapes:
        print(f"  shape of {shape.category} ({shape.animals} animals): {_distance(shape)}")
    for vocabulary, category, count in learned.small_classes:
        who = category or "animals without a category"
        why = f"fewer than {LEAST_OF_CLASS}" if category else "which are no class"
        print(f"  no shape of {who} ({vocabulary}, {count} animals, {why})")


def largest(places: KeypointPlaces) -> str:
    """The largest offsets by the keypoints' names, of a left and a right one the first.

    Example:
        >>> from animal3dbox.labels.calibration import KeypointPlaces
        >>> offsets = ((0.03, 0.0, -0.02), (0.0, 0.0, 0.001))
        >>> largest(KeypointPlaces("own", "0", ("nose", "chin"), offsets, (0.01, 0.01), 40))
        'nose 3.0 forward, 2.0 down; chin in place'
    """
    sizes = np.linalg.norm(np.array(places.offsets), axis=1)
    order = sorted(range(len(sizes)), key=lambda j: (-sizes[j], j))
    told: list[str] = []
    seen: set[float] = set()
    for j in order:
        if len(told) < LARGEST and sizes[j] not in seen:
            told.append(f"{places.keypoints[j]} {in_words(places.offsets[j])}")
            seen.add(sizes[j])
    return "; ".join(told)


def in_words(offset: Sequence[float]) -> str:
    """An offset in trunk lengths as words.

    Example:
        >>> in_words((0.03, -0.01, 0.0))
        '3.0 forward, 1.0 to its right'
    """
    parts = [
        f"{100 * abs(value):.1f} {ways[value < 0]}"
        for value, ways in zip(offset, WAYS, strict=True)
        if abs(value) >= LEAST_TOLD
    ]
    return ", ".join(parts) or "in place"


def _distance(shape: ClassShape) -> str:
    """How far a class's mean is from a preset: root mean square over vertices, of the length."""
    model = load_quadruped()
    if len(shape.betas) != model.beta_count:
        return "of another model than the quadruped"
    vertices, own = as_numpy(model.v_template), as_numpy(model.shapedirs) @ np.array(shape.betas)

    def apart(preset: str) -> float:
        other = as_numpy(model.shapedirs) @ as_numpy(preset_betas(preset))
        off = own - other - (own - other).mean(0)
        return float(np.sqrt((off**2).sum(-1).mean()) / np.ptp(vertices[:, 0]))

    nearest = min(quadruped_names().presets, key=apart) if shape.preset is None else shape.preset
    word = "nearest preset" if shape.preset is None else "preset"
    return f"{100 * apart(nearest):.1f} % of the length from the {word} {nearest}"

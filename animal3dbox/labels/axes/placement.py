"""Learning a dataset's keypoint placement from its own animals (self-calibration).

On every animal the line between two groups of trunk landmarks makes an angle with the trunk. Where
annotators put their keypoints shifts it for the whole dataset alike; the animals' poses scatter it.
What the angle is, an animal's surface tells (sections across its trunk); without a surface, its
paws do: the ground under a standing animal runs along its trunk. The densest place of the angles is
the placement's pitch; animals that do not stand are few in any one place of them.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from animal3dbox.labels.axes.body_axes import named_landmarks, trunk_pitch
from animal3dbox.labels.axes.trunk_line import Array, line_axes
from animal3dbox.labels.calibration import MOST_PITCH_DEG, Calibration, PlacementPitch, densest
from animal3dbox.labels.observation import Observation

LEAST_ANIMALS = 10
"""Animals of one species from which it gets a pitch of its own, and of a dataset for "auto"."""
PAWS = tuple(f"{side}_{end}_paw" for end in ("front", "back") for side in ("left", "right"))


class LearnedAngle(NamedTuple):
    """One animal's part in a calibration.

    Attributes:
        vocabulary: its keypoints' name.
        species: its category; "" if it is not known.
        line: which line.
        pitch_deg: by how much the line rises above the trunk.
        by_surface: whether its surface told, or its paws.
    """

    vocabulary: str
    species: str
    line: str
    pitch_deg: float
    by_surface: bool


def learned_angle(observation: Observation) -> LearnedAngle | None:
    """What one animal tells of its dataset's placement.

    None of a body in correspondence with a template, whose vertices tell the axes, and of one whose
    landmarks, surface and paws do not suffice.
    """
    body = observation.body
    if body.template is not None and body.vertices is not None:
        return None
    landmarks = named_landmarks(observation)
    axes = line_axes(landmarks)
    if axes is None:
        return None
    pitch = trunk_pitch(landmarks, body.vertices, body.faces)
    by_surface = pitch is not None
    if pitch is None:
        pitch = _pitch_over_paws(landmarks, axes.R_box)
    if pitch is None or abs(pitch) > MOST_PITCH_DEG:
        return None
    words, species = observation.vocabulary.name, observation.species or ""
    return LearnedAngle(words, species, axes.line.name, pitch, by_surface)


def learned_placement(angles: Iterable[LearnedAngle]) -> Calibration:
    """The calibration of a dataset from its animals' angles.

    All animals of a vocabulary have a pitch together; a species with LEAST_ANIMALS of them or more
    has its own beside it. Angles of surfaces exclude those of paws, which bear the placement of the
    paws too.
    """
    groups: dict[tuple[str, str, str | None], list[LearnedAngle]] = defaultdict(list)
    for angle in angles:
        groups[angle.vocabulary, angle.line, None].append(angle)
        if angle.species:
            groups[angle.vocabulary, angle.line, angle.species].append(angle)
    placement = []
    for (vocabulary, line, species), members in groups.items():
        of_surfaces = [angle for angle in members if angle.by_surface]
        chosen = [angle.pitch_deg for angle in of_surfaces or members]
        if species is None or len(chosen) >= LEAST_ANIMALS:
            pitch = densest(chosen)
            placement.append(PlacementPitch(vocabulary, species, line, pitch, len(chosen)))
    placement.sort(key=lambda entry: (entry.vocabulary, entry.line, entry.species or ""))
    return Calibration(tuple(placement))


def _pitch_over_paws(landmarks: Mapping[str, Array], R_box: Array) -> float | None:
    """Degrees by which a line rises above the way from the back paws to the front ones."""
    if not all(name in landmarks for name in PAWS):
        return None
    front, back = (
        (landmarks[f"left_{end}_paw"] + landmarks[f"right_{end}_paw"]) / 2
        for end in ("front", "back")
    )
    way = (front - back) @ R_box
    return -float(np.rad2deg(np.arctan2(way[2], way[0])))

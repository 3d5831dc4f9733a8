"""Axes of a body from its trunk's landmarks: a line forward, and all pairs together to the left."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.orthogonal_frames import frame_from_directions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrunkLine:
    """A line along the trunk between two groups of landmarks.

    Attributes:
        rear: the places whose mean it starts at; a pair by its name without left or right.
        front: likewise those that it ends at.
    """

    rear: tuple[str, ...]
    front: tuple[str, ...]

    @property
    def name(self) -> str:
        """The line in words, as "tail_base to withers"; the key of its facts."""
        return f"{'+'.join(self.rear)} to {'+'.join(self.front)}"


LINES = (
    TrunkLine(("tail_base",), ("shoulder_blade",)),
    TrunkLine(("hip",), ("shoulder_point",)),
    TrunkLine(("tail_base",), ("shoulder_point",)),
    TrunkLine(("tail_base",), ("withers",)),
    TrunkLine(("tail_base", "back_knee"), ("neck", "front_elbow")),
    TrunkLine(("hip",), ("shoulder_blade",)),
    TrunkLine(("hip",), ("withers",)),
    TrunkLine(("back_knee",), ("front_elbow",)),
    TrunkLine(("tail_base",), ("neck",)),
    TrunkLine(("hip",), ("neck",)),
    TrunkLine(("tail_base",), ("front_elbow",)),
    TrunkLine(("back_knee",), ("withers",)),
)
"""The lines, of which the first that a body has the landmarks of is taken.

Those between places that legs, neck and head do not move come first; the mean of neck and elbows is
as high as the trunk, and its share in the motion of either is half.
"""

PAIR_WEIGHTS = {
    "shoulder_blade": 3.0,
    "shoulder_point": 3.0,
    "hip": 3.0,
    "front_elbow": 1.0,
    "back_knee": 1.0,
    "front_wrist": 0.5,
    "back_hock": 0.5,
}
"""How much the way from the right to the left place counts; the further down, the more legs swing.
"""

LEGS = ("front_elbow", "back_knee", "front_wrist", "back_hock", "front_paw", "back_paw")
"""Pairs that a trunk lies above, whatever the animal does with it: their middles tell its roll."""
LEGS_WEIGHT = 3.0
"""How much the trunk's height above the middle of its legs counts beside PAIR_WEIGHTS."""

FRONT_PLACES = ("shoulder_blade", "shoulder_point", "withers", "front_elbow", "neck")
REAR_PLACES = ("tail_base", "hip", "back_knee")


@dataclass(frozen=True)
class LineFacts:
    """What is known of a line from many bodies, learned by `benchmarks/learn_trunk.py`.

    Attributes:
        pitch_deg: by how much the line rises forward above the trunk's axis, a mean of species.
        sd_deg: its standard deviation from that among animals of all datasets.
        sd_within_deg: the same among animals of one dataset, whose keypoints have the same places.
    """

    pitch_deg: float
    sd_deg: float
    sd_within_deg: float


@dataclass(frozen=True)
class LineAxes:
    """Axes whose x runs along a line.

    Attributes:
        R_box: (3, 3) columns along the line, left, up.
        line: which line.
        pairs: the pairs that told left from right.
    """

    R_box: Array
    line: TrunkLine
    pairs: tuple[str, ...]


@cache
def learned_facts() -> Mapping[str, Any]:
    """The content of learned_trunk.json, which comes with the package."""
    file = resources.files("animal3dbox.labels").joinpath("assets", "learned_trunk.json")
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return content


def line_facts(line: TrunkLine) -> LineFacts:
    """What is known of a line of LINES."""
    return LineFacts(**learned_facts()["lines"][line.name])


def line_axes(landmarks: Mapping[str, Array]) -> LineAxes | None:
    """Axes along the best of LINES, and left by all pairs of the trunk and its legs together.

    The ways from right to left are added (PAIR_WEIGHTS); what is up, from the middle of the legs to
    the line, is turned to the left about the line and joins them. A pair that lies close to the
    middle tells little of left once a leg is raised, and the middle of both legs stays below.

    Args:
        landmarks: name -> (3,) in world.

    Returns:
        The axes; None if there is no line, no pair, or all are parallel.

    """
    candidates = (frame_along(landmarks, line) for line in LINES)
    return next((axes for axes in candidates if axes is not None), None)


def frame_along(landmarks: Mapping[str, Array], line: TrunkLine) -> LineAxes | None:
    """Axes along one line, see line_axes; None if its landmarks or all pairs are missing."""
    places = _with_named_shoulders(landmarks)
    pairs = tuple(name for name in PAIR_WEIGHTS if _is_pair(places, name))
    if not (pairs and all(_is_place(places, name) for name in (*line.rear, *line.front))):
        return None
    rear, front = _mean_place(places, line.rear), _mean_place(places, line.front)
    leftward = LEGS_WEIGHT * _left_of_legs(places, rear, front)
    for name in pairs:
        leftward = leftward + PAIR_WEIGHTS[name] * (
            places[f"left_{name}"] - places[f"right_{name}"]
        )
    R_box = frame_from_directions(front - rear, leftward)
    return None if R_box is None else LineAxes(R_box, line, pairs)


def _left_of_legs(places: Mapping[str, Array], rear: Array, front: Array) -> Array:
    """The way (3,) up from the legs to a line, turned to the left; zero without legs."""
    legs = [name for name in LEGS if _is_pair(places, name)]
    if not legs:
        return np.zeros(3)
    up = (rear + front) / 2 - _mean_place(places, legs)
    way = front - rear
    left: Array = np.cross(up, way / max(float(np.linalg.norm(way)), 1e-300))
    return left


def pitched(R_box: Array, pitch_deg: float) -> Array:
    """Axes (3, 3) whose x is turned from a frame's x towards its z by an angle."""
    angle = np.deg2rad(pitch_deg)
    x = np.cos(angle) * R_box[:, 0] + np.sin(angle) * R_box[:, 2]
    z = np.cos(angle) * R_box[:, 2] - np.sin(angle) * R_box[:, 0]
    return np.stack((x, R_box[:, 1], z), axis=1)


def pitch_between(R_box: Array, other: Array) -> float:
    """Degrees by which another frame's x rises above a frame's x, in the latter's plane of x, z."""
    x = other[:, 0] @ R_box
    return float(np.rad2deg(np.arctan2(x[2], x[0])))


def trunk_ends(landmarks: Mapping[str, Array]) -> tuple[Array, Array] | None:
    """Roughly the rear and the front end of a trunk, (3,) each: means of what is known of them."""
    places = _with_named_shoulders(landmarks)
    rear = next((name for name in REAR_PLACES if _is_place(places, name)), None)
    front = [name for name in FRONT_PLACES if _is_place(places, name)]
    if rear is None or not front:
        return None
    return _mean_place(places, [rear]), _mean_place(places, front)


def _with_named_shoulders(landmarks: Mapping[str, Array]) -> dict[str, Array]:
    """Landmarks in which shoulders of the old name are points (Vocabulary.notes)."""
    places = dict(landmarks)
    for side in ("left", "right"):
        if f"{side}_shoulder" in places and f"{side}_shoulder_blade" not in places:
            places.setdefault(f"{side}_shoulder_point", places[f"{side}_shoulder"])
    return places


def _is_pair(places: Mapping[str, Array], name: str) -> bool:
    return f"left_{name}" in places and f"right_{name}" in places


def _is_place(places: Mapping[str, Array], name: str) -> bool:
    return name in places or _is_pair(places, name)


def _mean_place(places: Mapping[str, Array], names: Sequence[str]) -> Array:
    """The mean (3,) of places in the middle and of middles of pairs."""
    middles = [
        places[name] if name in places else (places[f"left_{name}"] + places[f"right_{name}"]) / 2
        for name in names
    ]
    mean: Array = np.mean(middles, axis=0)
    return mean

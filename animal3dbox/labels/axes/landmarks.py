"""The paper's axes: from pairs of landmarks, falling back on others where the first are hidden."""

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.orthogonal_frames import frame_from_directions
from animal3dbox.smal.keypoints.vocabulary import OLD_SHOULDERS

Array = NDArray[np.float64]
V = TypeVar("V")

FORWARD_RULES = (
    (("tail_base",), ("neck",)),
    (("tail_base",), ("withers",)),
    (("tail_base",), ("left_shoulder", "right_shoulder")),
    (("tail_base",), ("left_front_elbow", "right_front_elbow")),
    (("left_back_knee", "right_back_knee"), ("left_shoulder", "right_shoulder")),
    (("left_back_knee", "right_back_knee"), ("left_front_elbow", "right_front_elbow")),
    (("tail_base",), ("nose",)),
    (("left_back_paw", "right_back_paw"), ("left_front_paw", "right_front_paw")),
    (("left_ear", "right_ear"), ("nose",)),
)
"""x: from the mean of the first landmarks to that of the second.

The first rule whose landmarks are all there holds.
"""

LEFTWARD_RULES = (
    ("right_shoulder", "left_shoulder"),
    ("right_hip", "left_hip"),
    ("right_front_elbow", "left_front_elbow"),
    ("right_back_knee", "left_back_knee"),
    ("right_ear", "left_ear"),
    ("right_eye", "left_eye"),
    ("right_front_paw", "left_front_paw"),
    ("right_back_paw", "left_back_paw"),
)
"""y: from a landmark on the right to its twin on the left."""


def landmark_axes(
    landmarks: Mapping[str, Array], visible: Mapping[str, bool]
) -> tuple[Array, str] | None:
    """Axes from landmark pairs, visible ones first (section 2.1.1, axes and fallback).

    x runs from the rear to the front, y from the right to the left made square to x, and z = x × y:
    what the paper calls Fleming's left-hand rule, read so that the axes are a rotation.

    Args:
        landmarks: name -> (3,) in world.
        visible: name -> whether the landmark is seen in the image. Hidden ones serve when no
            visible rule is left.

    Returns:
        R_world_box (3, 3), columns forward, left, up, and the rule that gave it, for the record;
        None if no rule applies or x and y are parallel.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import landmark_axes
        >>> places = {
        ...     "left_shoulder": [1.0, 1, 0], "right_shoulder": [1.0, -1, 0],
        ...     "tail_base": [-1.0, 0, 0]}
        >>> landmarks = {name: np.array(place) for name, place in places.items()}
        >>> axes, rule = landmark_axes(landmarks, dict.fromkeys(landmarks, True))
        >>> axes.round(6)
        array([[1., 0., 0.],
               [0., 1., 0.],
               [0., 0., 1.]])
    """
    landmarks, visible = _with_plain_shoulders(landmarks), _with_plain_shoulders(visible)
    visible_ones = {name: place for name, place in landmarks.items() if visible.get(name, False)}
    for pool, note in ((visible_ones, "visible"), (dict(landmarks), "hidden")):
        forward = next(
            (rule for rule in FORWARD_RULES if all(n in pool for n in (*rule[0], *rule[1]))), None
        )
        leftward = next((rule for rule in LEFTWARD_RULES if all(n in pool for n in rule)), None)
        if forward is None or leftward is None:
            continue
        behind, ahead = (np.stack([pool[n] for n in names]).mean(0) for names in forward)
        R_box = frame_from_directions(ahead - behind, pool[leftward[1]] - pool[leftward[0]])
        if R_box is not None:
            x_rule = "+".join(forward[0]) + " to " + "+".join(forward[1])
            return R_box, f"landmarks ({note}): x {x_rule}; y {leftward[0]} to {leftward[1]}"
    return None


def _with_plain_shoulders(values: Mapping[str, V]) -> dict[str, V]:
    """Values by landmark, with whichever shoulders there are under the rules' names.

    The paper does not say which place of a shoulder it means.
    """
    plain = dict(values)
    for kind in ("blade", "point"):
        for name in OLD_SHOULDERS:
            if f"{name}_{kind}" in values:
                plain.setdefault(name, values[f"{name}_{kind}"])
    return plain

"""The paper's axes.

From pairs of landmarks, falling back on others where the first are not visible.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

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


@dataclass(frozen=True)
class BodyAxes:
    """The axes of a body and where they come from.

    Attributes:
        R_box: (3, 3) R_world_box, columns forward, left, up; det +1.
        rule: the rule that gave them, for the record.
    """

    R_box: Tensor
    rule: str


def landmark_axes(landmarks: Mapping[str, Tensor], visible: Mapping[str, bool]) -> BodyAxes | None:
    """Axes from landmark pairs, visible ones first (section 2.1.1, axes and fallback).

    x runs from the rear to the front, y from the right to the left made square to x, and z = x × y:
    what the paper calls Fleming's left-hand rule, read so that the axes are a rotation.

    Args:
        landmarks: name -> (3,) in world.
        visible: name -> whether the landmark is seen in the image. Hidden ones serve when no
            visible rule is left.

    Returns:
        The axes, or None if no rule applies or x and y are parallel.

    """
    seen = {name: point for name, point in landmarks.items() if visible.get(name, False)}
    for pool, note in ((seen, "visible"), (dict(landmarks), "hidden")):
        forward = next(
            (rule for rule in FORWARD_RULES if all(n in pool for n in (*rule[0], *rule[1]))), None
        )
        leftward = next((rule for rule in LEFTWARD_RULES if all(n in pool for n in rule)), None)
        if forward is None or leftward is None:
            continue
        behind, ahead = (torch.stack([pool[n] for n in names]).mean(0) for names in forward)
        R_box = axes_from_directions(ahead - behind, pool[leftward[1]] - pool[leftward[0]])
        if R_box is not None:
            spoken = "+".join(forward[0]) + " to " + "+".join(forward[1])
            return BodyAxes(
                R_box, f"landmarks ({note}): x {spoken}; y {leftward[0]} to {leftward[1]}"
            )
    return None


def axes_from_directions(forward: Tensor, leftward: Tensor) -> Tensor | None:
    """The frame (3, 3) whose x is forward and whose y is leftward made square to it.

    None if they are parallel.
    """
    x = torch.nn.functional.normalize(forward, dim=-1)
    y = leftward - (leftward @ x) * x
    if float(torch.linalg.vector_norm(y)) <= 1e-6 * float(
        torch.linalg.vector_norm(leftward)
    ) or not bool(forward.any()):
        return None
    y = torch.nn.functional.normalize(y, dim=-1)
    return torch.stack((x, y, torch.linalg.cross(x, y)), dim=-1)

"""The flank that a picture shows, left, right or undecided, with a probability of its own.

Seen from ahead or behind an animal shows neither flank, and near there an error of the pose by some
degrees names the wrong one. With theta the angle by which the camera stands to the left of the
animal's plane of symmetry, d what it sees more of the left surface than of the right (parts of the
visible surface), and sigma the deviation of the pose's rotation, the probability of left is

    P(left) = slip / 2 + (1 - slip) Phi((a theta + b d) / sqrt(sigma^2 + sigma_axes^2))

slip is how often a pose is wrong from the ground up. A camera that is known exactly leaves only the
axes to be wrong: P(left) = Phi(theta / sigma_axes). The numbers lie in assets/flank.json, which
``python benchmarks/flank.py fit`` writes.
"""

import json
import math
from dataclasses import dataclass, fields
from functools import cache
from importlib import resources
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from animal3dbox.geometry.cuboid import FACE_NAMES

Array = NDArray[np.float64]

Flank = Literal["undecided", "left", "right"]
FLANKS: tuple[Flank, ...] = get_args(Flank)
"""The flanks by their numbers in a target: 0, 1, 2."""
UNKNOWN_SD_RAD = math.radians(9.0)
"""The deviation of a pose by a method that tells none: the median of those that are told of rigid
bodies in the world that the numbers were fitted on."""
AXES_SD_RAD = math.radians(3.0)
"""How far a body's axes may be off, about its up, if the camera is known; a body's torso vertices
give them within 1.3 degrees (median) and 4.3 (95 %) of the trunk's."""
_LEFT, _RIGHT = FACE_NAMES.index("left"), FACE_NAMES.index("right")


@dataclass(frozen=True, kw_only=True)
class FlankModel:
    """The numbers of the formula above, for poses that were estimated.

    Attributes:
        lateral: a.
        surface: b, radians.
        lateral_alone: a where the visible surface was not measured; d is then 0.
        slip: part of the poses that tell nothing.
        decided_from: least probability of a flank that is named.
    """

    lateral: float
    surface: float
    lateral_alone: float
    slip: float
    decided_from: float

    def left(self, theta: Array, shares: Array, sigma: Array) -> Array:
        """The probability (B,) that the left flank is seen.

        Args:
            theta: (B,) radians, see lateral_angle.
            shares: (B, 6) of the visible surface; negative where they were not measured.
            sigma: (B,) radians, deviation of the pose's rotation.

        """
        measured = shares[:, 0] >= 0
        more_left = np.where(measured, shares[:, _LEFT] - shares[:, _RIGHT], 0.0)
        slope = np.where(measured, self.lateral, self.lateral_alone)
        evidence = slope * theta + self.surface * more_left
        spread = np.hypot(sigma, AXES_SD_RAD)
        left: Array = self.slip / 2 + (1 - self.slip) * ndtr(evidence / spread)
        return left


@cache
def flank_model() -> FlankModel:
    """The shipped numbers, of assets/flank.json."""
    file = resources.files("animal3dbox.labels").joinpath("assets", "flank.json")
    numbers = json.loads(file.read_bytes())["model"]
    return FlankModel(**{field.name: float(numbers[field.name]) for field in fields(FlankModel)})


def lateral_angle(center: Array, rotation: Array) -> Array:
    """How far cameras stand to the left of the plane of symmetry, (B,) radians, -pi/2 to pi/2.

    Args:
        center: (B, 3) of the boxes, in the camera frame.
        rotation: (B, 3, 3) R_cam_box.

    Example:
        >>> ahead = np.array([[0.0, 0, 4]])
        >>> lateral_angle(ahead, np.array([[[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]])).round(3) + 0.0
        array([0.])
    """
    left_cam = rotation[:, :, 1]
    distance = np.linalg.norm(center, axis=1)
    # The camera's centre is the origin: it lies at -center from the box's
    sine = -(left_cam * center).sum(1) / np.maximum(distance, np.finfo(np.float64).tiny)
    angle: Array = np.arcsin(np.clip(sine, -1.0, 1.0))
    return angle


def decided_flanks(
    theta: Array, shares: Array, sigma: Array, *, known_camera: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], Array]:
    """The flanks (B,) as numbers of FLANKS, and the probability (B,) of each.

    Of an undecided one it is that of the likelier flank.

    Args:
        theta: (B,) radians, see lateral_angle.
        shares: (B, 6) of the visible surface; negative where they were not measured.
        sigma: (B,) radians, deviation of the pose's rotation; of no matter where it is known.
        known_camera: (B,) whether the camera is known exactly.

    Example:
        >>> nothing = np.full((2, 6), -1.0), np.zeros(2)
        >>> flank, confidence = decided_flanks(
        ...     np.radians([40.0, -1]), *nothing, known_camera=np.array([True, True]))
        >>> [FLANKS[number] for number in flank], confidence.round(2).tolist()
        (['left', 'undecided'], [1.0, 0.63])
    """
    model = flank_model()
    left = np.where(known_camera, ndtr(theta / AXES_SD_RAD), model.left(theta, shares, sigma))
    confidence = np.maximum(left, 1 - left)
    named = np.where(left > 0.5, FLANKS.index("left"), FLANKS.index("right"))
    return np.where(confidence >= model.decided_from, named, 0), confidence

"""The choice between poses that explain the keypoints about equally well.

Two things that the joint cost does not see: a camera is seldom under the ground and seldom
rolled, and annotators mark what they see, not what the body hides.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.problem import PoseProblem
from animal3dbox.labels.pose.self_occlusion import hidden_landmarks

Array = NDArray[np.float64]
BELOW_DEG, BELOW_SIGMA_DEG = 0.0, 25.0
"""Elevation of the camera over the animal's own plane from which on a pose costs more, and by
which standard deviation."""
ROLL_SIGMA_DEG = 50.0
GRAVITY_SIGMA_DEG = 40.0
"""Standard deviation of an animal's up from the true one, where gravity is given."""
MOST_UP = 6.0
"""Most that a pose can cost more for its up, in halves of a squared standard deviation: what
keypoints tell for certain stays."""
EXCHANGE_COST, MOST_MISFIT = 3.5, 3.0
HIDDEN_COST = 2.0
"""Of a keypoint that is marked although the body hides it, in halves of a squared standard
deviation, by the root of the body's misfit: a body in another pose hides other places."""


def up_cost(R_cam_box: Array, down_cam: Array | None, center_cam: Array) -> float:
    """What a pose costs for where it puts the ground.

    Args:
        R_cam_box: (3, 3) of the animal's axes.
        down_cam: (3,) gravity in the camera frame; None: not known.
        center_cam: (3,) a point of the animal, by which it is seen from above or below.

    """
    up = R_cam_box[:, 2]
    if down_cam is not None:
        sine = float(np.linalg.norm(np.cross(up, -down_cam)))
        angle = math.degrees(math.atan2(sine, -float(up @ down_cam)))
        return min((angle / GRAVITY_SIGMA_DEG) ** 2 / 2, MOST_UP)
    elevation, roll = elevation_and_roll(R_cam_box, center_cam)
    shown = math.hypot(up[0], up[1])
    below = (BELOW_DEG, BELOW_SIGMA_DEG)
    return float(camera_costs(elevation, roll, shown=shown, below=below))


def camera_costs(
    elevation_deg: Array | float,
    roll_deg: Array | float,
    *,
    shown: Array | float,
    below: tuple[float, float],
) -> Array:
    """What cameras cost for standing below and for their roll, in halves of a squared deviation.

    Args:
        elevation_deg: (B,) of the camera over the animal's plane or the ground.
        roll_deg: (B,) of the camera against that plane's normal.
        shown: (B,) the part of the normal that the picture shows, by which the roll counts.
        below: the elevation from which on a camera costs more, and by which standard deviation.

    """
    under = np.minimum(elevation_deg - below[0], 0.0) / below[1]
    rolled = shown * roll_deg / ROLL_SIGMA_DEG
    return np.minimum((under**2 + rolled**2) / 2, MOST_UP)


def elevation_and_roll(R_cam_box: Array, center_cam: Array) -> tuple[float, float]:
    """The camera's height over an animal's own plane, and its roll against it, in degrees.

    Args:
        R_cam_box: (3, 3) of the animal's axes.
        center_cam: (3,) a point of the animal.

    Returns:
        elevation: -90 to 90.
        roll: -180 to 180, of the animal's up in the picture from the picture's.

    """
    up = R_cam_box[:, 2]
    sine = -float(up @ center_cam) / max(float(np.linalg.norm(center_cam)), 1e-12)
    elevation = math.degrees(math.asin(min(max(sine, -1.0), 1.0)))
    return elevation, math.degrees(math.atan2(float(up[0]), -float(up[1])))


def exchange_cost(misfit_of_body: float) -> float:
    """What a labeling other than the given one costs, in halves of a squared standard deviation.

    It grows with the body's misfit, see body_misfit: a body that fits badly leaves room for chance.
    """
    return EXCHANGE_COST * min(misfit_of_body, MOST_MISFIT)


@dataclass(frozen=True)
class Extras:
    """What a pose costs beside the joint cost.

    Attributes:
        up: see up_cost.
        hidden: part of the marked keypoints that the body hides.
        n_hidden: how many those are.
    """

    up: float
    hidden: float
    n_hidden: int

    def total(self, misfit_of_body: float) -> float:
        """The sum, in halves of a squared standard deviation; see body_misfit."""
        return self.up + HIDDEN_COST / math.sqrt(misfit_of_body) * self.n_hidden


def extra_costs(problem: PoseProblem, R: Array, t: Array, config: LabelConfig) -> Extras:
    """What a pose costs beside the joint cost, about the landmarks' mean."""
    up = 0.0
    if config.upright == "prior":
        up = up_cost(R @ problem.R_box, problem.down_cam, t)
    n_hidden, count = 0, len(problem.points_world)
    if problem.vertices_world is not None:
        hidden = hidden_landmarks(problem.points_world, problem.vertices_world, R=R, t=t)
        n_hidden = int(hidden.sum())
    return Extras(up, n_hidden / count, n_hidden)

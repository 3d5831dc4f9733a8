"""The choice between hypotheses that explain an animal about equally well.

What the cost of the descent does not see: annotators mark what they see, cameras are seldom under
the ground and seldom rolled, and left and right are seldom exchanged.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.descent import labeled, projected
from animal3dbox.labels.fit.fit_body import FitBody
from animal3dbox.labels.fit.kinematics import JointFrames, landmark_parts
from animal3dbox.labels.fit.pose_prior import ground_normals
from animal3dbox.labels.fit.problem import FitProblem, FitState

Array = NDArray[np.float64]
EXCHANGED_COST = 6.0
"""What exchanged sides cost, in halves of a squared standard deviation."""
TURNED_AWAY, FULLY_AWAY = -0.15, -0.45
"""Cosines of a landmark's surface and the line of sight at which it begins to be hidden, and is."""
MARKED_AWAY, UNMARKED_FACING = 1.0, 0.5
"""What a marked keypoint costs that is turned away, and an unmarked one that faces the camera."""
UNDER_DEG, UNDER_SD_DEG = -10.0, 10.0
"""The camera's elevation over the ground below which a state costs more, and by which deviation."""
ROLLED_SD_DEG = 50.0
MOST_FOR_UP = 6.0


@dataclass(frozen=True)
class ChoiceCosts:
    """What states cost beside the descent's cost, (B,) each, in halves of a squared deviation.

    Attributes:
        exchange: of exchanged sides.
        facing: of marked keypoints turned away, and of unmarked ones that face the camera.
        up: of a camera under the ground, or rolled.
        away: part of the marked keypoints that are turned away.
    """

    exchange: Array
    facing: Array
    up: Array
    away: Array

    @property
    def total(self) -> Array:
        """Their sum, (B,)."""
        return self.exchange + self.facing + self.up


def choice_costs(body: FitBody, problem: FitProblem, state: FitState) -> ChoiceCosts:
    """What states cost beside the descent's cost."""
    _, frames = body.frames(state.pose, state.shape)
    facing, away = _facing_costs(body, problem, state, frames)
    return ChoiceCosts(
        exchange=EXCHANGED_COST * state.exchanged.astype(np.float64),
        facing=facing,
        up=_up_costs(body, state),
        away=away,
    )


def _facing_costs(
    body: FitBody, problem: FitProblem, state: FitState, frames: JointFrames
) -> tuple[Array, Array]:
    """The cost of what faces the camera, and the part of marked keypoints that are turned away."""
    points = landmark_parts(body.tables, frames, state.shape).sum(1)
    normals = state.R @ (frames.rotations @ body.tables.normals).sum(1)
    cam = state.R @ points + state.t[..., None]
    sight = cam / np.sqrt((cam * cam).sum(1, keepdims=True))
    cosine = -(normals * sight).sum(1)
    _, weights = labeled(body, problem, state)
    marked = weights > 0
    away = np.clip((TURNED_AWAY - cosine) / (TURNED_AWAY - FULLY_AWAY), 0.0, 1.0) * marked
    slopes = np.zeros((len(state), 0, 3, points.shape[-1]))
    px, _, _ = projected(state, problem.linear[state.animal], points, slopes)
    frame = problem.frame[state.animal]
    in_frame = ((px > frame[:, :2, None]) & (px < frame[:, 2:, None])).all(1)
    unmarked = ~marked & in_frame & body.tables.known
    open_to = np.clip((cosine + TURNED_AWAY) / (TURNED_AWAY - FULLY_AWAY), 0.0, 1.0) * unmarked
    cost = MARKED_AWAY * away.sum(1) + UNMARKED_FACING * open_to.sum(1)
    return cost, away.sum(1) / np.maximum(marked.sum(1), 1)


def _up_costs(body: FitBody, state: FitState) -> Array:
    """What states cost for where they put the ground, (B,)."""
    up = (state.R @ ground_normals(body.pose_prior, state.pose)[..., None])[..., 0]
    sight = state.t / np.sqrt((state.t * state.t).sum(-1, keepdims=True))
    sine = -(up * sight).sum(-1)
    elevation = np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0)))
    roll = np.degrees(np.arctan2(up[:, 0], -up[:, 1]))
    below = np.minimum(elevation - UNDER_DEG, 0.0) / UNDER_SD_DEG
    # The roll counts as far as the ground's normal is seen at all
    rolled = np.hypot(up[:, 0], up[:, 1]) * roll / ROLLED_SD_DEG
    cost: Array = np.minimum((below**2 + rolled**2) / 2, MOST_FOR_UP)
    return cost

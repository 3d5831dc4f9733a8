"""The choice between hypotheses that explain an animal about equally well.

What the cost of the descent does not see: annotators mark what they see, cameras are seldom under
the ground and seldom rolled, and left and right are seldom exchanged.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.descent import labeled
from animal3dbox.labels.fit.fit_body import FitBody
from animal3dbox.labels.fit.kinematics import JointFrames, landmark_parts
from animal3dbox.labels.fit.pose_prior import ground_normals
from animal3dbox.labels.fit.problem import FitProblem, FitState
from animal3dbox.labels.pose.choice import camera_costs

Array = NDArray[np.float64]
EXCHANGED_COST = 6.0
"""What exchanged sides cost, in halves of a squared standard deviation."""
TURNED_AWAY, FULLY_AWAY = -0.15, -0.45
"""Cosines of a landmark's surface and the line of sight at which it begins to be hidden, and is."""
AWAY_COST = 1.5
"""What a marked keypoint costs whose surface is turned away."""
FARTHER, FARTHER_COST = 0.5, 2.0
"""What the one that is marked of a left and a right keypoint costs if it is the farther one, by
more than FARTHER of their distance."""
UNDER_DEG, UNDER_SD_DEG = -10.0, 10.0
"""The camera's elevation over the ground below which a state costs more, and by which deviation."""


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
        """What each state costs in all beside the descent's cost, (B,)."""
        return self.exchange + self.facing + self.up


def choice_costs(body: FitBody, problem: FitProblem, state: FitState) -> ChoiceCosts:
    """What states cost beside the descent's cost."""
    _, frames = body.frames(state.pose, state.shape)
    facing, away = _facing_costs(body, problem, state, frames)
    return ChoiceCosts(
        exchange=EXCHANGED_COST * state.exchanged.astype(np.float64),
        facing=facing,
        up=problem.up_weight[state.animal] * _up_costs(body, state),
        away=away,
    )


def _facing_costs(
    body: FitBody, problem: FitProblem, state: FitState, frames: JointFrames
) -> tuple[Array, Array]:
    """The cost of hidden keypoints (B,), and the part of marked ones that are turned away (B,).

    Legs are thin, and annotators mark the far ones too, so a surface that is turned away tells only
    of the trunk and the head. But of a left and a right keypoint one of which alone is marked, that
    is the nearer one.
    """
    points = landmark_parts(body.tables, frames, state.shape).sum(1)
    normals = state.R @ (frames.rotations @ body.tables.normals).sum(1)
    cam = state.R @ points + state.t[..., None]
    sight = cam / np.sqrt((cam * cam).sum(1, keepdims=True))
    cosine = -(normals * sight).sum(1)
    _, weights = labeled(body, problem, state)
    marked = weights > 0
    away = np.clip((TURNED_AWAY - cosine) / (TURNED_AWAY - FULLY_AWAY), 0.0, 1.0) * marked
    away *= body.tables.on_trunk
    twin = np.array(body.vocabulary.flip)
    behind = cam[:, 2] - cam[:, 2][:, twin]
    apart = points - points[:, :, twin]
    width = np.sqrt((apart * apart).sum(1))
    alone = marked & ~marked[:, twin] & body.tables.known[twin]
    farther = np.clip(behind / np.maximum(FARTHER * width, 1e-9), 0.0, 1.0) * alone
    cost = AWAY_COST * away.sum(1) + FARTHER_COST * farther.sum(1)
    return cost, away.sum(1) / np.maximum(marked.sum(1), 1)


def _up_costs(body: FitBody, state: FitState) -> Array:
    """What states cost for where they put the ground, (B,)."""
    up = (state.R @ ground_normals(body.pose_prior, state.pose)[..., None])[..., 0]
    sight = state.t / np.sqrt((state.t * state.t).sum(-1, keepdims=True))
    sine = -(up * sight).sum(-1)
    elevation = np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0)))
    roll = np.degrees(np.arctan2(up[:, 0], -up[:, 1]))
    shown = np.hypot(up[:, 0], up[:, 1])
    return camera_costs(elevation, roll, shown=shown, below=(UNDER_DEG, UNDER_SD_DEG))

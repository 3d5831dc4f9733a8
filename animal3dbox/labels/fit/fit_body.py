"""All that the fit needs of a body, worked out once: skeleton, landmarks, priors, scan."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.kinematics import (
    JointFrames,
    LandmarkTables,
    Skeleton,
    joint_frames,
    landmark_parts,
    landmark_tables,
    skeleton_of,
    turns_of_joints,
)
from animal3dbox.labels.fit.pose_prior import PosePrior, axis_angles, pose_prior
from animal3dbox.labels.fit.shape_prior import ShapePrior, shape_prior
from animal3dbox.smal.keypoints.exchanges import exchange_order
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped
from animal3dbox.smal.quadruped.rest_pose import rest_alignment

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PosedJoints:
    """The joints of B posed bodies, and how they turn.

    Attributes:
        theta: (B, N, 3) angles of the fitted joints.
        frames: the joints' places and rotations.
        turns: (B, N, 3, P) see turns_of_joints.
    """

    theta: Array
    frames: JointFrames
    turns: Array


@dataclass(frozen=True, eq=False)
class FitBody:
    """A model with the priors and tables that one vocabulary and species need.

    Attributes:
        model: the body's.
        vocabulary: names of the L keypoints.
        skeleton: of the mean shape.
        tables: of the landmarks.
        pose_prior: of the fitted joints' angles.
        shape_prior: of the betas.
        exchanged: (L,) the keypoints that take each one's place if left and right are exchanged.
    """

    model: SmalModel
    vocabulary: Vocabulary
    skeleton: Skeleton
    tables: LandmarkTables
    pose_prior: PosePrior
    shape_prior: ShapePrior
    exchanged: Sequence[int]

    @property
    def length(self) -> float:
        """The skeleton's length along x in the template pose, in the model's unit."""
        return float(np.ptp(self.skeleton.rest[:, 0]))

    @property
    def sizes(self) -> tuple[int, int]:
        """How many pose directions and shape directions there are."""
        return self.pose_prior.directions.shape[2], self.shape_prior.directions.shape[1]

    def frames(self, pose: Array, shape: Array) -> tuple[Array, JointFrames]:
        """Angles (B, N, 3) and joints of coefficients (B, P) and (B, S)."""
        theta = axis_angles(self.pose_prior, pose)
        return theta, joint_frames(self.skeleton, theta, shape)

    def joints(self, pose: Array, shape: Array, count: int) -> PosedJoints:
        """The joints of coefficients (B, P) and (B, S), and how the first directions turn them."""
        theta, frames = self.frames(pose, shape)
        directions = self.pose_prior.directions[..., :count]
        return PosedJoints(theta, frames, turns_of_joints(self.skeleton, frames, theta, directions))

    def landmarks(self, pose: Array, shape: Array) -> Array:
        """The landmarks (B, 3, L) of coefficients (B, P) and (B, S), about the body's origin."""
        _, frames = self.frames(pose, shape)
        places: Array = landmark_parts(self.tables, frames, shape).sum(1)
        return places


@lru_cache(maxsize=64)
def fit_body(model: SmalModel, vocabulary: Vocabulary, species: str | None = None) -> FitBody:
    """The body of a model for a vocabulary, and a species where it is known."""
    shapes = shape_prior(model, species)
    arguments = (shapes.mean, shapes.directions)
    alignment = (
        None
        if model is load_quadruped()
        else rest_alignment(model, shapes.mean, shape_prior(load_quadruped()).mean)
    )
    return FitBody(
        model=model,
        vocabulary=vocabulary,
        skeleton=skeleton_of(model, *arguments, alignment),
        tables=landmark_tables(model, vocabulary, *arguments),
        pose_prior=pose_prior(model.joint_names),
        shape_prior=shapes,
        exchanged=exchange_order(vocabulary, "all"),
    )

"""All that the fit needs of a body, worked out once: skeleton, landmarks, priors, scan."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.calibration import ClassShape, KeypointPlaces
from animal3dbox.labels.fit.kinematics import (
    JointFrames,
    LandmarkTables,
    Skeleton,
    blended_rotations,
    joint_frames,
    landmark_parts,
    landmark_tables,
    skeleton_of,
    trunk_lengths,
    turns_of_joints,
)
from animal3dbox.labels.fit.pose_prior import PosePrior, axis_angles, pose_prior
from animal3dbox.labels.fit.shape_prior import ShapePrior, class_prior, shape_prior
from animal3dbox.smal.keypoints.exchanges import exchange_order
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped
from animal3dbox.smal.quadruped.rest_pose import rest_alignment

Array = NDArray[np.float64]
PLACES_SD = 0.015
"""Standard deviation of a keypoint's place in the picture beside its noise, by their extent."""


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
        offsets: (L, 3) of learned places from the model's own, see KeypointPlaces; else 0.
        places_sd: (L,) standard deviations of the keypoints' places in the picture beside their
            noise, by their extent.
        exchanged: (L,) the keypoints that take each one's place if left and right are exchanged.
    """

    model: SmalModel
    vocabulary: Vocabulary
    skeleton: Skeleton
    tables: LandmarkTables
    pose_prior: PosePrior
    shape_prior: ShapePrior
    offsets: Array
    places_sd: Array
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

    def moved_places(self, shape: Array, R_world_joint: Array) -> Array:
        """How far landmarks (B, L, 3) of posed bodies lie from the model's own places.

        Args:
            shape: (B, S) coefficients.
            R_world_joint: (B, J, 3, 3) global rotations of the joints.

        """
        length, length_shape = trunk_lengths(self.skeleton)
        blended = blended_rotations(self.tables, R_world_joint).transpose(0, 3, 1, 2)
        lengths = length + shape @ length_shape
        moved: Array = lengths[:, None, None] * (blended @ self.offsets[..., None])[..., 0]
        return moved

    def landmarks(self, pose: Array, shape: Array) -> Array:
        """The landmarks (B, 3, L) of coefficients (B, P) and (B, S), about the body's origin."""
        _, frames = self.frames(pose, shape)
        places: Array = landmark_parts(self.tables, frames, shape).sum(1)
        return places


@lru_cache(maxsize=256)
def fit_body(
    model: SmalModel,
    vocabulary: Vocabulary,
    species: str | None = None,
    *,
    places: KeypointPlaces | None = None,
    shape: ClassShape | None = None,
) -> FitBody:
    """The body of a model for a vocabulary, and a species where it is known.

    Args:
        model: with SMAL's joints and landmarks.
        vocabulary: names the keypoints.
        species: one of the quadruped's presets; None: not known, or the class has its own shape.
        places: where the animals' dataset has its keypoints; None: where the model has them.
        shape: of the animals' class; None: not learned.

    """
    shapes = shape_prior(model, species) if shape is None else class_prior(model, shape)
    return body_of_prior(model, vocabulary, shapes, places)


def body_of_prior(
    model: SmalModel, vocabulary: Vocabulary, shapes: ShapePrior, places: KeypointPlaces | None
) -> FitBody:
    """The body of a model and a prior of its shapes; see fit_body."""
    arguments = (shapes.mean, shapes.directions)
    alignment = (
        None
        if model is load_quadruped()
        else rest_alignment(model, shapes.mean, shape_prior(load_quadruped()).mean)
    )
    count = len(vocabulary)
    offsets = np.zeros((count, 3)) if places is None else np.array(places.offsets)
    tables = landmark_tables(model, vocabulary, *arguments, offsets=offsets)
    return FitBody(
        model=model,
        vocabulary=vocabulary,
        skeleton=skeleton_of(model, *arguments, alignment),
        tables=tables,
        offsets=offsets,
        places_sd=np.full(count, PLACES_SD) if places is None else np.array(places.sd),
        pose_prior=pose_prior(model.joint_names),
        shape_prior=shapes,
        exchanged=exchange_order(vocabulary, "all"),
    )


@lru_cache(maxsize=16)
def body_digest(model: SmalModel, vocabulary: Vocabulary) -> str:
    """12 hexadecimal digits that name a body at rest and where a vocabulary's keypoints are on it.

    See SmalModel.digest.
    """
    content = f"{model.digest} {vocabulary.landmarks!r}".encode()
    return hashlib.blake2b(content, digest_size=6).hexdigest()

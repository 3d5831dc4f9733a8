"""Poses of the quadruped on a model that stands otherwise while it is at rest.

A pose turns bones from where they are at rest, so the same angles mean another posture on a model
whose legs, neck or tail point elsewhere in its template. Here a posture is what the bones' own
directions are: A_j turns the model's bone j at rest to the direction that the quadruped's has, and
the joint turns

    R_j = A_parent^T exp(theta_j) A_j

have the model's bones where the quadruped's angles theta have the quadruped's. At theta = 0 the
model stands as the quadruped's template does.

What is assumed: the template stands level with its nose along x, so that the trunk's joints need no
such turn (A = 1); joints have the quadruped's names; A_j is the least turn beyond the parent's that
aligns the bone, so a bone that is twisted about its own length at rest stays so.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.rigid_transforms import (
    axis_angle_from_rotation,
    cross_matrix,
    rotation_from_axis_angle,
)
from animal3dbox.smal.model import SPINE_JOINTS, SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

Array = NDArray[np.float64]
OPPOSITE = 1e-6
"""Least 1 + cosine between two directions of which one can be turned to the other."""


@dataclass(frozen=True, eq=False)
class RestAlignment:
    """What stands before and behind the quadruped's joint turns on a model.

    Attributes:
        before: (N, 3, 3) A_parent^T.
        after: (N, 3, 3) A_j.

    Example:
        >>> alignment = rest_alignment(load_quadruped(), np.zeros(41), np.zeros(41))
        >>> bool(np.allclose(alignment.after, np.eye(3)))
        True
    """

    before: Array
    after: Array

    def __getitem__(self, joints: NDArray[np.intp]) -> "RestAlignment":
        """The alignment of some joints alone."""
        return RestAlignment(self.before[joints], self.after[joints])

    def turns(self, theta: Array) -> Array:
        """The model's joint turns (..., N, 3, 3) of the quadruped's angles (..., N, 3)."""
        turns: Array = self.before @ rotation_from_axis_angle(theta) @ self.after
        return turns

    def angles(self, theta: Array) -> Array:
        """The model's own angles (..., N, 3), axis-angle, of the quadruped's."""
        return as_numpy(axis_angle_from_rotation(torch.from_numpy(self.turns(theta))))


def rest_alignment(model: SmalModel, betas: Array, quadruped_betas: Array) -> RestAlignment:
    """The alignment of all J joints of a model with the quadruped.

    Args:
        model: with the quadruped's joint names.
        betas: (S,) the shape in which its bones are looked at.
        quadruped_betas: (S',) the quadruped's.

    Example:
        >>> rest_alignment(load_quadruped(), np.zeros(41), np.zeros(41)).before.shape
        (35, 3, 3)
    """
    quadruped = load_quadruped()
    own, wanted = _bones(model, betas), _bones(quadruped, quadruped_betas)
    trunk = {quadruped.joint_names[j] for j in SPINE_JOINTS}
    after = np.tile(np.eye(3), (model.joint_count, 1, 1))
    for j, name in enumerate(model.joint_names):
        if name in trunk:
            continue
        inherited = after[model.parents[j]]
        target = wanted[quadruped.joint_names.index(name)]
        after[j] = _least_turn(inherited @ own[j], target) @ inherited
    parents = np.maximum(np.array(model.parents), 0)
    return RestAlignment(after[parents].transpose(0, 2, 1), after)


def _bones(model: SmalModel, betas: Array) -> Array:
    """The unit directions (J, 3) of a shaped template's bones.

    From each joint to its only child; where it has none or several, to the middle of its own skin.
    """
    template = as_numpy(model.v_template) + as_numpy(model.shapedirs) @ betas
    joints, weights = as_numpy(model.J_regressor) @ template, as_numpy(model.weights)
    ends = (weights.T @ template) / np.maximum(weights.sum(0), OPPOSITE)[:, None]
    for j in range(model.joint_count):
        children = [k for k, parent in enumerate(model.parents) if parent == j]
        if len(children) == 1:
            ends[j] = joints[children[0]]
    along = ends - joints
    unit: Array = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-12)
    return unit


def _least_turn(direction: Array, target: Array) -> Array:
    """The rotation (3, 3) by the least angle that turns one unit direction to another."""
    across, cosine = np.cross(direction, target), float(direction @ target)
    if 1 + cosine < OPPOSITE:  # any half turn across the direction
        axis = np.eye(3)[np.abs(direction).argmin()]
        axis = axis - direction * (axis @ direction)
        half_turn: Array = 2 * np.outer(axis, axis) / (axis @ axis) - np.eye(3)
        return half_turn
    skew = cross_matrix(across)
    turn: Array = np.eye(3) + skew + skew @ skew / (1 + cosine)
    return turn

"""The quadruped's poses on a model that stands otherwise at rest."""

import numpy as np
import torch
from numpy.typing import NDArray
from smal_stand_in import converted_stand_in, rest_pose

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.poses import named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names
from animal3dbox.smal.quadruped.rest_pose import _least_turn, rest_alignment

Array = NDArray[np.float64]
LENGTH = 1.5
"""Of the quadruped, in its unit."""


def presets_mean() -> Array:
    mean: Array = np.stack([preset_betas(name).numpy() for name in quadruped_names().presets]).mean(
        0
    )
    return mean


def joints(model: SmalModel, betas: Array, pose: Array) -> Array:
    """The joints (J, 3) of a posed body about its root."""
    body = model.posed(
        torch.from_numpy(betas)[None],
        torch.from_numpy(pose)[None],
        torch.zeros(1, 3, dtype=torch.float64),
    )
    return as_numpy(body.joints[0] - body.joints[0, 0])


def test_a_pose_of_the_quadruped_puts_the_stand_ins_joints_where_it_puts_the_quadrupeds() -> None:
    model, mean = converted_stand_in(), presets_mean()
    alignment = rest_alignment(model, np.zeros(model.beta_count), mean)
    for name in ("stand", "sit", "curl", "run"):
        pose = as_numpy(named_pose(name))
        wanted = joints(load_quadruped(), mean, pose)
        own = joints(model, np.zeros(model.beta_count), alignment.angles(pose))
        # Joints depend on bones alone, but for the ears: the head's own skin says where it points
        assert np.abs(own - wanted).max() < 3e-4 * LENGTH
        plain = joints(model, np.zeros(model.beta_count), pose)
        assert np.abs(plain - wanted).max() > 0.05 * LENGTH


def test_at_rest_the_stand_in_takes_the_quadrupeds_stance() -> None:
    model, names = converted_stand_in(), load_quadruped().joint_names
    angles = rest_alignment(model, np.zeros(model.beta_count), presets_mean()).angles(
        np.zeros((len(names), 3))
    )
    hip = names.index("LLegBack1")
    undone = rotation_from_axis_angle(angles[hip]) @ rotation_from_axis_angle(rest_pose()[hip])
    thigh = np.array([0.0, 0.0, -1.0])
    assert np.degrees(np.arccos(thigh @ undone @ thigh)) < 1


def test_a_turn_is_the_least_that_aligns_two_directions() -> None:
    rng = np.random.default_rng(3)
    for a, b in rng.standard_normal((20, 2, 3)):
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        turn = _least_turn(a, b)
        assert np.abs(turn @ a - b).max() < 1e-12
        assert np.isclose((np.trace(turn) - 1) / 2, a @ b)
    back = _least_turn(np.array([0.0, 0.6, 0.8]), np.array([0.0, -0.6, -0.8]))
    assert np.allclose(back @ [0.0, 0.6, 0.8], [0.0, -0.6, -0.8])
    assert np.isclose(np.linalg.det(back), 1.0)

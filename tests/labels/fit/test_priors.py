"""The priors of the fit: poses and shapes."""

import numpy as np
import pytest

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.labels.fit.pose_prior import (
    axis_angles,
    ground_normals,
    mirrored_pose,
    pose_prior,
)
from animal3dbox.labels.fit.shape_prior import shape_prior
from animal3dbox.smal.quadruped.poses import named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

NAMES = load_quadruped().joint_names


def fitted_joints() -> list[int]:
    return [j for j, name in enumerate(NAMES) if j > 0 and name not in ("Mouth", "LEar", "REar")]


@pytest.mark.parametrize("name", ["stand", "walk", "run", "sit", "lie", "rear", "graze"])
def test_named_poses_are_within_the_prior(name: str) -> None:
    prior = pose_prior(NAMES)
    theta = as_numpy(named_pose(name))[fitted_joints()]
    c = prior.coefficients(theta[None])
    again = axis_angles(prior, c)[0]
    assert np.abs(np.degrees(again - theta)).max() < 16
    assert (c**2).sum() / len(c[0]) < 2.5


def test_coefficients_of_the_directions_are_unit_vectors() -> None:
    prior = pose_prior(NAMES)
    for k in (0, 7, 39):
        c = np.eye(prior.directions.shape[2])[k][None]
        assert np.abs(prior.coefficients(axis_angles(prior, c)) - c).max() < 1e-9


def test_the_ground_of_a_sitting_animal_is_steep_against_its_trunk() -> None:
    prior = pose_prior(NAMES)
    for name, least, most in (("stand", 0, 12), ("sit", 25, 60), ("rear", 25, 70)):
        c = prior.coefficients(as_numpy(named_pose(name))[fitted_joints()][None])
        up = ground_normals(prior, c)[0]
        assert least <= np.degrees(np.arccos(up[2])) <= most, name
    assert np.abs(np.linalg.norm(up) - 1) < 1e-12


def test_mirroring_a_pose_twice_gives_it_back() -> None:
    pose = as_numpy(named_pose("walk"))
    image = mirrored_pose(pose, NAMES)
    assert np.array_equal(mirrored_pose(image, NAMES), pose)
    left, right = NAMES.index("LLeg1"), NAMES.index("RLeg1")
    assert np.array_equal(image[left], pose[right] * [-1, 1, -1])


def test_a_skeleton_without_ears_has_the_same_prior() -> None:
    whole, earless = pose_prior(NAMES), pose_prior(NAMES[:33])
    assert np.array_equal(whole.directions, earless.directions)


def test_species_are_within_the_prior_of_shapes_and_their_own_is_narrower() -> None:
    model = load_quadruped()
    every, dogs = shape_prior(model), shape_prior(model, "dog")
    assert np.array_equal(dogs.mean, as_numpy(preset_betas("dog")))
    columns = as_numpy(model.shapedirs).reshape(-1, model.beta_count)
    spread = [np.linalg.norm(columns @ one.directions) for one in (every, dogs)]
    assert spread[1] < 0.8 * spread[0]
    for name in quadruped_names().presets:
        apart = columns @ (as_numpy(preset_betas(name)) - every.mean)
        directions = columns @ every.directions
        s = np.linalg.lstsq(directions, apart, rcond=None)[0]
        assert np.linalg.norm(directions @ s - apart) < 0.35 * np.linalg.norm(apart)
        assert (s**2).mean() < 2.5


def test_each_preset_is_a_kind_of_its_own_and_likelier_there_than_in_the_middle() -> None:
    model = load_quadruped()
    prior, dogs = shape_prior(model), shape_prior(model, "dog")
    assert len(prior.kinds) == len(quadruped_names().presets)
    columns = as_numpy(model.shapedirs).reshape(-1, model.beta_count)
    for name, kind in zip(quadruped_names().presets, prior.kinds, strict=True):
        apart = columns @ (as_numpy(preset_betas(name)) - prior.mean - prior.directions @ kind)
        whole = columns @ (as_numpy(preset_betas(name)) - prior.mean)
        assert np.linalg.norm(apart) < 0.35 * np.linalg.norm(whole)
    narrower = np.linalg.eigvalsh(prior.precision)  # than all species together
    assert narrower.min() > 1 - 1e-9
    assert narrower.max() > 2
    assert (dogs.kinds.tolist(), dogs.precision[0, 0]) == ([[0.0] * 18], 1.0)


def test_the_overall_size_is_not_among_the_shapes() -> None:
    prior = shape_prior(load_quadruped())
    size = quadruped_names().columns.index("size")
    assert np.abs(prior.directions[size]).max() < 1e-12

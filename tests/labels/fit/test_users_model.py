"""Fits of a user's SMAL model, proved on a stand-in; see tests/support/smal_stand_in.py."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from smal_stand_in import converted_stand_in

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.config import ALONE, ForeignConfig
from animal3dbox.errors import ConfigError
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.fit.fit import fit_many
from animal3dbox.labels.fit.fit_body import fit_body
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.fit.kinematics import landmark_parts, slopes_of_parts, turns_of_joints
from animal3dbox.labels.fit_parameters import fitted_vertices
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.model import SmalModel

WORLD = ForeignConfig(
    world=replace(ALONE, fill=(0.4, 0.9)), proportions=0.0, places=0.0, places_of_animal=0.0
)
STEP = 1e-6


@cache
def animals() -> tuple[ForeignAnimal, ...]:
    return tuple(foreign_animal(7, index, WORLD) for index in range(6))


def fits(model: SmalModel | None) -> list[FittedBody]:
    outcomes = fit_many(
        {
            "image_hw": one.camera.image_hw,
            "keypoints_2d": one.keypoints_2d,
            "K": one.camera.K,
            "mask": one.mask,
            "model": model,
        }
        for one in animals()
    )
    return [one for one in outcomes if isinstance(one, FittedBody)]


def test_a_users_model_comes_out_where_the_quadruped_does() -> None:
    ours, theirs = fits(None), fits(converted_stand_in())
    assert len(ours) == len(theirs) == len(animals())
    assert {fit.body_name for fit in theirs} == {"model"}
    turns, apart = [], []
    for one, other in zip(ours, theirs, strict=True):
        turn = rotation_angle(torch.from_numpy(one.rotation), torch.from_numpy(other.rotation))
        turns.append(float(torch.rad2deg(turn)))
        # At one distance: a picture does not tell size
        v, w = (fit.vertices_cam / np.linalg.norm(fit.vertices_cam.mean(0)) for fit in (one, other))
        apart.append(np.linalg.norm(v - w, axis=1).mean() / np.linalg.norm(np.ptp(v, axis=0)))
    assert np.median(turns) < 4
    assert max(turns) < 15
    assert np.median(apart) < 0.02


def test_its_parameters_pose_its_vertices_again_and_are_the_models_alone() -> None:
    fit = fits(converted_stand_in())[0]
    posed = fitted_vertices(fit.parameters, converted_stand_in())
    assert np.abs(posed - fit.vertices).max() < 1e-6
    with pytest.raises(ConfigError, match="the file that it was fitted with"):
        fitted_vertices(fit.parameters)


def test_slopes_along_pose_directions_are_finite_differences_of_another_rest_pose_too() -> None:
    body = fit_body(converted_stand_in(), VOCABULARIES["animal3d26"])
    rng = np.random.default_rng(5)
    pose, shape = (rng.standard_normal((2, count)) for count in body.sizes)
    theta, frames = body.frames(pose, shape)
    parts = landmark_parts(body.tables, frames, shape)
    turns = turns_of_joints(body.skeleton, frames, theta, body.pose_prior.directions)
    slopes = slopes_of_parts(body.skeleton, frames, parts, turns=turns, beyond=body.tables.beyond)
    for k in range(body.sizes[0]):
        step = STEP * np.eye(body.sizes[0])[k]
        ahead, behind = body.landmarks(pose + step, shape), body.landmarks(pose - step, shape)
        assert np.abs(slopes[:, k] - (ahead - behind) / (2 * STEP)).max() < 1e-5


def test_a_model_without_landmarks_or_with_a_preset_of_ours_is_refused() -> None:
    model = converted_stand_in()
    with pytest.raises(ConfigError, match="has no landmarks"):
        FittedBodies(replace(model, landmarks={}))
    with pytest.raises(ConfigError, match="preset of the embedded quadruped"):
        FittedBodies(model, "cow")
    assert (
        FittedBodies(model).fingerprint
        != FittedBodies(replace(model, faces=model.faces[1:])).fingerprint
    )

"""The door of the fit: fit_animal and fit_many."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from animal3dbox import fit_animal
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.config import ALONE, ForeignConfig
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.geometry.rigid_transforms import rotation_angle
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.choice import choice_costs
from animal3dbox.labels.fit.fit import fit_many
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.fit.request import fit_request
from animal3dbox.labels.fit.view_scan import scan_starts
from animal3dbox.labels.types import Rejection
from animal3dbox.smal.keypoints.exchanges import exchange_order
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

WORLD = ForeignConfig(
    world=replace(ALONE, fill=(0.4, 0.9)), proportions=0.0, places=0.0, places_of_animal=0.0
)


def animal(index: int, config: ForeignConfig = WORLD) -> ForeignAnimal:
    return foreign_animal(7, index, config)


def arguments(one: ForeignAnimal, **changes: Any) -> Mapping[str, Any]:
    return {
        "image_hw": one.camera.image_hw,
        "keypoints_2d": one.keypoints_2d,
        "K": one.camera.K,
        "mask": one.mask,
        "vocabulary": one.vocabulary,
        "sample_id": one.sample_id,
        **changes,
    }


def fitted(outcome: FittedBody | Rejection) -> FittedBody:
    assert isinstance(outcome, FittedBody), outcome
    return outcome


def degrees_off(fit: FittedBody, one: ForeignAnimal) -> float:
    angle = rotation_angle(torch.from_numpy(fit.rotation), one.cuboid.rotation)
    return float(torch.rad2deg(angle))


def test_the_trunks_of_twelve_animals_are_found() -> None:
    animals = [animal(i) for i in range(12)]
    fits = [fitted(one) for one in fit_many([arguments(one) for one in animals])]
    off = [degrees_off(fit, one) for fit, one in zip(fits, animals, strict=True)]
    assert np.median(off) < 5
    assert max(off) < 20
    assert {fit.labeling for fit in fits} == {"as given"}


def test_the_body_lies_in_its_mask_and_on_its_keypoints() -> None:
    one = animal(1)
    fit = fitted(fit_animal(**arguments(one)))
    vertices = torch.from_numpy(fit.vertices_cam)
    drawn = silhouette(vertices, load_quadruped().faces, one.camera.K, one.camera.image_hw)
    assert float((drawn & one.mask).sum() / (drawn | one.mask).sum()) > 0.85
    seen = one.keypoints_2d[:, 2].numpy() > 0
    cam = fit.landmarks @ fit.R.T + fit.t
    px = (cam @ fit.K.T)[:, :2] / cam[:, 2:]
    apart = np.linalg.norm(px - one.keypoints_2d[:, :2].numpy(), axis=1)[seen]
    assert np.median(apart) < 8


def test_the_vertices_are_the_models_posed_by_the_parameters() -> None:
    fit = fitted(fit_animal(**arguments(animal(2))))
    body = load_quadruped().posed(
        torch.from_numpy(fit.betas)[None],
        torch.from_numpy(fit.pose)[None],
        torch.zeros(1, 3, dtype=torch.float64),
    )
    assert np.array_equal(fit.vertices, body.vertices[0].numpy())
    assert fit.pose[0].tolist() == [0, 0, 0]
    assert fit.faces.shape == tuple(load_quadruped().faces.shape)


def test_a_fit_is_the_same_to_the_byte_alone_and_among_others() -> None:
    mixed = [
        arguments(animal(0)),
        arguments(animal(1), mask=None),
        arguments(animal(2), K=None),
        arguments(animal(3), K=None, mask=None),
        arguments(animal(4), species="cow"),
        arguments(animal(5)),
    ]
    together = fit_many(mixed)
    for one, among_others in zip(mixed, together, strict=True):
        alone = fit_many([one])[0]
        for name in ("vertices", "R", "t", "K", "betas", "pose", "rotation_covariance"):
            own, other = (getattr(fitted(fit), name) for fit in (alone, among_others))
            assert np.array_equal(own, other), name
        assert fitted(alone).margin == fitted(among_others).margin


def test_exchanged_sides_are_mended() -> None:
    animals = [animal(i) for i in range(8)]
    order = list(exchange_order(VOCABULARIES["animal3d26"], "all"))
    given = [arguments(one, keypoints_2d=one.keypoints_2d[order]) for one in animals]
    fits = [fitted(fit) for fit in fit_many(given)]
    assert sum(fit.labeling == "all" for fit in fits) >= 7
    assert sum(degrees_off(fit, one) < 25 for fit, one in zip(fits, animals, strict=True)) >= 7


def test_a_picture_turned_into_its_mirror_image_gives_the_mirrored_body() -> None:
    one = animal(3)
    width = one.camera.image_hw[1]
    K = one.camera.K.clone()
    K[0, 2] = width - 1 - K[0, 2]
    keypoints = one.keypoints_2d[list(one.vocabulary.flip)].clone()
    keypoints[:, 0] = torch.where(keypoints[:, 2] > 0, width - 1 - keypoints[:, 0], 0.0)
    fit = fitted(fit_animal(**arguments(one, mask=None)))
    image = fitted(fit_animal(**arguments(one, mask=None, K=K, keypoints_2d=keypoints)))
    mirror = np.diag([-1.0, 1, 1]) @ fit.rotation @ np.diag([1.0, -1, 1])
    angle = rotation_angle(torch.from_numpy(image.rotation), torch.from_numpy(mirror))
    assert float(torch.rad2deg(angle)) < 6


def test_an_unknown_focal_length_is_estimated_and_told() -> None:
    fit = fitted(fit_animal(**arguments(animal(2), K=None)))
    guess = 1.2 * max(animal(2).camera.image_hw)
    assert fit.K_source == "estimated"
    assert fit.K[0, 0] == pytest.approx(guess * np.exp(fit.log_focal))
    known = fitted(fit_animal(**arguments(animal(2))))
    assert (known.K_source, known.log_focal) == ("given", 0.0)
    assert np.array_equal(known.K, animal(2).camera.K.numpy())


def test_the_standard_deviation_grows_with_the_noise() -> None:
    noisy = replace(WORLD, faults=FaultConfig(noise_px=12.0))
    sure, unsure = (
        fitted(fit_animal(**arguments(animal(1, config), keypoints_2d=points, mask=None)))
        for config, points in ((WORLD, animal(1).keypoints_2d), (noisy, weak(animal(1))))
    )
    assert unsure.rotation_sd_deg > 1.2 * sure.rotation_sd_deg


def weak(one: ForeignAnimal) -> torch.Tensor:
    """The keypoints with a confidence of 0.1 instead of 1."""
    scale = torch.tensor([1.0, 1.0, 0.1], dtype=torch.float64)
    return one.keypoints_2d * scale


@pytest.mark.parametrize("vocabulary", ["ap10k17", "stanfordextra24", "animalpose20"])
def test_every_vocabulary_can_be_fitted(vocabulary: str) -> None:
    config = replace(WORLD, world=replace(WORLD.world, vocabulary=VOCABULARIES[vocabulary]))
    one = animal(2, config)
    assert degrees_off(fitted(fit_animal(**arguments(one))), one) < 20


def test_too_few_keypoints_and_keypoints_at_one_pixel_are_rejected_with_a_reason() -> None:
    few = torch.zeros(26, 3)
    few[:5] = torch.tensor([10.0, 20.0, 1.0])
    outcome = fit_animal((48, 64), few, sample_id="a")
    assert isinstance(outcome, Rejection)
    assert (outcome.sample_id, outcome.reason) == ("a", "too_few_keypoints")
    few[:8] = torch.tensor([10.0, 20.0, 1.0])
    outcome = fit_animal((48, 64), few)
    assert isinstance(outcome, Rejection)
    assert outcome.reason == "coplanar_keypoints"


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"keypoints_2d": np.zeros((25, 3))}, SampleError, "26"),
        ({"mask": np.zeros((3, 3), dtype=bool)}, SampleError, "image_hw"),
        ({"K": np.eye(3)}, SampleError, "normalised"),
        ({"image_hw": (0, 10)}, SampleError, "image_hw"),
        ({"species": "unicorn"}, ConfigError, "unicorn"),
        ({"vocabulary": "none"}, ConfigError, "vocabulary"),
    ],
)
def test_wrong_arguments_raise_errors_that_name_them(
    changes: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        fit_animal(**{**arguments(animal(0)), **changes})


def test_a_model_whose_joints_are_not_known_is_refused() -> None:
    model = load_quadruped()
    names = ("root", *(f"joint{j}" for j in range(1, model.joint_count)))
    with pytest.raises(ConfigError, match="root"):
        fit_animal(**{**arguments(animal(0)), "model": replace(model, joint_names=names)})


def other_model() -> SmalModel:
    """The quadruped twice as large, in a shape basis of its own."""
    model = load_quadruped()
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((41, 41)))
    basis = torch.einsum("vcs,st->vct", model.shapedirs, torch.from_numpy(turn[:, :20] * 0.5))
    return replace(
        model, v_template=2 * model.v_template, shapedirs=2 * basis, posedirs=2 * model.posedirs
    )


def test_a_model_of_another_size_and_shape_basis_can_be_fitted() -> None:
    animals = [animal(i) for i in range(6)]
    model = other_model()
    fits = [fitted(fit) for fit in fit_many([arguments(one, model=model) for one in animals])]
    off = [degrees_off(fit, one) for fit, one in zip(fits, animals, strict=True)]
    assert np.median(off) < 12
    assert {fit.body_name for fit in fits} == {"model"}
    assert fits[0].betas.shape == (20,)


def tilted(one: ForeignAnimal, degrees: float) -> torch.Tensor:
    """Gravity's direction in the camera, turned from the true one about the line of sight."""
    angle = np.deg2rad(degrees)
    x, y, z = (-one.camera.T_cam_world[:3, 2]).tolist()
    return torch.tensor(
        [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z]
    )


def test_gravity_turns_the_fit_towards_it() -> None:
    one = animal(3)
    level, leaning = (
        fitted(fit_animal(**arguments(one, down_cam=tilted(one, degrees)))) for degrees in (0, 25)
    )
    ups = [torch.from_numpy(fit.rotation)[:, 2] for fit in (level, leaning)]
    cosines = [float(up @ -tilted(one, 25)) for up in ups]
    assert cosines[1] > cosines[0] + 0.001
    assert degrees_off(level, one) < 10


def test_gravity_and_upright_cameras_count_only_with_the_prior() -> None:
    one, free = animal(3), LabelConfig(upright="none")
    requests = [
        fit_request(config=config, **arguments(one, **more))
        for config in (LabelConfig(), free)
        for more in ({}, {"down_cam": (0.0, 0.0, 1.0)})
    ]
    weights = [float(request.problem.up_weight[0]) for request in requests]
    known = [bool(np.isfinite(request.problem.down).all()) for request in requests]
    assert weights == [1.0, 0.0, 0.0, 0.0]
    assert known == [False, True, False, False]


def test_a_picture_turned_upside_down_is_another_choice_without_the_prior() -> None:
    one = animal(3)
    height, width = one.camera.image_hw
    turned = one.keypoints_2d.clone()
    turned[:, :2] = torch.tensor([width - 1.0, height - 1.0]) - turned[:, :2]
    costs = []
    for upright in ("prior", "none"):
        request = fit_request(
            config=LabelConfig(upright=upright),
            **arguments(one, keypoints_2d=turned, mask=None),
        )
        starts = scan_starts(request.body, request.problem, exchanges=False)
        costs.append(choice_costs(request.body, request.problem, starts).up.max())
    assert costs[0] > 1
    assert costs[1] == 0


def test_gravity_of_another_length_is_refused() -> None:
    with pytest.raises(SampleError, match="down_cam: must be a unit vector"):
        fit_animal(**arguments(animal(3), down_cam=(0.0, 0.0, 2.0)))

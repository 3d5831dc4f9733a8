import pickle
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import ShapeError
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.parameters import (
    SmalParameters,
    posed_bodies,
    posed_body,
)
from animal3dbox.smal.quadruped.poses import named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

F64 = torch.float64
ZERO = torch.zeros(3, dtype=F64)


def without_ears() -> SmalModel:
    """The quadruped with SMAL 2017's 33 joints: what the ears moved, the head moves."""
    model = load_quadruped()
    weights = model.weights[:, :33].clone()
    weights[:, 16] += model.weights[:, 33:].sum(1)
    return SmalModel(
        v_template=model.v_template,
        faces=model.faces,
        shapedirs=model.shapedirs,
        posedirs=model.posedirs[:, :, : 9 * 32],
        J_regressor=model.J_regressor[:33],
        weights=weights,
        parents=model.parents[:33],
        joint_names=model.joint_names[:33],
        landmarks=model.landmarks,
    )


def test_flat_parameters_give_the_body_of_the_posed_model() -> None:
    model, pose = load_quadruped(), named_pose("walk")
    trans = torch.tensor([0.1, 0.2, 3.0], dtype=F64)
    body = posed_body(
        model, SmalParameters(pose.flatten().float(), preset_betas("cow")[:20], trans)
    )
    betas = torch.zeros(1, model.beta_count, dtype=F64)
    betas[0, :20] = preset_betas("cow")[:20]
    expected = model.posed(betas, pose.float().double()[None], trans[None])
    assert_close(body.vertices, expected.vertices)
    assert_close(body.R_world_joint, expected.R_world_joint)


def test_offsets_from_a_familys_mean_are_added_to_it() -> None:
    model, pose = load_quadruped(), torch.zeros(105, dtype=F64)
    mean, offset = 0.01 * torch.arange(41, dtype=F64), 0.1 * torch.ones(20, dtype=F64)
    summed = mean.clone()
    summed[:20] += 0.1
    body = posed_body(model, SmalParameters(pose, offset, ZERO, family_mean=mean))
    assert torch.equal(
        body.vertices, posed_body(model, SmalParameters(pose, summed, ZERO)).vertices
    )


def test_a_pose_of_33_joints_leaves_the_ears_at_rest() -> None:
    pose = torch.randn(99, generator=torch.Generator().manual_seed(0), dtype=F64)
    at_rest = torch.cat((pose, torch.zeros(6, dtype=F64)))
    bodies = posed_bodies(
        load_quadruped(), [SmalParameters(p, torch.zeros(1), ZERO) for p in (pose, at_rest)]
    )
    assert torch.equal(bodies.vertices[0], bodies.vertices[1])


def test_a_pose_of_35_joints_fits_a_model_without_ears_only_if_its_ears_rest() -> None:
    model, pose = without_ears(), torch.zeros(105, dtype=F64)
    assert posed_body(
        model, SmalParameters(pose, torch.zeros(5, dtype=F64), ZERO)
    ).vertices.shape == (1, model.vertex_count, 3)
    pose[-1] = 0.1
    with pytest.raises(ShapeError, match="pose turns the ears"):
        posed_body(model, SmalParameters(pose, torch.zeros(5, dtype=F64), ZERO))


@pytest.mark.parametrize(
    ("pose", "betas", "trans", "says"),
    [
        (torch.zeros(104), torch.zeros(41), ZERO, r"pose must be \(3 J,\)"),
        (torch.zeros(60), torch.zeros(41), ZERO, "pose has 20 joints, but the model has 35"),
        (torch.full((105,), torch.nan), torch.zeros(41), ZERO, "pose must be finite"),
        (torch.zeros(105), torch.zeros(145), ZERO, "betas has 145 numbers, but the model has 41"),
        (torch.zeros(105), torch.full((41,), torch.inf), ZERO, "betas must be finite"),
        (torch.zeros(105), torch.zeros(1, 41), ZERO, "betas must have shape"),
        (torch.zeros(105), torch.zeros(41), torch.zeros(2), "trans must have shape"),
        (torch.zeros(105), torch.zeros(41), torch.full((3,), torch.nan), "trans must be finite"),
    ],
)
def test_parameters_that_do_not_fit_are_refused_by_name(
    pose: Tensor, betas: Tensor, trans: Tensor, says: str
) -> None:
    with pytest.raises(ShapeError, match=says):
        posed_body(load_quadruped(), SmalParameters(pose, betas, trans))


def test_a_model_in_another_type_poses_in_it_and_is_otherwise_the_same() -> None:
    model = load_quadruped()
    single = model.to(torch.float32)
    body = single.posed(torch.zeros(1, 3), torch.zeros(1, 35, 3), torch.zeros(1, 3))
    assert body.vertices.dtype == torch.float32
    assert model.v_template.dtype == F64
    assert (single.parents, single.landmarks, single.extra_landmarks) == (
        model.parents,
        model.landmarks,
        model.extra_landmarks,
    )
    assert_close(body.vertices[0].double(), model.v_template, atol=1e-6, rtol=0)


def dense(model: SmalModel) -> SmalModel:
    """The model with pose columns and weights of which few are zero."""
    generator = torch.Generator().manual_seed(1)
    weights = model.weights + 0.01 * torch.rand(model.weights.shape, generator=generator, dtype=F64)
    posedirs = model.posedirs + 1e-4 * torch.randn(
        model.posedirs.shape, generator=generator, dtype=F64
    )
    return replace(model, posedirs=posedirs, weights=weights / weights.sum(1, keepdim=True))


@pytest.mark.parametrize("change", [lambda model: model, dense])
@pytest.mark.parametrize("vertices_in", [torch.float32, torch.float64])
def test_bodies_posed_together_are_those_posed_one_by_one_to_the_last_bit(
    vertices_in: torch.dtype, change: Callable[[SmalModel], SmalModel]
) -> None:
    model, generator = change(load_quadruped()), torch.Generator().manual_seed(0)
    animals = [
        SmalParameters(
            0.2 * torch.randn(105, generator=generator),
            preset_betas("cow")[:count],
            torch.randn(3, generator=generator, dtype=F64),
        )
        for count in range(1, 20)
    ]
    together = posed_bodies(model, animals, vertices_in)
    for i, animal in enumerate(animals):
        alone = posed_bodies(model, [animal], vertices_in)
        for name in ("vertices", "joints", "R_world_joint"):
            assert torch.equal(getattr(together, name)[i], getattr(alone, name)[0]), name


def test_a_body_is_the_same_with_and_without_gradients() -> None:
    model, pose = load_quadruped(), named_pose("walk")[None]
    betas, trans = preset_betas("dog")[None], torch.ones(1, 3, dtype=F64)
    plain, with_gradients = (
        model.posed(betas, pose, trans),
        model.posed(betas.clone().requires_grad_(), pose, trans),
    )
    assert with_gradients.vertices.requires_grad
    assert_close(plain.vertices, with_gradients.vertices.detach(), atol=1e-12, rtol=0)
    assert_close(plain.R_world_joint, with_gradients.R_world_joint.detach(), atol=1e-12, rtol=0)


def test_what_a_model_works_out_is_not_sent_along_with_it() -> None:
    model = load_quadruped().to(torch.float64)
    before = len(pickle.dumps(model))
    model.posed(preset_betas("dog")[None], named_pose("walk")[None], torch.zeros(1, 3, dtype=F64))
    assert len(pickle.dumps(model)) == before
    again = pickle.loads(pickle.dumps(model))  # our own bytes
    assert torch.equal(again.v_template, model.v_template)


def test_what_the_user_has_set_for_products_of_his_own_changes_no_body() -> None:
    model, animal = load_quadruped(), SmalParameters(named_pose("walk"), preset_betas("dog"), ZERO)
    plain, precision = (
        posed_bodies(model, [animal], torch.float32).vertices,
        torch.get_float32_matmul_precision(),
    )
    torch.set_float32_matmul_precision("medium")
    try:
        with torch.autocast("cpu", dtype=torch.bfloat16):
            assert torch.equal(posed_bodies(model, [animal], torch.float32).vertices, plain)
    finally:
        torch.set_float32_matmul_precision(precision)


@pytest.mark.parametrize("away", [0.0, 0.3, 10.0, 1000.0])
def test_vertices_in_float32_are_good_wherever_the_template_stands(away: float) -> None:
    model = load_quadruped()
    shifted = replace(model, v_template=model.v_template + away)
    animal = SmalParameters(named_pose("walk"), preset_betas("dog"), ZERO)
    quick, exact = (
        posed_bodies(shifted, [animal], dtype).vertices for dtype in (torch.float32, torch.float64)
    )
    assert float((quick - exact).abs().amax()) < 1e-6


def test_no_animals_are_no_bodies() -> None:
    with pytest.raises(ShapeError, match="at least one animal"):
        posed_bodies(load_quadruped(), [])

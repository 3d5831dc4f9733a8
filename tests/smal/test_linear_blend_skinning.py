"""The worker's fast way of posing against the definition, and the definition against a hand's.

test_model.py holds posed() to a reference in NumPy, vertex by vertex.
"""

import pytest
import torch
from torch import Tensor

from animal3dbox.smal.linear_blend_skinning import PosedBody, linear_blend_skinning
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.poses import random_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

F64 = torch.float64


def by_definition(model: SmalModel, betas: Tensor, pose: Tensor, trans: Tensor) -> PosedBody:
    return linear_blend_skinning(
        betas,
        pose,
        trans,
        v_template=model.v_template,
        shapedirs=model.shapedirs,
        posedirs=model.posedirs,
        J_regressor=model.J_regressor,
        weights=model.weights,
        parents=model.parents,
    )


def twenty_bodies() -> tuple[Tensor, Tensor, Tensor]:
    """More than are posed at a time, of all presets."""
    presets, generator = quadruped_names().presets, torch.Generator().manual_seed(0)
    betas = torch.stack([preset_betas(presets[i % len(presets)]) for i in range(20)])
    pose = torch.stack([random_pose(generator) for _ in range(20)])
    pose[:, 0] = torch.randn(20, 3, generator=generator, dtype=F64)
    return betas, pose, torch.randn(20, 3, generator=generator, dtype=F64)


@pytest.mark.parametrize(
    ("dtype", "vertices_in", "tolerance"),
    [(F64, None, 1e-12), (F64, torch.float32, 1e-6), (torch.float32, None, 1e-5)],
)
def test_the_fast_way_gives_the_bodies_of_the_definition(
    dtype: torch.dtype, vertices_in: torch.dtype | None, tolerance: float
) -> None:  # bodies are about 1 long
    model = load_quadruped().to(dtype)
    betas, pose, trans = (x.to(dtype) for x in twenty_bodies())
    fast = model.posed_arrays(betas.numpy(), pose.numpy(), trans.numpy(), vertices_in=vertices_in)
    defined = by_definition(model, betas, pose, trans)
    for name in ("vertices", "joints", "R_world_joint"):
        torch.testing.assert_close(
            getattr(fast, name), getattr(defined, name), atol=tolerance, rtol=0
        )


def test_tensors_with_derivatives_are_posed_by_the_definition() -> None:
    model, (betas, pose, trans) = load_quadruped(), twenty_bodies()
    body = model.posed(betas[:1], pose[:1].requires_grad_(), trans[:1])
    assert torch.equal(body.vertices, by_definition(model, betas[:1], pose[:1], trans[:1]).vertices)


def test_a_bent_joint_turns_what_it_moves_about_itself() -> None:
    # Two joints at x = 0 and x = 1; the vertex at x = 2 belongs to the second, which turns by 90
    # degrees about z
    body = linear_blend_skinning(
        torch.zeros(1, 0),
        torch.tensor([[[0.0, 0, 0], [0, 0, torch.pi / 2]]]),
        torch.tensor([[0.0, 0, 10]]),
        v_template=torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]),
        shapedirs=torch.zeros(3, 3, 0),
        posedirs=torch.zeros(3, 3, 9),
        J_regressor=torch.eye(2, 3),
        weights=torch.tensor([[1.0, 0], [0, 1], [0, 1]]),
        parents=(-1, 0),
    )
    expected = torch.tensor([[[0.0, 0, 10], [1, 0, 10], [1, 1, 10]]])
    torch.testing.assert_close(body.vertices, expected, atol=1e-6, rtol=0)
    assert body.joints.tolist() == [[[0, 0, 10], [1, 0, 10]]]


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_autocast_does_not_cost_joints_their_digits(dtype: torch.dtype) -> None:
    model = load_quadruped().to(torch.float32)
    betas, pose, trans = (x[:2].float() for x in twenty_bodies())
    pose.requires_grad_()
    plain = model.posed(betas, pose, trans)
    with torch.autocast("cpu", dtype=dtype):
        assert torch.equal(model.posed(betas, pose, trans).vertices, plain.vertices)

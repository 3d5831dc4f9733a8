"""SmalModel against a plain reference, on a tiny body that is made here."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor
from torch.autograd import forward_ad

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.smal.model import SmalModel, trunk_rotation

PARENTS_35 = (
    *(-1, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 6, 11, 12, 13, 6, 15, 0, 17, 18, 19, 0, 21, 22, 23),
    *(0, 25, 26, 27, 28, 29, 30, 16, 16, 16),
)
NAMES_35 = (
    "pelvis", "pelvis0", "spine", "spine0", "spine1", "spine2", "spine3", "LLeg1", "LLeg2", "LLeg3",
    "LFoot", "RLeg1", "RLeg2", "RLeg3",
    "RFoot", "Neck", "Head", "LLegBack1", "LLegBack2", "LLegBack3", "LFootBack", "RLegBack1",
    "RLegBack2", "RLegBack3", "RFootBack",
    "Tail1", "Tail2", "Tail3", "Tail4", "Tail5", "Tail6", "Tail7", "Mouth", "LEar", "REar",
)  # fmt: skip


def random_model(
    joint_count: int = 35, vertex_count: int = 12, beta_count: int = 4, seed: int = 0
) -> SmalModel:
    """A body without meaning, of SMAL's structure."""
    g = torch.Generator().manual_seed(seed)

    def draw(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=g, dtype=torch.float64)

    return SmalModel(
        v_template=draw(vertex_count, 3),
        faces=torch.randint(vertex_count, (2 * vertex_count, 3), generator=g),
        shapedirs=0.1 * draw(vertex_count, 3, beta_count),
        posedirs=0.05 * draw(vertex_count, 3, 9 * (joint_count - 1)),
        J_regressor=torch.softmax(draw(joint_count, vertex_count), dim=1),
        weights=torch.softmax(3 * draw(vertex_count, joint_count), dim=1),
        parents=PARENTS_35[:joint_count],
        joint_names=NAMES_35[:joint_count],
        landmarks={"nose": (0,), "chin": (1, 2, 3)},
    )


def plain_reference(
    model: SmalModel, betas: Tensor, pose: Tensor, trans: Tensor
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One body posed vertex by vertex, joint by joint, with 4x4 matrices."""
    template, shapedirs, posedirs = (
        model.v_template.numpy(),
        model.shapedirs.numpy(),
        model.posedirs.numpy(),
    )
    weights, parents = model.weights.numpy(), model.parents
    local = [Rotation.from_rotvec(p).as_matrix() for p in pose.numpy()]
    shaped = template.copy()
    for s, beta in enumerate(betas.numpy()):
        shaped += beta * shapedirs[:, :, s]
    rest = model.J_regressor.numpy() @ shaped
    feature = np.concatenate([(R - np.eye(3)).ravel() for R in local[1:]])
    world: list[np.ndarray] = []
    skin: list[np.ndarray] = []
    for j, R in enumerate(local):
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = R, rest[j] - (rest[parents[j]] if j else 0)
        world.append(step if j == 0 else world[parents[j]] @ step)
        back = np.eye(4)
        back[:3, 3] = -rest[j]
        skin.append(world[j] @ back)
    out = np.zeros_like(template)
    for v in range(len(template)):
        point = np.append(shaped[v] + posedirs[v] @ feature, 1.0)
        for j in range(len(parents)):
            out[v] += weights[v, j] * (skin[j] @ point)[:3]
    return (
        out + trans.numpy(),
        np.stack([w[:3, 3] for w in world]) + trans.numpy(),
        np.stack([w[:3, :3] for w in world]),
    )


@pytest.mark.parametrize(("joint_count", "vertex_count"), [(35, 12), (33, 7), (35, 40)])
def test_posing_equals_the_plain_reference(joint_count: int, vertex_count: int) -> None:
    model = random_model(joint_count, vertex_count)
    g = torch.Generator().manual_seed(1)
    betas, trans = (
        torch.randn(3, 4, generator=g, dtype=torch.float64),
        torch.randn(3, 3, generator=g, dtype=torch.float64),
    )
    pose = torch.randn(3, joint_count, 3, generator=g, dtype=torch.float64)
    body = model.posed(betas, pose, trans)
    for b in range(3):
        vertices, joints, rotations = plain_reference(model, betas[b], pose[b], trans[b])
        torch.testing.assert_close(body.vertices[b], torch.from_numpy(vertices), atol=1e-10, rtol=0)
        torch.testing.assert_close(body.joints[b], torch.from_numpy(joints), atol=1e-10, rtol=0)
        torch.testing.assert_close(
            body.R_world_joint[b], torch.from_numpy(rotations), atol=1e-10, rtol=0
        )


def test_missing_betas_are_zero() -> None:
    model = random_model()
    pose, trans = (
        0.3 * torch.ones(1, 35, 3, dtype=torch.float64),
        torch.zeros(1, 3, dtype=torch.float64),
    )
    short = model.posed(torch.tensor([[0.5, -1.0]], dtype=torch.float64), pose, trans)
    full = model.posed(torch.tensor([[0.5, -1.0, 0.0, 0.0]], dtype=torch.float64), pose, trans)
    torch.testing.assert_close(short.vertices, full.vertices, atol=1e-14, rtol=0)


def test_zero_pose_gives_the_shaped_template_and_identities() -> None:
    model = random_model()
    body = model.posed(
        torch.zeros(2, 4, dtype=torch.float64),
        torch.zeros(2, 35, 3, dtype=torch.float64),
        torch.zeros(2, 3, dtype=torch.float64),
    )
    torch.testing.assert_close(body.vertices[0], model.v_template, atol=1e-14, rtol=0)
    assert torch.equal(body.R_world_joint, torch.eye(3, dtype=torch.float64).expand(2, 35, 3, 3))


def test_gradients_are_right_and_finite_at_the_zero_pose() -> None:
    model = random_model(joint_count=33, vertex_count=4, beta_count=2)
    inputs = [
        torch.zeros(1, 2, dtype=torch.float64),
        torch.zeros(1, 33, 3, dtype=torch.float64),
        torch.zeros(1, 3, dtype=torch.float64),
    ]
    inputs[1][0, 5] = torch.tensor([0.4, -0.2, 0.9])
    for tensor in inputs:
        tensor.requires_grad_()
    assert torch.autograd.gradcheck(
        lambda *a: (model.posed(*a).vertices, model.posed(*a).joints), inputs, atol=1e-6
    )


@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")  # torch's own, the first time
def test_forward_derivatives_are_those_of_small_steps() -> None:
    model = random_model(joint_count=33, vertex_count=4, beta_count=2)
    torch.manual_seed(0)
    inputs = [0.1 * torch.randn(1, *shape, dtype=torch.float64) for shape in ((2,), (33, 3), (3,))]
    along, step = [torch.randn_like(x) for x in inputs], 1e-6
    ahead, behind = (
        model.posed(*(x + sign * step * d for x, d in zip(inputs, along, strict=True))).vertices
        for sign in (1, -1)
    )
    with forward_ad.dual_level():
        duals = [forward_ad.make_dual(x, d) for x, d in zip(inputs, along, strict=True)]  # type: ignore[no-untyped-call]
        found = forward_ad.unpack_dual(model.posed(*duals).vertices).tangent  # type: ignore[no-untyped-call]
    torch.testing.assert_close(found, (ahead - behind) / (2 * step), atol=1e-7, rtol=1e-6)


def test_turning_the_root_turns_everything_rigidly_about_it() -> None:
    model = random_model()
    g = torch.Generator().manual_seed(3)
    betas, trans = (
        torch.randn(1, 4, generator=g, dtype=torch.float64),
        torch.zeros(1, 3, dtype=torch.float64),
    )
    pose = torch.randn(1, 35, 3, generator=g, dtype=torch.float64)
    pose[0, 0] = 0
    turned = pose.clone()
    turned[0, 0] = torch.tensor([0.3, -1.2, 0.7])
    before, after = model.posed(betas, pose, trans), model.posed(betas, turned, trans)
    R = rotation_from_axis_angle(turned[0, 0])
    root = before.joints[0, 0]
    torch.testing.assert_close(
        after.vertices[0], (before.vertices[0] - root) @ R.T + root, atol=1e-12, rtol=0
    )
    torch.testing.assert_close(
        after.R_world_joint[0], R @ before.R_world_joint[0], atol=1e-12, rtol=0
    )


def test_a_batch_equals_its_members() -> None:
    model = random_model()
    g = torch.Generator().manual_seed(4)
    betas, trans = (
        torch.randn(4, 4, generator=g, dtype=torch.float64),
        torch.randn(4, 3, generator=g, dtype=torch.float64),
    )
    pose = torch.randn(4, 35, 3, generator=g, dtype=torch.float64)
    whole = model.posed(betas, pose, trans)
    for b in range(4):
        one = model.posed(betas[b : b + 1], pose[b : b + 1], trans[b : b + 1])
        torch.testing.assert_close(one.vertices[0], whole.vertices[b], atol=1e-13, rtol=0)


def test_keypoints_are_group_means_in_order() -> None:
    model = random_model()
    vertices = torch.arange(36, dtype=torch.float64).reshape(1, 12, 3)
    assert model.keypoints(vertices).tolist() == [[[0, 1, 2], [6, 7, 8]]]


def test_torso_and_tail_come_from_the_weights() -> None:
    model = random_model(vertex_count=4)
    weights = torch.zeros(4, 35, dtype=torch.float64)
    weights[0, 3] = 1.0
    weights[1, 6], weights[1, 7] = 0.85, 0.15
    weights[2, 25], weights[2, 30], weights[2, 0] = 0.3, 0.3, 0.4
    weights[3, 16] = 1.0
    parts = {
        name: getattr(model, name)
        for name in (
            "v_template",
            "shapedirs",
            "posedirs",
            "J_regressor",
            "parents",
            "joint_names",
            "landmarks",
        )
    }
    model = SmalModel(weights=weights, faces=torch.tensor([[0, 1, 3], [0, 1, 2]]), **parts)
    assert model.torso_vertices.tolist() == [0]
    assert model.tail_vertices.tolist() == [2]
    assert model.tail_faces.tolist() == [1]
    assert model.without_tail_faces().tolist() == [[0, 1, 3]]


def test_trunk_rotation_of_equal_joints_is_theirs_and_of_opposite_yaws_is_between() -> None:
    R = rotation_from_axis_angle(torch.tensor([0.2, 0.5, -1.0], dtype=torch.float64))
    torch.testing.assert_close(trunk_rotation(R.expand(35, 3, 3)), R, atol=1e-14, rtol=0)
    yaw = torch.zeros(2, 35, 3, dtype=torch.float64)
    yaw[:, 0:3, 2], yaw[:, 4:7, 2] = 0.4, -0.4
    yaw[:, 7:] = 2.0  # limbs do not count
    torch.testing.assert_close(
        trunk_rotation(rotation_from_axis_angle(yaw)),
        torch.eye(3, dtype=torch.float64).expand(2, 3, 3),
        atol=1e-14,
        rtol=0,
    )


@pytest.mark.parametrize(
    ("name", "shapes"),
    [
        ("betas", ((1, 5), (1, 35, 3), (1, 3))),
        ("betas", ((4,), (1, 35, 3), (1, 3))),
        ("pose", ((1, 4), (1, 33, 3), (1, 3))),
        ("pose", ((2, 4), (1, 35, 3), (2, 3))),
        ("trans", ((1, 4), (1, 35, 3), (3,))),
    ],
)
def test_wrong_shapes_name_the_argument(name: str, shapes: tuple[tuple[int, ...], ...]) -> None:
    with pytest.raises(ShapeError, match=f"^{name} must"):
        random_model().posed(*(torch.zeros(*shape, dtype=torch.float64) for shape in shapes))


def test_vertices_of_another_topology_are_refused() -> None:
    with pytest.raises(ShapeError, match="vertices must have shape"):
        random_model().keypoints(torch.zeros(1, 13, 3))


def test_a_skeleton_without_a_spine_has_no_trunk_rotation() -> None:
    with pytest.raises(ShapeError, match="R_world_joint"):
        trunk_rotation(torch.eye(3).expand(6, 3, 3))


def test_parts_that_do_not_fit_are_refused() -> None:
    model = random_model()
    with pytest.raises(ShapeError, match="weights must have shape"):
        replace(model, weights=model.weights[:, :34])
    with pytest.raises(ShapeError, match="landmarks"):
        replace(model, landmarks={"nose": (12,)})


def zeros(model: SmalModel, batch: int = 1, dtype: torch.dtype = torch.float64) -> list[Tensor]:
    """betas, pose and trans of nothing."""
    return [
        torch.zeros(batch, *shape, dtype=dtype)
        for shape in ((model.beta_count,), (model.joint_count, 3), (3,))
    ]


def test_bodies_are_in_the_models_type() -> None:
    model = random_model()
    for dtype in (torch.float32, torch.int64):
        body = model.posed(*zeros(model, dtype=dtype))
        assert {body.vertices.dtype, body.joints.dtype, body.R_world_joint.dtype} == {torch.float64}


@pytest.mark.parametrize("batch", [0, 2])
def test_a_model_may_have_no_shape_columns(batch: int) -> None:
    model = replace(
        random_model(),
        shapedirs=torch.zeros(len(random_model().v_template), 3, 0, dtype=torch.float64),
    )
    betas, pose, trans = zeros(model, batch)
    torch.testing.assert_close(
        model.posed(betas, pose, trans).vertices, model.v_template.expand(batch, -1, -1)
    )
    torch.testing.assert_close(
        model.posed(betas, pose.requires_grad_(), trans).vertices,
        model.v_template.expand(batch, -1, -1),
    )


@pytest.mark.parametrize("setting", ["autocast", "precision", "inference"])
def test_the_first_use_of_a_model_does_not_decide_on_all_later_ones(setting: str) -> None:
    fresh, used = (random_model(vertex_count=2000).to(torch.float32) for _ in range(2))
    inputs, precision = zeros(fresh, dtype=torch.float32), torch.get_float32_matmul_precision()
    used.posed(*inputs)
    try:
        if setting == "precision":
            torch.set_float32_matmul_precision("medium")
        with (
            torch.autocast("cpu", enabled=setting == "autocast"),
            torch.inference_mode(setting == "inference"),
        ):
            fresh.posed(*inputs)
            if setting == "inference":
                fresh.posed(inputs[0], inputs[1].clone().requires_grad_(), inputs[2])
    finally:
        torch.set_float32_matmul_precision(precision)
    inputs[1] += 0.3
    assert torch.equal(fresh.posed(*inputs).vertices, used.posed(*inputs).vertices)
    (slope,) = torch.autograd.grad(
        fresh.posed(inputs[0], inputs[1].requires_grad_(), inputs[2]).vertices.sum(), inputs[1]
    )
    assert bool(slope.any())


@pytest.mark.parametrize("name", ["v_template", "shapedirs", "posedirs", "J_regressor", "weights"])
def test_a_models_own_constants_have_gradients_call_after_call(name: str) -> None:
    model = random_model()
    constant = getattr(model, name).requires_grad_()
    for _ in range(2):
        betas, pose, trans = zeros(model)
        (slope,) = torch.autograd.grad(
            model.posed(betas + 0.1, pose + 0.1, trans).vertices.square().sum(), constant
        )
        assert bool(slope.any())

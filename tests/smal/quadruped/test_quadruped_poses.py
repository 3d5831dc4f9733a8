"""Named and random poses of the embedded quadruped, and the limits of its joints."""

import pytest
import torch
import trimesh
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.smal.model import SmalModel, trunk_rotation
from animal3dbox.smal.quadruped.joint_limits import JOINT_LIMITS_DEG, joint_limits
from animal3dbox.smal.quadruped.poses import POSES, ground_trans, named_pose, random_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas, quadruped_names

PRESETS = quadruped_names().presets
F64 = torch.float64


@pytest.fixture(scope="module")
def model() -> SmalModel:
    return load_quadruped()


def posed(model: SmalModel, preset: str, poses: Tensor) -> Tensor:
    """Vertices (B, V, 3) of a preset in poses (B, J, 3), each with its lowest point on z = 0."""
    body = model.posed(
        preset_betas(preset).expand(len(poses), -1), poses, torch.zeros(len(poses), 3, dtype=F64)
    )
    return body.vertices + ground_trans(body.vertices)[:, None]


def point(model: SmalModel, vertices: Tensor, name: str) -> Tensor:
    return vertices[..., list({**model.landmarks, **model.extra_landmarks}[name]), :].mean(dim=-2)


def volume(model: SmalModel, vertices: Tensor) -> float:
    return float(trimesh.Trimesh(vertices.numpy(), model.faces.numpy(), process=False).volume)


def test_the_poses_are_the_documented_ones() -> None:
    assert set(POSES) == {
        "stand",
        "walk",
        "trot",
        "run",
        "graze",
        "sit",
        "lie",
        "rear",
        "curl",
        "head_turned",
    }


def test_every_joint_has_limits_about_three_axes_that_mirror(model: SmalModel) -> None:
    assert set(JOINT_LIMITS_DEG) == set(model.joint_names)
    for name, (x, y, z) in JOINT_LIMITS_DEG.items():
        assert all(low <= 0 <= high for low, high in (x, y, z)), name
        if name[0] == "L":
            assert JOINT_LIMITS_DEG["R" + name[1:]] == ((-x[1], -x[0]), y, (-z[1], -z[0]))


def test_the_limits_are_radians_in_the_models_order(model: SmalModel) -> None:
    low, high = joint_limits()
    knee = model.joint_names.index("RLegBack2")
    assert low.shape == high.shape == (35, 3)
    torch.testing.assert_close(low[knee, 1], torch.tensor(-20 * torch.pi / 180, dtype=F64))
    torch.testing.assert_close(high[knee, 1], torch.tensor(118 * torch.pi / 180, dtype=F64))


@pytest.mark.parametrize("pose", POSES)
def test_a_named_pose_is_within_the_limits(pose: str) -> None:
    low, high = joint_limits()
    angles = named_pose(pose)
    assert bool(((angles >= low - 1e-12) & (angles <= high + 1e-12)).all())


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("preset", PRESETS)
def test_a_named_pose_is_finite_and_keeps_most_of_the_volume(
    model: SmalModel, pose: str, preset: str
) -> None:
    vertices = posed(model, preset, torch.stack([named_pose(pose), named_pose("stand")]))
    assert bool(torch.isfinite(vertices).all())
    assert 0.85 < volume(model, vertices[0]) / volume(model, vertices[1]) < 1.15
    assert float(vertices[0, :, 2].min()) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("preset", PRESETS)
def test_standing_gaits_keep_feet_near_the_ground(model: SmalModel, preset: str) -> None:
    names = ("stand", "walk", "trot", "head_turned") + (
        ("graze",) if preset not in ("pig", "hippo") else ()
    )  # their heads reach below
    poses, betas = (
        torch.stack([named_pose(pose) for pose in names]),
        preset_betas(preset).expand(len(names), -1),
    )
    lowest = (
        model.posed(betas, poses, torch.zeros(len(names), 3, dtype=F64))
        .vertices[..., 2]
        .amin(dim=1)
    )
    assert bool(((lowest > -0.05) & (lowest < 0.08)).all())


@pytest.mark.parametrize("preset", PRESETS)
def test_poses_are_what_their_names_say(model: SmalModel, preset: str) -> None:
    names = list(POSES)
    vertices = dict(
        zip(
            names,
            posed(model, preset, torch.stack([named_pose(name) for name in names])),
            strict=True,
        )
    )
    z = {
        name: {
            p: float(point(model, v, p)[2])
            for p in ("withers", "tail_base", "nose", "left_front_paw", "left_back_paw")
        }
        for name, v in vertices.items()
    }
    assert z["graze"]["nose"] < z["stand"]["nose"] - 0.03
    assert (
        z["sit"]["withers"] - z["sit"]["tail_base"]
        > z["stand"]["withers"] - z["stand"]["tail_base"] + 0.2
    )
    assert z["lie"]["withers"] < 0.9 * z["stand"]["withers"]
    assert z["rear"]["left_front_paw"] > z["rear"]["left_back_paw"] + 0.2
    assert z["rear"]["withers"] > z["stand"]["withers"]
    nose, tail = point(model, vertices["curl"], "nose"), point(model, vertices["curl"], "tail_tip")
    stood = float(
        (
            point(model, vertices["stand"], "nose") - point(model, vertices["stand"], "tail_tip")
        ).norm()
    )
    assert float((nose - tail).norm()) < 0.75 * stood
    strides = {
        name: float(
            (
                point(model, vertices[name], "left_front_paw")
                - point(model, vertices[name], "left_back_paw")
            )[0]
        )
        for name in names
    }
    assert strides["run"] > strides["trot"] > strides["stand"]


def test_random_poses_are_seeded_plausible_and_do_not_turn_the_trunk_far(model: SmalModel) -> None:
    poses = torch.stack([random_pose(torch.Generator().manual_seed(seed)) for seed in range(50)])
    low, high = joint_limits()
    assert bool(((poses >= low) & (poses <= high)).all())
    assert float(poses[:, 0].abs().max()) == 0.0
    assert torch.equal(poses[3], random_pose(torch.Generator().manual_seed(3)))
    assert float((poses[0] - poses[1]).abs().max()) > 0.05
    body = model.posed(
        preset_betas("dog")[None].expand(50, -1), poses, torch.zeros(50, 3, dtype=F64)
    )
    assert bool(torch.isfinite(body.vertices).all())
    assert (
        float(trunk_rotation(body.R_world_joint)[:, 0, 0].min()) > 0.9
    )  # forward is still forward


def test_an_unknown_pose_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"stand, walk.*'fly'"):
        named_pose("fly")

"""The embedded quadruped, from its asset."""

import io
import os
import subprocess
import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.poses import random_pose
from animal3dbox.smal.quadruped.preset_bodies import (
    load_quadruped,
    measure_betas,
    preset_betas,
    quadruped_names,
)

KEYPOINTS = [
    "left_eye", "right_eye", "chin", "left_front_paw", "right_front_paw", "left_back_paw",
    "right_back_paw", "tail_base",
    "left_front_elbow", "right_front_elbow", "left_back_knee", "right_back_knee",
    "left_shoulder_blade", "right_shoulder_blade", "left_front_wrist",
    "right_front_wrist", "left_back_hock", "right_back_hock", "neck", "tail_tip", "left_ear",
    "right_ear", "left_mouth", "right_mouth",
    "nose", "tail_middle",
]  # fmt: skip
PRESETS = ("dog", "cat", "horse", "cow", "bear", "deer", "zebra", "pig", "hippo", "lion")
FLIP = [
    1,
    0,
    2,
    4,
    3,
    6,
    5,
    7,
    9,
    8,
    11,
    10,
    13,
    12,
    15,
    14,
    17,
    16,
    18,
    19,
    21,
    20,
    23,
    22,
    24,
    25,
]
PARENTS = (
    -1,
    0,
    1,
    2,
    3,
    4,
    5,
    6,
    7,
    8,
    9,
    6,
    11,
    12,
    13,
    6,
    15,
    0,
    17,
    18,
    19,
    0,
    21,
    22,
    23,
    0,
    25,
    26,
    27,
    28,
    29,
    30,
    16,
    16,
    16,
)
JOINTS = [
    "pelvis", "pelvis0", "spine", "spine0", "spine1", "spine2", "spine3", "LLeg1", "LLeg2", "LLeg3",
    "LFoot", "RLeg1", "RLeg2", "RLeg3",
    "RFoot", "Neck", "Head", "LLegBack1", "LLegBack2", "LLegBack3", "LFootBack", "RLegBack1",
    "RLegBack2", "RLegBack3", "RFootBack",
    "Tail1", "Tail2", "Tail3", "Tail4", "Tail5", "Tail6", "Tail7", "Mouth", "LEar", "REar",
]  # fmt: skip
MIRROR = torch.tensor([1.0, -1.0, 1.0], dtype=torch.float64)


@pytest.fixture(scope="module")
def model() -> SmalModel:
    return load_quadruped()


def shape(model: SmalModel, **amounts: float) -> Tensor:
    return model.shaped(measure_betas(amounts)[None])[0]


def symmetry(model: SmalModel) -> Tensor:
    assert model.symmetry is not None
    return model.symmetry


def vertex_groups(model: SmalModel) -> dict[str, tuple[int, ...]]:
    """The landmarks that are groups of vertices: name -> ids."""
    return {**model.landmarks, **model.extra_landmarks}


def point(model: SmalModel, vertices: Tensor, name: str) -> Tensor:
    return vertices[list(vertex_groups(model)[name])].mean(dim=0)


def apart(model: SmalModel, vertices: Tensor, a: str, b: str) -> float:
    return float((point(model, vertices, a) - point(model, vertices, b)).norm())


def joint(model: SmalModel, vertices: Tensor, name: str) -> Tensor:
    return model.J_regressor[model.joint_names.index(name)] @ vertices


def winding_number(corners: Tensor, place: Tensor) -> float:
    """How often faces (F, 3, 3) go round a place.

    1 inside a closed surface, 0 outside (van Oosterom and Strackee).
    """
    a, b, c = (corners - place).unbind(dim=1)
    la, lb, lc = a.norm(dim=1), b.norm(dim=1), c.norm(dim=1)
    flat = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float((torch.atan2((a * torch.linalg.cross(b, c)).sum(1), flat)).sum() / (2 * torch.pi))


def as_trimesh(model: SmalModel, vertices: Tensor) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices.numpy(), model.faces.numpy(), process=False)


def test_it_has_smals_structure(model: SmalModel) -> None:
    assert model.joint_names == tuple(JOINTS)
    assert model.parents == PARENTS
    assert list(model.landmarks) == KEYPOINTS
    assert model.shapedirs.shape[2] == 41
    assert 3000 <= model.vertex_count <= 6000
    assert model.v_template.dtype == torch.float64
    names = quadruped_names()
    assert len(set(names.columns)) == 41 > len(names.measures) >= 12
    assert names.presets == PRESETS
    assert set(load_quadruped().extra_landmarks) == {
        "withers",
        "throat",
        *(
            f"{s}_{n}"
            for s in ("left", "right")
            for n in ("hip", "ear_base", "ear_tip", "shoulder_point")
        ),
    }


def test_the_asset_is_small_plain_and_says_where_it_comes_from() -> None:
    data = resources.files("animal3dbox.smal").joinpath("assets/quadruped.npz").read_bytes()
    assert len(data) < 1.2e6
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        assert all(arrays[key].dtype.kind in "iufU" for key in arrays.files)
        assert "no SMAL data" in str(arrays["provenance"])


@pytest.mark.parametrize("preset", [None, *PRESETS])
def test_it_is_one_closed_outward_surface(model: SmalModel, preset: str | None) -> None:
    vertices = shape(model, **({preset: 1.0} if preset else {}))
    mesh = as_trimesh(model, vertices)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert mesh.volume > 0.01
    assert mesh.area_faces.min() > 0
    assert (
        mesh.face_adjacency_angles > 2.8
    ).mean() < 0.01  # hardly an edge is folded back on itself


def test_the_mirror_is_an_exact_involution_of_everything(model: SmalModel) -> None:
    s = symmetry(model)
    names = [{"L": "R", "R": "L"}.get(n[0], n[0]) + n[1:] for n in JOINTS]
    swap = [JOINTS.index(n) for n in names]
    assert torch.equal(s[s], torch.arange(model.vertex_count))
    assert torch.equal(model.v_template[s] * MIRROR, model.v_template)
    assert torch.equal(model.shapedirs[s] * MIRROR[:, None], model.shapedirs)
    assert torch.equal(model.weights[s][:, swap], model.weights)
    torch.testing.assert_close(model.J_regressor[swap][:, s], model.J_regressor, atol=1e-15, rtol=0)
    triples = {tuple(sorted(face)) for face in model.faces.tolist()}
    assert {tuple(sorted(face)) for face in s[model.faces].tolist()} == triples


def test_a_mirrored_pose_gives_the_mirrored_body(model: SmalModel) -> None:
    swap = [JOINTS.index({"L": "R", "R": "L"}.get(n[0], n[0]) + n[1:]) for n in JOINTS]
    pose = random_pose(torch.Generator().manual_seed(2))
    pose_mirrored = pose[swap] * torch.tensor([-1.0, 1.0, -1.0], dtype=torch.float64)
    betas, trans = preset_betas("dog")[None].expand(2, -1), torch.zeros(2, 3, dtype=torch.float64)
    one, other = model.posed(betas, torch.stack([pose, pose_mirrored]), trans).vertices
    torch.testing.assert_close(other, one[symmetry(model)] * MIRROR, atol=1e-12, rtol=0)


def test_weights_are_sparse_shares(model: SmalModel) -> None:
    assert float(model.weights.min()) >= 0
    torch.testing.assert_close(
        model.weights.sum(dim=1),
        torch.ones(model.vertex_count, dtype=torch.float64),
        atol=1e-12,
        rtol=0,
    )
    assert int((model.weights > 0).sum(dim=1).max()) <= 4
    torch.testing.assert_close(
        model.J_regressor.sum(dim=1), torch.ones(35, dtype=torch.float64), atol=1e-12, rtol=0
    )


def test_every_joint_moves_some_vertices_nearly_alone(model: SmalModel) -> None:
    most = model.weights.max(dim=0).values
    assert float(most[:7].min()) > 0.3  # the vertebrae share the trunk smoothly
    assert float(most[7:].min()) > 0.5
    assert len(model.torso_vertices) > 300
    assert len(model.tail_vertices) > 40
    assert len(model.without_tail_faces()) + len(model.tail_faces) == len(model.faces)


@pytest.mark.parametrize("preset", [None, *PRESETS])
def test_joints_lie_inside_the_body(model: SmalModel, preset: str | None) -> None:
    vertices = shape(model, **({preset: 1.0} if preset else {}))
    inside = [
        winding_number(vertices[model.faces], place) > 0.5 for place in model.J_regressor @ vertices
    ]
    outside = [name for name, yes in zip(JOINTS, inside, strict=True) if not yes]
    assert not [name for name in outside if "Ear" not in name and name != "Tail1"]


@pytest.mark.parametrize("preset", [None, *PRESETS])
def test_left_is_left_and_the_pairs_are_mirror_images(model: SmalModel, preset: str | None) -> None:
    vertices = shape(model, **({preset: 1.0} if preset else {}))
    groups = vertex_groups(model)
    for name, ids in groups.items():
        y = vertices[list(ids), 1]
        if name.startswith("left_"):
            assert bool((y > 0).all()), name
            assert sorted(symmetry(model)[list(ids)].tolist()) == sorted(
                groups[name.replace("left_", "right_")]
            )
        elif not name.startswith("right_"):
            assert abs(float(y.mean())) < 1e-12, name
    for name in JOINTS:
        side = float(joint(model, vertices, name)[1])
        assert (
            side > 0.01 if name[0] == "L" else side < -0.01 if name[0] == "R" else abs(side) < 1e-12
        ), name


def test_the_mirror_permutes_keypoints_by_the_flip(model: SmalModel) -> None:
    keypoints = model.keypoints(model.v_template)
    torch.testing.assert_close(keypoints[FLIP] * MIRROR, keypoints, atol=1e-14, rtol=0)


@pytest.mark.parametrize("preset", [None, *PRESETS])
def test_the_frame_is_nose_ahead_back_up_soles_down(model: SmalModel, preset: str | None) -> None:
    v = shape(model, **({preset: 1.0} if preset else {}))
    x = {name: float(point(model, v, name)[0]) for name in KEYPOINTS}
    z = {name: float(point(model, v, name)[2]) for name in (*KEYPOINTS, "withers")}
    assert (
        x["nose"]
        > x["left_eye"]
        > x["left_shoulder_blade"]
        > x["left_front_elbow"]
        > x["left_back_knee"]
        > x["left_back_hock"]
        > x["tail_tip"]
    )
    assert x["tail_base"] > x["tail_middle"]
    assert (
        z["withers"]
        > z["left_shoulder_blade"]
        > z["left_front_elbow"]
        > z["left_front_wrist"]
        > z["left_front_paw"]
    )
    assert z["left_back_knee"] > z["left_back_hock"] > z["left_back_paw"]
    assert abs(float(v[:, 2].min())) < 0.02
    assert 0.8 < float(v[:, 0].max() - v[:, 0].min()) < 1.4


MEASURED = {
    "size": lambda m, v: float(v[:, 2].max() - v[:, 2].min()),
    "leg_length": lambda m, v: apart(m, v, "left_front_elbow", "left_front_paw"),
    "leg_thickness": lambda m, v: float(
        np.ptp(v[m.weights[:, JOINTS.index("LLeg3")] > 0.7][:, 1].numpy())
    ),
    "foot_size": lambda m, v: float(
        np.ptp(v[m.weights[:, JOINTS.index("LFoot")] > 0.7][:, 1].numpy())
    ),
    "trunk_length": lambda m, v: float(joint(m, v, "LLeg1")[0] - joint(m, v, "LLegBack1")[0]),
    "trunk_width": lambda m, v: float(v[m.torso_vertices, 1].max()),
    "chest_depth": lambda m, v: float(point(m, v, "withers")[2] - v[under(m, 0.2, 0.25), 2].min()),
    "belly": lambda m, v: float(point(m, v, "withers")[2] - v[under(m, -0.06, 0.06), 2].min()),
    "neck_length": lambda m, v: float((joint(m, v, "Head") - joint(m, v, "Neck")).norm()),
    "neck_thickness": lambda m, v: float(v[m.weights[:, JOINTS.index("Neck")] > 0.7][:, 1].max()),
    "neck_raise": lambda m, v: float(joint(m, v, "Head")[2]),
    "head_size": lambda m, v: apart(m, v, "nose", "left_ear_base"),
    "muzzle_length": lambda m, v: apart(m, v, "nose", "left_eye"),
    "ear_size": lambda m, v: apart(m, v, "left_ear_base", "left_ear_tip"),
    "tail_length": lambda m, v: float((joint(m, v, "Tail7") - joint(m, v, "Tail1")).norm()),
    "tail_thickness": lambda m, v: float(v[m.weights[:, JOINTS.index("Tail4")] > 0.5][:, 1].max()),
}


def under(model: SmalModel, low: float, high: float) -> Tensor:
    """The trunk's vertices between two places along the template."""
    x = model.v_template[model.torso_vertices, 0]
    return model.torso_vertices[(x > low) & (x < high)]


@pytest.mark.parametrize("measure", quadruped_names().measures)
def test_a_measure_column_changes_its_measure_steadily(model: SmalModel, measure: str) -> None:
    values = [
        MEASURED[measure](model, shape(model, **{measure: amount}))
        for amount in (-2.0, -1.0, 0.0, 1.0, 2.0)
    ]
    steps = np.diff(values) / values[2]
    assert (steps > 0.01).all(), (measure, values)


def proportions(model: SmalModel, preset: str) -> dict[str, float]:
    v = shape(model, **{preset: 1.0})
    trunk = float(joint(model, v, "LLeg1")[0] - joint(model, v, "LLegBack1")[0])
    chest = float(point(model, v, "withers")[2] - v[under(model, -0.06, 0.25), 2].min())
    return {
        "leg": apart(model, v, "left_front_elbow", "left_front_paw") / trunk,
        "neck": float((joint(model, v, "Head") - joint(model, v, "Neck")).norm()) / trunk,
        "head": apart(model, v, "nose", "left_ear_base") / trunk,
        "muzzle": apart(model, v, "nose", "left_eye") / apart(model, v, "nose", "left_ear_base"),
        "depth": chest / trunk,
        "tail_end": float(point(model, v, "tail_tip")[0] - point(model, v, "tail_base")[0]) / trunk,
    }


def test_the_presets_differ_as_the_animals_do(model: SmalModel) -> None:
    dog, cat, horse, cow, bear, deer, zebra, pig, hippo, lion = (
        proportions(model, name) for name in PRESETS
    )
    assert horse["leg"] > dog["leg"] > cow["leg"]
    assert horse["leg"] > cat["leg"]
    assert horse["neck"] > dog["neck"] > cow["neck"]
    assert cow["depth"] > horse["depth"] > cat["depth"]
    assert horse["muzzle"] > dog["muzzle"] > cat["muzzle"]
    assert dog["leg"] > bear["leg"]
    assert bear["depth"] > dog["depth"]
    assert cat["tail_end"] < dog["tail_end"] < horse["tail_end"]
    assert (
        min(deer["leg"], horse["leg"], zebra["leg"])
        > max(dog["leg"], cow["leg"], bear["leg"])
        > pig["leg"]
        > hippo["leg"]
    )
    assert min(bear["depth"], zebra["depth"], hippo["depth"]) > deer["depth"] > cat["depth"]
    assert zebra["neck"] < horse["neck"]
    assert deer["head"] < horse["head"] < hippo["head"]
    assert deer["neck"] > bear["neck"] > hippo["neck"]
    assert lion["muzzle"] < dog["muzzle"] < hippo["muzzle"]
    assert lion["tail_end"] < bear["tail_end"] < pig["tail_end"] + 0.1


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"dog, cat, horse, cow, bear.*'unicorn'"):
        preset_betas("unicorn")
    with pytest.raises(ConfigError, match=r"leg_length.*'wings'"):
        measure_betas({"wings": 1.0})


@pytest.mark.slow
def test_the_asset_is_what_the_tables_give(tmp_path: Path) -> None:
    from animal3dbox.smal.quadruped.modelling import assemble, asset

    asset.write_asset(assemble.build_parts(), tmp_path / "fresh.npz")
    shipped = resources.files("animal3dbox.smal").joinpath("assets/quadruped.npz").read_bytes()
    with np.load(tmp_path / "fresh.npz") as fresh, np.load(io.BytesIO(shipped)) as old:
        assert fresh.files == old.files
        for key in old.files:
            if old[key].dtype.kind == "U":
                assert str(fresh[key]) == str(old[key])
            else:  # rounding may differ by a step or two of the 16-bit numbers between machines
                steps = 2.0 if key in ("vertices", "columns", "weight_values") else 1e-6
                np.testing.assert_allclose(
                    fresh[key].astype(float),
                    old[key].astype(float),
                    rtol=0,
                    atol=steps,
                    err_msg=key,
                )


def test_the_body_is_the_same_to_the_bit_on_any_number_of_threads() -> None:
    """Label caches are named by its numbers: one that is filled elsewhere must be found."""
    code = (
        "from animal3dbox.datasets.storage.fingerprint import content_digest;"
        "from animal3dbox.smal import load_quadruped;"
        "print(content_digest(load_quadruped()).hex())"
    )
    digests = set()
    for count in ("1", "2", "3"):
        threads = {"OMP_NUM_THREADS": count, "OPENBLAS_NUM_THREADS": count}
        process = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, **threads},
        )
        digests.add(process.stdout)
    assert len(digests) == 1

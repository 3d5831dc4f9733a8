import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hostile_pickles import FLAG, named, within
from safetensors.torch import load_file, save_file
from smal_pickles import (
    ROOT_PARENT,
    Arrays,
    Chumpy,
    python2_pickle,
    python3_pickle,
    random_content,
    smal_content,
    written,
)

from animal3dbox.cli.convert import convert_model
from animal3dbox.errors import ConfigError, ModelFileError
from animal3dbox.smal.files.model_files import load_family, load_model, load_smal, load_symmetry
from animal3dbox.smal.files.safetensors_file import load_safetensors, save_safetensors
from animal3dbox.smal.keypoints.smal_topology import (
    SMAL_EXTRA_LANDMARKS,
    SMAL_JOINTS,
    SMAL_LANDMARKS,
    SMAL_PARENTS,
    misplaced_sides,
)
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

TENSORS = ("v_template", "faces", "shapedirs", "posedirs", "J_regressor", "weights")


def store(path: Path, content: Any, protocol: int = 2) -> Path:
    path.write_bytes(
        python2_pickle(content, protocol) if protocol <= 2 else python3_pickle(content, protocol)
    )
    return path


def unwrapped(content: Arrays) -> dict[str, Any]:
    return {key: value.x if isinstance(value, Chumpy) else value for key, value in content.items()}


def assert_same(one: SmalModel, other: SmalModel) -> None:
    """Bit by bit."""
    for name in TENSORS:
        assert getattr(one, name).dtype == getattr(other, name).dtype, name
        assert torch.equal(getattr(one, name), getattr(other, name)), name
    assert (one.parents, one.joint_names) == (other.parents, other.joint_names)


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("chumpy", [False, True])
def test_a_smal_file_gives_the_numbers_it_holds(
    tmp_path: Path, protocol: int, chumpy: bool
) -> None:
    content = random_content(chumpy=chumpy)
    model = load_smal(store(tmp_path / "smal.pkl", content, protocol))
    arrays = unwrapped(content)
    for name in ("v_template", "shapedirs", "posedirs", "weights"):
        np.testing.assert_array_equal(getattr(model, name).numpy(), arrays[name])
        assert getattr(model, name).dtype == torch.float64
    np.testing.assert_array_equal(model.faces.numpy(), arrays["f"])
    assert model.faces.dtype == torch.int64
    np.testing.assert_array_equal(model.J_regressor.numpy(), arrays["J_regressor"].toarray())
    assert (model.parents, model.joint_names, model.landmarks) == (SMAL_PARENTS, SMAL_JOINTS, {})


@pytest.mark.parametrize("protocol", [0, 1, 2])
def test_the_quadruped_survives_a_smal_file_bit_by_bit(tmp_path: Path, protocol: int) -> None:
    quadruped = load_quadruped()
    path = tmp_path / "quadruped.pkl"
    path.write_bytes(written(smal_content(quadruped), protocol))
    model = load_smal(path, landmarks=quadruped.landmarks, symmetry=quadruped.symmetry)
    assert_same(model, quadruped)
    assert model.landmarks == quadruped.landmarks


@pytest.mark.parametrize(("joints", "betas"), [(35, 41), (33, 41), (35, 145), (25, 10)])
def test_relatives_with_other_joints_and_betas_are_read(
    tmp_path: Path, joints: int, betas: int
) -> None:
    model = load_smal(store(tmp_path / "smal.pkl", random_content(joints=joints, betas=betas)))
    assert (model.joint_count, model.beta_count, model.posedirs.shape[2]) == (
        joints,
        betas,
        9 * (joints - 1),
    )
    expected = SMAL_JOINTS[:joints] if joints >= 33 else tuple(f"joint{j}" for j in range(joints))
    assert model.joint_names == expected


def test_the_facts_about_smal_are_those_of_the_quadruped_and_of_animal3d() -> None:
    assert load_quadruped().joint_names == SMAL_JOINTS
    assert load_quadruped().parents == SMAL_PARENTS
    assert tuple((name,) for name in SMAL_LANDMARKS) == VOCABULARIES["animal3d26"].landmarks
    ids = [i for group in SMAL_LANDMARKS.values() for i in group]
    assert len(set(ids)) == len(ids) == 111
    assert 0 <= min(ids) < max(ids) < 3889


def test_smals_own_landmarks_are_used_for_its_vertex_count_alone(tmp_path: Path) -> None:
    path = store(tmp_path / "smal.pkl", random_content(3889, 50))
    model = load_smal(path)
    assert (model.landmarks, model.extra_landmarks) == (SMAL_LANDMARKS, SMAL_EXTRA_LANDMARKS)
    assert misplaced_sides(model.v_template, model.landmarks) == ()
    mirrored = model.v_template * torch.tensor([1.0, -1.0, 1.0])
    assert set(misplaced_sides(mirrored, model.landmarks)) == {
        name for name in SMAL_LANDMARKS if name.startswith("left_")
    }
    assert load_smal(path, landmarks={"nose": [7]}).landmarks == {"nose": (7,)}
    assert load_smal(store(tmp_path / "other.pkl", random_content(3890, 50))).landmarks == {}


def test_parents_are_read_from_the_ids_of_kintree_table_and_not_assumed(tmp_path: Path) -> None:
    content = random_content(joints=5)
    content["kintree_table"] = np.array([[-1, 40, 40, 20, 10], [40, 20, 10, 7, 3]])
    assert load_smal(store(tmp_path / "ids.pkl", content)).parents == (-1, 0, 0, 1, 2)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ([[ROOT_PARENT, 0, 2], [0, 1, 1]], r"kintree_table must name each joint once in row 1"),
        ([[ROOT_PARENT, 2, 0], [0, 1, 2]], r"column 1 \(joint 1\) has parent 2"),
        ([[0, 0, 1], [0, 1, 2]], r"column 0 \(joint 0\) has parent 0"),
        ([[ROOT_PARENT, 0, 9], [0, 1, 2]], r"column 2 \(joint 2\) has parent 9"),
        ([[ROOT_PARENT, ROOT_PARENT, 0], [0, 1, 2]], r"column 1 \(joint 1\) has parent 4294967295"),
        ([[ROOT_PARENT, 0, 1]], r"kintree_table must have shape \(2, J\), got \(1, 3\)"),
    ],
)
def test_a_tree_that_is_none_is_refused(
    tmp_path: Path, table: list[list[int]], message: str
) -> None:
    content = {**random_content(joints=3), "kintree_table": np.array(table, dtype=np.uint32)}
    with pytest.raises(ModelFileError, match=message):
        load_smal(store(tmp_path / "smal.pkl", content))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("v_template", np.zeros((12, 4)), r"v_template must have shape \(V, 3\), got \(12, 4\)"),
        (
            "v_template",
            np.full((12, 3), np.nan),
            r"v_template must be finite, but 36 of its 36 values",
        ),
        (
            "f",
            np.full((4, 3), 12, np.uint32),
            r"f must hold vertex numbers from 0 to 11, got 12 to 12",
        ),
        (
            "f",
            np.full((4, 3), -1, np.int32),
            r"f must hold vertex numbers from 0 to 11, got -1 to -1",
        ),
        ("f", np.zeros((4, 3)), r"f must hold whole numbers, got float64"),
        ("f", np.zeros((0, 3), np.uint32), r"f must have shape \(F, 3\), got \(0, 3\)"),
        (
            "shapedirs",
            np.zeros((11, 3, 41)),
            r"shapedirs must have shape \(12, 3, S\), got \(11, 3, 41\)",
        ),
        (
            "posedirs",
            np.zeros((12, 3, 288)),
            r"posedirs must have shape \(12, 3, 306\), got \(12, 3, 288\)",
        ),
        (
            "weights",
            np.zeros((12, 35)),
            r"weights must be shares whose rows sum to 1, got sums from 0 to 0",
        ),
        ("weights", np.zeros((12, 33)), r"weights must have shape \(12, 35\), got \(12, 33\)"),
        ("weights", np.full((12, 35), True), r"weights must hold numbers, got bool"),
        (
            "J_regressor",
            np.zeros((33, 12)),
            r"J_regressor must have shape \(35, 12\), got \(33, 12\)",
        ),
        ("J_regressor", "none", r"J_regressor: expected an array, got a str of length 4"),
    ],
)
def test_a_key_that_does_not_fit_is_named_with_what_was_expected(
    tmp_path: Path, key: str, value: object, message: str
) -> None:
    path = store(tmp_path / "smal.pkl", {**random_content(), key: value})
    with pytest.raises(ModelFileError, match=rf"^{path}: {message}.*; "):
        load_smal(path)


def test_missing_keys_and_other_contents_are_named(tmp_path: Path) -> None:
    content = random_content()
    del content["posedirs"]
    with pytest.raises(
        ModelFileError, match=r"the key posedirs is missing; there are J_regressor, bs_style,"
    ):
        load_smal(store(tmp_path / "smal.pkl", content))
    with pytest.raises(
        ModelFileError, match=r"expected a dictionary with v_template, .*got a list of length 2"
    ):
        load_smal(store(tmp_path / "list.pkl", [1, 2]))


def test_a_landmark_outside_the_model_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ModelFileError, match=r"landmarks\['nose'\] must hold vertex ids in 0\.\.11"
    ):
        load_smal(store(tmp_path / "smal.pkl", random_content()), landmarks={"nose": [12]})


def test_a_symmetry_that_does_not_fit_the_model_is_refused(tmp_path: Path) -> None:
    path = store(tmp_path / "smal.pkl", random_content())
    with pytest.raises(ModelFileError, match=r"symmetry must have shape \(12\), got \(11,\)"):
        load_smal(path, symmetry=torch.arange(11))
    with pytest.raises(
        ModelFileError,
        match=(
            r"symmetry must be its own inverse, but 12 of 12 vertices do not come back: 0 -> 1 -> 2"
        ),
    ):
        load_smal(path, symmetry=torch.arange(12).roll(-1))


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("form", ["list", "array", "objects"])
def test_the_shape_families_are_read(tmp_path: Path, protocol: int, form: str) -> None:
    rng = np.random.default_rng(0)
    means, members = rng.normal(size=(5, 41)), rng.normal(size=(5, 41, 41))
    objects = np.empty(5, dtype=object)
    objects[:] = list(members)
    stored = {"list": list(members), "array": members, "objects": objects}[form]
    path = tmp_path / "family.pkl"
    path.write_bytes(
        python3_pickle(
            {"cluster_means": means, "cluster_cov": stored, "eigs": np.zeros(3)}, protocol
        )
    )
    family = load_family(path)
    np.testing.assert_array_equal(family.means.numpy(), means)
    np.testing.assert_array_equal(family.covariances.numpy(), members)


def test_shape_families_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    means = np.zeros((5, 41))
    for covariances, message in (
        (
            np.zeros((4, 41, 41)),
            r"cluster_cov: expected an array of shape \(5, 41, 41\), got \(4, 41, 41\)",
        ),
        (
            [np.zeros((41, 40))] * 5,
            r"cluster_cov: expected an array of shape \(41, 41\), got \(41, 40\)",
        ),
        ([], r"cluster_cov: expected 5 arrays of shape \(41, 41\), got 0"),
        (np.full((5, 41, 41), np.inf), "must be finite"),
        (np.full((5, 41, 41), True), "cluster_cov must hold numbers, got bool"),
        (np.float64(1), r"expected an array of shape \(5, 41, 41\), got \(\)"),
        (None, "cluster_cov: expected an array, got None"),
    ):
        with pytest.raises(ModelFileError, match=message):
            load_family(
                store(tmp_path / "family.pkl", {"cluster_means": means, "cluster_cov": covariances})
            )


@pytest.mark.parametrize("form", ["array", "float", "list", "dictionary"])
def test_symmetry_is_read_and_must_be_an_involution(tmp_path: Path, form: str) -> None:
    swap = np.array([1, 0, 2, 4, 3])
    value = {
        "array": swap,
        "float": swap.astype(float),
        "list": swap.tolist(),
        "dictionary": {"symIdx": swap},
    }[form]
    symmetry = load_symmetry(store(tmp_path / "symIdx.pkl", value), vertex_count=5)
    assert symmetry.dtype == torch.int64
    assert symmetry.tolist() == swap.tolist()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (
            np.array([1, 2, 0]),
            "symIdx must be its own inverse, but 3 of 3 vertices do not come back: 0 -> 1 -> 2",
        ),
        (np.array([0, 1, 3]), "symIdx must hold 3 vertex numbers from 0 to 2"),
        (np.array([0, -1, 1]), "symIdx must hold 3 vertex numbers from 0 to 2"),
        (np.array([0, 1.5, 2]), "symIdx must hold whole numbers"),
        (np.array([0, np.nan, np.inf]), "symIdx must hold whole numbers"),
        (np.zeros((3, 1), int), r"symIdx must have shape \(3\), got \(3, 1\)"),
        (np.arange(4), r"symIdx must have shape \(3\), got \(4,\)"),
        ({"other": 1}, "the key symIdx is missing; there are other"),
    ],
)
def test_a_symmetry_that_is_none_is_refused(tmp_path: Path, value: object, message: str) -> None:
    with pytest.raises(ModelFileError, match=message):
        load_symmetry(store(tmp_path / "symIdx.pkl", value), vertex_count=3)


def test_a_safetensors_file_gives_back_the_model_bit_by_bit(tmp_path: Path) -> None:
    quadruped, path = load_quadruped(), tmp_path / "quadruped.safetensors"
    save_safetensors(quadruped, path)
    first = path.read_bytes()
    model = load_safetensors(path)
    assert_same(model, quadruped)
    assert (list(model.landmarks.items()), model.extra_landmarks) == (
        list(quadruped.landmarks.items()),
        quadruped.extra_landmarks,
    )
    assert model.symmetry is not None
    assert quadruped.symmetry is not None
    assert torch.equal(model.symmetry, quadruped.symmetry)
    save_safetensors(model, path)
    assert path.read_bytes() == first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["quadruped.safetensors"]


def changed(
    tmp_path: Path,
    tensors: dict[str, Any] | None = None,
    names: dict[str, Any] | None = None,
    metadata: dict[str, str] | None = None,
) -> Path:
    """A model's safetensors file with some parts replaced, or left out if they are None."""
    path = tmp_path / "model.safetensors"
    save_safetensors(load_smal(store(tmp_path / "smal.pkl", random_content(joints=3))), path)
    parts = {
        key: value
        for key, value in {**load_file(path), **(tensors or {})}.items()
        if value is not None
    }
    text = {
        "schema": "animal3dbox.smal_model",
        "version": 1,
        "parents": [-1, 0, 1],
        "joint_names": ["a", "b", "c"],
        "landmarks": {},
        "extra_landmarks": {},
    }
    text = {key: value for key, value in {**text, **(names or {})}.items() if value is not None}
    save_file(
        parts, path, metadata={"smal_model": json.dumps(text)} if metadata is None else metadata
    )
    return path


def test_an_unchanged_safetensors_file_of_the_tests_is_read(tmp_path: Path) -> None:
    assert load_safetensors(changed(tmp_path)).joint_names == ("a", "b", "c")
    assert load_safetensors(changed(tmp_path, {"symmetry": torch.arange(12)})).symmetry is not None


@pytest.mark.parametrize(
    ("tensors", "names", "message"),
    [
        ({"weights": None}, {}, r"missing \['weights'\], unknown \[\]"),
        ({"payload": torch.zeros(1)}, {}, r"missing \[\], unknown \['payload'\]"),
        ({"faces": torch.zeros(4, 3)}, {}, "faces must be int64, got torch.float32"),
        (
            {"faces": torch.full((4, 3), 12)},
            {},
            "faces must hold vertex numbers from 0 to 11, got 12 to 12",
        ),
        ({"faces": torch.zeros((0, 3), dtype=torch.int64)}, {}, "got no faces"),
        (
            {"weights": torch.zeros(12, 3)},
            {},
            r"must all be float64 or all float32, got \['torch.float32', 'torch.float64'\]",
        ),
        (
            {"weights": torch.zeros(12, 3, dtype=torch.float64)},
            {},
            "weights must be shares whose rows sum to 1",
        ),
        (
            {"v_template": torch.full((12, 3), torch.inf, dtype=torch.float64)},
            {},
            "v_template must be finite",
        ),
        (
            {"posedirs": torch.zeros((12, 3, 9), dtype=torch.float64)},
            {},
            r"posedirs must have shape \(12, 3, 18\), got \(12, 3, 9\)",
        ),
        ({"symmetry": torch.arange(12).roll(1)}, {}, "symmetry must be its own inverse"),
        ({}, {"parents": [-1, 2, 0]}, "parents must be -1 and then an earlier joint"),
        ({}, {"parents": []}, "parents must name at least the root"),
        ({}, {"joint_names": ["a"]}, "joint_names must name 3 joints"),
        ({}, {"landmarks": {"nose": [12]}}, r"landmarks\['nose'\] must hold vertex ids in 0\.\.11"),
        ({}, {"landmarks": {"nose": ["1"]}}, "breaks the schema: Expected `int`"),
        ({}, {"version": 2}, "breaks the schema: Invalid"),
        ({}, {"schema": "other"}, "breaks the schema: Invalid"),
        ({}, {"parents": None}, "breaks the schema: .*missing required field `parents`"),
        ({}, {"more": 1}, "breaks the schema: .*unknown field `more`"),
    ],
)
def test_a_safetensors_file_that_breaks_the_schema_is_refused(
    tmp_path: Path, tensors: dict[str, Any], names: dict[str, Any], message: str
) -> None:
    path = changed(tmp_path, tensors, names)
    with pytest.raises(ModelFileError, match=message) as caught:
        load_safetensors(path)
    assert str(path) in str(caught.value)


def test_files_that_are_no_model_in_safetensors_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ModelFileError, match="its metadata has no 'smal_model'; convert the SMAL file again"
    ):
        load_safetensors(changed(tmp_path, metadata={}))
    with pytest.raises(ModelFileError, match="breaks the schema"):
        load_safetensors(changed(tmp_path, metadata={"smal_model": "[" * 100_000}))
    whole = changed(tmp_path)
    for data in (b"", b"\x80\x02N.", b"\xff" * 100, whole.read_bytes()[:-9]):
        path = tmp_path / "damaged.safetensors"
        path.write_bytes(data)
        with pytest.raises(ModelFileError, match=r"damaged\.safetensors cannot be read"):
            load_safetensors(path)
    for path in (tmp_path / "absent.safetensors", tmp_path):
        with pytest.raises(ModelFileError, match="cannot be read"):
            load_safetensors(path)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, path = (
        load_smal(store(tmp_path / "smal.pkl", random_content(joints=3))),
        tmp_path / "model.safetensors",
    )
    path.write_bytes(b"old")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left"):
        save_safetensors(model, path)
    assert path.read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.safetensors", "smal.pkl"]


def test_a_new_file_takes_the_place_of_the_old_at_once(tmp_path: Path) -> None:
    model, path = (
        load_smal(store(tmp_path / "smal.pkl", random_content(joints=3))),
        tmp_path / "model.safetensors",
    )
    path.write_bytes(b"old")
    with path.open("rb") as old:  # who reads the old file meanwhile reads it to its end
        save_safetensors(model, path)
        assert old.read() == b"old"
    assert_same(load_safetensors(path), model)


def test_the_suffix_chooses_the_reader(tmp_path: Path) -> None:
    pickled, converted = (
        store(tmp_path / "smal.PKL", random_content(joints=3)),
        tmp_path / "smal.safetensors",
    )
    save_safetensors(load_model(pickled, landmarks={"nose": [3]}), converted)
    assert_same(load_model(converted), load_model(pickled))
    assert load_model(converted).landmarks == {"nose": (3,)}
    with pytest.raises(ConfigError, match="holds its own"):
        load_model(converted, landmarks={})
    with pytest.raises(
        ConfigError, match=r"must end in \.safetensors, \.pkl, \.pickle, got .*model\.npz"
    ):
        load_model(tmp_path / "model.npz")


def test_convert_model_says_in_a_line_what_it_wrote(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, target = (
        store(tmp_path / "smal.pkl", random_content(3889, 50, joints=3, betas=2)),
        tmp_path / "smal.safetensors",
    )
    assert convert_model(source, target) == 0
    out, err = capsys.readouterr()
    assert (
        out == f"{source} -> {target}: 3889 vertices, 50 faces, 3 joints, 2 betas, 26 landmarks,"
        f" {target.stat().st_size / 1e6:.1f} MB\n"
    )
    assert err == ""
    assert_same(load_model(target), load_model(source))


def test_convert_model_warns_of_a_template_that_is_not_smals(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = random_content(3889, 50, joints=3, betas=2, chumpy=False)
    content["v_template"] = np.asarray(content["v_template"]) * [1.0, -1.0, 1.0]
    assert convert_model(store(tmp_path / "smal.pkl", content), tmp_path / "smal.safetensors") == 0
    assert "left_eye, left_front_paw" in capsys.readouterr().err


def test_convert_model_refuses_other_suffixes_and_hostile_files(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"the target must end in \.safetensors, got .*smal\.npz"):
        convert_model(tmp_path / "smal.pkl", tmp_path / "smal.npz")
    hostile = tmp_path / "smal.pkl"
    hostile.write_bytes(within(named(*FLAG) + b")R"))
    with pytest.raises(
        ModelFileError,
        match=r"v_template: expected an array, got an object of hostile_target\.fire",
    ):
        convert_model(hostile, tmp_path / "smal.safetensors")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["smal.pkl"]

"""Bodies of labels.

Presets of the quadruped, and anybody's mesh with its landmarks in the file's own order.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from one_label import label_of
from photo_dataset import HW, WORDS, Scene, toy_scene, view_of
from torch import Tensor

from animal3dbox.datasets.bodies.mesh_file import MeshBody, load_mesh_body
from animal3dbox.datasets.bodies.presets import PresetBodies, species_notes
from animal3dbox.datasets.bodies.sources import ModelBody, ParametersBody, preset_body
from animal3dbox.datasets.images.rle import encode_mask
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.synthetic.scenes import synthetic_animal
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError, SampleError
from animal3dbox.geometry.rigid_transforms import rotation_angle, rotation_from_axis_angle
from animal3dbox.labels.body import Body
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.files.model_files import load_model
from animal3dbox.smal.files.safetensors_file import save_safetensors
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.parameters import SmalParameters
from animal3dbox.smal.quadruped.poses import named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

CUBE = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
V = "".join(f"v {x} {y} {z}\n" for x, y, z in CUBE)
TRIANGLES = [[4, 5, 6], [4, 6, 7], [0, 3, 2], [0, 2, 1]]
F = "f 5 6 7\nf 5 7 8\nf 1 4 3\nf 1 3 2\n"
RECORD = AnimalRecord("s7", "s7", None, HW, WORDS, np.zeros((len(WORDS), 3)), None, "dog")


def loaded(
    folder: Path, mesh: str | bytes, landmarks: str | bytes = '{"Nose": [0]}', suffix: str = ".obj"
) -> MeshBody:
    """The body of a mesh file and a landmarks file with this content."""
    path, places = folder / f"body{suffix}", folder / "landmarks.json"
    path.write_bytes(mesh.encode() if isinstance(mesh, str) else mesh)
    places.write_bytes(landmarks.encode() if isinstance(landmarks, str) else landmarks)
    return load_mesh_body(path, places)


# Meshes
# --------------------------------------------------------------------------------------------------

SEAMS = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt .5 .5\n"


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(V + F, id="plain"),
        pytest.param(V + "f 5 6 7 8\nf 1 4 3 2\n", id="quads"),
        pytest.param(
            "mtllib x.mtl\n" + V + "usemtl b\nf 5 6 7\nf 5 7 8\nusemtl a\nf 1 4 3\nf 1 3 2\n",
            id="materials",
        ),
        pytest.param(
            V + "o b\ng x\ns off\nf 5 6 7\nf 5 7 8\no a\nf 1 4 3\nf 1 3 2\n", id="objects"
        ),
        pytest.param(
            V
            + SEAMS
            + "usemtl b\nf 5/1 6/2 7/3\nf 5/5 7/2 8/1\nusemtl a\nf 1/5 4/4 3/1\nf 1/1 3/3 2/2\n",
            id="seams_and_materials",
        ),
        pytest.param(
            V + "vn 0 0 1\nvn 0 0 -1\nf 5//1 6//1 7//1\nf 5//2 7//2 8//1\nf 1//1 4//1 3//1\nf 1//2"
            " 3//2 2//2\n",
            id="normals",
        ),
        pytest.param(V + "f -4 -3 -2\nf -4 -2 -1\nf -8 -5 -6\nf -8 -6 -7\n", id="counted_back"),
        pytest.param("".join(f"v {x} {y} {z} 1 0 0\n" for x, y, z in CUBE) + F, id="colours"),
        pytest.param((V + F).replace("\n", "\r\n"), id="windows"),
        pytest.param(V + F.replace("5 6 7", "5 6 \\\n 7"), id="continued_line"),
        pytest.param(
            (V + F.replace("5 6 7", "5 6 \\\n 7")).replace("\n", "\r\n"),
            id="continued_line_of_windows",
        ),
        pytest.param(
            "# by Zoë\n#\tv 9 9 9\n".encode("latin-1") + V.encode() + b"\n  \n" + F.encode(),
            id="comments_that_are_not_utf8",
        ),
    ],
)
def test_an_obj_keeps_the_vertices_and_faces_of_its_file(tmp_path: Path, text: str | bytes) -> None:
    body = loaded(tmp_path, text)
    assert body.vertices.tolist() == [list(map(float, point)) for point in CUBE]
    assert body.faces.tolist() == TRIANGLES
    assert (body.vertices.dtype, body.faces.dtype) == (torch.float64, torch.int64)


def test_vertices_that_no_face_uses_still_count(tmp_path: Path) -> None:
    body = loaded(tmp_path, "v 9 9 9\n" + V + "f 6 7 8\n", '{"Nose": [0], "Chin": [1]}')
    assert body.points["Nose"].tolist() == [9, 9, 9]
    assert body.points["Chin"].tolist() == [0, 0, 0]


def test_indices_that_count_back_do_so_from_their_own_line(tmp_path: Path) -> None:
    body = loaded(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -3 -2 -1\n")
    assert body.faces.tolist() == [[0, 1, 2], [1, 2, 3]]


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """The files that are opened during the test."""
    names: list[str] = []
    watching = True

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if watching and event == "open":
            names.append(str(arguments[0]))

    sys.addaudithook(hook)  # cannot be removed again, only told to rest
    yield names
    watching = False


def test_the_material_file_that_an_obj_names_is_never_opened(
    tmp_path: Path, opened: list[str]
) -> None:
    (tmp_path / "secret.mtl").write_text("newmtl a\nmap_Kd secret.png\n")
    opened.clear()
    loaded(tmp_path, "mtllib secret.mtl\n" + V + "usemtl a\n" + F)
    ours = [Path(name).name for name in opened if name.startswith(str(tmp_path))]
    assert "body.obj" in ours
    assert not any("secret" in name for name in ours)


def exported(suffix: str) -> str | bytes:
    data: str | bytes = trimesh.Trimesh(CUBE, TRIANGLES, process=False).export(
        file_type=suffix.lower()[1:]
    )  # type: ignore[assignment]
    return data


@pytest.mark.parametrize("suffix", [".ply", ".off", ".OFF"])
def test_other_formats_keep_the_order_of_their_file(tmp_path: Path, suffix: str) -> None:
    body = loaded(tmp_path, exported(suffix), suffix=suffix)
    assert body.vertices.tolist() == [list(map(float, point)) for point in CUBE]
    assert body.faces.tolist() == TRIANGLES


def test_an_off_with_a_comment_that_is_not_utf8_is_read(tmp_path: Path) -> None:
    off = b"OFF\n# by Zo\xeb\n8 1 0\n" + V.replace("v ", "").encode() + b"3 4 5 6\n"
    assert loaded(tmp_path, off, suffix=".off").faces.tolist() == [[4, 5, 6]]


def test_an_stl_has_three_vertices_a_face_in_the_order_of_its_file(tmp_path: Path) -> None:
    points = '{"Nose": {"point": [1, 2, 3]}}'
    body = loaded(tmp_path, exported(".stl"), points, suffix=".stl")
    assert body.vertices[body.faces].tolist() == [
        [list(map(float, CUBE[i])) for i in face] for face in TRIANGLES
    ]
    assert len(body.vertices) == 3 * len(TRIANGLES)


def test_a_ply_with_texture_seams_keeps_its_vertices(tmp_path: Path) -> None:
    rows = [
        "ply",
        "format ascii 1.0",
        "comment TextureFile secret.png",
        "element vertex 8",
        *(f"property float {c}" for c in "xyz"),
        "element face 4",
    ]
    rows += [
        "property list uchar int vertex_indices",
        "property list uchar float texcoord",
        "end_header",
        *(f"{x} {y} {z}" for x, y, z in CUBE),
    ]
    rows += [f"3 {a} {b} {c} 6 0 {i} 1 {i} 0 1" for i, (a, b, c) in enumerate(TRIANGLES)]
    body = loaded(tmp_path, "\n".join(rows) + "\n", suffix=".ply")
    assert body.vertices.tolist() == [list(map(float, point)) for point in CUBE]
    assert body.faces.tolist() == TRIANGLES


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".off"])
@pytest.mark.parametrize(
    "data",
    [b"", b"no mesh\n", b"\0" * 300, bytes(range(256)) * 3],
    ids=["empty", "text", "zeros", "bytes"],
)
def test_a_file_that_is_no_mesh_is_refused_by_name(
    tmp_path: Path, suffix: str, data: bytes
) -> None:
    with pytest.raises(DatasetFormatError, match="body"):
        loaded(tmp_path, data, suffix=suffix)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (V.replace("v 1 0 0", "v nan 0 0") + F, "1 of their coordinates not finite"),
        (V.replace("v 1 0 0", "v 1e999 0 0") + F, "1 of their coordinates not finite"),
        (
            V.replace("v 1 0 0", "v 1 0") + F,
            (
                "cannot be read as a mesh: the line 'v 1 0' has 2 of at least 3 numbers; is the"
                " file whole? Write"
            ),
        ),
        ("v 0 0\nv 1 0\nv 1 1\nv 0 1\nf 1 2 3\n", "the line 'v 0 0' has 2 of at least 3 numbers"),
        (V[:-4], "the line 'v 0 ' has 1 of at least 3 numbers"),
        (
            V[:-8],
            "must have faces, all of its own 7 vertices: is the file whole? Write or copy it again",
        ),
        (V + F[:-2], "the line 'f 1 3 ' has 2 of at least 3 numbers"),
        (
            "",
            (
                "body.obj cannot be read as a mesh: it is empty; is the file whole? Write or copy"
                " it again"
            ),
        ),
        ("# a cube\n", "must have four vertices (V, 3) or more, got vertices of shape (0, 3)"),
        (V.replace("v 1 0 0", "v one 0 0") + F, "cannot be read as a mesh"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "vertices of shape (3, 3)"),
        (V, "must have faces, all of its own 8 vertices"),
        (V + "f 1 2 9\n", "must have faces, all of its own 8 vertices"),
        (V + "f 0 1 2\n", "must have faces, all of its own 8 vertices"),
        (V + "f -9 1 2\n", "must have faces, all of its own 8 vertices"),
        (V + "f a b c\n", "cannot be read as a mesh"),
        (V + "f\n", "cannot be read as a mesh"),
    ],
)
def test_an_obj_is_refused_when_its_geometry_is_damaged(
    tmp_path: Path, text: str, reason: str
) -> None:
    with pytest.raises(DatasetFormatError) as caught:
        loaded(tmp_path, text)
    assert str(tmp_path / "body.obj") in str(caught.value)
    assert reason in str(caught.value)


def test_an_off_that_is_cut_off_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(
        DatasetFormatError,
        match=(
            r"body\.off cannot be read as a mesh: its rows have different lengths; is the file"
            r" whole"
        ),
    ):
        loaded(tmp_path, "OFF\n8 4 0\n0 0 0\n1 0", suffix=".off")


def test_a_cloud_of_points_is_refused(tmp_path: Path) -> None:
    header = [
        "ply",
        "format ascii 1.0",
        "element vertex 8",
        *(f"property float {c}" for c in "xyz"),
        "end_header",
    ]
    with pytest.raises(DatasetFormatError, match=r"body\.ply"):
        loaded(
            tmp_path,
            "\n".join([*header, *(f"{x} {y} {z}" for x, y, z in CUBE)]) + "\n",
            suffix=".ply",
        )


def test_an_off_without_faces_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetFormatError, match=r"body\.off"):
        loaded(tmp_path, "OFF\n8 0 0\n" + V.replace("v ", ""), suffix=".off")


@pytest.mark.parametrize("name", ["body.glb", "body.fbx", "body.pkl", "body.obj.gz", "poodle"])
def test_a_mesh_of_an_unknown_kind_is_refused_with_the_kinds_there_are(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_text(V + F)
    with pytest.raises(ConfigError) as caught:
        load_mesh_body(tmp_path / name, tmp_path / "landmarks.json")
    assert all(word in str(caught.value) for word in (name, ".obj, .ply, .stl, .off", "dog"))


def test_a_missing_mesh_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"there is no file .*body\.obj"):
        load_mesh_body(tmp_path / "body.obj", tmp_path / "landmarks.json")


# Landmarks
# --------------------------------------------------------------------------------------------------


def test_a_landmark_is_the_mean_of_its_vertices_or_a_point(tmp_path: Path) -> None:
    body = loaded(
        tmp_path, V + F, '{"Nose": [1, 2], "tail_base": [0, 1, 6], "Chin": {"point": [1, 2.5, -3]}}'
    )
    assert body.points["Nose"].tolist() == [1, 0.5, 0]
    assert_near(body.points["tail_base"], torch.tensor([2 / 3, 1 / 3, 1 / 3], dtype=torch.float64))
    assert body.points["Chin"].tolist() == [1, 2.5, -3]


def assert_near(a: Tensor, b: Tensor) -> None:
    torch.testing.assert_close(a, b, atol=1e-12, rtol=0)


def test_rows_follow_the_vocabulary_and_what_the_mesh_lacks_is_nan(tmp_path: Path) -> None:
    body: Body = loaded(
        tmp_path, V + F, '{"nose": [1], "left_front_paw": [2], "Left rear leg: paw": [3]}'
    ).body(RECORD)
    known = {
        WORDS.keypoints.index("Nose"): CUBE[1],
        WORDS.keypoints.index("Left front leg: paw"): CUBE[2],
        WORDS.keypoints.index("Left rear leg: paw"): CUBE[3],
    }
    for row, point in known.items():
        assert body.landmarks[row].tolist() == list(point)
    assert torch.isfinite(body.landmarks).all(1).nonzero()[:, 0].tolist() == sorted(known)
    assert body.template is None


def test_the_keypoints_own_name_goes_before_its_landmarks(tmp_path: Path) -> None:
    body = loaded(
        tmp_path, V + F, '{"left_ear": [1], "left_ear_base": [2], "Base of left ear": [3]}'
    ).body(RECORD)
    assert body.landmarks[WORDS.keypoints.index("Base of left ear")].tolist() == list(CUBE[3])


@pytest.mark.parametrize(
    ("landmarks", "reason"),
    [
        ('{"Nose": [8]}', "Nose must be vertex ids from 0 to 7, got [8]"),
        ('{"Nose": [0, -1]}', "Nose must be vertex ids from 0 to 7, got [0, -1]"),
        ('{"Nose": []}', "Nose must be vertex ids from 0 to 7, got []"),
        ('{"Nose": [0.5]}', "Expected `int`, got `float`"),
        ('{"Nose": ["0"]}', "Expected `int`, got `str`"),
        ('{"Nose": 0}', "got `int`"),
        ('{"Nose": null}', "got `null`"),
        (
            '{"Nose": {"point": [1, 2]}}',
            'Nose must be {"point": [x, y, z]} or a list of vertex ids',
        ),
        ('{"Nose": {"point": [1, 2, 3, 4]}}', "Nose must be"),
        ('{"Nose": {"place": [1, 2, 3]}}', "Nose must be"),
        ('{"Nose": {"point": [1, 2, null]}}', "Expected `float`, got `null`"),
        ('{"Nose": {"point": [1, 2, 1e999]}}', "out of range"),
        ('{"Nose": {"point": [1, 2, NaN]}}', "NaN, which JSON does not have"),
        ('[{"Nose": [0]}]', "Expected `object`, got `array`"),
        ("Nose: 0", "is not valid JSON"),
        ("", "is empty"),
        (b'{"Nos\xff": [0]}', "is not UTF-8"),
        (
            '{"left_eyee": [0]}',
            "'left_eyee' is no landmark or keypoint; the nearest names are left_eye",
        ),
    ],
)
def test_landmarks_are_refused_by_name_and_reason(
    tmp_path: Path, landmarks: str | bytes, reason: str
) -> None:
    with pytest.raises(DatasetFormatError) as caught:
        loaded(tmp_path, V + F, landmarks)
    assert str(tmp_path / "landmarks.json") in str(caught.value)
    assert reason in str(caught.value)


def test_missing_landmarks_are_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "body.obj").write_text(V + F)
    with pytest.raises(DatasetNotFoundError, match=r"there is no file .*landmarks\.json"):
        load_mesh_body(tmp_path / "body.obj", tmp_path / "landmarks.json")


# Labels
# --------------------------------------------------------------------------------------------------


def write_scene(folder: Path, scene: Scene, R: Tensor, scale: float) -> MeshBody:
    """The scene as an OBJ in a frame and a unit of its own, its landmarks as points."""
    here, marks = scale * scene.vertices @ R.mT, scale * scene.landmarks @ R.mT
    text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in here.tolist()) + "".join(
        f"f {a} {b} {c}\n" for a, b, c in (scene.faces + 1).tolist()
    )
    places = {
        name: {"point": mark}
        for name, mark in zip(WORDS.keypoints, marks.tolist(), strict=True)
        if np.isfinite(mark).all()
    }
    return loaded(folder, text, json.dumps(places))


@pytest.mark.parametrize(
    ("azimuth_deg", "side"), [(90, "left"), (-90, "right"), (0, "front"), (180, "back")]
)
def test_a_mesh_of_any_topology_frame_and_unit_shows_the_side_the_camera_sees(
    tmp_path: Path, azimuth_deg: float, side: str
) -> None:
    scene, R = (
        toy_scene(),
        rotation_from_axis_angle(torch.tensor([0.4, -1.9, 0.8], dtype=torch.float64)),
    )
    body, view = write_scene(tmp_path, scene, R, 37.0), view_of(scene, azimuth_deg)
    record = AnimalRecord(
        "s7", "s7", None, HW, WORDS, np.array(view.joints), encode_mask(view.mask), "dog"
    )
    label = label_of(record, body, LabelConfig())
    assert isinstance(label, CuboidLabel)
    assert label.side == side
    assert (
        abs((label.azimuth_deg - azimuth_deg + 180) % 360 - 180) < 15
    )  # forward is the trunk's, which the toy's is to a few degrees
    assert label.quality.reprojection_error_px is not None
    assert label.quality.reprojection_error_px < 0.5
    assert float(torch.rad2deg(rotation_angle(label.cuboid_mesh.rotation, R))) < 15
    extent = 37 * (scene.vertices.amax(0) - scene.vertices.amin(0))
    torch.testing.assert_close(label.size, extent, rtol=0.2, atol=0)


# Presets
# --------------------------------------------------------------------------------------------------


def test_a_preset_has_every_keypoint_and_its_template() -> None:
    source = preset_body("dog")
    body = source.body(RECORD)
    assert source.name == "quadruped:dog"
    assert bool(torch.isfinite(body.landmarks).all())
    assert body.template is not None
    assert len(body.vertices) == body.template.vertex_count
    left, right = WORDS.keypoints.index("Left eye"), WORDS.keypoints.index("Right eye")
    assert float(body.landmarks[left, 1]) > 0 > float(body.landmarks[right, 1])


def test_the_preset_is_the_categorys_or_a_dog() -> None:
    source = PresetBodies()
    for category, preset in (("Snow_Leopard", "lion"), ("okapi", "dog"), ("zebra", "zebra")):
        own = source.body(replace(RECORD, category=category)).vertices
        assert torch.equal(torch.as_tensor(own), preset_body(preset).body(RECORD).vertices)
    of_all = PresetBodies("cow").body(replace(RECORD, category="zebra")).vertices
    assert torch.equal(torch.as_tensor(of_all), preset_body("cow").body(RECORD).vertices)
    assert PresetBodies("unknown").preset("zebra") == "dog"
    assert source.fingerprint != PresetBodies("cow").fingerprint
    with pytest.raises(ConfigError, match="species must be one of"):
        PresetBodies("okapi")


def test_it_is_told_which_presets_stand_for_which_categories() -> None:
    categories = ("wolf", "wolf", "okapi", "zebra")
    (note,) = species_notes("auto", categories)
    assert note.startswith(
        "species by category: 2 dog, 1 zebra; no preset is like 1 of the animals:"
    )
    assert "'okapi'" in note
    assert species_notes("auto", categories[:2]) == ()
    assert species_notes("auto", categories[3:]) == ("species by category: 1 zebra",)
    assert species_notes("cow", categories) == ()


def test_presets_differ_in_shape() -> None:
    dog, cow = preset_body("dog").body(RECORD), preset_body("cow").body(RECORD)
    assert float((dog.vertices - cow.vertices).abs().amax()) > 0.02


def test_an_unknown_preset_is_refused_with_the_presets_there_are() -> None:
    with pytest.raises(ConfigError) as caught:
        preset_body("poodle")
    assert all(word in str(caught.value) for word in ("dog", "horse", "'poodle'"))


# Parameters
# --------------------------------------------------------------------------------------------------


def parameters_record(sample_id: str, keypoints: Tensor) -> AnimalRecord:
    return AnimalRecord(
        sample_id,
        sample_id,
        None,
        (480, 640),
        VOCABULARIES["animal3d26"],
        keypoints.numpy(),
        None,
        "animal",
    )


def test_each_animals_own_parameters_give_its_body_and_its_label() -> None:
    animal = synthetic_animal(0, 3, preset="horse", pose="trot")
    parameters = SmalParameters(
        named_pose("trot").flatten(),
        preset_betas("horse"),
        torch.tensor([0.3, -0.2, 5.0], dtype=torch.float64),
    )
    source = ParametersBody(animal.model, {"horse-1": parameters})
    label = label_of(parameters_record("horse-1", animal.keypoints_2d), source, LabelConfig())
    assert isinstance(label, CuboidLabel)
    assert label.quality.orientation_rule == "torso vertices on the template"
    assert label.quality.reprojection_error_px is not None
    assert label.quality.reprojection_error_px < 60  # the focal length is guessed
    assert "1 of a model with 35 joints" in source.name


@pytest.mark.parametrize(
    ("sample_id", "pose", "says"),
    [("zebra-9", torch.zeros(105), "there are none"), ("horse-1", torch.zeros(7), "pose must be")],
)
def test_missing_or_unfit_parameters_are_faults_of_their_sample(
    sample_id: str, pose: Tensor, says: str
) -> None:
    source = ParametersBody(
        load_quadruped(), {"horse-1": SmalParameters(pose, torch.zeros(3), torch.zeros(3))}
    )
    with pytest.raises(SampleError, match=f"{sample_id}: parameters: {says}"):
        source.body(parameters_record(sample_id, torch.zeros(26, 3)))


# A model of the user's own
# --------------------------------------------------------------------------------------------


def test_a_model_of_ones_own_serves_in_its_template_pose_and_unit(tmp_path: Path) -> None:
    model = load_quadruped()
    larger = replace(
        model,
        v_template=3 * model.v_template,
        shapedirs=3 * model.shapedirs,
        posedirs=3 * model.posedirs,
    )
    save_safetensors(larger, tmp_path / "mine.safetensors")
    source = ModelBody(load_model(tmp_path / "mine.safetensors"), "mine")
    animal = synthetic_animal(0, 0, preset="dog", pose="stand")
    record = parameters_record("dog-1", animal.keypoints_2d)
    body, own = source.body(record), ModelBody(model, "own").body(record)
    assert body.landmark_sigma is not None
    assert own.landmark_sigma is not None
    torch.testing.assert_close(body.landmark_sigma, 3 * own.landmark_sigma)
    label = label_of(record, source, LabelConfig())
    assert isinstance(label, CuboidLabel)
    assert label.side is not None


def test_a_model_of_other_joints_does_not_claim_to_know_how_its_landmarks_stray() -> None:
    model = load_quadruped()
    renamed = replace(model, joint_names=tuple(f"bone{i}" for i in range(model.joint_count)))
    assert (
        ModelBody(renamed, "mine")
        .body(parameters_record("dog-1", torch.zeros(26, 3)))
        .landmark_sigma
        is None
    )


def test_a_model_without_landmarks_is_refused() -> None:
    with pytest.raises(ConfigError, match="mine has no landmarks"):
        ModelBody(replace(load_quadruped(), landmarks={}), "mine")

"""Mesh folders.

Files found by name, cameras used as they are, meshes read when asked for, every fault with sample
and field.
"""

import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from animals import camera_round, toy_mesh
from mesh_folder_dataset import (
    FOLDER_FAULTS,
    LANDMARK_IDS,
    camera_json,
    keypoints_json,
    npz_with,
    obj_text,
    write_json,
    write_mask,
    write_mesh_folder,
    write_picture,
)  # fmt: skip
from numpy.typing import NDArray
from one_label import label_of
from photo_dataset import HW, K
from PIL import Image
from smal_like import smal_like_mesh
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.cli.main import main
from animal3dbox.datasets.bodies import mesh_folder as mesh_folder_bodies
from animal3dbox.datasets.bodies.mesh_formats import read_mesh
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.formats import read_dataset, recognised_format
from animal3dbox.datasets.labelling.filters import LabelFilter
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.readers.mesh_folder.reader import MeshFolder, read_mesh_folder
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError, SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.mesh_landmarks import SMAL_NOTE
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.files.safetensors_file import save_safetensors
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

DOCS = Path(__file__).parents[3] / "docs" / "formats.md"


def labels_of(read: MeshFolder, config: LabelConfig | None = None) -> list[CuboidLabel]:
    """The labels of all records, which none may lack."""
    found = [
        label_of(record, read.bodies, config or LabelConfig()) for record in read.records.records
    ]
    return [label for label in found if isinstance(label, CuboidLabel) or pytest.fail(str(label))]


def test_known_cameras_are_used_as_they_are_and_others_found_from_keypoints(tmp_path: Path) -> None:
    read = read_mesh_folder(write_mesh_folder(tmp_path))
    assert (read.records.faults, read.records.notes) == ((), ())
    a, b = read.records.records
    assert (a.sample_id, a.image_id, a.image_hw, a.category, a.metres_per_unit) == (
        "a.jpg",
        "a.jpg",
        HW,
        "animal",
        None,
    )
    assert a.mask is not None
    R, t = camera_round(60, 12.0, 2.4)
    assert a.pose is not None
    assert_close(torch.from_numpy(a.pose[0]), R)
    assert b.pose is None
    first, second = labels_of(read)
    assert (first.side, second.side) == ("left", "right")
    assert_close(first.R, R)
    assert_close(first.t, t)
    assert first.quality.pose_source == "given"
    assert first.quality.mask_iou is not None
    assert first.quality.mask_iou > 0.98
    R, t = camera_round(250, 12.0, 2.4)
    assert_close(second.R, R, atol=1e-4, rtol=0)
    assert_close(second.t, t, atol=1e-3, rtol=0)


def test_a_guess_at_the_camera_is_one_start_among_others(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    write_json(root / "cameras" / "b.json", {**camera_json(240), "exact": False})
    record = read_mesh_folder(root).records.records[1]
    assert record.pose is None
    assert record.stored_pose is not None
    write_json(root / "cameras" / "a.json", {**camera_json(60), "exact": False})
    (fault,) = [fault for fault in map(str, _labelling_outcomes(root)) if "a.jpg" in fault]
    assert "too_few_keypoints" in fault


def test_matrices_of_a_camera_may_be_flat(tmp_path: Path) -> None:
    plain = read_mesh_folder(write_mesh_folder(tmp_path / "plain")).records.records[0]
    root = write_mesh_folder(tmp_path / "flat")
    content = camera_json(60)
    flat = {key: np.ravel(content[key]).tolist() for key in ("K", "R")}
    write_json(root / "cameras" / "a.json", {**content, **flat})
    found = read_mesh_folder(root).records
    assert found.faults == ()
    assert found.records[0].K is not None
    assert plain.K is not None
    assert np.array_equal(found.records[0].K, plain.K)
    for part, other in zip(found.records[0].pose or (), plain.pose or (), strict=True):
        assert np.array_equal(part, other)
    write_json(root / "cameras" / "a.json", {**content, "K": flat["K"][:8]})
    (fault,) = read_mesh_folder(root).records.faults
    assert (fault.sample_id, fault.field) == ("a.jpg", "camera")


def test_marked_keypoints_at_minus_one_are_missing_with_a_note(tmp_path: Path) -> None:
    plain = read_mesh_folder(write_mesh_folder(tmp_path / "plain")).records.records[1].keypoints_2d
    names = list(keypoints_json(250))
    absent = names[::4]
    rows = np.where(np.isin(names, absent)[:, None], -1.0, plain[:, :2])
    marks, minus_marks = np.ones((len(rows), 1)), np.where(rows[:, :1] == -1, -1.0, 1.0)
    files: dict[str, dict[str, list[int]] | NDArray[np.float64]] = {
        "json": {name: [-1, -1, 1] for name in absent},
        "json without marks": {name: [-1, -1] for name in absent},
        "json of marks -1": {name: [-1, -1, -1] for name in absent},
        "npy": np.hstack((rows, marks)),
        "npy of marks -1": np.hstack((rows, minus_marks)),
        "npy without marks": rows,
    }
    for kind, content in files.items():
        root = write_mesh_folder(tmp_path / kind)
        (root / "keypoints" / "b.json").unlink()
        if isinstance(content, dict):
            write_json(root / "keypoints" / "b.json", {**keypoints_json(250), **content})
        else:
            np.save(root / "keypoints" / "b.npy", content)
        read = read_mesh_folder(root).records
        assert read.faults == (), kind
        keypoints = read.records[1].keypoints_2d
        assert not keypoints[::4].any(), kind
        kept = np.arange(len(names)) % 4 != 0
        assert np.array_equal(keypoints[kept], plain[kept]), kind
        is_noted = any("(-1, -1)" in note and "b.jpg" in note for note in read.notes)
        assert is_noted == ("marks -1" not in kind)


def _labelling_outcomes(root: Path) -> list[object]:
    read = read_mesh_folder(root)
    return [label_of(record, read.bodies, LabelConfig()) for record in read.records.records]


def test_lens_and_unit_of_length_reach_the_record(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    write_json(
        root / "cameras" / "a.json",
        {**camera_json(60), "distortion": [0.1, 0, 0, 0, 0], "unit_m": 0.5},
    )
    write_json(root / "mesh_folder.json", {"unit_m": 2.0, "category": "cow"})
    a, b = read_mesh_folder(root / "mesh_folder.json").records.records
    assert a.distortion is not None
    assert a.distortion.tolist() == [0.1, 0, 0, 0, 0]
    assert (a.metres_per_unit, b.metres_per_unit) == (0.5, 2.0)
    assert (a.category, b.distortion) == ("cow", None)


def test_cameras_share_meshes_and_animals_have_numbers(tmp_path: Path) -> None:
    vertices, faces = toy_mesh()
    (tmp_path / "meshes").mkdir()
    for number in (10, 0, 2):
        (tmp_path / "meshes" / f"0007_{number}.obj").write_text(obj_text(vertices + number, faces))
    for camera, azimuth in (("north", 60), ("south", 250)):
        write_picture(tmp_path / "images" / camera / "0007.jpg")
        write_json(tmp_path / "cameras" / f"{camera}.json", camera_json(azimuth))
    write_mask(tmp_path / "masks" / "south" / "0007_2.png", 250)
    write_json(tmp_path / "keypoints" / "north" / "0007_10.json", keypoints_json(60))
    write_json(tmp_path / "landmarks.json", LANDMARK_IDS)
    read = read_mesh_folder(tmp_path)
    assert [record.sample_id for record in read.records.records] == [
        f"{camera}/0007.jpg{number}" for camera in ("north", "south") for number in ("", "#1", "#2")
    ]
    assert [read.bodies.meshes[record.sample_id].path.name for record in read.records.records] == [
        "0007_0.obj",
        "0007_2.obj",
        "0007_10.obj",
    ] * 2
    assert [record.mask_path is not None for record in read.records.records] == [False] * 4 + [
        True,
        False,
    ]
    assert [bool(record.keypoints_2d.any()) for record in read.records.records] == [
        False,
        False,
        True,
        False,
        False,
        False,
    ]
    poses = [record.pose for record in read.records.records]
    assert all(
        pose is not None and np.allclose(pose[0], camera_round(azimuth, 12.0, 2.4)[0])
        for pose, azimuth in zip(poses[::3], (60, 250), strict=True)
    )


def test_a_number_in_an_images_own_name_is_not_an_animals(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    for name in ("frame_1", "frame_2", "frame"):
        write_picture(root / "images" / f"{name}.jpg")
        (root / "meshes" / f"{name}.obj").write_text(obj_text(*toy_mesh()))
    write_json(root / "camera.json", camera_json(60))
    read = read_mesh_folder(root)
    assert [record.sample_id for record in read.records.records] == [
        "a.jpg",
        "b.jpg",
        "frame.jpg",
        "frame_1.jpg",
        "frame_2.jpg",
    ]


def test_an_animal_that_its_camera_does_not_see_is_left_out_and_counted(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    camera = camera_json(60)
    camera["t"][0] += 9.0
    (root / "masks" / "a.png").unlink()
    write_json(root / "cameras" / "a.json", camera)
    dataset = AnnotatedDataset(root)
    assert isinstance(dataset[0], Skipped)
    (case,) = dataset.report().cases
    assert (case.kind, case.sample_id, case.field) == ("filtered", "a.jpg", "allow_unseen")
    seen = AnnotatedDataset(root, filters=LabelFilter(allow_unseen=True))[0]
    assert not isinstance(seen, Skipped)


def test_a_file_whose_name_is_not_utf8_is_a_fault_of_its_own(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    for file in sorted(root.rglob("a.*")):
        try:
            file.rename(file.with_stem("\udce9"))  # a byte that is no UTF-8
        except OSError:
            pytest.skip("this file system holds Unicode names only")
    dataset = AnnotatedDataset(root, on_bad="skip")
    (fault,) = dataset.source.faults
    assert (fault.sample_id, fault.field) == ("\\udce9.jpg", "sample_id")
    assert "UTF-8" in fault.problem
    assert len(dataset) == 1
    with pytest.raises(SystemExit) as ended:
        main(["label", str(root), "--out", str(tmp_path / "out")])
    assert ended.value.code == 4
    assert r"\\udce9.jpg" in (tmp_path / "out" / "report.json").read_text()


def test_what_nothing_was_made_of_is_counted(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    write_picture(root / "images" / "c.jpg")
    write_json(root / "keypoints" / "aa.json", {})
    write_mask(root / "masks" / "b_0.png", 60)
    for file in ("masks/cam1/b.jpg", "masks/.hidden", "cameras/b.yaml"):
        (root / file).parent.mkdir(exist_ok=True)
        (root / file).touch()
    notes = read_mesh_folder(root).records.notes
    assert notes == (
        "1 of 3 images have no mesh",
        "1 files in keypoints/ belong to no animal and are not used: aa.json",
        "1 files in masks/ belong to no animal and are not used: b_0.png",
        "1 files in masks/ are no .png and are not used: cam1/b.jpg",
        "1 files in cameras/ are no .json and are not used: b.yaml",
    )


# Bodies
# --------------------------------------------------------------------------------------------------


def test_meshes_are_read_when_asked_for_and_few_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, opened = write_mesh_folder(tmp_path), list[str]()

    def watched(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        opened.append(path.name)
        return read_mesh(path)

    monkeypatch.setattr(mesh_folder_bodies, "read_mesh", watched)
    read = read_mesh_folder(root)
    assert opened == []
    a, b = read.records.records
    for record in (a, a, b, a):
        read.bodies.body(record)
    assert opened == ["a.obj", "b.obj"]
    assert mesh_folder_bodies._read.cache_info().maxsize == mesh_folder_bodies.CACHED < 100
    (root / "meshes" / "a.obj").write_text(obj_text(toy_mesh()[0] + 1.0, toy_mesh()[1]))
    assert_close(read.bodies.body(a).vertices, toy_mesh()[0] + 1.0)


def test_the_bodies_pass_to_other_processes(tmp_path: Path) -> None:
    read = read_mesh_folder(write_mesh_folder(tmp_path))
    there: MeshFolder = pickle.loads(pickle.dumps(read))
    assert len(pickle.dumps(read.bodies)) < 10_000
    for record in there.records.records:
        assert_close(there.bodies.body(record).landmarks, read.bodies.body(record).landmarks)


def test_an_npz_may_bring_its_own_landmarks(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    npz_with(
        landmarks=np.array([[1.0, 2, 3], [4, 5, 6]]), landmark_names=np.array(["nose", "tail_base"])
    )(root)
    read = read_mesh_folder(root)
    body = read.bodies.body(read.records.records[0])
    names = VOCABULARIES["animal3d26"].keypoints
    assert body.landmarks[names.index("tail_base")].tolist() == [4, 5, 6]
    assert int(torch.isfinite(body.landmarks).all(1).sum()) == 2
    assert_close(body.vertices, toy_mesh()[0])


def test_a_mesh_of_the_models_topology_gets_its_template(tmp_path: Path) -> None:
    model, root = load_quadruped(), tmp_path / "folder"
    write_picture(root / "images" / "a.jpg")
    (root / "meshes").mkdir()
    turn, t = camera_round(60, 12.0, 2.4)
    scale = 1.0 / float(model.v_template[:, 0].max() - model.v_template[:, 0].min())
    standing = (model.v_template - model.v_template.mean(0)) * scale + torch.tensor(
        [0.0, 0, 0.4], dtype=torch.float64
    )
    (root / "meshes" / "a.obj").write_text(obj_text(standing @ turn.mT + t, model.faces))
    write_json(
        root / "camera.json",
        {"focal_over_side": 1.2, "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 0]},
    )
    file = tmp_path / "model.safetensors"
    save_safetensors(model, file)
    with pytest.raises(SampleError, match=r"a\.jpg: landmarks: nothing tells .* or --model"):
        labels_of(read_mesh_folder(root))
    (label,) = labels_of(read_mesh_folder(root, model=file), LabelConfig(tail="drop"))
    assert label.quality.orientation_rule == "torso vertices on the template"
    assert_close(label.rotation, turn, atol=1e-6, rtol=0)
    order = torch.randperm(model.vertex_count, generator=torch.Generator().manual_seed(0))
    (root / "meshes" / "a.obj").write_text(obj_text(standing, order[model.faces]))
    with pytest.raises(
        SampleError,
        match=r"a\.jpg: mesh: a\.obj has .* not among those of --model .* give landmarks\.json",
    ):
        labels_of(read_mesh_folder(root, model=file))


def write_one_mesh(root: Path, vertices: Tensor, faces: Tensor) -> Path:
    """A folder of one picture whose camera sees a body from the front and its left."""
    turn, t = camera_round(60, 12.0, 2.4)
    scale = 1.0 / float(vertices[:, 0].max() - vertices[:, 0].min())
    write_picture(root / "images" / "a.jpg")
    (root / "meshes").mkdir(exist_ok=True)
    standing = (vertices - vertices.mean(0)) * scale
    (root / "meshes" / "a.obj").write_text(obj_text(standing @ turn.mT + t, faces))
    write_json(
        root / "camera.json",
        {"focal_over_side": 1.2, "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 0]},
    )
    return root


def test_a_model_whose_tail_faces_were_cut_away_still_corresponds(tmp_path: Path) -> None:
    model, file = load_quadruped(), tmp_path / "model.safetensors"
    save_safetensors(model, file)
    faces = model.without_tail_faces().flip(0)
    root = write_one_mesh(tmp_path / "folder", model.v_template, faces)
    (label,) = labels_of(read_mesh_folder(root, model=file))
    assert label.quality.orientation_rule == "torso vertices on the template"
    assert_close(label.rotation, camera_round(60, 12.0, 2.4)[0], atol=1e-6, rtol=0)
    assert "count for nothing" in label.quality.warnings[0]
    write_one_mesh(root, model.v_template, model.faces)
    (whole,) = labels_of(read_mesh_folder(root, model=file))
    assert label.size[0] < 0.97 * whole.size[0]


def test_smals_order_is_recognised_without_the_model_and_said(tmp_path: Path) -> None:
    root = write_one_mesh(tmp_path, *smal_like_mesh())
    (label,) = labels_of(read_mesh_folder(root))
    assert label.quality.warnings == (SMAL_NOTE,)
    assert "shoulder" in label.quality.orientation_rule
    assert label.viewpoint == "front-left"


def test_3889_vertices_in_another_order_get_no_landmarks_of_smals(tmp_path: Path) -> None:
    vertices, faces = smal_like_mesh()
    order = torch.randperm(3889, generator=torch.Generator().manual_seed(0))
    root = write_one_mesh(tmp_path, vertices[order], order.argsort()[faces])
    with pytest.raises(
        SampleError,
        match=r"a\.jpg: landmarks: nothing tells where a\.obj has its nose or tail \(it has as many"
        r" vertices as SMAL, but the vertices of SMAL's landmarks do not lie together\): give",
    ):
        labels_of(read_mesh_folder(root))


def test_meshes_of_a_y_up_regressor_are_seen_right_by_the_documented_camera(tmp_path: Path) -> None:
    (camera,) = [
        json.loads(block)
        for block in re.findall(r"```json\n(.*?)```", DOCS.read_text(), re.DOTALL)
        if "3.90625" in block
    ]
    root = write_mesh_folder(tmp_path)
    R, t = camera_round(60, 12.0, 2.4)
    vertices, faces = toy_mesh()
    (root / "meshes" / "a.obj").write_text(
        obj_text((vertices @ R.mT + t) * torch.tensor([1.0, -1, -1]), faces)
    )
    write_json(root / "cameras" / "a.json", {**camera, "focal_over_side": 1.2})
    label = labels_of(read_mesh_folder(root))[0]
    assert label.side == "left"
    assert_close(label.K, K)
    assert label.quality.mask_iou is not None
    assert label.quality.mask_iou > 0.98


# Faults
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FOLDER_FAULTS)
def test_a_fault_is_named_with_sample_field_and_remedy_and_spoils_no_other(
    tmp_path: Path, name: str
) -> None:
    fault, root = FOLDER_FAULTS[name], write_mesh_folder(tmp_path / "folder")
    fault.spoil(root)
    read = read_mesh_folder(root)
    errors, good = list(read.records.faults), []
    assert bool(errors) is fault.when_read
    for record in read.records.records:
        try:
            good.append(label_of(record, read.bodies, LabelConfig()))
        except SampleError as error:
            errors.append(error)
    spoilt = {error.sample_id for error in errors}
    assert fault.sample in spoilt
    assert spoilt <= {fault.sample, "b.jpg"} if "landmarks" in name else spoilt == {fault.sample}
    assert fault.field in errors[0].field
    assert fault.reason in errors[0].problem
    assert all(isinstance(label, CuboidLabel) for label in good)
    assert good or name == "no_landmarks"


@pytest.mark.parametrize(
    ("file", "content", "reason"),
    [
        ("mesh_folder.json", {"vocabulary": "dogs"}, "mesh_folder.json: vocabulary must be one of"),
        ("mesh_folder.json", {"vocabulary": "mine.toml"}, "mine.toml cannot be read"),
        ("mesh_folder.json", {"scale": 1}, "unknown field `scale`"),
        ("mesh_folder.json", {"unit_m": -1}, "unit_m must be"),
        ("landmarks.json", {"nose": {"point": [1, 2, 3]}}, "a point does not move with the mesh"),
        ("landmarks.json", {"snout": [1]}, "'snout' is no landmark"),
    ],
)
def test_a_wrong_file_for_the_whole_folder_is_refused(
    tmp_path: Path, file: str, content: object, reason: str
) -> None:
    write_json(write_mesh_folder(tmp_path) / file, content)
    with pytest.raises(DatasetFormatError, match=reason):
        read_mesh_folder(tmp_path)


def test_a_folder_without_its_folders_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"there is no folder .*images"):
        read_mesh_folder(tmp_path)
    write_picture(tmp_path / "images" / "a.jpg")
    (tmp_path / "meshes").mkdir()
    with pytest.raises(DatasetFormatError, match="holds no mesh"):
        read_mesh_folder(tmp_path)
    with pytest.raises(DatasetNotFoundError, match="there is no folder"):
        read_mesh_folder(tmp_path / "nowhere")


def test_the_users_vocabulary_names_the_keypoints(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    write_json(root / "keypoints" / "b.json", {"Nose": [10, 20], "root_of_tail": [30.5, 40, 0.25]})
    record = read_dataset(
        root, options=ReadOptions(vocabulary=VOCABULARIES["ap10k17"])
    ).records.records[1]
    assert record.keypoints_2d[2].tolist() == [10, 20, 1]
    assert record.keypoints_2d[4].tolist() == [30.5, 40, 0.25]
    assert not record.keypoints_2d[[0, 1, 3, *range(5, 17)]].any()


# From the docs and the command line
# -----------------------------------------------------------------------------------


def test_the_folder_in_the_docs_is_read_as_the_docs_say(tmp_path: Path) -> None:
    text = DOCS.read_text()
    paths = re.findall(r"^(capture/\S+)", text, re.MULTILINE)
    contents = dict(
        re.findall(r"^`(capture/[^`]+)`:\n\n```json\n(.*?)```", text, re.MULTILINE | re.DOTALL)
    )
    assert set(contents) < set(paths)
    vertices, faces = toy_mesh()
    for name in paths:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix in (".jpg", ".png"):
            Image.new("RGB", (640, 480), (90, 120, 90)).save(path)
        elif path.suffix == ".obj":
            path.write_text(obj_text(vertices, faces))
        elif path.suffix == ".npz":
            np.savez(path, vertices=vertices.numpy(), faces=faces.numpy())
        else:
            path.write_text(contents.get(name, contents["capture/cameras/cam1.json"]))
    assert recognised_format(tmp_path / "capture") == "mesh_folder"
    read = read_mesh_folder(tmp_path / "capture")
    assert (read.records.faults, read.records.notes) == ((), ())
    samples = {record.sample_id: record for record in read.records.records}
    assert list(samples) == [
        "000044.jpg",
        "cam1/000012.jpg",
        "cam1/000012.jpg#1",
        "cam2/000012.jpg",
        "cam2/000012.jpg#1",
    ]
    first, own = samples["cam1/000012.jpg"], samples["000044.jpg"]
    assert (first.category, first.metres_per_unit, own.metres_per_unit) == ("horse", 1.2, 1.0)
    assert first.mask_path is not None
    assert samples["cam2/000012.jpg"].mask_path is None
    assert own.K is not None
    assert own.K[0].tolist() == [768, 0, 319.5]
    keypoints = dict(zip(own.vocabulary.keypoints, own.keypoints_2d.tolist(), strict=True))
    assert (keypoints["nose"], keypoints["left_eye"], keypoints["right_eye"]) == (
        [412, 233.5, 1],
        [398.5, 221, 0.9],
        [0, 0, 0],
    )
    label = label_of(first, read.bodies, LabelConfig())
    assert isinstance(label, CuboidLabel)
    assert label.viewpoint == "front" or label.side in ("left", "right")
    assert label.quality.orientation_rule.startswith("trunk line")


def test_label_reads_a_mesh_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = write_mesh_folder(tmp_path / "folder")
    write_json(root / "keypoints" / "b.json", {"snout": [1, 2]})
    for body in ([], ["--body", "dog"]):
        with pytest.raises(SystemExit) as caught:
            main(["label", str(root), "--out", str(tmp_path / "out"), "--json", *body])
        assert caught.value.code == (2 if body else 4)
    assert json.loads(capsys.readouterr().out)["kept"] == 1
    (label,) = json.loads((tmp_path / "out" / "labels.json").read_text())["animals"]
    assert (label["sample_id"], label["side"], label["quality"]["pose_source"]) == (
        "a.jpg",
        "left",
        "given",
    )


def test_a_body_of_ones_own_is_refused_where_cameras_belong_to_the_meshes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(
            [
                "label",
                str(write_mesh_folder(tmp_path)),
                "--out",
                str(tmp_path / "out"),
                "--body",
                "dog",
            ]
        )
    assert "quadruped:dog cannot be the body of all animals" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="for formats whose files do not tell"):
        read_dataset(
            Path(__file__), "stanfordextra", ReadOptions(vocabulary=VOCABULARIES["ap10k17"])
        )


def test_the_dataset_gives_mesh_folders_and_coco_with_a_changed_mesh_told_apart(
    tmp_path: Path,
) -> None:
    root = write_mesh_folder(tmp_path / "folder")
    dataset = AnnotatedDataset(root)
    sample = dataset[0]
    assert isinstance(sample, tuple)
    target = sample[1]
    assert (len(dataset), dataset.image_id(0), len(target["corners_3d"])) == (2, "a.jpg", 1)
    assert_close(target["R"][0], camera_round(60, 12.0, 2.4)[0].float())
    with pytest.raises(ConfigError, match="cannot be the body of all animals"):
        AnnotatedDataset(root, body="dog")
    read = read_mesh_folder(root)
    record = read.records.records[0]
    before = read.bodies.content(record.sample_id)
    (root / "meshes" / "a.obj").write_text(obj_text(toy_mesh()[0] + 1.0, toy_mesh()[1]))
    assert read.bodies.content(record.sample_id) != before
    write_json(root / "landmarks.json", {"nose": [3]})
    assert read_mesh_folder(root).bodies.fingerprint != read.bodies.fingerprint

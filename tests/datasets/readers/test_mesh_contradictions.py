"""Meshes whose landmarks, names or cameras cannot mean what they seem to."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from animals import toy_mesh
from commands import ran
from mesh_folder_dataset import (
    LANDMARK_IDS,
    camera_json,
    keypoints_json,
    obj_text,
    write_json,
    write_mesh_folder,
    write_picture,
)
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.datasets.bodies.mesh_file import load_mesh_body
from animal3dbox.datasets.bodies.mesh_folder import LOOSE_NOTE
from animal3dbox.datasets.formats import ReadDataset, read_dataset
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.labelling.sample_checks import Outcome
from animal3dbox.errors import DatasetFormatError, SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.report.summary import flags_of

QUICK = LabelConfig(surface_share=False, mask_iou=False)


def outcomes(dataset: ReadDataset) -> list[Outcome]:
    requests = [request_of_record(record, dataset.bodies) for record in dataset.records.records]
    return label_records(requests, QUICK)


def fault_of(root: Path) -> SampleError:
    """The fault of a.jpg, the first of the folder; the other animal has its label."""
    fault, other = outcomes(read_dataset(root))
    assert isinstance(fault, SampleError)
    assert isinstance(other, CuboidLabel)
    assert fault.sample_id == "a.jpg"
    return fault


def soup() -> tuple[Any, Any]:
    """The toy animal with the corners of each triangle by themselves."""
    vertices, faces = toy_mesh()
    return vertices[faces.reshape(-1)], np.arange(faces.numel()).reshape(-1, 3)


# Landmarks by the ids of vertices that have none
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_ids_of_vertices_are_refused_of_an_stl(tmp_path: Path, kind: str) -> None:
    root = write_mesh_folder(tmp_path)
    vertices, faces = toy_mesh()
    mesh = trimesh.Trimesh(vertices.numpy(), faces.numpy(), process=False)
    (root / "meshes" / "a.obj").unlink()
    mesh.export(root / "meshes" / "a.stl", file_type=kind)
    fault = fault_of(root)
    assert fault.field == "landmarks"
    assert "a.stl" in fault.problem
    assert "save the mesh as .obj, .ply, .off or .npz" in fault.problem
    with pytest.raises(DatasetFormatError, match="STL stores the corners"):
        load_mesh_body(root / "meshes" / "a.stl", root / "landmarks.json")
    points = write_json(root / "points.json", {"nose": {"point": [1, 2, 3]}})
    assert load_mesh_body(root / "meshes" / "a.stl", points).points["nose"].tolist() == [1, 2, 3]


def test_a_mesh_of_another_format_whose_triangles_share_nothing_is_doubted(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    vertices, faces = soup()
    np.savez(root / "meshes" / "a.npz", vertices=vertices.numpy(), faces=faces)
    (root / "meshes" / "a.obj").unlink()
    doubted, other = outcomes(read_dataset(root))
    assert isinstance(doubted, CuboidLabel)
    assert isinstance(other, CuboidLabel)
    assert LOOSE_NOTE in doubted.quality.warnings
    assert LOOSE_NOTE not in other.quality.warnings


# Meshes that may be of either of two images
# --------------------------------------------------------------------------------------------------


def named(root: Path, images: str, meshes: str) -> ReadDataset:
    """A folder of images and meshes of these names."""
    for name in images.split():
        write_picture(root / "images" / f"{name}.jpg")
    for name in meshes.split():
        (root / "meshes").mkdir(exist_ok=True)
        (root / "meshes" / f"{name}.obj").write_text(obj_text(*toy_mesh()))
    write_json(root / "camera.json", camera_json(60))
    write_json(root / "landmarks.json", LANDMARK_IDS)
    return read_dataset(root)


@pytest.mark.parametrize(
    ("images", "meshes", "left"),
    [
        ("dog dog_1", "dog_1", []),
        ("dog dog_1", "dog_0 dog_1", ["dog.jpg"]),
        ("dog dog_1", "dog dog_1 dog_2", ["dog.jpg", "dog.jpg#1"]),
        ("dog dog_1", "dog dog_1 dog_1_0", ["dog.jpg", "dog_1.jpg"]),
        ("north/dog south/dog_1", "dog_0 dog_1", ["north/dog.jpg"]),
    ],
)
def test_a_mesh_that_may_be_of_either_of_two_images_is_a_fault_of_both(
    tmp_path: Path, images: str, meshes: str, left: list[str]
) -> None:
    records = named(tmp_path, images, meshes).records
    assert [record.sample_id for record in records.records] == left
    one, other = images.split()
    assert [(f.sample_id, f.field) for f in records.faults] == [
        (f"{one}.jpg#1", "mesh"),
        (f"{other}.jpg", "mesh"),
    ]
    for fault in records.faults:
        assert f"may be animal 1 of {one}.jpg, or the first of {other}.jpg" in fault.problem
        assert "name it dog.1.obj or dog_1_0.obj" in fault.problem


@pytest.mark.parametrize("name", ["dog.1", "dog_1_0"])
def test_the_names_that_the_error_tells_are_of_one_image(tmp_path: Path, name: str) -> None:
    records = named(tmp_path, "dog dog_1", f"dog_0 {name}").records
    assert records.faults == ()
    second = "dog.jpg#1" if name == "dog.1" else "dog_1.jpg"
    assert [record.sample_id for record in records.records] == ["dog.jpg", second]


def test_images_that_each_have_the_mesh_of_their_name_keep_it_with_a_note(tmp_path: Path) -> None:
    records = named(tmp_path, "dog dog_1 dog_2", "dog dog_1 dog_2").records
    assert records.faults == ()
    assert [record.sample_id for record in records.records] == ["dog.jpg", "dog_1.jpg", "dog_2.jpg"]
    assert any(note.startswith("2 meshes are called like an image, and") for note in records.notes)


@pytest.mark.parametrize(
    ("images", "meshes", "count"),
    [("dog cat", "dog_0 dog_1 cat", 3), ("dog_1 dog_2", "dog_1 dog_2", 2), ("dog_1", "dog_1_0", 1)],
)
def test_names_that_can_mean_one_thing_are_no_matter(
    tmp_path: Path, images: str, meshes: str, count: int
) -> None:
    records = named(tmp_path, images, meshes).records
    assert (records.faults, records.notes) == ((), ())
    assert len(records.records) == count


# Cameras and meshes in different units
# --------------------------------------------------------------------------------------------------


# Names in another letter case or Unicode form
# --------------------------------------------------------------------------------------------------

COMPOSED, APART = "r\u00e9n\u00e9", "re\u0301ne\u0301"


@pytest.mark.parametrize(
    ("image", "other"), [("A", "a"), ("a", "A"), (COMPOSED, APART), (APART, COMPOSED)]
)
def test_files_in_another_letter_case_or_unicode_form_belong_together(
    tmp_path: Path, image: str, other: str
) -> None:
    root = write_mesh_folder(tmp_path / "cap")
    (root / "images" / "a.jpg").rename(root / "images" / f"{image}.JPG")
    for kind, suffix in (("meshes", "obj"), ("masks", "png"), ("cameras", "json")):
        (root / kind / f"a.{suffix}").rename(root / kind / f"{other}.{suffix}")
    records = read_dataset(root).records
    assert records.faults == ()
    (record,) = [record for record in records.records if record.image_id == f"{image}.JPG"]
    assert record.pose is not None
    assert record.mask is not None


def test_numbered_files_and_cameras_of_folders_are_spelled_otherwise_too(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path / "cap")
    (root / "images" / "Cam1").mkdir()
    (root / "images" / "a.jpg").rename(root / "images" / "Cam1" / "A.jpg")
    for k in (0, 1):
        (root / "meshes" / f"a_{k}.obj").write_text((root / "meshes" / "a.obj").read_text())
    (root / "meshes" / "a.obj").unlink()
    (root / "masks" / "a.png").unlink()
    (root / "cameras" / "a.json").rename(root / "cameras" / "cam1.json")
    records = read_dataset(root).records
    assert records.faults == ()
    found = [one for one in records.records if one.image_id == "Cam1/A.jpg"]
    assert [record.sample_id for record in found] == ["Cam1/A.jpg", "Cam1/A.jpg#1"]
    assert all(record.pose is not None for record in found)


def test_a_file_spelled_as_its_image_comes_first(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path / "cap")
    (root / "meshes" / "A.obj").write_text("v")
    (fault,) = read_dataset(root).records.faults
    assert (fault.sample_id, fault.problem) == (
        "A.obj",
        "has the name of a.obj: keep one of them",
    )


def test_a_mesh_that_may_be_of_two_spellings_or_of_none_names_what_is_near(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path / "cap")
    for name in ("bear_01", "Bear_01", "tiger_07"):
        write_picture(root / "images" / f"{name}.jpg")
    for name in ("BEAR_01", "tigre_07"):
        (root / "meshes" / f"{name}.obj").write_text((root / "meshes" / "a.obj").read_text())
    faults = {fault.sample_id: fault.problem for fault in read_dataset(root).records.faults}
    assert "it may be of Bear_01.jpg or bear_01.jpg" in faults["meshes/BEAR_01.obj"]
    assert "the nearest there is 'tiger_07.jpg'" in faults["meshes/tigre_07.obj"]


# A camera that the mask denies
# --------------------------------------------------------------------------------------------------


def labelled(root: Path) -> CuboidLabel:
    """The label of a.jpg, the first of the folder, whose camera is known."""
    dataset = read_dataset(root)
    requests = [request_of_record(record, dataset.bodies) for record in dataset.records.records]
    label = label_records(requests[:1], LabelConfig(surface_share=False))[0]
    assert isinstance(label, CuboidLabel)
    assert label.quality.pose_source == "given"
    return label


def change_mask(root: Path, change: Callable[[NDArray[np.bool_]], NDArray[np.bool_]]) -> None:
    path = root / "masks" / "a.png"
    mask = np.asarray(Image.open(path)) > 0
    Image.fromarray(np.uint8(255) * change(mask).astype(np.uint8)).save(path)


@pytest.mark.parametrize(
    "camera",
    [
        {"t": [0.0, 0.0, 24.0]},
        {"t": [1.5, 0.0, 2.4]},
        {"K": [[60.0, 0, 79.5], [0, 60, 59.5], [0, 0, 1]]},
    ],
)
def test_a_known_camera_that_the_mask_denies_is_flagged_and_named(
    tmp_path: Path, camera: dict[str, Any]
) -> None:
    root = write_mesh_folder(tmp_path / "cap")
    write_json(root / "cameras" / "a.json", {**camera_json(60), **camera})
    label = labelled(root)
    assert "off_mask" in label.quality.flags
    assert "off_mask" in flags_of(label)
    (warning,) = [words for words in label.quality.warnings if "of the mask" in words]
    assert "the camera (K, R, t)" in warning
    code, output = ran("label", root, "--out", tmp_path / "out")
    assert (code, "1 x off_mask" in output) == (0, True), output


def test_a_mask_of_what_little_is_visible_denies_no_camera(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path / "cap")
    assert "off_mask" not in labelled(root).quality.flags

    def mostly_hidden(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        columns = np.flatnonzero(mask.any(0))
        return mask & (np.arange(mask.shape[1]) < np.quantile(columns, 0.25))

    change_mask(root, mostly_hidden)
    label = labelled(root)
    assert label.quality.mask_iou is not None
    assert label.quality.mask_iou < 0.3
    assert "off_mask" not in label.quality.flags
    assert not any("of the mask" in words for words in label.quality.warnings)


def with_scaled_camera(root: Path, factor: float) -> Path:
    """The known camera of a.jpg with t in another unit than the mesh."""
    write_mesh_folder(root)
    camera = camera_json(60)
    camera["t"] = [factor * number for number in camera["t"]]
    write_json(root / "cameras" / "a.json", camera)
    (root / "masks" / "a.png").unlink()
    return root


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1000.0, "px long"),
        (100.0, "px long"),
        (0.001, "the camera is inside the animal"),
        (0.01, "the camera is inside the animal"),
    ],
)
def test_a_camera_in_another_unit_than_its_mesh_is_a_fault(
    tmp_path: Path, factor: float, words: str
) -> None:
    fault = fault_of(with_scaled_camera(tmp_path, factor))
    assert fault.field == "camera, mesh"
    assert "cameras/a.json puts a.obj" in fault.problem
    assert words in fault.problem


@pytest.mark.parametrize("factor", [0.5, 1.0, 4.0])
def test_near_and_far_animals_are_no_fault(tmp_path: Path, factor: float) -> None:
    found, other = outcomes(read_dataset(with_scaled_camera(tmp_path, factor)))
    assert not isinstance(found, SampleError)
    assert not isinstance(other, SampleError)


def test_a_vertex_that_no_face_uses_is_no_part_of_the_animals_length(tmp_path: Path) -> None:
    root = with_scaled_camera(tmp_path, 1.0)
    vertices, faces = toy_mesh()
    far = vertices.new_full((1, 3), 1e5)
    lines = obj_text(vertices, faces)
    first_face = lines.index("f ")
    lines = f"{lines[:first_face]}v 1e5 1e5 1e5\n{lines[first_face:]}"
    (root / "meshes" / "a.obj").write_text(lines)
    found, _ = outcomes(read_dataset(root))
    assert isinstance(found, CuboidLabel), found
    assert float(found.size.max()) < float(far.max()) / 1e4


def test_a_guessed_camera_in_another_unit_is_only_a_guess(tmp_path: Path) -> None:
    root = with_scaled_camera(tmp_path, 1000.0)
    camera = json.loads((root / "cameras" / "a.json").read_text())
    write_json(root / "cameras" / "a.json", {**camera, "exact": False})
    write_json(root / "keypoints" / "a.json", keypoints_json(60))
    found, _ = outcomes(read_dataset(root))
    assert isinstance(found, CuboidLabel)
    assert found.quality.reprojection_error_px is not None
    assert found.quality.reprojection_error_px < 1

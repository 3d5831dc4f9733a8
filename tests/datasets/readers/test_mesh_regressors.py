"""Outputs of mesh regressors as they lie on the disk, by their public code's names and keys."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from animals import camera_round, toy_landmarks, toy_mesh
from mesh_folder_dataset import (
    LANDMARK_IDS,
    camera_json,
    keypoints_json,
    obj_text,
    write_json,
    write_mesh_folder,
)
from numpy.typing import NDArray
from photo_dataset import HW, K
from PIL import Image
from torch.testing import assert_close

from animal3dbox.datasets.bodies.mesh_folder import SKELETON_NOTE, WEAK_NOTE
from animal3dbox.datasets.formats import ReadDataset, read_dataset
from animal3dbox.datasets.labelling.label_records import label_records
from animal3dbox.datasets.labelling.label_requests import request_of_record
from animal3dbox.datasets.labelling.sample_checks import Outcome
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.readers.mesh_folder.camera_files import weak_perspective_camera
from animal3dbox.datasets.readers.mesh_folder.regressor_names import own_name
from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.files.safetensors_file import save_safetensors
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26
from animal3dbox.smal.parameters import SmalParameters, posed_body
from animal3dbox.smal.quadruped.poses import named_pose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, preset_betas

QUICK = LabelConfig(surface_share=False, mask_iou=False)
SQUARE = 200
Array = NDArray[np.float64]


def outcomes(dataset: ReadDataset) -> list[Outcome]:
    requests = [request_of_record(record, dataset.bodies) for record in dataset.records.records]
    return label_records(requests, QUICK)


def picture(path: Path, hw: tuple[int, int] = HW) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", hw[::-1], (90, 90, 90)).save(path)


def toy_keypoints(azimuth_deg: float = 60.0) -> Array:
    """The 26 keypoints (26, 3) in px of the image, as a.jpg's camera sees them."""
    rows = keypoints_json(azimuth_deg)
    return np.array([rows[name] for name in ANIMAL3D_26])


# Names
# --------------------------------------------------------------------------------------------------


def regressed(root: Path, *meshes: str, images: tuple[str, ...] = ("a",)) -> ReadDataset:
    """A folder of meshes of these names, which all lie in the frame of one camera."""
    for name in images:
        picture(root / "images" / f"{name}.jpg")
    (root / "meshes").mkdir(exist_ok=True)
    for number, name in enumerate(meshes):
        vertices, faces = toy_mesh()
        (root / "meshes" / f"{name}.obj").write_text(obj_text(vertices * (1 + number / 10), faces))
    write_json(root / "camera.json", camera_json(60))
    write_json(root / "landmarks.json", LANDMARK_IDS)
    return read_dataset(root)


@pytest.mark.parametrize(
    ("meshes", "used"),
    [
        (("a_0", "a_1"), {"a.jpg": "a_0.obj", "a.jpg#1": "a_1.obj"}),
        (("a_0_after_tta",), {"a.jpg": "a_0_after_tta.obj"}),
        (
            ("a_0_before_tta", "a_0_after_tta", "a_1_before_tta"),
            {"a.jpg": "a_0_after_tta.obj", "a.jpg#1": "a_1_before_tta.obj"},
        ),
        (("a_0", "a_0_after_tta"), {"a.jpg": "a_0_after_tta.obj"}),
        (("a_0", "a_0_before_tta"), {"a.jpg": "a_0.obj"}),
    ],
)
def test_meshes_of_an_adaptation_are_their_animals(
    tmp_path: Path, meshes: tuple[str, ...], used: dict[str, str]
) -> None:
    found = regressed(tmp_path, *meshes)
    assert found.records.faults == ()
    assert found.bodies is not None
    files = {
        record.sample_id: found.bodies.meshes[record.sample_id].path.name  # type: ignore[attr-defined]
        for record in found.records.records
    }
    assert files == used
    replaced = len(meshes) - len(used)
    notes = [note for note in found.records.notes if "have a better one beside them" in note]
    assert len(notes) == bool(replaced)
    assert all(note.startswith(f"{replaced} files") for note in notes)


def test_meshes_of_a_video_are_their_frames(tmp_path: Path) -> None:
    frames = ("clip_frame000012", "clip_frame000013")
    meshes = (f"{frames[0]}_score0.987", f"{frames[1]}_score1.000")
    records = regressed(tmp_path, *meshes, images=frames).records
    assert records.faults == ()
    assert [record.image_id for record in records.records] == [f"{name}.jpg" for name in frames]


def test_two_meshes_of_one_frame_are_a_fault(tmp_path: Path) -> None:
    frame = "clip_frame000012"
    records = regressed(tmp_path, f"{frame}_score0.100", f"{frame}_score0.200", images=(frame,))
    (fault,) = records.records.faults
    assert fault.field == "mesh"
    assert f"has the name of {frame}_score0.100.obj" in fault.problem


def test_an_image_that_has_such_a_name_itself_keeps_its_mesh(tmp_path: Path) -> None:
    name = "x_frame1_score0.5"
    records = regressed(tmp_path, name, images=(name, "x_frame1")).records
    assert [record.image_id for record in records.records] == [f"{name}.jpg"]


@pytest.mark.parametrize("name", ["dog", "dog_0", "after_tta", "clip_frame12", "a_score0.5"])
def test_other_names_stay_as_they_are(name: str) -> None:
    assert own_name(name)[0] == name


# Arrays of keypoints
# --------------------------------------------------------------------------------------------------


def with_array(root: Path, name: str, array: Any) -> Path:
    write_mesh_folder(root)
    (root / "keypoints").mkdir(exist_ok=True)
    np.save(root / "keypoints" / name, array)
    return root


@pytest.mark.parametrize("name", ["a.npy", "a_prima26_kpts.npy", "a_mapped_keypoints.npy"])
@pytest.mark.parametrize("shape", [(26, 3), (1, 26, 3)])
def test_arrays_of_keypoints_in_pixels_of_the_image_are_read(
    tmp_path: Path, name: str, shape: tuple[int, ...]
) -> None:
    points = toy_keypoints()
    points[3, 2], points[4] = 0.25, np.nan
    found = read_dataset(with_array(tmp_path, name, points.reshape(shape).astype(np.float32)))
    record = found.records.records[0]
    points[4] = 0
    assert_close(record.keypoints_2d, points, atol=1e-4, rtol=0)
    assert not any("PRIMA" in note for note in found.records.notes)


def test_two_numbers_a_keypoint_are_enough(tmp_path: Path) -> None:
    points = toy_keypoints()[:, :2]
    points[2] = 0
    found = read_dataset(with_array(tmp_path, "a.npy", points)).records.records[0].keypoints_2d
    assert found[:, 2].tolist() == [1.0, 1.0, 0.0] + [1.0] * 23
    assert_close(found[:, :2], points)


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((25, 3)), "must be 26 x 3 (x, y, confidence) or 26 x 2 of animal3d26"),
        (np.ones((26, 3)) * 2, "confidences must be from 0 to 1, got up to 2"),
        (np.ones((2, 26, 3)), "got (2, 26, 3)"),
        (np.array(["x"] * 26), "is no array of numbers"),
        (np.array([{}] * 26, dtype=object), "is no array of numbers"),
    ],
)
def test_an_array_of_another_form_is_a_fault(tmp_path: Path, array: Any, words: str) -> None:
    (fault,) = read_dataset(with_array(tmp_path, "a.npy", array)).records.faults
    assert (fault.sample_id, fault.field) == ("a.jpg", "keypoints")
    assert "keypoints/a.npy" in fault.problem
    assert words in fault.problem


def in_crop(points: Array) -> Array:
    """Keypoints in the pixels of a crop of 256 that is twice as large as the animal."""
    low, high = points[:, :2].min(0), points[:, :2].max(0)
    scale = 128 / (high - low).max()
    return np.concatenate(((points[:, :2] - low) * scale + 64, points[:, 2:]), axis=1)


def test_keypoints_in_pixels_of_a_crop_are_left_out_where_the_mesh_tells(tmp_path: Path) -> None:
    found = read_dataset(with_array(tmp_path, "a_prima26_kpts.npy", in_crop(toy_keypoints())))
    first, second = found.records.records
    assert not first.keypoints_2d.any()
    assert second.keypoints_2d.any()
    note = next(note for note in found.records.notes if "PRIMA" in note)
    assert note.startswith("the keypoints of 1 animals are in pixels of PRIMA's crops")
    label, _ = outcomes(found)
    assert isinstance(label, CuboidLabel)


def test_keypoints_of_a_crop_alone_are_a_fault(tmp_path: Path) -> None:
    root = with_array(tmp_path, "a_prima26_kpts.npy", in_crop(toy_keypoints()))
    (root / "keypoints" / "b.json").unlink()
    np.save(root / "keypoints" / "b_prima26_kpts.npy", in_crop(toy_keypoints(250)))
    found = read_dataset(root).records
    (fault,) = found.faults
    assert (fault.sample_id, fault.field) == ("b.jpg", "keypoints")
    assert "PRIMA's crop" in fault.problem
    assert [record.sample_id for record in found.records] == ["a.jpg"]


def test_where_no_camera_tells_a_note_says_to_look(tmp_path: Path) -> None:
    root = with_array(tmp_path, "a_prima26_kpts.npy", toy_keypoints())
    write_json(root / "cameras" / "a.json", {"K": K.tolist()})
    found = read_dataset(root).records
    assert found.faults == ()
    assert any("taken for the image's; look at overlays" in note for note in found.notes)


# Weak perspective
# --------------------------------------------------------------------------------------------------


def test_a_weak_perspective_is_met_to_thousandths_of_a_pixel() -> None:
    generator = np.random.default_rng(5)
    points = generator.uniform(-1, 1, (200, 3))
    scale, x, y = 180.0, 70.0, 66.0
    K_far, (R, t) = weak_perspective_camera([scale, x, y], (140, 150))
    px, depth = project(
        torch.from_numpy(K_far),
        torch.from_numpy(points) @ torch.from_numpy(R).mT + torch.from_numpy(t),
    )
    assert (depth > 0).all()
    expected = scale * points[:, :2] + [x, y]
    assert np.abs(px.numpy() - expected).max() < 0.004


@pytest.mark.parametrize("weak", [[0.0, 1, 1], [-2.0, 1, 1], [1.0, 2], [1.0, np.nan, 0]])
def test_a_weak_perspective_that_is_none_is_refused(weak: list[float]) -> None:
    with pytest.raises(ShapeError, match="weak_perspective must be s, tx, ty"):
        weak_perspective_camera(weak, (10, 10))


def weak_folder(root: Path, camera: dict[str, Any]) -> Path:
    """One picture, its mesh with x to the right and y down, and the camera of its image."""
    R, _ = camera_round(60, 12.0, 2.4)
    vertices, faces = toy_mesh()
    picture(root / "images" / "a.jpg")
    (root / "meshes").mkdir()
    (root / "meshes" / "a.obj").write_text(obj_text(vertices @ R.mT, faces))
    write_json(root / "landmarks.json", LANDMARK_IDS)
    write_json(root / "cameras" / "a.json", camera)
    return root


def test_a_file_of_a_camera_may_be_a_weak_perspective(tmp_path: Path) -> None:
    root = weak_folder(tmp_path, {"weak_perspective": [50.0, 81.0, 57.0]})
    (label,) = outcomes(read_dataset(root))
    assert isinstance(label, CuboidLabel)
    assert WEAK_NOTE in label.quality.warnings
    R, _ = camera_round(60, 12.0, 2.4)
    px = 50.0 * (toy_mesh()[0] @ R.mT)[:, :2] + torch.tensor([81.0, 57.0])
    expected = [*px.amin(0).tolist(), *px.amax(0).tolist()]
    assert np.abs(label.box.numpy() - expected).max() < 0.6  # pixels from edge to edge
    assert_close(label.rotation, R, atol=0.15, rtol=0)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"K": K.tolist()}, "leave out K"),
        ({"t": [0, 0, 1], "focal_px": 5.0}, "leave out focal_px and t"),
        ({"R": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]}, "rotation matrices"),
    ],
)
def test_a_weak_perspective_stands_alone(tmp_path: Path, more: dict[str, Any], words: str) -> None:
    root = weak_folder(tmp_path, {"weak_perspective": [50.0, 81.0, 57.0], **more})
    (fault,) = read_dataset(root).records.faults
    assert (fault.sample_id, fault.field) == ("a.jpg", "camera")
    assert words in fault.problem


# npz of regressors
# --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.safetensors"
    save_safetensors(load_quadruped(), path)
    return path


def genzoo(**changes: Any) -> dict[str, Any]:
    """The arrays of a GenZoo file of a sitting dog that looks to the left of its picture."""
    pose = named_pose("sit").reshape(-1, 3).clone()
    turn = torch.tensor([[-1.0, 0, 0], [0, 0, -1], [0, -1, 0]], dtype=torch.float64)
    matrices = rotation_from_axis_angle(pose)
    matrices[0] = turn @ matrices[0]
    from animal3dbox.geometry.rigid_transforms import axis_angle_from_rotation

    body = posed_body(
        load_quadruped(),
        SmalParameters(
            axis_angle_from_rotation(matrices), preset_betas("dog"), torch.zeros(3).double()
        ),
    )
    return {
        "pose": matrices.numpy().astype(np.float32),
        "beta": preset_betas("dog").numpy(),
        "scale": np.array([0.35]),
        "tx": np.array([0.02]),
        "ty": np.array([-0.1]),
        "vertices_3d": body.vertices[0].numpy(),
        "vertices_2d": np.zeros((len(body.vertices[0]), 2)),
    } | changes


def genzoo_folder(root: Path, hw: tuple[int, int] = (SQUARE, SQUARE), **changes: Any) -> Path:
    picture(root / "images" / "a.png", hw)
    (root / "meshes").mkdir()
    arrays = {key: value for key, value in genzoo(**changes).items() if value is not None}
    np.savez(root / "meshes" / "a.npz", **arrays)
    return root


@pytest.mark.parametrize("parameters_only", [False, True])
def test_a_genzoo_file_is_its_mesh_under_its_own_camera(
    tmp_path: Path, model_file: Path, *, parameters_only: bool
) -> None:
    changes: dict[str, Any] = {"vertices_3d": None} if parameters_only else {"pose": None}
    root = genzoo_folder(tmp_path / "set", **changes)
    (label,) = outcomes(read_dataset(root, options=ReadOptions(model=model_file)))
    assert isinstance(label, CuboidLabel)
    vertices = genzoo()["vertices_3d"]
    px = 0.35 * SQUARE * vertices[:, :2] + [0.52 * SQUARE, 0.4 * SQUARE]
    expected = np.clip([*px.min(0), *px.max(0)], -0.5, SQUARE - 0.5)
    assert np.abs(label.box.numpy() - expected).max() < 0.6
    assert label.quality.orientation_rule == "torso vertices on the template"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vertices_3d": np.zeros((10, 3))}, "has 10 vertices, but --model"),
        ({"vertices_3d": None, "pose": np.zeros((35, 3, 3))}, "does not fit --model"),
        ({"vertices_3d": None, "beta": np.zeros(145)}, "does not fit --model"),
        ({"vertices_3d": None, "pose": None}, "must have vertices and faces, or vertices_3d"),
    ],
)
def test_a_genzoo_file_that_is_none_is_a_fault(
    tmp_path: Path, model_file: Path, changes: dict[str, Any], words: str
) -> None:
    root = genzoo_folder(tmp_path / "set", **changes)
    (fault,) = outcomes(read_dataset(root, options=ReadOptions(model=model_file)))
    assert isinstance(fault, SampleError)
    assert (fault.sample_id, fault.field) == ("a.png", "mesh")
    assert "a.npz" in fault.problem
    assert words in fault.problem


def test_a_genzoo_file_without_its_model_says_what_to_give(tmp_path: Path) -> None:
    (fault,) = outcomes(read_dataset(genzoo_folder(tmp_path / "set")))
    assert isinstance(fault, SampleError)
    assert "has no faces: give --model" in fault.problem


def test_parts_of_a_side_mean_nothing_on_a_picture_that_is_not_square(tmp_path: Path) -> None:
    root = genzoo_folder(tmp_path / "set", hw=(150, 200))
    (fault,) = read_dataset(root).records.faults
    assert (fault.sample_id, fault.field) == ("a.png", "camera")
    assert "the image is 200 x 150: give weak_perspective in px" in fault.problem
    write_json(root / "cameras" / "a.json", {"weak_perspective": [70.0, 100.0, 80.0]})
    assert read_dataset(root).records.faults == ()


def skeleton_folder(root: Path, points: Any, key: str = "pose3d") -> Path:
    picture(root / "images" / "a.jpg")
    (root / "meshes").mkdir()
    (root / "keypoints").mkdir()
    np.savez(root / "meshes" / "a.npz", **{key: points})
    np.save(root / "keypoints" / "a_mapped_keypoints.npy", toy_keypoints()[None, :, :2])
    write_json(root / "camera.json", {"K": K.tolist()})
    return root


@pytest.mark.parametrize("key", ["pose3d", "pose_3d"])
def test_a_skeleton_of_26_points_is_labelled_by_its_landmarks(tmp_path: Path, key: str) -> None:
    turn, _ = camera_round(200, 40.0, 2.0)
    points = (toy_landmarks() @ turn.mT).numpy().astype(np.float32)
    (label,) = outcomes(read_dataset(skeleton_folder(tmp_path, points, key)))
    assert isinstance(label, CuboidLabel)
    assert SKELETON_NOTE in label.quality.warnings
    assert label.quality.bounds_source == "keypoints"
    assert label.quality.reprojection_error_px is not None
    assert label.quality.reprojection_error_px < 0.5


@pytest.mark.parametrize(
    "points",
    [np.zeros((17, 3)), np.full((26, 3), np.nan), np.zeros((26, 2))],
)
def test_a_skeleton_of_another_form_is_a_fault(tmp_path: Path, points: Any) -> None:
    (fault,) = outcomes(read_dataset(skeleton_folder(tmp_path, points)))
    assert isinstance(fault, SampleError)
    assert (fault.sample_id, fault.field) == ("a.jpg", "mesh")
    assert "must have the 26 finite points of Animal3D" in fault.problem


def test_a_damaged_npz_is_a_fault(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    (root / "meshes" / "a.obj").unlink()
    (root / "meshes" / "a.npz").write_bytes(b"PK\x03\x04 not whole")
    found = read_dataset(root)
    (fault, other) = outcomes(found)
    assert isinstance(fault, SampleError)
    assert "a.npz cannot be read" in fault.problem
    assert isinstance(other, CuboidLabel)


# The page
# --------------------------------------------------------------------------------------------------


def test_the_cameras_of_the_page_are_cameras(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs" / "regressors.md").read_text()
    blocks = [block.split("```")[0] for block in page.split("```json\n")[1:]]
    assert len(blocks) == 2
    for number, block in enumerate(blocks):
        root = weak_folder(tmp_path / str(number), json.loads(block))
        found = read_dataset(root)
        assert found.records.faults == ()
        assert found.records.records[0].pose is not None

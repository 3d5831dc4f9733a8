"""Omni3D files of its follow-ups for animals: absolute paths, named sides, tracks."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cuboid_sets import random_set
from PIL import Image

from animal3dbox.datasets.cuboid_datasets import Omni3DDataset
from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.records import CuboidSet

Content = dict[str, Any]
NORMALS = {0: (1, -1), 1: (1, 1), 2: (0, -1), 3: (0, 1), 4: (2, 1), 5: (2, -1)}
"""Face ids: axis of R_cam's columns, and sign."""


def level_set() -> CuboidSet:
    return random_set(upright=True, in_view=True)


@pytest.fixture
def content(tmp_path: Path) -> Content:
    """A file of another program, whose boxes stand on the ground."""
    write_omni3d(level_set(), tmp_path / "good.json")
    file: Content = json.loads((tmp_path / "good.json").read_text())
    file["info"] = {"id": "x", "name": "made", "units": "m"}
    for annotation in file["annotations"]:
        del annotation["metric"], annotation["heading_known"]
    return file


def read(tmp_path: Path, content: Content, **options: Any) -> CuboidSet:
    (tmp_path / "file.json").write_text(json.dumps(content))
    return read_omni3d(tmp_path / "file.json", **options)


def pictures(folder: Path, content: Content) -> None:
    for image in content["images"]:
        path = folder / Path(image["file_path"]).name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.new("L", (image["width"], image["height"])).save(path)


@pytest.mark.parametrize("prefix", ["/data/of/another/machine/", "C:\\data\\", "file:///data/"])
def test_absolute_paths_are_read_with_a_folder_of_images_and_do_not_travel(
    tmp_path: Path, content: Content, prefix: str
) -> None:
    pictures(tmp_path / "pictures", content)
    for image in content["images"]:
        image["file_path"] = prefix + Path(image["file_path"]).name
    back = read(tmp_path, content, images=tmp_path / "pictures")
    assert (len(back.records), back.faults) == (10, ())
    assert [image.image_id for image in back.images] == [f"{n}.jpg" for n in range(5)]
    assert back.records[0].image_path == (tmp_path / "pictures" / "0.jpg").resolve()
    write_omni3d(back, tmp_path / "out.json")
    assert "machine" not in (tmp_path / "out.json").read_text()
    alone = read(tmp_path, content)
    assert (alone.records, len(alone.faults)) == ((), 5)
    assert all("--images" in fault.problem for fault in alone.faults)


def test_absolute_paths_of_images_beside_the_file_need_no_folder(
    tmp_path: Path, content: Content
) -> None:
    pictures(tmp_path / "images", content)
    for image in content["images"]:
        image["file_path"] = "/data/" + Path(image["file_path"]).name
    back = read(tmp_path, content)
    assert (len(back.records), back.faults) == (10, ())


def test_two_names_of_one_file_are_a_fault(tmp_path: Path, content: Content) -> None:
    pictures(tmp_path / "images", content)
    content["images"][1]["file_path"] = "/elsewhere/images/0.jpg"
    back = read(tmp_path, content, images=tmp_path)
    assert any(fault.field == "file_path" and "is that of" in str(fault) for fault in back.faults)


def face_of(R_cam: np.ndarray, direction: np.ndarray) -> int:
    """The id of the face whose normal points most in a direction."""
    return max(NORMALS, key=lambda face: NORMALS[face][1] * R_cam[:, NORMALS[face][0]] @ direction)


def locks_of(content: Content) -> CuboidSet:
    """Lock the faces of all boxes where they are."""
    there = level_set()
    for annotation, record in zip(content["annotations"], there.records, strict=True):
        R_cam = np.array(annotation["R_cam"])
        annotation["face_locks"] = {
            "front": face_of(R_cam, record.rotation[:, 0]),
            "left": face_of(R_cam, record.rotation[:, 1]),
            "top": face_of(R_cam, record.rotation[:, 2]),
        }
    return there


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_locked_faces_name_the_sides_whatever_the_columns_are(
    tmp_path: Path, content: Content, quarter: int
) -> None:
    there = level_set()
    turn = np.linalg.matrix_power(np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), quarter)
    for annotation, record in zip(content["annotations"], there.records, strict=True):
        R_cam = np.array(annotation["R_cam"]) @ turn  # about its own y, which points down
        W, H, L = annotation["dimensions"]
        annotation["R_cam"] = R_cam.tolist()
        annotation["bbox3D_cam"] = None
        annotation["dimensions"] = [L, H, W] if quarter % 2 else [W, H, L]
        annotation["face_locks"] = {
            name: face_of(R_cam, record.rotation[:, axis])
            for axis, name in enumerate(("front", "left", "top"))
        }
    back = read(tmp_path, content)
    assert back.faults == ()
    for ours, theirs in zip(back.records, there.records, strict=True):
        assert ours.heading_known
        assert np.abs(ours.rotation - theirs.rotation).max() < 1e-9
        assert np.abs(ours.size - theirs.size).max() < 1e-9
    assert any("10 boxes have their sides named by the file's face_locks" in n for n in back.notes)
    assert not any(r.heading_known for r in read(tmp_path, content, heading_known=False).records)


def test_two_locked_faces_tell_the_third(tmp_path: Path, content: Content) -> None:
    there = locks_of(content)
    for number, annotation in enumerate(content["annotations"]):
        del annotation["face_locks"][("top", "left")[number % 2]]
    back = read(tmp_path, content)
    assert back.faults == ()
    for ours, theirs in zip(back.records, there.records, strict=True):
        assert np.abs(ours.rotation - theirs.rotation).max() < 1e-9


BAD: dict[str, tuple[Content, str]] = {
    "left-handed": ({"front": 3, "top": 0, "left": 5}, "no right-handed frame"),
    "one axis twice": ({"front": 3, "top": 2}, "two names for one axis"),
    "unknown face": ({"front": 6, "top": 0}, "faces 0 to 5"),
    "unknown name": ({"front": 3, "nose": 0}, "must give front, top, left"),
    "no front": ({"top": 0}, "must give the front"),
}


@pytest.mark.parametrize("case", BAD)
def test_locks_that_contradict_themselves_are_faults(
    tmp_path: Path, content: Content, case: str
) -> None:
    content["annotations"][1]["face_locks"], words = BAD[case]
    back = read(tmp_path, content)
    (fault,) = back.faults
    assert (fault.sample_id, fault.field) == ("images/0.jpg#1", "face_locks")
    assert words in fault.problem


def with_headings(content: Content, off: float) -> None:
    """Give all boxes KITTI's alpha of their front, so many radians off."""
    for annotation in content["annotations"]:
        forward = np.array(annotation["R_cam"])[:, 0]
        x, _, z = annotation["center_cam"]
        yaw = np.arctan2(-forward[2], forward[0])
        annotation |= {"heading_alpha": yaw - np.arctan2(x, z) + off, "heading_valid": 1}


@pytest.mark.parametrize(("off", "turned"), [(0.0, False), (0.4, False), (np.pi - 0.3, True)])
def test_a_heading_tells_which_end_of_the_box_is_its_front(
    tmp_path: Path, content: Content, off: float, turned: bool
) -> None:
    with_headings(content, off)
    back = read(tmp_path, content)
    assert back.faults == ()
    turn = np.diag([-1.0, -1, 1]) if turned else np.eye(3)
    for ours, theirs in zip(back.records, level_set().records, strict=True):
        assert ours.heading_known
        assert np.abs(ours.rotation - theirs.rotation @ turn).max() < 1e-9
        assert np.abs(ours.size - theirs.size).max() < 1e-9
    assert any("10 boxes have their front by heading_alpha" in note for note in back.notes)
    assert "face_visible" in target_of(tmp_path, content)


def target_of(tmp_path: Path, content: Content) -> dict[str, Any]:
    pictures(tmp_path / "images", content)
    sample = Omni3DDataset(tmp_path / "file.json")[0]
    assert not isinstance(sample, Skipped)
    return sample[1]


def test_headings_that_run_across_most_boxes_name_none(tmp_path: Path, content: Content) -> None:
    with_headings(content, np.pi / 2)
    back = read(tmp_path, content)
    assert (len(back.records), back.faults) == (10, ())
    assert not any(record.heading_known for record in back.records)
    assert any("10 boxes have a heading_alpha that does not point" in n for n in back.notes)
    assert "face_visible" not in target_of(tmp_path, content)


def test_headings_name_no_side_while_many_run_across(tmp_path: Path, content: Content) -> None:
    with_headings(content, 0.0)
    for annotation in content["annotations"][:3]:
        annotation["heading_alpha"] += np.pi / 2
    assert not any(record.heading_known for record in read(tmp_path, content).records)
    with_headings(content, 0.0)
    content["annotations"][0]["heading_alpha"] += np.pi / 2
    known = [record.heading_known for record in read(tmp_path, content).records]
    assert known == [False] + [True] * 9


def test_headings_that_are_not_valid_say_nothing(tmp_path: Path, content: Content) -> None:
    with_headings(content, 0.0)
    content["annotations"][3]["heading_valid"] = 0
    content["annotations"][4]["heading_alpha"] = None
    known = [record.heading_known for record in read(tmp_path, content).records]
    assert known == [number not in (3, 4) for number in range(10)]


def test_times_individuals_and_tracks_travel_and_places_do_not(
    tmp_path: Path, content: Content
) -> None:
    content["images"][0] |= {"datetime": "2024-05-01 06:10:00", "location": "a secret place"}
    content["annotations"][0]["individual_id"] = "Nala"
    content["annotations"][0]["track_id"] = 17
    content["annotations"][1]["track_id"] = "mare"
    back = read(tmp_path, content)
    assert [record.sighting.track for record in back.records[:3]] == ["17", "mare", None]
    known = target_of(tmp_path, content)["meta"]["sightings"]
    assert known[0] == {"time": "2024-05-01 06:10:00", "individual": "Nala", "track": "17"}
    assert [one["time"] for one in known] == ["2024-05-01 06:10:00"] * 4
    assert "secret" not in str(back)
    write_omni3d(back, tmp_path / "out.json")
    written = json.loads((tmp_path / "out.json").read_text())["annotations"]
    assert [a.get("track_id", "none") for a in written[:3]] == ["17", "mare", "none"]

"""Omni3D files of other programs: other axes and units, flat matrices, things listed twice."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cuboid_sets import random_set, visible_part

from animal3dbox.datasets.cuboid_datasets import Omni3DDataset
from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.records import CuboidSet
from animal3dbox.errors import ConfigError

Content = dict[str, Any]
LENGTHS = ("center_cam", "bbox3D_cam", "dimensions")


@pytest.fixture
def content(tmp_path: Path) -> Content:
    """A good file of another program, all of whose boxes are in front of the camera."""
    write_omni3d(random_set(in_view=True), tmp_path / "good.json")
    file: Content = json.loads((tmp_path / "good.json").read_text())
    file["info"] = {"id": 0, "source": "made", "name": "made", "version": 0.1}
    for annotation in file["annotations"]:
        del annotation["metric"], annotation["heading_known"]
    return file


def read(tmp_path: Path, content: Content, **options: Any) -> CuboidSet:
    (tmp_path / "file.json").write_text(json.dumps(content))
    return read_omni3d(tmp_path / "file.json", **options)


def in_opengl(annotation: Content) -> None:
    """Turn a box into OpenGL's axes: y up, z backward."""
    turn = np.array([1.0, -1, -1])
    annotation["center_cam"] = (turn * annotation["center_cam"]).tolist()
    annotation["bbox3D_cam"] = (turn * annotation["bbox3D_cam"]).tolist()
    annotation["R_cam"] = (turn[:, None] * annotation["R_cam"]).tolist()
    annotation |= {key: [-1] * 4 for key in ("bbox2D_proj", "bbox2D_trunc", "bbox2D_tight")}


@pytest.mark.parametrize("behind_camera", [False, 0, None, -1])
def test_a_file_in_opengl_axes_is_a_fault_that_says_so(
    tmp_path: Path, content: Content, behind_camera: object
) -> None:
    for annotation in content["annotations"]:
        in_opengl(annotation)
        annotation["behind_camera"] = behind_camera
    back = read(tmp_path, content)
    assert back.records == ()
    assert len(back.faults) == 10
    assert str(back.faults[0]).startswith("images/0.jpg: center_cam: has z = -")
    assert all("OpenGL's axes" in fault.problem for fault in back.faults)


def test_one_box_behind_the_camera_that_denies_it_is_a_fault(
    tmp_path: Path, content: Content
) -> None:
    in_opengl(content["annotations"][1])
    back = read(tmp_path, content)
    (fault,) = back.faults
    assert (fault.sample_id, fault.field) == ("images/0.jpg#1", "center_cam")
    assert "behind_camera is false" in fault.problem
    assert "OpenGL" not in fault.problem


def test_boxes_that_say_they_are_behind_the_camera_are_read_and_a_file_of_them_noted(
    tmp_path: Path, content: Content
) -> None:
    in_opengl(content["annotations"][1])
    content["annotations"][1]["behind_camera"] = True
    back = read(tmp_path, content)
    assert (len(back.records), back.faults) == (10, ())
    assert not any("behind the camera" in note for note in back.notes)
    for annotation in content["annotations"]:
        if annotation["center_cam"][2] > 0:
            in_opengl(annotation)
        annotation["behind_camera"] = True
    back = read(tmp_path, content)
    assert len(back.records) == 10
    assert any("all 10 boxes lie behind the camera" in note for note in back.notes)


@pytest.mark.parametrize(
    ("per_metre", "words"),
    [(1000.0, "millimetres"), (100.0, "centimetres"), (0.002, "scaled"), (1.0, None)],
)
def test_boxes_of_a_size_that_metres_do_not_explain_are_noted(
    tmp_path: Path, content: Content, per_metre: float, words: str | None
) -> None:
    for annotation in content["annotations"]:
        for key in LENGTHS:
            annotation[key] = (np.array(annotation[key]) * per_metre).tolist()
    back = read(tmp_path, content)
    assert (len(back.records), back.faults) == (10, ())
    notes = [note for note in back.notes if "the median box" in note]
    assert len(notes) == (words is not None)
    assert all(words in note for note in notes if words)


@pytest.mark.parametrize(
    ("units", "metric", "known"),
    [
        (None, "info", False),
        (None, "yes", True),
        ("m", "info", True),
        ("Metres", "info", True),
        ("mm", "info", False),
        ("m", "no", False),
    ],
)
def test_lengths_of_a_foreign_file_are_metres_where_it_or_the_user_says_so(
    tmp_path: Path, content: Content, units: str | None, metric: Any, known: bool
) -> None:
    if units is not None:
        content["info"]["units"] = units
    content["annotations"][0]["metric"] = True  # which is a key of files of this package
    back = read(tmp_path, content, metric=metric)
    assert {record.metric for record in back.records} == {known}
    assert any("--metric yes" in note for note in back.notes) == (not known and metric == "info")
    dataset = Omni3DDataset(tmp_path / "file.json", metric=metric)
    assert any("--metric yes" in note for note in dataset.source.notes) == (
        not known and metric == "info"
    )


def test_another_word_for_metric_is_refused(tmp_path: Path, content: Content) -> None:
    with pytest.raises(ConfigError, match="metric must be one of yes, no, info, got 'maybe'"):
        read(tmp_path, content, metric="maybe")


@pytest.mark.parametrize("field", ["K", "R_cam", "bbox3D_cam"])
def test_a_matrix_row_by_row_in_one_list_is_read(
    tmp_path: Path, content: Content, field: str
) -> None:
    there = read(tmp_path, content)
    for element in content["images" if field == "K" else "annotations"]:
        element[field] = np.array(element[field]).ravel().tolist()
    back = read(tmp_path, content)
    assert (len(back.records), back.faults) == (10, ())
    for ours, theirs in zip(back.records, there.records, strict=True):
        assert ours.K.tolist() == theirs.K.tolist()
        assert ours.rotation.tolist() == theirs.rotation.tolist()
        assert ours.center.tolist() == theirs.center.tolist()


def test_a_flat_matrix_column_by_column_is_a_fault(tmp_path: Path, content: Content) -> None:
    content["images"][0]["K"] = np.array(content["images"][0]["K"]).T.ravel().tolist()
    back = read(tmp_path, content)
    assert str(back.faults[0]).startswith("images/0.jpg: K: K must be upper triangular")


def as_floats(value: Any) -> Any:
    """A JSON value as tables of floats write it."""
    if isinstance(value, dict):
        return {key: as_floats(one) for key, one in value.items()}
    if isinstance(value, list):
        return [as_floats(one) for one in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def test_floats_for_whole_numbers_lose_no_box(tmp_path: Path, content: Content) -> None:
    there = read(tmp_path, content)
    back = read(tmp_path, as_floats(content))
    assert (len(back.records), back.faults) == (10, ())
    assert [record.sample_id for record in back.records] == [
        record.sample_id for record in there.records
    ]


def test_nulls_for_what_need_not_be_said_and_a_mark_of_utf8_are_read(
    tmp_path: Path, content: Content
) -> None:
    for annotation in content["annotations"]:
        annotation |= dict.fromkeys(("valid3D", "behind_camera", "category_name", "truncation"))
    (tmp_path / "marked.json").write_bytes(b"\xef\xbb\xbf" + json.dumps(content).encode())
    back = read_omni3d(tmp_path / "marked.json")
    assert (len(back.records), back.faults) == (10, ())


def test_an_annotation_whose_id_another_has_is_a_fault(tmp_path: Path, content: Content) -> None:
    content["annotations"][2]["id"] = content["annotations"][0]["id"]
    back = read(tmp_path, content)
    (fault,) = back.faults
    assert (fault.sample_id, fault.field) == ("images/0.jpg#2", "id")
    assert "is that of images/0.jpg too" in fault.problem
    assert len(back.records) == 9


def test_the_same_box_twice_is_a_fault_though_rounded_and_of_another_category(
    tmp_path: Path, content: Content
) -> None:
    again = json.loads(json.dumps(content["annotations"][1])) | {"id": 999, "category_id": 1}
    again["category_name"] = content["categories"][1]["name"]
    again["center_cam"] = np.round(again["center_cam"], 4).tolist()
    content["annotations"].append(again)
    back = read(tmp_path, content)
    (fault,) = back.faults
    assert (fault.sample_id, fault.field) == ("images/0.jpg#4", "box")
    assert "is that of images/0.jpg#1 once more" in fault.problem
    assert len(back.records) == 10


def test_the_same_box_in_two_images_is_two_boxes(tmp_path: Path, content: Content) -> None:
    first, other = content["images"][0], content["images"][2]  # the other has no box
    other |= {key: first[key] for key in ("K", "width", "height")}
    again = content["annotations"][0] | {"id": 999, "image_id": other["id"]}
    content["annotations"].append(again)
    back = read(tmp_path, content)
    assert (len(back.records), back.faults) == (11, ())


@pytest.mark.parametrize("field", ["bbox2D_tight", "bbox2D_trunc", "bbox2D_proj"])
def test_a_2d_box_beside_the_projected_one_is_a_fault(
    tmp_path: Path, content: Content, field: str
) -> None:
    width = content["images"][0]["width"]
    content["annotations"][0][field] = [width - 9.0, 1.0, width - 2.0, 9.0]
    back = read(tmp_path, content)
    (fault,) = back.faults
    assert (fault.sample_id, fault.field) == ("images/0.jpg", field)


@pytest.mark.parametrize(
    ("signs", "words"),
    [((1, -1, 1), "y up"), ((-1, -1, 1), "PyTorch3D's axes"), ((-1, 1, 1), "x left of")],
)
def test_axes_of_another_camera_are_named_where_2d_boxes_tell_them(
    tmp_path: Path, content: Content, signs: tuple[int, ...], words: str
) -> None:
    turn = np.array(signs)
    annotation = content["annotations"][0]
    for key in ("center_cam", "bbox3D_cam"):
        annotation[key] = (turn * annotation[key]).tolist()
    annotation["R_cam"] = None  # whose columns a mirror makes no rotation
    if turn.prod() > 0:
        annotation["R_cam"] = (turn[:, None] * content_rotation(tmp_path)).tolist()
    else:
        annotation["bbox3D_cam"] = [annotation["bbox3D_cam"][k] for k in (4, 5, 6, 7, 0, 1, 2, 3)]
    back = read(tmp_path, content)
    (fault,) = back.faults
    assert (fault.sample_id, fault.field) == ("images/0.jpg", "bbox2D_proj")
    assert words in fault.problem


def content_rotation(tmp_path: Path) -> np.ndarray:
    """R_cam of the first box of the good file."""
    return np.array(json.loads((tmp_path / "good.json").read_text())["annotations"][0]["R_cam"])


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_k_of_a_picture_of_another_size_is_named(
    tmp_path: Path, content: Content, factor: float
) -> None:
    K = np.array(content["images"][1]["K"])
    content["images"][1]["K"] = (np.diag([1 / factor, 1 / factor, 1]) @ K).tolist()
    (fault,) = read(tmp_path, content).faults
    assert (fault.sample_id, fault.field) == ("images/1.jpg", "bbox2D_proj")
    assert f"a picture {factor:g} times as large" in fault.problem


def test_a_2d_box_of_the_visible_half_is_no_fault(tmp_path: Path, content: Content) -> None:
    for annotation in content["annotations"]:
        x1, y1, x2, y2 = annotation["bbox2D_trunc"]
        annotation["bbox2D_tight"] = [x1, y1, (x1 + x2) / 2, (y1 + y2) / 2]
    assert read(tmp_path, content).faults == ()


def test_orientation_without_corners_is_taken_on_trust_and_noted(
    tmp_path: Path, content: Content
) -> None:
    assert not any("on trust" in note for note in read(tmp_path, content).notes)
    for annotation in content["annotations"][:3]:
        annotation["bbox3D_cam"] = None
    back = read(tmp_path, content)
    assert back.faults == ()
    assert any("bbox3D_cam is missing in 3 of 10" in note for note in back.notes)


@pytest.mark.parametrize("order", ["LHW", "HWL", "LWH", "WLH", "HLW"])
@pytest.mark.parametrize("field", ["bbox2D_proj", "bbox2D_trunc", "bbox2D_tight"])
def test_dimensions_in_another_order_without_corners_are_faults_that_name_it(
    tmp_path: Path, content: Content, order: str, field: str
) -> None:
    for annotation in content["annotations"]:
        annotation["bbox3D_cam"] = None
        annotation["bbox2D_tight"] = annotation["bbox2D_trunc"]
        annotation |= {
            key: [-1] * 4 for key in ("bbox2D_proj", "bbox2D_trunc", "bbox2D_tight") if key != field
        }
        by_name = dict(zip("WHL", annotation["dimensions"], strict=True))
        annotation["dimensions"] = [by_name[name] for name in order]
    back = read(tmp_path, content)
    assert back.records == ()
    assert len(back.faults) == 10
    for fault in back.faults:
        assert fault.field == "dimensions"
        assert f"look like [{', '.join(order)}], not [W, H, L]" in fault.problem


@pytest.mark.parametrize("field", ["bbox2D_proj", "bbox2D_trunc", "bbox2D_tight"])
def test_dimensions_as_documented_are_no_fault_without_corners(
    tmp_path: Path, content: Content, field: str
) -> None:
    for number, annotation in enumerate(content["annotations"]):
        annotation["bbox3D_cam"] = None
        annotation |= {
            key: [-1] * 4
            for key in ("bbox2D_proj", "bbox2D_trunc", "bbox2D_tight")
            if key != field or number % 4 == 0
        }
    assert read(tmp_path, content).faults == ()


@pytest.mark.parametrize("order", ["WHL", "LHW", "HLW", "LWH"])
def test_boxes_round_what_is_visible_tell_an_order_together(tmp_path: Path, order: str) -> None:
    records = []
    for seed in range(4):
        for one in random_set(seed, upright=True, in_view=True).records:
            animal = replace(
                one,
                sample_id=f"{seed}/{one.sample_id}",
                image_id=f"{seed}/{one.image_id}",
                size=one.size.mean() * np.array([1.6, 0.5, 1.0]),
            )
            records.append(replace(animal, box=visible_part(animal)))
    write_omni3d(CuboidSet("things", tuple(records), ()), tmp_path / "good.json")
    content = json.loads((tmp_path / "good.json").read_text())
    content["info"] = {"id": 0}
    for annotation in content["annotations"]:
        annotation |= {key: [-1] * 4 for key in ("bbox2D_proj", "bbox2D_trunc")}
        annotation["bbox3D_cam"] = None
        by_name = dict(zip("WHL", annotation["dimensions"], strict=True))
        annotation["dimensions"] = [by_name[name] for name in order]
    faults = read(tmp_path, content).faults
    if order == "WHL":
        assert faults == ()
        return
    assert len(faults) == len(records)
    assert all(f"look like [{', '.join(order)}]" in fault.problem for fault in faults)

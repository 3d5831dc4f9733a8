"""What other programs write differently is read alike by every reader of JSON, and noted."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from photo_dataset import View, toy_scene, view_of
from PIL import Image
from written_otherwise import JsonSet, broken_mask, json_set

from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.labelling.keypoint_places import keypoints_problem
from animal3dbox.datasets.records import RecordSet
from animal3dbox.errors import ConfigError, SampleError

FORMATS = ("coco", "stanfordextra", "animal3d")
Rows = list[list[float]]


@pytest.fixture(scope="module")
def view() -> View:
    return view_of(toy_scene(), 60)


@pytest.fixture(params=FORMATS)
def made(request: pytest.FixtureRequest, tmp_path: Path, view: View) -> JsonSet:
    return json_set(request.param, tmp_path / "set", view)


def read(made: JsonSet, **options: object) -> RecordSet:
    return read_dataset(made.write(), made.format, made.options(**options)).records


def same(found: RecordSet, plain: RecordSet) -> None:
    assert found.faults == ()
    assert len(found.records) == len(plain.records)
    for one, other in zip(found.records, plain.records, strict=True):
        assert (one.image_hw, one.image_path) == (other.image_hw, other.image_path)
        assert np.array_equal(one.keypoints_2d, other.keypoints_2d)


def as_floats(value: object) -> object:
    if isinstance(value, dict):
        return {key: as_floats(one) for key, one in value.items() if key != "counts"} | (
            {"counts": value["counts"]} if "counts" in value else {}
        )
    if isinstance(value, list):
        return [as_floats(one) for one in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def test_whole_numbers_may_be_floats(made: JsonSet) -> None:
    plain = read(made)
    made.content = as_floats(made.content)
    if made.format == "coco":
        for animal in made.animals:
            animal["iscrowd"] = None
    same(read(made), plain)


@pytest.mark.parametrize(
    "rename",
    [
        lambda name: name.replace("/", "\\"),
        lambda name: "C:\\photos\\" + name.replace("/", "\\"),
        lambda name: f"/somewhere/else/{name}",
        lambda name: f"images/{name}",
        lambda name: f"https://example.org/set/{name}",
        lambda name: name.replace("/", "%2F"),
        lambda name: name.upper(),
    ],
)
def test_images_are_found_by_names_of_other_systems(
    made: JsonSet, rename: Callable[[str], str]
) -> None:
    plain = read(made)
    made.rename_images(rename)
    found = read(made)
    same(found, plain)
    for record in found.records:
        assert "somewhere" not in record.image_id, "an absolute path does not travel"


def test_images_that_lie_elsewhere_are_noted(made: JsonSet) -> None:
    assert not any("not where" in note for note in read(made).notes)
    made.rename_images(lambda name: f"photos/{name}")
    assert any("not where their names say: 'photos/" in note for note in read(made).notes)


def test_two_names_of_one_file_are_a_fault(made: JsonSet) -> None:
    second, key = made.images[1]
    first, _ = made.images[0]
    second[key] = first[key].upper()
    faults = read(made).faults
    assert faults
    assert all("two images of a dataset are two files" in fault.problem for fault in faults)


def test_a_lost_image_does_not_get_another_of_the_same_name(made: JsonSet) -> None:
    plain = read(made)
    lost, key = made.images[0]
    lost[key] = f"other/{lost[key]}"
    found = read(made)
    assert found.faults
    assert all("is not taken for it, since other images" in one.problem for one in found.faults)
    kept = [record.image_id for record in plain.records if record.image_id != lost[key][6:]]
    assert [record.image_id for record in found.records] == kept


def test_names_of_windows_do_not_travel(made: JsonSet) -> None:
    plain = read(made)
    made.rename_images(lambda name: name.replace("/", "\\"))
    assert [one.image_id for one in read(made).records] == [one.image_id for one in plain.records]


@pytest.mark.parametrize("value", [None, "10 10 5 5", [1, 2, "x", 4], {"x": 1}, [[1, 2, 3, 4]]])
@pytest.mark.parametrize("made", ["coco", "stanfordextra"], indirect=True)  # Animal3D's: not read
def test_a_box_of_any_wrong_form_costs_only_itself(made: JsonSet, value: Any) -> None:
    made.animals[0][box_key(made)] = value
    path = made.write()
    dropped = read_dataset(path, options=made.options(optional="drop")).records
    assert not dropped.faults
    assert sum(record.box is None for record in dropped.records) == 1
    faults = read_dataset(path, options=made.options()).records.faults
    is_absent = made.format == "coco" and value is None
    assert {fault.field for fault in faults} == (set() if is_absent else {box_key(made)})


def box_key(made: JsonSet) -> str:
    return "bbox" if made.format == "coco" else "img_bbox"


def test_ids_that_floats_cannot_tell_apart_are_faults(tmp_path: Path, view: View) -> None:
    made = json_set("coco", tmp_path / "set", view)
    first = 2.0**53
    for k, image in enumerate(made.content["images"]):
        for animal in made.animals:
            if animal["image_id"] == image["id"]:
                animal["image_id"] = first + 2 * k
        image["id"] = first + 2 * k
    found = read(made)
    assert not found.records
    assert {fault.field for fault in found.faults} >= {"id"}


def minus_ones(rows: Rows) -> Rows:
    return [[-1.0, -1.0, 1.0], *rows[1:]]


def test_minus_one_is_missing_and_noted(made: JsonSet) -> None:
    made.change_keypoints(minus_ones)
    found = read(made)
    assert found.faults == ()
    for record in found.records:
        assert not (record.keypoints_2d[:, :2] == -1).any()
    assert any("(-1, -1)" in note for note in found.notes)


def test_a_visibility_of_minus_one_is_missing(made: JsonSet) -> None:
    plain = read(made)
    made.change_keypoints(lambda rows: [[x, y, v or -1] for x, y, v in rows])
    same(read(made), plain)


@pytest.mark.parametrize("made", ["coco", "animal3d"], indirect=True)
def test_scores_are_confidences_where_one_says_so(made: JsonSet) -> None:
    made.change_keypoints(lambda rows: [[x, y, 0.8 if v else 0.01] for x, y, v in rows])
    assert all("--visibility scores" in fault.problem for fault in read(made).faults)
    found = read(made, visibility="scores")
    assert found.faults == ()
    for record in found.records:
        assert set(record.keypoints_2d[:, 2].tolist()) <= {0.0, 0.8}
    with pytest.raises(ConfigError, match="visibility must be one of flags, scores"):
        read(made, visibility="sure")


@pytest.mark.parametrize("made", ["stanfordextra", "animal3d"], indirect=True)
def test_rows_of_two_numbers_are_visible_but_for_the_origin(made: JsonSet) -> None:
    plain = read(made)
    made.change_keypoints(lambda rows: [[x * (v > 0), y * (v > 0)] for x, y, v in rows])
    found = read(made)
    for one, other in zip(found.records, plain.records, strict=True):
        assert np.array_equal(one.keypoints_2d[:, 2] > 0, other.keypoints_2d[:, 2] > 0)


def test_a_bad_mask_costs_the_animal_or_only_itself(made: JsonSet) -> None:
    plain = read(made)
    broken_mask(made)
    (fault,) = read(made).faults
    assert isinstance(fault, SampleError)
    found = read(made, optional="drop")
    assert found.faults == ()
    assert len(found.records) == len(plain.records)
    assert sum(record.mask is None for record in found.records) >= 1
    assert any("left out" in note and fault.field in note for note in found.notes)


@pytest.mark.parametrize("made", ["coco", "stanfordextra"], indirect=True)
def test_an_empty_box_costs_only_itself(made: JsonSet) -> None:
    made.animals[0]["bbox" if made.format == "coco" else "img_bbox"] = []
    assert len(read(made).faults) == 1
    found = read(made, optional="drop")
    assert found.faults == ()
    assert sum(record.box is None for record in found.records) == 1


def test_an_entry_twice_is_a_fault(made: JsonSet) -> None:
    if made.format == "coco":
        made.content["annotations"].append(copy.deepcopy(made.animals[0]) | {"id": 99})
    else:
        (made.content["data"] if made.format == "animal3d" else made.content).append(
            copy.deepcopy(made.animals[0])
        )
    (fault,) = read(made).faults
    assert "once more" in fault.problem


def test_coco_reads_the_animals_of_a_mixed_file(tmp_path: Path, view: View) -> None:
    made = json_set("coco", tmp_path / "set", view)
    people = ["nose", "left_ear", "right_ear", "left_wrist", "right_wrist", "left_ankle"]
    made.content["categories"].append({"id": 1, "name": "person", "keypoints": people})
    made.animals[0].update(category_id=1, keypoints=[1.0, 1.0, 2.0] * 6)
    found = read(made)
    assert found.faults == ()
    assert {record.category for record in found.records} == {"antelope"}
    assert found.categories == ("antelope",)
    assert any("1 of 'person'" in note for note in found.notes)
    assert len(read(made, categories=("PERSON",)).faults) == 1
    with pytest.raises(ConfigError, match="categories must be of antelope, person, got cow"):
        read(made, categories=("cow",))


@pytest.mark.parametrize(
    "spell",
    [
        lambda name: name.replace("_", " "),
        lambda name: name.replace("_", "-").upper(),
        lambda name: "".join(word.capitalize() for word in name.split("_")),
        lambda name: name.replace("left_", "L_").replace("right_", "R_"),
    ],
)
def test_coco_matches_names_spelled_otherwise(
    tmp_path: Path, view: View, spell: Callable[[str], str]
) -> None:
    made = json_set("coco", tmp_path / "set", view)
    plain = read(made)
    (category,) = made.content["categories"]
    category["keypoints"] = [spell(name) for name in category["keypoints"]]
    same(read(made), plain)


def test_animal3ds_picture_is_no_mask_and_zero_parameters_are_none(
    tmp_path: Path, view: View
) -> None:
    made = json_set("animal3d", tmp_path / "set", view)
    for animal in made.animals:
        animal.update(mask_path=animal["img_path"], pose=[0.0] * 105, shape=[0.0] * 20)
        animal.update(trans=[0.0] * 3)
    found = read(made)
    assert found.faults == ()
    assert all(record.mask is None for record in found.records)
    assert any("all zero" in note for note in found.notes)


def test_animal3ds_pose_may_be_rows(tmp_path: Path, view: View) -> None:
    made = json_set("animal3d", tmp_path / "set", view)
    for animal in made.animals:
        animal.update(pose=[[0.1, 0.0, 0.0]] * 35, shape=[0.0] * 20, trans=[0.0] * 3)
    assert read(made).faults == ()


def test_categories_are_of_every_format(made: JsonSet) -> None:
    plain = read(made)
    name = plain.records[0].category
    assert len(read(made, categories=(name.upper(),)).records) == len(plain.records)
    with pytest.raises(ConfigError, match="categories must be of"):
        read(made, categories=("unicorn",))


def test_an_animal_that_comes_twice_but_for_rounding_is_a_fault(made: JsonSet) -> None:
    again = copy.deepcopy(made.animals[0])
    again["note"] = "from another tool"
    if made.format == "coco":
        again["id"] = 99
    made.append(again)
    made.change_last_keypoints(lambda rows: [[x + 0.04, y - 0.04, v] for x, y, v in rows])
    (fault,) = read(made).faults
    assert fault.field == "keypoints_2d"
    assert "once more, but for rounding" in fault.problem


@pytest.mark.parametrize("made", ["coco", "stanfordextra"], indirect=True)
def test_boxes_of_two_corners_are_not_read_as_width_and_height(made: JsonSet) -> None:
    for animal in made.animals:
        x, y, width, height = animal[box_key(made)]
        animal[box_key(made)] = [x, y, x + width, y + height]
    found = read(made)
    assert not found.records
    assert all("looks like two corners" in fault.problem for fault in found.faults)
    dropped = read(made, optional="drop")
    assert not dropped.faults
    assert all(record.box is None for record in dropped.records)


def test_two_missing_images_do_not_share_a_third_file(tmp_path: Path, view: View) -> None:
    made = json_set("stanfordextra", tmp_path / "set", view)
    made.animals[0]["img_path"], made.animals[1]["img_path"] = "vid1/a.jpg", "vid2/a.jpg"
    found = read(made)
    assert [fault.sample_id for fault in found.faults] == ["vid1/a.jpg", "vid2/a.jpg"]


@pytest.mark.parametrize("place", [(-2.0, -2.0), (-0.5, -0.5), (159.0, 119.0)])
def test_a_place_that_stands_for_missing_is_told(made: JsonSet, place: tuple[float, float]) -> None:
    made.change_keypoints(
        lambda rows: [[*place, v] if k % 4 == 0 else [x, y, v] for k, (x, y, v) in enumerate(rows)]
    )
    problems = [keypoints_problem(one, one.mask) or "" for one in read(made).records]
    assert problems
    assert all("share one place" in problem for problem in problems)


@pytest.mark.parametrize("made", ["animal3d"], indirect=True)
def test_the_picture_is_no_mask_however_it_is_named(made: JsonSet) -> None:
    animal = made.animals[0]
    for name in (f"./{animal['img_path']}", animal["img_path"].upper(), "copy.png"):
        Image.open(made.root / "images" / "a.jpg").save(made.root / "images" / "copy.png")
        animal["mask_path"] = name
        record = read(made).records[0]
        if name == "copy.png":
            with pytest.raises(SampleError, match="looks like a photograph"):
                _ = record.mask
        else:
            assert record.mask_path is None

"""Detectors' boxes in every layout: as they were, whatever one element of a file is."""

import json
import os
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from cuboid_sets import standing_set
from detector_files import (
    PTH_WRITERS,
    SCORE,
    detected_set,
    flat_elements,
    nested_elements,
    tracked_content,
    written_boxer,
    written_detany3d,
    written_flat,
    written_frames,
    written_json,
    written_pth,
    written_tracks,
    written_truth,
)

from animal3dbox.datasets.exchange.kitti_writer import write_kitti
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.readers.predictions.layouts import LAYOUTS
from animal3dbox.datasets.readers.predictions.reader import read_predictions
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError, DatasetFormatError

BOXES = detected_set()
WRITERS: dict[str, Callable[[Path, Path], Path]] = {
    "cubercnn": written_pth,
    "detect3d": written_flat,
    "detany3d": written_detany3d,
    "boxer": lambda folder, truth: written_boxer(folder, BOXES),
    "tracks": lambda folder, truth: written_tracks(folder, BOXES),
    "frames": lambda folder, truth: written_frames(folder, BOXES),
}


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    return written_truth(tmp_path, BOXES)


def same(record: CuboidRecord, other: CuboidRecord) -> bool:
    """Whether two boxes of one image and category are one, front and all."""
    return (record.image_id, record.category) == (other.image_id, other.category) and all(
        np.allclose(getattr(record, field), getattr(other, field), rtol=0, atol=1e-9)
        for field in ("center", "rotation", "size", "K")
    )


def check_all_found(found: CuboidSet, boxes: CuboidSet = BOXES) -> None:
    assert found.faults == ()
    assert len(found.records) == len(boxes.records)
    for record in boxes.records:
        assert sum(same(one, record) for one in found.records) == 1, record.sample_id


@pytest.mark.parametrize("layout", WRITERS)
def test_every_layout_gives_the_boxes_that_were_written(
    layout: str, tmp_path: Path, truth: Path
) -> None:
    found = read_predictions(WRITERS[layout](tmp_path, truth), truth)
    check_all_found(found)
    assert found.name == layout
    assert {one.score for one in found.records} == {None if layout == "tracks" else SCORE}
    assert {one.heading_known for one in found.records} == {LAYOUTS[layout].heading_known}
    assert len({one.sample_id for one in found.records}) == len(BOXES.records)


@pytest.mark.parametrize("layout", ["detect3d", "boxer"])
def test_paths_may_be_words_and_begin_at_home(
    layout: str, tmp_path: Path, truth: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = WRITERS[layout](tmp_path, truth)
    monkeypatch.setenv("HOME", str(tmp_path))
    found = read_predictions(
        f"~/{path.relative_to(tmp_path)}",
        f"~/{truth.name}",
        cameras="~/camera_poses.csv" if layout == "boxer" else None,
    )
    check_all_found(found)
    boxes = read_omni3d(f"~/{truth.name}")
    assert len(boxes.records) == len(BOXES.records)
    write_kitti(BOXES, tmp_path / "kitti", scale_free=True)
    assert len(read_kitti("~/kitti").records) == len(BOXES.records)


def test_2d_boxes_come_in_our_pixels(tmp_path: Path, truth: Path) -> None:
    found = read_predictions(written_flat(tmp_path, truth), truth)
    stated = json.loads(truth.read_text())["annotations"][0]["bbox2D_trunc"]
    assert found.records[0].box == pytest.approx(np.array(stated) - 0.5)


@pytest.mark.parametrize("form", PTH_WRITERS)
def test_every_form_of_a_pth_is_read(form: str, tmp_path: Path, truth: Path) -> None:
    check_all_found(read_predictions(written_pth(tmp_path, truth, form), truth))


class _Runs:
    """Makes a folder if it is ever unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (self.path,)


@pytest.mark.parametrize("form", PTH_WRITERS)
def test_nothing_that_a_pth_names_is_run(form: str, tmp_path: Path, truth: Path) -> None:
    content = nested_elements(truth)
    content[0]["instances"][1]["score"] = _Runs(tmp_path / "was-run")
    path = tmp_path / "p.pth"
    PTH_WRITERS[form](content, path)
    found = read_predictions(path, truth)
    assert not (tmp_path / "was-run").exists()
    assert [(one.sample_id, one.field) for one in found.faults] == [("images/0.jpg#1", "score")]
    assert len(found.records) == len(BOXES.records) - 1


def test_a_pth_with_tensors_is_refused_with_a_remedy(tmp_path: Path, truth: Path) -> None:
    torch.save([{"image_id": 1, "instances": [{"bbox3D": torch.zeros(8, 3)}]}], tmp_path / "p.pth")
    with pytest.raises(DatasetFormatError, match="tolist"):
        read_predictions(tmp_path / "p.pth", truth)


def test_a_part_that_a_pickle_names_very_often_is_refused(tmp_path: Path, truth: Path) -> None:
    part: list[Any] = [1.0] * 10
    for _ in range(12):
        part = [part] * 10
    (tmp_path / "p.pkl").write_bytes(pickle.dumps([part]))
    with pytest.raises(DatasetFormatError, match="more than a file can have written"):
        read_predictions(tmp_path / "p.pkl", truth)


@pytest.mark.parametrize("value", [1.0, 0.0, -1.0])
def test_dummy_boxes_are_refused_and_counted(value: float, tmp_path: Path, truth: Path) -> None:
    elements = flat_elements(truth)
    elements[2] |= {
        "bbox3D": [[value] * 3] * 8, "center_cam": [value] * 3, "dimensions": [value] * 3,
        "R_cam": np.eye(3).tolist(),
    }  # fmt: skip
    found = read_predictions(written_json(tmp_path / "p.json", elements), truth)
    assert found.faults == ()
    assert len(found.records) == len(BOXES.records) - 1
    assert any("1 dummy boxes" in note and "images/0.jpg#2" in note for note in found.notes)


@pytest.mark.parametrize("order", [[7, 6, 5, 4, 3, 2, 1, 0], [0, 4, 1, 5, 3, 7, 2, 6]])
@pytest.mark.parametrize("dimensions", [[0, 1, 2], [2, 1, 0], [2, 0, 1]])
def test_orders_are_inferred_where_corners_are(
    order: list[int], dimensions: list[int], tmp_path: Path, truth: Path
) -> None:
    elements = flat_elements(truth)
    for one in elements:
        one["bbox3D"] = [one["bbox3D"][k] for k in order]
        one["dimensions"] = [one["dimensions"][k] for k in dimensions]
    check_all_found(read_predictions(written_json(tmp_path / "p.json", elements), truth))


def test_boxes_are_not_matched_to_the_truths(tmp_path: Path, truth: Path) -> None:
    path = written_flat(tmp_path, truth)
    content = json.loads(truth.read_text())
    truth.write_text(json.dumps({**content, "annotations": []}))
    check_all_found(read_predictions(path, truth))


@pytest.mark.parametrize("layout", ["detect3d", "cubercnn"])
@pytest.mark.parametrize("known", [True, False])
def test_the_user_can_say_whether_headings_are_known(
    layout: str, known: bool, tmp_path: Path, truth: Path
) -> None:
    found = read_predictions(WRITERS[layout](tmp_path, truth), truth, heading_known=known)
    assert {one.heading_known for one in found.records} == {known}


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"image_id": 99}, "image_id"),
        ({"image_id": None}, "image_id"),
        ({"category_id": 99}, "category_id"),
        ({"category_id": "dog"}, "category_id"),
        ({"score": float("nan")}, "score"),
        ({"score": "high"}, "score"),
        ({"bbox": [1, 2, -3, 4]}, "bbox"),
        ({"bbox": [1, 2, 3]}, "bbox"),
        ({"bbox3D": [[0.0, 1, 2]] * 7}, "bbox3D"),
        ({"bbox3D": [[float("inf"), 1, 2]] * 8}, "bbox3D"),
        ({"bbox3D": [[0.0, 1, k] for k in range(8)]}, "bbox3D"),
        ({"center_cam": [0, 0, 99]}, "center_cam"),
        ({"center_cam": [0, None, 5]}, "center_cam"),
        ({"dimensions": [1, 2]}, "dimensions"),
        ({"dimensions": None}, "dimensions"),
        ({"dimensions": [0.5, -1, 2]}, "dimensions"),
        ({"dimensions": [9.0, 9, 9]}, "dimensions"),
        ({"R_cam": [[2.0, 0, 0], [0, 1, 0], [0, 0, 1]]}, "R_cam"),
        ({"R_cam": [[-1.0, 0, 0], [0, 1, 0], [0, 0, 1]]}, "R_cam"),
        ({"R_cam": None, "bbox3D": None}, "bbox3D"),
    ],
)
def test_a_bad_detection_is_a_fault_of_its_own_alone(
    changes: dict[str, Any], field: str, tmp_path: Path, truth: Path
) -> None:
    elements = flat_elements(truth)
    elements[1] |= changes
    found = read_predictions(written_json(tmp_path / "p.json", elements), truth)
    sample_id = "detection 1" if field == "image_id" else "images/0.jpg#1"
    assert [(one.sample_id, one.field.partition("[")[0]) for one in found.faults] == [
        (sample_id, field)
    ]
    assert len(found.records) == len(BOXES.records) - 1


@pytest.mark.parametrize("element", [None, 3, [], "box", {}])
def test_what_is_no_detection_is_a_fault(element: object, tmp_path: Path, truth: Path) -> None:
    elements = [*flat_elements(truth), element]
    found = read_predictions(written_json(tmp_path / "p.json", elements), truth)
    assert [one.sample_id for one in found.faults] == ["detection 10"]
    assert len(found.records) == len(BOXES.records)


def test_categories_of_a_pth_are_places_and_of_a_list_are_ids(tmp_path: Path) -> None:
    truth = written_truth(tmp_path, BOXES, first_category_id=1000)
    check_all_found(read_predictions(written_pth(tmp_path, truth), truth))
    check_all_found(read_predictions(written_flat(tmp_path, truth), truth))
    wrong = read_predictions(written_flat(tmp_path, truth), truth, category_ids="contiguous")
    assert {one.field for one in wrong.faults} == {"category_id"}
    assert len(wrong.faults) == len(BOXES.records)
    (tmp_path / "truth_category_meta.json").unlink()
    check_all_found(read_predictions(written_pth(tmp_path, truth), truth))


def test_a_pth_of_another_camera_is_noted(tmp_path: Path, truth: Path) -> None:
    content = nested_elements(truth)
    content[1]["width"] += 10
    content[3]["K"][0][0] *= 2
    torch.save(content, tmp_path / "p.pth")
    notes = read_predictions(tmp_path / "p.pth", truth).notes
    assert any("of 2 images differ" in note for note in notes)
    content[1]["width"], content[3]["K"], content[4]["K"] = "wide", {"fx": 1}, [[1.0], 2]
    torch.save(content, tmp_path / "p.pth")
    found = read_predictions(tmp_path / "p.pth", truth)
    check_all_found(found)
    assert any("of 3 images differ" in note for note in found.notes)


def test_numbers_that_no_float_holds_cost_only_their_detection(tmp_path: Path, truth: Path) -> None:
    path = written_flat(tmp_path, truth)
    path.write_text(path.read_text().replace(f'"score": {SCORE}', '"score": 1e999', 1))
    found = read_predictions(path, truth)
    assert [(one.sample_id, one.field) for one in found.faults] == [("images/0.jpg", "score")]
    assert len(found.records) == len(BOXES.records) - 1


def test_categories_that_the_truth_lacks_are_kept_and_noted(tmp_path: Path, truth: Path) -> None:
    content = tracked_content(BOXES)
    content["tracks"]["0"]["category"] = "Dog"
    content["tracks"]["1"]["category"] = "okapi"
    found = read_predictions(written_json(tmp_path / "t.json", content), truth)
    assert {"Dog", "okapi"} <= {one.category for one in found.records}
    assert "the truth has no categories 'okapi'" in found.notes


def test_boxer_needs_the_cameras_poses(tmp_path: Path, truth: Path) -> None:
    path = written_boxer(tmp_path, BOXES)
    poses = (tmp_path / "camera_poses.csv").rename(tmp_path / "elsewhere.csv")
    with pytest.raises(DatasetFormatError, match="cameras' poses as a csv"):
        read_predictions(path, truth)
    check_all_found(read_predictions(path, truth, cameras=poses))


@pytest.mark.parametrize(
    ("column", "value", "field"),
    [
        (0, "7", "time_ns"),
        (1, "", "tx_world_object"),
        (4, "9", "qw_world_object"),
        (8, "-1", "scale_x"),
        (14, "nan", "prob"),
    ],
)
def test_a_bad_row_of_boxer_is_a_fault_of_its_own_alone(
    column: int, value: str, field: str, tmp_path: Path, truth: Path
) -> None:
    path = written_boxer(tmp_path, BOXES)
    lines = path.read_text().splitlines()
    cells = lines[2].split(",")
    cells[column] = value
    path.write_text("\n".join((*lines[:2], ",".join(cells), *lines[3:])))
    found = read_predictions(path, truth)
    assert [one.field.partition(",")[0] for one in found.faults] == [field]
    assert len(found.records) == len(BOXES.records) - 1


def test_frames_need_the_cameras_poses_or_a_word_that_there_are_none(
    tmp_path: Path, truth: Path
) -> None:
    path = written_frames(tmp_path, BOXES)
    (tmp_path / "camera_params").rename(tmp_path / "poses")
    with pytest.raises(DatasetFormatError, match="cam_c2w"):
        read_predictions(path, truth)
    check_all_found(read_predictions(path, truth, cameras=tmp_path / "poses"))
    in_world = read_predictions(path, truth, cameras="camera")
    assert not any(same(one, other) for one in in_world.records for other in BOXES.records)


def test_a_bad_frame_is_a_fault_of_its_own_alone(tmp_path: Path, truth: Path) -> None:
    path = written_frames(tmp_path, BOXES)
    (path / "frame_0000.json").write_text("[")
    (path / "frame_0001.json").write_text("{}")
    (tmp_path / "camera_params" / "frame_0003.npz").write_bytes(b"none")
    (path / "mask_track_mapping.json").write_text("{}")
    found = read_predictions(path, truth, layout="frames")
    assert len(found.faults) == 4
    assert {one.image_id for one in found.records} == {"images/4.jpg"}


def test_poses_of_images_that_the_truth_lacks_spoil_nothing(tmp_path: Path) -> None:
    path = written_boxer(tmp_path, BOXES)
    some = tuple(one for one in BOXES.records if one.image_id != "images/1.jpg")
    truth = written_truth(tmp_path, replace(BOXES, records=some, images=()))
    found = read_predictions(path, truth)
    assert [one.field for one in found.faults] == ["time_ns"]
    assert len(found.records) == len(some)


def test_damaged_files_are_refused_as_such(tmp_path: Path, truth: Path) -> None:
    whole = written_pth(tmp_path, truth).read_bytes()
    rng = np.random.default_rng(0)
    spoilt = [whole[: len(whole) // 2], b"\x80\x02.", b"PK\x03\x04", b"[", rng.bytes(300)]
    for number in range(60):
        data = bytearray(whole)
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        spoilt.append(bytes(data) if number % 2 else pickle.dumps(nested_elements(truth))[:-number])
    refused = 0
    for content in spoilt:
        (tmp_path / "p.pth").write_bytes(content)
        try:
            read_predictions(tmp_path / "p.pth", truth)
        except DatasetFormatError:
            refused += 1  # any other error fails the test
    assert refused > len(spoilt) // 2


def renamed(names: list[str]) -> CuboidSet:
    """The set with other names for its images."""
    of = {image.image_id: name for image, name in zip(BOXES.images, names, strict=True)}
    return replace(
        BOXES,
        images=tuple(replace(one, image_id=of[one.image_id]) for one in BOXES.images),
        records=tuple(
            replace(one, image_id=of[one.image_id], sample_id=of[one.image_id])
            for one in BOXES.records
        ),
    )


def test_frames_of_tracks_are_found_by_number_or_order_and_never_guessed(tmp_path: Path) -> None:
    letters, from_one = renamed(list("abcde")), renamed([f"v/{k}.jpg" for k in range(1, 6)])
    for boxes in (letters, from_one):
        truth = written_truth(tmp_path, boxes)
        found = read_predictions(written_tracks(tmp_path, boxes), truth)
        check_all_found(found, boxes)
        assert any("in their order" in note for note in found.notes)
    fewer = {**tracked_content(from_one), "n_frames": 4}
    with pytest.raises(DatasetFormatError, match="cannot be told"):
        read_predictions(written_json(tmp_path / "t.json", fewer), truth)


def test_a_bad_box_of_a_track_is_a_fault_of_its_own_alone(tmp_path: Path, truth: Path) -> None:
    content = tracked_content(BOXES)
    content["tracks"]["0"]["boxes_3d"][0][6:] = [0.0, 0, 0, 0]
    content["tracks"]["1"] = {"category": "dog", "boxes_3d": 5}
    found = read_predictions(written_json(tmp_path / "t.json", content), truth)
    assert sorted(one.field for one in found.faults) == ["boxes_3d", "boxes_3d"]
    assert found.records


def test_kitti_results_are_read_in_the_truths_images(tmp_path: Path) -> None:
    boxes = standing_set()
    boxes = replace(boxes, images=boxes.listed_images())
    truth = written_truth(tmp_path, boxes)
    write_kitti(boxes, tmp_path / "kitti")
    for file in (tmp_path / "kitti" / "label_2").glob("*.txt"):
        file.write_text("".join(f"{line} 0.5\n" for line in file.read_text().splitlines()))
    found = read_predictions(tmp_path / "kitti", truth)
    assert found.faults == ()
    assert [one.image_id for one in found.records] == [one.image_id for one in boxes.records]
    for record, other in zip(found.records, boxes.records, strict=True):
        assert record.score == 0.5
        assert record.center == pytest.approx(other.center, abs=1e-5)
        assert record.rotation == pytest.approx(other.rotation, abs=1e-5)


def test_options_without_use_and_unknown_layouts_are_refused(tmp_path: Path, truth: Path) -> None:
    path = written_flat(tmp_path, truth)
    with pytest.raises(ConfigError, match="cameras has no use"):
        read_predictions(path, truth, cameras="camera")
    with pytest.raises(ConfigError, match="layout must be one of"):
        read_predictions(path, truth, layout="yolo")
    with pytest.raises(ConfigError, match="category_ids has no use"):
        read_predictions(written_tracks(tmp_path, BOXES), truth, category_ids="dataset")
    for content in ({"a": 1}, [{"a": 1}], 3):
        with pytest.raises(DatasetFormatError, match="no layout"):
            read_predictions(written_json(tmp_path / "other.json", content), truth)


def test_the_page_of_layouts_says_what_the_code_does() -> None:
    page = (Path(__file__).parents[3] / "docs" / "predictions.md").read_text()
    page = page.split("## Layouts")[1].split("\n## ")[0]
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| `")]
    assert [row[0].strip("`") for row in rows] == list(LAYOUTS)
    for row, layout in zip(rows, LAYOUTS.values(), strict=True):
        assert row[1] == layout.written_by
        assert row[3] == layout.frame
        assert layout.categories in row[5] or (layout.categories == "dataset" and "ids" in row[5])
        assert (row[6] == "known") == layout.heading_known


@pytest.mark.parametrize("other", [2, "1"])
def test_an_instance_that_names_another_image_than_its_element_is_a_fault_that_names_both(
    other: int | str, tmp_path: Path, truth: Path
) -> None:
    elements = nested_elements(truth)
    first = next(element for element in elements if element["instances"])
    first["image_id"], first["instances"][0]["image_id"] = 1, other
    path = tmp_path / "p.pth"
    PTH_WRITERS["archive"](elements, path)
    found = read_predictions(path, truth)
    assert len(found.records) == len(BOXES.records) - 1
    (fault,) = found.faults
    assert fault.field == "image_id"
    assert f"is {other!r}, and its element's is 1" in fault.problem

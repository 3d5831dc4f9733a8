"""The command `compare`: who is whose, by how much they differ, and what is drawn."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from commands import labels_of_one_animal, ran
from cuboid_sets import simple_record
from detector_files import detected_set, flat_elements, written_json, written_pth, written_truth
from PIL import Image

from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import DatasetFormatError
from animal3dbox.evaluate.comparison import (
    compared_boxes,
    comparison_tables,
    cuboids_of,
    matched_pairs,
)
from animal3dbox.evaluate.comparison_pictures import drawn_boxes
from animal3dbox.report.cuboid_pen import FRONT
from animal3dbox.report.overlay import draw_cuboid

BOXES = detected_set()


def compared(folder: Path, spoil: Callable[[list[dict[str, Any]]], None], *more: str) -> Any:
    """The exit code, what was printed and compare.json, of detections that were changed."""
    truth = written_truth(folder, BOXES)
    elements = flat_elements(truth, "pose")
    spoil(elements)
    path = written_json(folder / "p.json", elements)
    code, text = ran(
        "compare", truth, "--with", path, "--truth", truth, "--out", folder / "out", *more
    )
    return code, text, json.loads((folder / "out" / "compare.json").read_text())


def facts(content: Any) -> dict[str, Any]:
    return {row["of the boxes"]: row["value"] for row in content["tables"]["summary"]["rows"]}


def test_the_truth_as_detections_matches_wholly(tmp_path: Path) -> None:
    truth = written_truth(tmp_path, BOXES)
    path = written_pth(tmp_path, truth)
    code, text = ran("compare", truth, "--with", path, "--truth", truth, "--out", tmp_path / "out")
    assert code == 0, text
    found = facts(json.loads((tmp_path / "out" / "compare.json").read_text()))
    assert (found["matched"], found["label only"], found["detection only"]) == (10, 0, 0)
    assert found["iou_3d, mean"] == pytest.approx(1, abs=1e-6)
    assert found["headings known in both"] == 10
    assert found["head for tail (heading_deg > 90), %"] == 0
    assert "Detections beside labels" in text


def test_what_is_missing_or_too_much_or_faulty_is_told(tmp_path: Path) -> None:
    def spoil(elements: list[dict[str, Any]]) -> None:
        far = {"center_cam": [30.0, 0, 90], "bbox3D": None}
        elements.append({**elements[0], **far})
        del elements[4]
        elements[5]["dimensions"] = [1, 2]

    code, text, content = compared(tmp_path, spoil, "--json")
    assert code == 4
    assert json.loads(text) == content
    found = facts(content)
    assert (found["matched"], found["label only"], found["detection only"]) == (8, 2, 1)
    assert ["dimensions" in fault for fault in content["about"]["faults"]] == [True]


def test_a_detection_turned_round_has_its_head_at_the_tail(tmp_path: Path) -> None:
    def spoil(elements: list[dict[str, Any]]) -> None:
        for one in elements:
            one["pose"] = (np.array(one["pose"]) * [-1, 1, -1]).tolist()

    found = facts(compared(tmp_path, spoil)[2])
    assert found["head for tail (heading_deg > 90), %"] == 100
    assert found["heading_deg, median"] == pytest.approx(180)
    assert found["axis_deg, median"] == pytest.approx(0, abs=1e-6)
    assert found["iou_3d, mean"] == pytest.approx(1, abs=1e-6)
    told = facts(compared(tmp_path, spoil, "--heading", "unknown")[2])
    assert told["headings known in both"] == 0
    assert told["heading_deg, median"] is None


def test_metrics_are_told_with_the_labels_for_the_truth(tmp_path: Path) -> None:
    def turned_and_wrong(elements: list[dict[str, Any]]) -> None:
        for one in elements:
            one["pose"] = (np.array(one["pose"]) * [-1, 1, -1]).tolist()
        elements.append({**elements[0], "score": 0.01})  # a repeat, and the least sure

    _, text, content = compared(tmp_path, turned_and_wrong)
    rows = {row["metric"]: row for row in content["tables"]["metrics"]["rows"]}
    assert (rows["truths"]["value"], rows["predictions"]["value"]) == (10, 11)
    assert rows["ap_3d"]["value"] == pytest.approx(1)
    assert rows["ap_3d_h45"]["value"] == 0
    assert rows["flip_rate"]["value"] == 1
    assert rows["ap_3d"]["low"] is not None
    assert "ap_3d_h45" in text


def test_scores_below_the_least_are_left_out_and_counted(tmp_path: Path) -> None:
    def spoil(elements: list[dict[str, Any]]) -> None:
        elements[0]["score"] = 0.1

    content = compared(tmp_path, spoil, "--least-score", "0.2")[2]
    assert facts(content)["label only"] == 1
    assert any("1 detections have a score below 0.2" in note for note in content["about"]["notes"])


def test_the_csv_has_a_row_a_box_and_runs_no_formula(tmp_path: Path) -> None:
    boxes = CuboidSet("labels", tuple(replace(one, category="=1+1") for one in BOXES.records), ())
    truth = written_truth(tmp_path, boxes)
    path = written_json(tmp_path / "p.json", flat_elements(truth))
    ran("compare", truth, "--with", path, "--truth", truth, "--out", tmp_path / "out")
    text = (tmp_path / "out" / "compare.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    assert len(rows) == 10
    assert {row["status"] for row in rows} == {"matched"}
    assert {row["label_category"] for row in rows} == {"'=1+1"}
    assert rows[0]["heading_deg"] == ""  # of a layout that folds yaw


def test_pictures_are_drawn_over_the_photographs_the_worst_first(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for image in BOXES.images[:4]:
        height, width = image.image_hw
        Image.new("RGB", (width, height), (0, 0, 200)).save(tmp_path / image.image_id)

    def spoil(elements: list[dict[str, Any]]) -> None:
        elements[4]["center_cam"] = (1.3 * np.array(elements[4]["center_cam"])).tolist()
        elements[4]["bbox3D"] = None

    overlay = tmp_path / "out" / "overlays" / "0000.png"  # as label calls that of 0000.jpg
    overlay.parent.mkdir(parents=True)
    overlay.write_bytes(b"of a label")
    compared(tmp_path, spoil)
    _, text, content = compared(tmp_path, spoil, "--pictures", "2")
    names = sorted(path.name for path in (tmp_path / "out" / "pictures").iterdir())
    assert names == ["0000.png", "0001.png"]
    assert overlay.read_bytes() == b"of a label"
    page = (tmp_path / "out" / "compare.html").read_text()
    assert page.index("<h2>images/1.jpg") == page.index("<h2>images/")
    assert content["tables"]["boxes"]["rows"]
    assert "pictures are grey" not in text


def test_a_picture_that_is_not_there_is_grey_and_told(tmp_path: Path) -> None:
    _, text, _ = compared(tmp_path, lambda elements: None)
    assert "4 pictures are grey" in text
    assert "--images" in text


def test_labels_of_other_images_are_refused(tmp_path: Path) -> None:
    labels = labels_of_one_animal(tmp_path)
    truth = written_truth(tmp_path, BOXES)
    path = written_json(tmp_path / "p.json", flat_elements(truth))
    code, text = ran("compare", labels, "--with", path, "--truth", truth, "--out", tmp_path / "out")
    assert code == 3
    assert "no image of the labels (herd/a.jpg, ...) is one of the truth's" in text


def test_labels_of_unknown_scale_are_compared_at_the_detections_distance(tmp_path: Path) -> None:
    labels = labels_of_one_animal(tmp_path)
    truth = tmp_path / "truth.json"
    code, text = ran("export", labels, "--to", "omni3d", "--out", truth, "--metres-per-unit", "2")
    assert code == 0, text
    path = written_json(tmp_path / "p.json", flat_elements(truth, "pose"))
    arguments = ("compare", labels, "--with", path, "--truth", truth, "--out", tmp_path / "out")
    assert ran(*arguments)[0] == 0
    (row,) = json.loads((tmp_path / "out" / "compare.json").read_text())["tables"]["boxes"]["rows"]
    assert row["iou_3d"] is None
    content = json.loads((tmp_path / "out" / "compare.json").read_text())
    values = {row["metric"]: row["value"] for row in content["tables"]["metrics"]["rows"]}
    assert values["rel_ap_3d"] > 0.9
    assert "ap_3d" not in values
    assert row["iou_3d_scaled"] == pytest.approx(1, abs=1e-6)
    assert row["size_ratio"] == pytest.approx(2)
    assert ran(*arguments, "--metres-per-unit", "2")[0] == 0
    (row,) = json.loads((tmp_path / "out" / "compare.json").read_text())["tables"]["boxes"]["rows"]
    assert row["iou_3d"] == pytest.approx(1, abs=1e-6)


def test_boxes_are_matched_one_to_one_in_space_before_in_the_picture() -> None:
    iou_3d = np.array([[0.0, 0.4], [0.3, 0.5]])
    iou_2d = np.array([[0.9, 0.5], [0.8, 0.9]])
    assert matched_pairs(iou_3d, iou_2d) == [(0, 1), (1, 0)]
    assert matched_pairs(np.zeros((1, 2)), np.array([[0.31, 0.6]])) == [(0, 1)]
    assert matched_pairs(np.array([[0.01]]), np.array([[0.1]])) == []
    assert matched_pairs(np.zeros((0, 3)), np.zeros((0, 3))) == []


def shifted(record: CuboidRecord, **changes: Any) -> CuboidSet:
    return CuboidSet("d", (replace(record, **changes),), ())


def test_numbers_of_one_pair_are_those_of_a_calculation_by_hand() -> None:
    label = simple_record()  # 2 x 1 x 1.5 along the camera's x, z, -y; centre (1, 0.5, 10)
    half = shifted(label, center=label.center + np.array([1.0, 0, 0]), score=0.5)
    (box,) = compared_boxes(CuboidSet("l", (label,), ()), half)
    assert box.iou_3d == pytest.approx(1 / 3)
    row = box.row()
    assert row["apart"] == pytest.approx(1)
    assert (row["size_ratio"], row["axis_deg"], row["heading_deg"]) == pytest.approx((1, 0, 0))
    farther = shifted(label, center=2 * label.center, size=2 * label.size)
    (box,) = compared_boxes(CuboidSet("l", (label,), ()), farther)
    assert box.status == "matched"  # by their projections, which are the same
    assert (box.iou_3d, box.iou_2d) == pytest.approx((0, 1))
    assert box.row()["iou_3d_scaled"] == pytest.approx(1)
    assert box.row()["size_ratio"] == pytest.approx(2)


def test_no_boxes_at_all_are_a_table_of_noughts() -> None:
    summary, every = comparison_tables(compared_boxes(CuboidSet("l", (), ()), BOXES))
    values = {str(row[0]): row[1] for row in summary.rows}
    assert values["detection only"] == 10
    assert values["iou_3d, mean"] is None
    assert len(every.rows) == 10
    with pytest.raises(DatasetFormatError, match="no image of the labels"):
        compared_boxes(CuboidSet("l", (simple_record(image_id="other.jpg"),), ()), BOXES)


def test_a_box_without_a_heading_has_no_coloured_front() -> None:
    boxes = cuboids_of([simple_record(center=np.array([-4.0, 0.5, 10]))])  # its front is seen
    box = type(boxes)(boxes.center[0], boxes.rotation[0], boxes.size[0])
    K = torch.tensor([[400.0, 0, 319.5], [0, 400, 239.5], [0, 0, 1]], dtype=torch.float64)
    for dashed in (False, True):
        greens = []
        for heading_known in (True, False):
            canvas = np.zeros((480, 640, 3), dtype=np.uint8)
            draw_cuboid(canvas, box, K, dashed=dashed, heading_known=heading_known)
            assert canvas.any()
            greens.append(int((canvas == FRONT).all(-1).sum()))
        assert greens[0] > 0
        assert greens[1] == 0


def test_the_picture_of_a_comparison_enlarges_small_animals_and_no_front_is_made_up() -> None:
    far = simple_record(center=np.array([-4.0, 0.5, 40]))
    pixels = np.zeros((480, 640, 3), dtype=np.uint8)
    for heading_known in (True, False):
        record = replace(far, heading_known=heading_known)
        (box,) = compared_boxes(CuboidSet("l", (record,), ()), CuboidSet("d", (record,), ()))
        picture = drawn_boxes(pixels, [box])
        assert picture[:, 480:].any()  # the inset, far from the animal
        assert (picture == FRONT).all(-1).any() == heading_known


def test_kitti_labels_have_their_own_pictures_and_the_truth_those_of_images(
    tmp_path: Path,
) -> None:
    kitti, out = tmp_path / "kitti", tmp_path / "out"
    assert ran("export", written_truth(tmp_path, BOXES), "--to", "kitti", "--out", kitti)[0] == 0
    (kitti / "image_2").mkdir()
    for line in (kitti / "images.txt").read_text().splitlines():
        if line[0].isdigit():
            number, width, height = line.split()[:3]
            picture = Image.new("RGB", (int(width), int(height)))
            picture.save(kitti / "image_2" / f"{int(number):06d}.png")
    (kitti / "images.txt").unlink()
    truth = tmp_path / "cars.json"
    assert ran("export", kitti, "--to", "omni3d", "--out", truth)[0] == 0
    detections = written_json(tmp_path / "p.json", flat_elements(truth, "pose"))
    code, text = ran(
        "compare", kitti, "--with", detections, "--truth", truth, "--out", out, "--images", kitti
    )
    assert code == 0, text
    found = facts(json.loads((out / "compare.json").read_text()))
    assert found["matched"] == len(BOXES.records)
    assert "grey" not in text


def test_a_list_of_pictures_that_is_a_folder_is_refused_before_the_work(tmp_path: Path) -> None:
    truth = written_truth(tmp_path, BOXES)
    path = written_json(tmp_path / "p.json", flat_elements(truth))
    (tmp_path / "out" / ".compare-pictures").mkdir(parents=True)
    code, text = ran("compare", truth, "--with", path, "--truth", truth, "--out", tmp_path / "out")
    assert code == 2
    assert ".compare-pictures is not a file" in text
    assert not (tmp_path / "out" / "compare.json").exists()

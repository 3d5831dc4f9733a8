"""2D boxes as prompts for open-vocabulary detectors: in the numbers of the Omni3D export."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import labels_of_one_animal, ran
from cuboid_sets import random_set, simple_record

from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.exchange.oracle2d_writer import write_oracle2d
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError


def written(folder: Path, boxes: CuboidSet, **options: Any) -> Any:
    write_oracle2d(boxes, folder / "oracle.json", **options)
    return json.loads((folder / "oracle.json").read_text())


def of(*records: CuboidRecord) -> CuboidSet:
    return CuboidSet("labels", records, ())


def test_an_element_has_what_detectors_ask_for(tmp_path: Path) -> None:
    record = simple_record(score=0.25, metric=False)
    assert written(tmp_path, of(record)) == [
        {
            "image_id": 1, "K": [[100.0, 0, 80], [0, 100, 60], [0, 0, 1]],
            "file_path": "images/a.jpg", "height": 120, "width": 160,
            "instances": [
                {"bbox": [80.0, 56, 20, 16], "score": 0.25, "category_id": 0,
                 "category_name": "dog"}
            ],
        }
    ]  # fmt: skip


def test_numbers_are_those_of_the_omni3d_export_of_the_same_set(tmp_path: Path) -> None:
    boxes = random_set(in_view=True)
    categories = ("zebra", "dog", "brown bear")
    images = written(tmp_path, boxes, first_id=7, categories=categories)
    write_omni3d(boxes, tmp_path / "o.json", first_id=7, categories=categories)
    content = json.loads((tmp_path / "o.json").read_text())
    for key, other in (("image_id", "id"), ("K", "K"), ("file_path", "file_path")):
        assert [one[key] for one in images] == [one[other] for one in content["images"]]
    meta = json.loads((tmp_path / "o_category_meta.json").read_text())
    prompts = [(image["image_id"], one) for image in images for one in image["instances"]]
    assert len(prompts) == len(content["annotations"]) == 10
    for (image_id, one), other in zip(prompts, content["annotations"], strict=True):
        assert image_id == other["image_id"]
        assert one["category_name"] == other["category_name"]
        assert meta["thing_classes"][one["category_id"]] == other["category_name"]
        stated = other["bbox2D_tight"]
        x1, y1, x2, y2 = other["bbox2D_trunc"] if stated == [-1] * 4 else stated
        assert one["bbox"] == pytest.approx([x1, y1, x2 - x1, y2 - y1])
    assert [len(image["instances"]) for image in images] == [4, 1, 0, 2, 3]


def test_boxes_are_cut_by_the_frame_and_those_beside_it_left_out(tmp_path: Path) -> None:
    cut = simple_record(box=np.array([149.5, 99.5, 200, 300]))
    beside = replace(cut, sample_id="images/a.jpg#1", box=np.array([200.0, 10, 220, 30]))
    behind = replace(cut, sample_id="images/a.jpg#2", box=None, center=np.array([0, 0, -9.0]))
    summary = write_oracle2d(of(cut, beside, behind), tmp_path / "oracle.json")
    content = json.loads((tmp_path / "oracle.json").read_text())
    assert [one["bbox"] for one in content[0]["instances"]] == [[150, 100, 10, 20]]
    assert [fault.sample_id for fault in summary.faults] == [beside.sample_id, behind.sample_id]
    assert (summary.boxes, summary.images, summary.next_id) == (1, 1, 2)


def test_boxes_that_the_dataset_does_not_give_are_told(tmp_path: Path) -> None:
    summary = write_oracle2d(of(simple_record(box=None)), tmp_path / "oracle.json")
    assert any("no 2D box of 1 boxes" in note for note in summary.notes)
    with pytest.raises(ConfigError, match="lacks dog"):
        write_oracle2d(of(simple_record()), tmp_path / "o.json", categories=("cat",))


def test_the_command_writes_labels_of_any_scale(tmp_path: Path) -> None:
    labels, out = labels_of_one_animal(tmp_path), tmp_path / "prompts.json"
    code, text = ran("export", labels, "--to", "oracle2d", "--out", out, "--first-id", "5")
    assert code == 0, text
    (image,) = json.loads(out.read_text())
    assert (image["image_id"], image["file_path"]) == (5, "herd/a.jpg")
    (row,) = json.loads((tmp_path / "labels.json").read_text())["animals"]
    x, y, width, height = image["instances"][0]["bbox"]
    assert [x - 0.5, y - 0.5, x + width - 0.5, y + height - 0.5] == pytest.approx(row["box"])
    code, text = ran("export", labels, "--to", "oracle2d", "--out", out, "--dataset-id", "1")
    assert code == 2
    assert "--dataset-id is for" in text

"""Exports that are joined: ids that differ, one list of categories; KITTI's occlusion, pictures."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import labels_of_one_animal, ran
from cuboid_sets import random_set, simple_record
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from animal3dbox.datasets.exchange.coco_writer import write_coco
from animal3dbox.datasets.exchange.export import ExportSummary
from animal3dbox.datasets.exchange.kitti_writer import write_kitti
from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError

Writer = Callable[..., ExportSummary]


def of_category(category: str, seed: int) -> CuboidSet:
    boxes = random_set(seed, in_view=True)
    return replace(
        boxes, records=tuple(replace(record, category=category) for record in boxes.records)
    )


@pytest.mark.parametrize("write", [write_omni3d, write_coco])
def test_two_exports_joined_have_no_id_twice_and_none_below_one(
    tmp_path: Path, write: Writer
) -> None:
    names = ("dog", "cat", "okapi")
    first = write(of_category("dog", 0), tmp_path / "a.json", categories=names)
    second = write(
        of_category("cat", 1), tmp_path / "b.json", categories=names, first_id=first.next_id
    )
    files: list[dict[str, Any]] = [
        json.loads((tmp_path / name).read_text()) for name in ("a.json", "b.json")
    ]
    for key in ("images", "annotations"):
        ids = [element["id"] for file in files for element in file[key]]
        assert min(ids) == 1
        assert len(set(ids)) == len(ids)
        assert second.next_id > max(ids)
    images = [{image["id"] for image in file["images"]} for file in files]
    for file, own in zip(files, images, strict=True):
        assert {annotation["image_id"] for annotation in file["annotations"]} <= own
    assert files[0]["categories"] == files[1]["categories"]
    by_id = {category["id"]: category["name"] for category in files[0]["categories"]}
    assert [by_id[file["annotations"][0]["category_id"]] for file in files] == ["dog", "cat"]


@pytest.mark.parametrize("write", [write_omni3d, write_coco])
def test_ids_and_categories_that_evaluators_misread_are_refused(
    tmp_path: Path, write: Writer
) -> None:
    boxes = of_category("dog", 0)
    for options, words in (
        ({"first_id": 0}, "must be 1 or greater, got 0: evaluators take 0 for no box"),
        ({"categories": ("cat",)}, "lacks dog"),
        ({"categories": ("dog", "dog")}, "categories must differ"),
    ):
        with pytest.raises(ConfigError, match=words):
            write(boxes, tmp_path / "a.json", **options)
    assert not any(tmp_path.iterdir())


def test_a_category_without_boxes_has_no_statistics_and_keeps_its_place(tmp_path: Path) -> None:
    write_omni3d(of_category("dog", 0), tmp_path / "a.json", categories=("okapi", "dog"))
    stats = json.loads((tmp_path / "a_stats.json").read_text())
    assert stats["priors_dims_per_cat"][0] == [None, None]
    assert [row["n_anns"] for row in stats["categories"]] == [0, 10]
    assert read_omni3d(tmp_path / "a.json").categories == ("okapi", "dog")


def at(x: float, z: float, number: int, **changes: object) -> CuboidRecord:
    """A box two wide, one deep and one high that faces the camera's right, at a place."""
    fields = {
        "sample_id": f"images/a.jpg#{number}" if number else "images/a.jpg",
        "center": np.array([x, 0.0, z]), "size": np.array([2.0, 1.0, 1.0]), "box": None,
    }  # fmt: skip
    return simple_record(**{**fields, **changes})


def occluded(folder: Path) -> list[int]:
    text = (folder / "label_2" / "000000.txt").read_text()
    return [int(line.split()[2]) for line in text.splitlines()]


@pytest.mark.parametrize(
    ("edge_px", "level"),
    # The far box goes from -20 to 20 px about the middle; all right of the near one's left edge is
    # hidden: nothing, a third, four fifths.
    [(25.0, 0), (6.7, 1), (-12.0, 2)],
)
def test_occlusion_is_what_nearer_boxes_hide(tmp_path: Path, edge_px: float, level: int) -> None:
    far = at(0.0, 5.5, 0)
    near = at(1.3 + edge_px * 4.5 / 100, 4.5, 1, size=np.array([2.6, 0.1, 3.0]))
    exported = write_kitti(CuboidSet("labels", (far, near), ()), tmp_path)
    assert occluded(tmp_path) == [level, 0]
    assert any("occluded of 2 of 2 boxes" in note for note in exported.notes)


@pytest.mark.parametrize(
    ("visibility", "level"), [(1.0, 0), (0.9, 0), (0.7, 1), (0.55, 1), (0.4, 2), (0.0, 2)]
)
def test_a_visibility_that_the_dataset_states_is_believed(
    tmp_path: Path, visibility: float, level: int
) -> None:
    boxes = CuboidSet("labels", (at(0.0, 8.0, 0, visibility=visibility),), ())
    exported = write_kitti(boxes, tmp_path / "kitti")
    assert occluded(tmp_path / "kitti") == [level]
    assert not any("occluded" in note for note in exported.notes)
    back = read_kitti(tmp_path / "kitti").records[0].visibility
    assert back == {0: 1.0, 1: 0.7, 2: 0.3}[level]
    write_omni3d(boxes, tmp_path / "a.json")
    assert read_omni3d(tmp_path / "a.json").records[0].visibility == visibility


def test_pictures_are_written_anew_without_what_their_files_say(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    pixels = np.arange(120 * 160 * 3, dtype=np.uint8).reshape(120, 160, 3)
    info = PngInfo()
    info.add_text("Comment", "a secret place")
    path = tmp_path / "images" / "a.png"
    Image.fromarray(pixels).save(path, pnginfo=info)
    assert b"secret" in path.read_bytes()
    boxes = CuboidSet(
        "labels", (at(0.0, 8.0, 0, image_path=path), at(1, 9.0, 1, image_path=path)), ()
    )
    exported = write_kitti(boxes, tmp_path / "kitti", split="val", first_id=7)
    assert exported.faults == ()
    written = tmp_path / "kitti" / "image_2" / "000007.png"
    assert b"secret" not in written.read_bytes()
    assert (np.asarray(Image.open(written)) == pixels).all()
    assert (tmp_path / "kitti" / "ImageSets" / "val.txt").read_text() == "000007\n"
    assert exported.next_id == 8
    back = read_kitti(tmp_path / "kitti")
    assert back.records[0].image_path == written
    assert back.records[0].image_id == "images/a.jpg"


def test_pictures_that_are_missing_are_noted_and_spoilt_ones_are_faults(tmp_path: Path) -> None:
    exported = write_kitti(CuboidSet("labels", (at(0.0, 8.0, 0),), ()), tmp_path / "a")
    assert any("1 of 1 pictures were not found" in note for note in exported.notes)
    Image.new("L", (10, 10)).save(tmp_path / "small.png")
    boxes = CuboidSet("labels", (at(0.0, 8.0, 0, image_path=tmp_path / "small.png"),), ())
    (fault,) = write_kitti(boxes, tmp_path / "b").faults
    assert (fault.sample_id, fault.field) == ("images/a.jpg", "image")


@pytest.mark.parametrize(
    ("options", "words"),
    [({"first_id": -1}, "must be 0 or greater"), ({"split": "../up"}, "split must be a name")],
)
def test_kitti_refuses_numbers_and_splits_that_are_none(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        write_kitti(CuboidSet("labels", (at(0.0, 8.0, 0),), ()), tmp_path, **options)
    assert not any(tmp_path.iterdir())


def test_the_command_passes_ids_splits_and_categories_on(tmp_path: Path) -> None:
    write_omni3d(of_category("dog", 0), tmp_path / "in.json")
    asked = ("export", tmp_path / "in.json", "--to")
    code, output = ran(
        *asked, "omni3d", "--out", tmp_path / "out.json", "--first-id", "92", "--dataset-id", "3",
        "--split", "val", "--categories", "cat", "dog",
    )  # fmt: skip
    assert (code, "--first-id 102" in output) == (0, True)
    file = json.loads((tmp_path / "out.json").read_text())
    assert (file["info"]["id"], file["info"]["split"]) == (3, "val")
    assert {annotation["dataset_id"] for annotation in file["annotations"]} == {3}
    assert [annotation["id"] for annotation in file["annotations"]] == list(range(92, 102))
    assert [category["name"] for category in file["categories"]] == ["cat", "dog"]
    for to, option in (
        ("coco", ("--split", "val")),
        ("kitti", ("--dataset-id", "1")),
        ("kitti", ("--categories", "dog")),
        ("animal3d", ("--first-id", "5")),
    ):
        code, output = ran(*asked, to, "--out", tmp_path / "x", *option)
        assert (code, f"{option[0]} is for --to" in output) == (2, True), output


def test_kitti_of_labels_takes_its_pictures_from_the_folder_that_is_given(tmp_path: Path) -> None:
    labels = labels_of_one_animal(tmp_path / "labels")
    row = json.loads((labels / "labels.json").read_text())["animals"][0]
    height, width = row["image_hw"]
    place = tmp_path / "photos" / row["image"]
    place.parent.mkdir(parents=True)
    Image.new("RGB", (width, height)).save(place)
    asked = ("export", labels, "--to", "kitti", "--scale-free", "--out")
    code, output = ran(*asked, tmp_path / "a", "--images", tmp_path / "photos")
    assert (code, "pictures were not found" in output) == (0, False)
    assert (tmp_path / "a" / "image_2" / "000000.png").is_file()
    code, output = ran(*asked, tmp_path / "b")
    assert (code, "1 of 1 pictures were not found" in output) == (0, True)

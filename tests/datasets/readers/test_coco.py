"""Reading COCO keypoints.

Names before positions, masks to the pixel, every fault with its sample and field.
"""

import json
import random
from pathlib import Path

import numpy as np
import pytest
from coco_dataset import (
    AP10K_NAMES,
    COCO_FAULTS,
    annotation_of,
    ap10k_view,
    coco_content,
    write_coco,
)
from photo_dataset import HW
from PIL import Image

from animal3dbox.cli.main import main
from animal3dbox.datasets.formats import read_dataset, recognised_format
from animal3dbox.datasets.images.rle import decode_counts
from animal3dbox.datasets.images.segmentation import polygon_mask
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.readers.coco.animal import HIDDEN_CONFIDENCE
from animal3dbox.datasets.readers.coco.reader import read_coco
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.smal.keypoints.vocabularies import AP10K
from animal3dbox.smal.keypoints.vocabulary import vocabulary_from_names

# What is there
# --------------------------------------------------------------------------------------------------


def test_records_hold_what_the_file_says_those_of_an_image_together(tmp_path: Path) -> None:
    found = read_coco(write_coco(tmp_path, coco_content(tmp_path)))
    assert found.faults == ()
    assert [record.sample_id for record in found.records] == ["a.jpg", "sub/b.jpg", "sub/b.jpg#1"]
    assert [record.image_id for record in found.records] == ["a.jpg", "sub/b.jpg", "sub/b.jpg"]
    assert found.notes == ("1 of 3 images have no annotation of an animal",)
    record, view = found.records[0], ap10k_view(60)
    assert (record.vocabulary.name, record.category, record.image_hw) == ("ap10k17", "antelope", HW)
    assert record.image_path == (tmp_path / "images" / "a.jpg").resolve()
    assert record.keypoints_2d.tolist() == view.joints
    assert record.mask is not None
    assert np.array_equal(record.mask, view.mask)
    assert record.box is not None
    rows, columns = np.nonzero(view.mask)
    assert record.box.tolist() == [
        columns.min() - 0.5,
        rows.min() - 0.5,
        columns.max() + 0.5,
        rows.max() + 0.5,
    ]


def test_a_permuted_list_of_names_gives_the_same_keypoints(tmp_path: Path) -> None:
    shuffled = random.Random(0).sample([*AP10K_NAMES, "antler"], 18)
    here = read_coco(write_coco(tmp_path, coco_content(tmp_path)))
    there = read_coco(write_coco(tmp_path, coco_content(tmp_path, shuffled)))
    for a, b in zip(here.records, there.records, strict=True):
        assert a.keypoints_2d.tolist() == b.keypoints_2d.tolist()
    assert "the keypoints antler are not in the vocabulary ap10k17 and not used" in there.notes


def test_each_category_has_a_vocabulary_of_its_own(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    few = ["nose", "root_of_tail", "left_knee", "right_knee", "left_elbow", "right_elbow"]
    content["categories"].append({"id": 4, "name": "calf", "keypoints": few})
    content["annotations"][1] = annotation_of(ap10k_view(60), 1, 10, few, category_id=4)
    record = read_coco(write_coco(tmp_path, content)).records[0]
    assert record.category == "calf"
    marked = [
        name
        for name, row in zip(record.vocabulary.keypoints, record.keypoints_2d, strict=True)
        if row[2] > 0
    ]
    assert sorted(marked) == sorted(few)


def test_visibility_1_is_hidden_only_where_the_file_also_says_2(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    content["annotations"][1]["keypoints"][2] = 1
    record = read_coco(write_coco(tmp_path, content)).records[0]
    assert record.keypoints_2d[0, 2] == HIDDEN_CONFIDENCE < LabelConfig().occluded_below
    assert record.keypoints_2d[1, 2] == 1.0
    for entry in content["annotations"]:
        entry["keypoints"] = [
            min(1, value) if i % 3 == 2 else value for i, value in enumerate(entry["keypoints"])
        ]
        entry["keypoints"][15:18] = [0, 0, 0]
    found = read_coco(write_coco(tmp_path, content))
    assert set(found.records[0].keypoints_2d[:, 2].tolist()) == {0.0, 1.0}
    assert any("1 is taken to mean visible" in note for note in found.notes)


def test_keypoints_may_be_rows_and_null_counts_as_missing(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    flat = content["annotations"][1]["keypoints"]
    content["annotations"][1]["keypoints"] = [
        [None, None, 0],
        *(flat[i : i + 3] for i in range(3, 51, 3)),
    ]
    record = read_coco(write_coco(tmp_path, content)).records[0]
    assert record.keypoints_2d[0].tolist() == [0, 0, 0]
    assert record.keypoints_2d[1:].tolist() == ap10k_view(60).joints[1:]


def test_crowds_are_no_animals_and_what_is_missing_is_counted(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    content["annotations"][0]["iscrowd"] = 1
    del (
        content["annotations"][1]["keypoints"],
        content["annotations"][1]["segmentation"],
        content["annotations"][1]["bbox"],
    )
    found = read_coco(write_coco(tmp_path, content))
    assert [record.sample_id for record in found.records] == ["a.jpg", "sub/b.jpg"]
    assert found.records[0].mask is None
    assert found.records[0].box is None
    assert (
        found.notes[0]
        == "1 annotations are crowds (iscrowd 1), no single animals, and were left out"
    )
    assert "1 of 2 animals have no marked keypoint" in found.notes
    assert (
        "num_keypoints is not the number of marked keypoints in 1 of 2 animals; the marks count"
        in found.notes
    )


def test_a_faulty_animal_keeps_its_number(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    content["annotations"][0]["bbox"] = [0, 0, 0, 0]
    found = read_coco(write_coco(tmp_path, content))
    assert [fault.sample_id for fault in found.faults] == ["sub/b.jpg"]
    assert [record.sample_id for record in found.records] == ["a.jpg", "sub/b.jpg#1"]


def test_sizes_that_the_file_leaves_out_come_from_the_images(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    del content["images"][0]["height"]
    assert read_coco(write_coco(tmp_path, content)).records[0].image_hw == HW


def test_animalposes_own_json_is_read_with_corners_for_boxes(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    spelled = {
        "root_of_tail": "tailbase",
        "left_elbow": "left_front_elbow",
        "right_elbow": "right_front_elbow",
    }
    names = [
        spelled.get(name, name)
        for name in AP10K_NAMES
        if "shoulder" not in name and "hip" not in name and name != "neck"
    ]
    names = [name.replace("_knee", "_back_elbow") for name in names]
    order = [*names, "left_ear", "right_ear", "throat", "withers"] + [
        f"{s}_{p}_knee" for s in ("left", "right") for p in ("front", "back")
    ]
    rows = dict(zip(AP10K_NAMES, ap10k_view(60).joints, strict=True))
    back = {new: old for old, new in spelled.items()} | {
        f"{s}_back_elbow": f"{s}_knee" for s in ("left", "right")
    }
    x, y, width, height = content["annotations"][1]["bbox"]
    whole = {
        "images": {"1": "a.jpg"},
        "annotations": [
            {"image_id": 1, "bbox": [x, y, x + width, y + height],
                "keypoints": [rows.get(back.get(name, name), [0, 0, 0]) for name in order],
             "num_keypoints": 20, "category_id": 1}
        ],
        "categories": [{"supercategory": "animal", "id": 1, "name": "dog", "keypoints": order,
            "skeleton": []}],
    }  # fmt: skip
    path = write_coco(tmp_path, whole, "keypoints.json")
    assert recognised_format(tmp_path) == recognised_format(path) == "coco"
    (record,) = read_coco(tmp_path).records
    assert (record.vocabulary.name, record.category, record.image_hw) == ("animalpose20", "dog", HW)
    assert record.box is not None
    assert record.box.tolist() == [x - 0.5, y - 0.5, x + width - 0.5, y + height - 0.5]
    by_landmark = dict(
        zip(
            (names[0] for names in record.vocabulary.landmarks),
            record.keypoints_2d.tolist(),
            strict=True,
        )
    )
    assert by_landmark["left_back_knee"] == rows["left_knee"]  # AnimalPose's back elbow
    assert by_landmark["tail_base"] == rows["root_of_tail"]


@pytest.mark.parametrize("folder", ["images", "data", "."])
def test_images_are_found_where_datasets_have_them(tmp_path: Path, folder: str) -> None:
    content = coco_content(tmp_path)
    (tmp_path / "images").rename(tmp_path / "moved")
    if folder == ".":
        for path in list((tmp_path / "moved").iterdir()):
            path.rename(tmp_path / path.name)
        (tmp_path / "images").mkdir()  # of something else
    else:
        (tmp_path / "moved").rename(tmp_path / folder)
    assert read_coco(write_coco(tmp_path, content, "annotations/train.json")).faults == ()
    if folder != "data":
        assert read_coco(write_coco(tmp_path, content)).faults == ()


def test_the_users_vocabulary_is_used_by_name_or_for_a_file_without_names(tmp_path: Path) -> None:
    content = coco_content(tmp_path, ["a", "b", "c", "d", "e"])
    own = vocabulary_from_names(
        "mine", {"e": "nose", "d": "tail_base", "c": None, "b": "chin", "a": "neck"}
    )
    for place in range(5):
        content["annotations"][1]["keypoints"][3 * place : 3 * place + 3] = [40 + place, 50, 2]
    content["annotations"][1]["bbox"] = [30, 30, 40, 40]
    path = write_coco(tmp_path, content)
    with pytest.raises(ConfigError, match=r"category 'antelope': .*nearest is"):
        read_coco(path)
    named = read_dataset(path, options=ReadOptions(vocabulary=own)).records.records[0]
    assert named.vocabulary is own
    assert named.keypoints_2d[:, 0].tolist() == [44, 43, 42, 41, 40]
    del content["categories"][0]["keypoints"]
    path = write_coco(tmp_path, content)
    with pytest.raises(ConfigError, match="'antelope' has no keypoint names: give --vocabulary"):
        read_coco(path)
    assert read_coco(path, vocabulary=own).records[0].keypoints_2d[:, 0].tolist() == [
        40,
        41,
        42,
        43,
        44,
    ]


# Masks
# --------------------------------------------------------------------------------------------------


def test_a_polygon_along_pixel_edges_fills_just_its_pixels() -> None:
    mask = polygon_mask([np.array([[1.0, 2], [4, 2], [4, 4], [1, 4]])], (6, 7))
    rows, columns = np.nonzero(mask)
    assert (rows.min(), rows.max(), columns.min(), columns.max(), mask.sum()) == (2, 3, 1, 3, 6)


def test_polygons_of_one_animal_add_up_and_may_leave_the_image() -> None:
    rings = [
        np.array([[-3.0, -3], [2, -3], [2, 1], [-3, 1]]),
        np.array([[5.0, 5], [9, 5], [9, 9], [5, 9]]),
    ]
    assert np.argwhere(polygon_mask(rings, (6, 6))).tolist() == [[0, 0], [0, 1], [5, 5]]


def test_a_polygon_has_the_pixels_whose_centres_lie_in_it() -> None:
    generator = np.random.default_rng(0)
    for _ in range(20):
        ring = generator.uniform(-5, 25, (generator.integers(3, 9), 2))
        expected = np.zeros((20, 22), dtype=bool)
        for row in range(20):
            for column in range(22):  # a ray to the right of the centre, edge by edge
                x, y, inside = column + 0.5, row + 0.5, False
                for (x0, y0), (x1, y1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                    if (y0 <= y) != (y1 <= y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
                        inside = not inside
                expected[row, column] = inside
        assert np.array_equal(polygon_mask([ring], (20, 22)), expected)


def test_masks_may_be_runs_polygons_or_none(tmp_path: Path) -> None:
    content, view = coco_content(tmp_path), ap10k_view(60)
    runs = content["annotations"][1]["segmentation"]["counts"]
    for segmentation in (runs, {"counts": decode_counts(runs), "size": list(HW)}):
        content["annotations"][1]["segmentation"] = segmentation
        mask = read_coco(write_coco(tmp_path, content)).records[0].mask
        assert mask is not None
        assert np.array_equal(mask, view.mask)
    content["annotations"][1]["segmentation"] = [[10, 10, 30, 10, 30, 20, 10, 20]]
    mask = read_coco(write_coco(tmp_path, content)).records[0].mask
    assert mask is not None
    assert np.count_nonzero(mask) == np.count_nonzero(mask[10:20, 10:30]) == 200
    content["annotations"][1]["segmentation"] = []
    assert read_coco(write_coco(tmp_path, content)).records[0].mask is None


# Faults
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", COCO_FAULTS)
def test_a_fault_is_named_with_sample_field_and_reason_and_spoils_no_other(
    tmp_path: Path, name: str
) -> None:
    fault, content = COCO_FAULTS[name], coco_content(tmp_path)
    fault.spoil(content, tmp_path)
    found = read_coco(write_coco(tmp_path, content))
    assert tuple(error.sample_id for error in found.faults) == fault.samples
    for error in found.faults:
        assert fault.field in error.field
        assert fault.reason in error.problem
    assert {record.image_id for record in found.records} | {"a.jpg"} == {"a.jpg", "sub/b.jpg"}
    assert len(found.records) + len(found.faults) >= len(content["annotations"])


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"images": [], "annotations": [], "categories": []}, "empty list of annotations"),
        ({"images": 7, "annotations": []}, r"\$.images"),
        ({"images": []}, "missing required field `annotations`"),
        (
            {"images": [], "annotations": [{}], "categories": [{"id": 1, "keypoints": [1]}]},
            r"\$.categories\[0\].keypoints",
        ),
        (
            {
                "images": [],
                "annotations": [{}],
                "categories": [{"id": 1, "name": "a"}, {"id": 1, "name": "b"}],
            },
            "a and b have one id, 1",
        ),
    ],
)
def test_a_file_that_is_not_cocos_is_refused(
    tmp_path: Path, content: dict[str, object], reason: str
) -> None:
    with pytest.raises(DatasetFormatError, match=reason):
        read_coco(write_coco(tmp_path, content))


def test_a_folder_without_its_file_or_images_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        DatasetNotFoundError, match=r"must hold exactly one of annotations.json, keypoints.json"
    ):
        read_coco(tmp_path)
    with pytest.raises(DatasetNotFoundError, match="no folder of images"):
        read_coco(write_coco(tmp_path, coco_content(tmp_path)), tmp_path / "nowhere")
    with pytest.raises(
        ConfigError, match="no category has known keypoints: the file has no categories"
    ):
        read_coco(write_coco(tmp_path, {"images": [], "annotations": [{}]}))


def test_options_that_coco_has_no_use_for_are_refused(tmp_path: Path) -> None:
    path = write_coco(tmp_path, coco_content(tmp_path))
    with pytest.raises(ConfigError, match="COCO has none"):
        read_dataset(path, options=ReadOptions(model=Path("smal.pkl")))


# From the command line
# ------------------------------------------------------------------------------------------------


def test_label_reads_coco_with_a_vocabulary_of_the_users_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [f"point {i}" for i in range(17)]
    content = coco_content(tmp_path, names)
    for i, azimuth in ((0, 110), (1, 60), (2, 120)):
        content["annotations"][i]["keypoints"] = annotation_of(ap10k_view(azimuth), 0, 0)[
            "keypoints"
        ]
    Image.new("RGB", (5, 5)).save(tmp_path / "images" / "c.jpg")
    lines = [f'"{name}" = "{AP10K[AP10K_NAMES[i]]}"' for i, name in enumerate(names)]
    flips = [
        f'"{names[i]}" = "{names[AP10K_NAMES.index(name.replace("left", "right"))]}"'
        for i, name in enumerate(AP10K_NAMES)
        if name.startswith("left")
    ]
    (tmp_path / "mine.toml").write_text(
        "\n".join(['name = "mine"', "[keypoints]", *lines, "[flip]", *flips])
    )
    path = write_coco(tmp_path, content)
    arguments = [
        "label",
        str(path),
        "--out",
        str(tmp_path / "out"),
        "--vocabulary",
        str(tmp_path / "mine.toml"),
        "--json",
    ]
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 0
    assert json.loads(capsys.readouterr().out)["animals"] == 3
    sides = [
        animal["side"]
        for animal in json.loads((tmp_path / "out" / "labels.json").read_text())["animals"]
    ]
    assert sides == ["left", "left", "left"]

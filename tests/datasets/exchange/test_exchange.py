"""Exchange formats.

Numbers a person can check, the way there and back, units, and what each format cannot hold.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cuboid_sets import HW, random_set, simple_record

from animal3dbox.datasets.exchange.coco_writer import FLIP_PAIRS, KEYPOINT_NAMES, write_coco
from animal3dbox.datasets.exchange.export import in_metres
from animal3dbox.datasets.exchange.kitti_writer import levelled, write_kitti
from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.labelling.given_boxes import given_label
from animal3dbox.datasets.readers.cuboid_conventions import (
    COCO,
    CONVENTIONS,
    KITTI,
    OMNI3D,
    Convention,
)
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.readers.visible_boxes import stacked_boxes, visible_boxes
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError
from animal3dbox.geometry.cuboid import CORNER_SIGNS

ONE = CuboidSet("labels", (simple_record(),), ())


def corners_of(record: CuboidRecord) -> np.ndarray:
    """The corners by hand: centre plus half sizes along the axes."""
    return np.stack(
        [
            record.center + record.rotation @ (np.array(signs) * record.size / 2)
            for signs in CORNER_SIGNS
        ]
    )


def written(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text())
    return content


def test_omni3d_holds_the_faces_that_a_dataset_gives_if_they_are_asked_for(tmp_path: Path) -> None:
    whole = random_set(in_view=True).records
    cut = replace(simple_record(), center=np.array([8.0, 0.5, 10.0]), image_id="cut.jpg")
    records = tuple(replace(one, heading_known=True) for one in (*whole, cut))
    boxes = CuboidSet("labels", records, ())
    write_omni3d(boxes, tmp_path / "plain.json")
    write_omni3d(boxes, tmp_path / "faces.json", faces=True)
    plain, faces = (written(tmp_path / name) for name in ("plain.json", "faces.json"))
    fields = ("face_visible", "face_area", "face_share", "face_share_in_image")
    names = list(dict.fromkeys(one.image_id for one in boxes.records))
    in_order = sorted(boxes.records, key=lambda one: names.index(one.image_id))
    for record, box, bare in zip(in_order, faces["annotations"], plain["annotations"], strict=True):
        label = given_label(record)
        for name in fields:
            assert np.allclose(box.pop(name), getattr(label, name), rtol=1e-9, atol=1e-9)
        assert box == bare


def test_omni3d_holds_no_faces_of_a_box_whose_front_is_not_known(tmp_path: Path) -> None:
    folded = CuboidSet("labels", (replace(simple_record(), heading_known=False),), ())
    write_omni3d(folded, tmp_path / "a.json", faces=True)
    assert "face_visible" not in written(tmp_path / "a.json")["annotations"][0]


def test_omni3d_holds_the_numbers_of_one_simple_box(tmp_path: Path) -> None:
    write_omni3d(ONE, tmp_path / "a.json")
    file = written(tmp_path / "a.json")
    image, box = file["images"][0], file["annotations"][0]
    assert image == {
        "id": 1,
        "dataset_id": 0,
        "width": 160,
        "height": 120,
        "file_path": "images/a.jpg",
        "K": [[100, 0, 80], [0, 100, 60], [0, 0, 1]],
    }
    assert box["dimensions"] == [1.0, 1.5, 2.0]  # width, height, length
    assert box["center_cam"] == [1.0, 0.5, 10.0]
    assert box["R_cam"] == [
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
    ]  # forward is the camera's x, down its y, left away from it
    assert box["bbox3D_cam"][0] == [
        0.0,
        -0.25,
        9.5,
    ]  # v0: back, top, right side, which is nearest to us
    assert box["bbox3D_cam"][6] == [2.0, 1.25, 10.5]
    assert box["bbox2D_tight"] == [80, 56, 100, 72]
    x = [80 + 100 * 0 / 9.5, 80 + 100 * 2 / 9.5]
    y = [60 - 100 * 0.25 / 9.5, 60 + 100 * 1.25 / 9.5]
    assert box["bbox2D_proj"] == pytest.approx([x[0], y[0], x[1], y[1]], abs=1e-9)
    assert box["bbox2D_trunc"] == pytest.approx(box["bbox2D_proj"], abs=1e-9)
    unknown = {
        key: box[key] for key in ("visibility", "segmentation_pts", "lidar_pts", "depth_error")
    }
    assert set(unknown.values()) == {-1.0}
    assert (box["truncation"], box["behind_camera"], box["valid3D"]) == (0.0, False, True)


def test_coco_holds_the_numbers_of_one_simple_box(tmp_path: Path) -> None:
    write_coco(ONE, tmp_path / "a.json")
    file = written(tmp_path / "a.json")
    box, category = file["annotations"][0], file["categories"][0]
    assert box["bbox"] == [80.0, 56.0, 20.0, 16.0]
    points = dict(
        zip(category["keypoints"], np.array(box["keypoints"]).reshape(9, 3).tolist(), strict=True)
    )
    assert points["center"] == pytest.approx([79.5 + 10, 59.5 + 5, 2])  # pixel indices: ours
    assert points["front_right_top"] == pytest.approx(
        [79.5 + 100 * 2 / 9.5, 59.5 - 100 * 0.25 / 9.5, 2]
    )
    assert points["back_left_bottom"] == pytest.approx([79.5 + 0, 59.5 + 100 * 1.25 / 10.5, 2])
    assert category["keypoints"][0] == "back_right_bottom"
    assert ("back_right_bottom", "back_left_bottom") in FLIP_PAIRS
    assert all(
        {a.replace("left", "right"), b.replace("left", "right")} == {a.replace("left", "right")}
        for a, b in FLIP_PAIRS
    )
    edges = [
        (category["keypoints"][a - 1], category["keypoints"][b - 1])
        for a, b in category["skeleton"]
    ]
    assert all(
        sum(x != y for x, y in zip(a.split("_"), b.split("_"), strict=True)) == 1 for a, b in edges
    )


def test_kitti_holds_the_numbers_of_one_simple_box(tmp_path: Path) -> None:
    exported = write_kitti(ONE, tmp_path)
    kind, *numbers = (tmp_path / "label_2" / "000000.txt").read_text().split()
    assert kind == "dog"
    assert [float(n) for n in numbers] == pytest.approx(
        [0, 0, -np.arctan2(1, 10), 79.5, 55.5, 99.5, 71.5, 1.5, 1, 2, 1, 0.5 + 0.75, 10, 0],
        abs=1e-6,
    )
    P2 = (tmp_path / "calib" / "000000.txt").read_text().splitlines()[2]
    assert [float(n) for n in P2.split()[1:]] == [100, 0, 79.5, 0, 0, 100, 59.5, 0, 0, 0, 1, 0]
    assert exported.iou == pytest.approx((1.0,))


@pytest.mark.parametrize("convention", CONVENTIONS.values(), ids=CONVENTIONS)
@pytest.mark.parametrize("seed", range(3))
def test_corners_written_are_the_same_points_and_boxes_come_back(
    convention: Convention, seed: int
) -> None:
    center, rotation, size = stacked_boxes(random_set(seed).records)
    ours = np.stack([corners_of(record) for record in random_set(seed).records])
    theirs = convention.corners_out(center, rotation, size)
    nearest = np.linalg.norm(theirs[:, :, None] - ours[:, None], axis=-1)
    assert nearest.min(1).max() < 1e-12
    assert nearest.min(2).max() < 1e-12
    location, turned, dimensions = convention.boxes_out(center, rotation, size)
    assert np.linalg.det(turned) == pytest.approx(np.ones(len(turned)))
    for back, there in zip(
        convention.boxes_in(location, turned, dimensions), (center, rotation, size), strict=True
    ):
        assert np.abs(back - there).max() < 1e-12


def test_omni3d_corner_k_is_our_corner_of_the_documented_permutation() -> None:
    record = random_set().records[0]
    theirs = OMNI3D.corners_out(record.center, record.rotation, record.size)
    assert np.abs(theirs - corners_of(record)[[4, 5, 1, 0, 7, 6, 2, 3]]).max() < 1e-12


def assert_same(back: CuboidSet, there: CuboidSet, tolerance: float, rotation: bool = True) -> None:
    assert [record.sample_id for record in back.records] == [
        record.sample_id for record in there.records
    ]
    assert [(image.image_id, image.image_hw) for image in back.images] == [
        (image.image_id, image.image_hw) for image in there.images
    ]
    for ours, theirs in zip(back.records, there.records, strict=True):
        assert np.abs(ours.center - theirs.center).max() <= tolerance
        assert np.abs(ours.size - theirs.size).max() <= tolerance
        assert np.abs(ours.K - theirs.K).max() <= 1e-9
        assert (
            np.abs(
                ours.rotation - (theirs.rotation if rotation else levelled(theirs.rotation))
            ).max()
            <= tolerance
        )
        if theirs.box is not None and ours.box is not None:
            assert np.abs(ours.box - theirs.box).max() <= tolerance


@pytest.mark.parametrize("seed", range(4))
def test_a_set_comes_back_from_omni3d(tmp_path: Path, seed: int) -> None:
    there = random_set(seed)
    exported = write_omni3d(there, tmp_path / "a.json")
    back = read_omni3d(tmp_path / "a.json")
    assert (exported.faults, back.faults) == ((), ())
    assert_same(back, there, 1e-9)
    assert [(r.category, r.heading_known, r.metric, r.box is None) for r in back.records] == [
        (r.category, r.heading_known, r.metric, r.box is None) for r in there.records
    ]
    stated = [
        (b.truncation, t.truncation)
        for b, t in zip(back.records, there.records, strict=True)
        if t.truncation is not None
    ]
    assert all(b == t for b, t in stated)


@pytest.mark.parametrize("seed", range(4))
def test_a_set_comes_back_from_kitti_but_for_pitch_and_roll(tmp_path: Path, seed: int) -> None:
    there = random_set(seed, in_view=True)
    exported = write_kitti(there, tmp_path / "k")
    back = read_kitti(tmp_path / "k")
    assert (exported.faults, back.faults) == ((), ())
    assert_same(back, there, 2e-6, rotation=False)
    assert exported.iou is not None
    assert min(exported.iou) < 0.9
    assert f"{min(exported.iou):.3f} at worst" in exported.notes[-1]


def test_an_upright_set_comes_back_from_kitti_whole(tmp_path: Path) -> None:
    there = random_set(upright=True, in_view=True)
    exported = write_kitti(there, tmp_path / "k")
    assert_same(read_kitti(tmp_path / "k"), there, 2e-6)
    assert exported.iou == pytest.approx([1.0] * len(there.records), abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_coco_keypoints_are_the_projected_corners(tmp_path: Path, seed: int) -> None:
    there = random_set(seed)
    write_coco(there, tmp_path / "a.json")
    file = written(tmp_path / "a.json")
    kept = [
        r
        for r in there.records
        if r.box is not None or not np.isnan(visible_boxes([r]).in_frame).any()
    ]
    assert len(file["annotations"]) == len(kept)
    assert len(file["images"]) == len(there.images)
    for annotation, record in zip(file["annotations"], kept, strict=True):
        points = np.array(annotation["keypoints"]).reshape(9, 3)
        cam = np.concatenate((corners_of(record), record.center[None]))
        near = 1e-2 * np.linalg.norm(record.size)
        for (x, y, v), point in zip(points, cam, strict=True):
            px = (record.K @ point)[:2] / point[2]
            inside = all(
                -0.5 <= value <= limit - 0.5
                for value, limit in zip(px, record.image_hw[::-1], strict=True)
            )
            assert v == (0 if point[2] <= near else 2 if inside else 1)
            assert [x, y] == pytest.approx(px if v else [0, 0], abs=1e-9)


def test_boxes_behind_the_camera_have_no_projected_box_and_say_so(tmp_path: Path) -> None:
    write_omni3d(random_set(), tmp_path / "a.json")
    behind = [a for a in written(tmp_path / "a.json")["annotations"] if a["behind_camera"]]
    assert behind
    assert all(a["bbox2D_proj"] == [-1.0] * 4 for a in behind)


@pytest.mark.parametrize(
    ("center", "edge", "limit"),
    [((-7.5, 0, 10), 0, 0), ((0, -5.5, 10), 1, 0), ((7.5, 0, 10), 2, 160), ((0, 5.5, 10), 3, 120)],
)
def test_a_box_cut_by_the_frame_is_truncated_to_it(
    tmp_path: Path, center: tuple[float, ...], edge: int, limit: float
) -> None:
    cut = replace(ONE, records=(simple_record(center=np.array(center), box=None, truncation=None),))
    write_omni3d(cut, tmp_path / "a.json")
    box = written(tmp_path / "a.json")["annotations"][0]
    assert box["bbox2D_trunc"][edge] == pytest.approx(limit)
    assert (box["bbox2D_proj"][edge] - limit) * (1 if edge > 1 else -1) > 1
    assert 0 < box["truncation"] < 1
    assert box["bbox2D_tight"] == [-1.0] * 4


@pytest.mark.parametrize("write", [write_omni3d, write_kitti])
def test_formats_of_metres_refuse_an_unknown_scale_unless_told(tmp_path: Path, write: Any) -> None:
    unscaled = replace(ONE, records=(simple_record(metric=False),))
    with pytest.raises(ConfigError, match=r"images/a\.jpg.*--metres-per-unit"):
        write(unscaled, tmp_path / "a.json")
    assert not any(tmp_path.iterdir())
    exported = write(unscaled, tmp_path / "a.json", scale_free=True)
    assert "not all in metres" in exported.notes[-1]


def test_a_file_without_scale_says_so_and_is_read_so(tmp_path: Path) -> None:
    write_omni3d(
        replace(ONE, records=(simple_record(metric=False),)), tmp_path / "a.json", scale_free=True
    )
    assert written(tmp_path / "a.json")["info"]["units"] == "unknown"
    assert not read_omni3d(tmp_path / "a.json").records[0].metric


def test_a_stated_scale_makes_metres() -> None:
    scaled = in_metres(replace(ONE, records=(simple_record(metric=False),)), 0.5).records[0]
    assert scaled.metric
    assert scaled.size.tolist() == [1.0, 0.5, 0.75]
    assert scaled.center.tolist() == [0.5, 0.25, 5.0]
    for wrong, match in ((-1.0, "positive"), (float("nan"), "positive")):
        with pytest.raises(ConfigError, match=match):
            in_metres(ONE, wrong)
    with pytest.raises(ConfigError, match="already"):
        in_metres(ONE, 2.0)


def test_statistics_are_those_of_the_boxes_as_trainers_look_them_up(tmp_path: Path) -> None:
    records = tuple(
        simple_record(
            sample_id=f"{n}", image_id=f"{n}.jpg", category=name, size=np.array([length, 1.0, 1.5])
        )
        for n, (name, length) in enumerate((("Dog", 2.0), ("dog", 3.0), ("cat", 1.0)))
    )
    write_omni3d(CuboidSet("labels", records, ()), tmp_path / "a.json", first_category_id=1000)
    meta, stats = written(tmp_path / "a_category_meta.json"), written(tmp_path / "a_stats.json")
    assert meta == {
        "thing_classes": ["cat", "dog"],
        "thing_dataset_id_to_contiguous_id": {"1000": 0, "1001": 1},
    }
    assert stats["priors_dims_per_cat"] == [
        [[1, 1.5, 1], None],
        [[1, 1.5, 2.5], [0, 0, pytest.approx(0.5**0.5)]],
    ]
    assert stats["category_names"] == ["cat", "dog"]
    assert {a["category_name"] for a in written(tmp_path / "a.json")["annotations"]} == {
        "cat",
        "dog",
    }


def test_two_cameras_for_one_image_are_a_fault_that_names_the_box(tmp_path: Path) -> None:
    other = simple_record(
        sample_id="images/a.jpg#1", K=np.array([[120.0, 0, 79.5], [0, 120, 59.5], [0, 0, 1]])
    )
    exported = write_omni3d(replace(ONE, records=(simple_record(), other)), tmp_path / "a.json")
    assert exported.boxes == 1
    assert str(exported.faults[0]).startswith("images/a.jpg#1: K: differs")


def test_a_box_outside_the_frame_has_no_place_in_formats_of_2d_boxes(tmp_path: Path) -> None:
    outside = replace(ONE, records=(simple_record(center=np.array([50.0, 0, 10]), box=None),))
    for exported in (
        write_coco(outside, tmp_path / "a.json"),
        write_kitti(outside, tmp_path / "k"),
    ):
        assert (exported.boxes, exported.images) == (0, 1)
        assert "nothing of it lies in the frame" in str(exported.faults[0])


def test_an_export_to_kitti_never_mixes_with_another(tmp_path: Path) -> None:
    write_kitti(random_set(), tmp_path)
    with pytest.raises(ConfigError, match="holds label files already"):
        write_kitti(ONE, tmp_path)


def test_pixel_origins_are_those_of_the_formats() -> None:
    first = np.array([-0.5, -0.5, HW[1] - 0.5, HW[0] - 0.5])
    assert (
        OMNI3D.boxes_2d_out(first).tolist() == COCO.boxes_2d_out(first).tolist() == [0, 0, 160, 120]
    )
    assert KITTI.boxes_2d_out(first).tolist() == first.tolist()
    assert len(KEYPOINT_NAMES) == len(set(KEYPOINT_NAMES)) == 9

"""Omni3D files from anybody.

Every corner order, other dimension orders, missing fields, and what contradicts itself.
"""

import json
from collections.abc import Callable
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cuboid_sets import random_set, simple_record
from PIL import Image

from animal3dbox.datasets.cuboid_datasets import Omni3DDataset
from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.records import CuboidSet
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError

Content = dict[str, Any]
SIGNED = [
    np.eye(3)[:, list(order)] * signs
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
]


@pytest.fixture
def content(tmp_path: Path) -> Content:
    """A good file with five images and ten boxes, as another tool would write it.

    Without this package's keys.
    """
    write_omni3d(random_set(), tmp_path / "good.json")
    file: Content = json.loads((tmp_path / "good.json").read_text())
    file["info"] = {
        "id": "x",
        "source": "made",
        "name": "made",
        "split": "train",
        "version": 0.1,
        "url": "",
    }
    for annotation in file["annotations"]:
        del annotation["metric"], annotation["heading_known"]
    return file


def read(tmp_path: Path, content: Content, **options: Any) -> CuboidSet:
    (tmp_path / "file.json").write_text(json.dumps(content))
    return read_omni3d(tmp_path / "file.json", **options)


def assert_boxes_are_those_written(back: CuboidSet, tolerance: float = 1e-9) -> None:
    there = random_set().records
    assert [record.sample_id for record in back.records] == [record.sample_id for record in there]
    for ours, theirs in zip(back.records, there, strict=True):
        assert np.abs(ours.center - theirs.center).max() < tolerance
        assert np.abs(ours.rotation - theirs.rotation).max() < tolerance
        assert np.abs(ours.size - theirs.size).max() < tolerance


def test_a_foreign_file_is_read_with_unnamed_faces_unless_the_user_knows_them(
    tmp_path: Path, content: Content
) -> None:
    back = read(tmp_path, content)
    assert_boxes_are_those_written(back)
    assert not any(record.heading_known for record in back.records)
    assert not any(record.metric for record in back.records)
    assert all(
        record.heading_known for record in read(tmp_path, content, heading_known=True).records
    )
    assert "all 10 boxes are in the documented order" in " ".join(back.notes)


def test_images_without_boxes_stay(tmp_path: Path, content: Content) -> None:
    content["annotations"] = []
    back = read(tmp_path, content)
    assert [image.image_id for image in back.images] == [f"images/{n}.jpg" for n in range(5)]
    assert (back.records, back.faults) == ((), ())


def test_an_image_whose_every_box_is_faulty_is_no_image_without_animals(
    tmp_path: Path, content: Content
) -> None:
    of_first = [
        annotation
        for annotation in content["annotations"]
        if annotation["image_id"] == content["images"][0]["id"]
    ]
    for annotation in of_first:
        annotation["dimensions"] = [-5, 1, 1]
    for n in range(5):
        (tmp_path / "images").mkdir(exist_ok=True)
        Image.new("RGB", (content["images"][n]["width"], content["images"][n]["height"])).save(
            tmp_path / f"images/{n}.jpg"
        )
    (tmp_path / "file.json").write_text(json.dumps(content))
    dataset = Omni3DDataset(tmp_path / "file.json", on_bad="skip")
    found = dataset[0]
    assert isinstance(found, Skipped)
    assert [case.field for case in found.cases] == ["dimensions"] * len(of_first)
    assert len(of_first) > 0


def test_minus_ones_are_read_as_unknown(tmp_path: Path, content: Content) -> None:
    for annotation in content["annotations"]:
        annotation |= {
            "bbox2D_tight": [-1, -1, -1, -1],
            "bbox2D_proj": [-1, -1, -1, -1],
            "truncation": -1,
            "behind_camera": -1,
            "visibility": -1,
        }
    back = read(tmp_path, content)
    assert back.faults == ()
    assert all(record.box is None and record.truncation is None for record in back.records)


def test_boxes_that_trainers_ignore_are_counted(tmp_path: Path, content: Content) -> None:
    content["annotations"][0]["lidar_pts"] = 0
    content["annotations"][1]["depth_error"] = 0.7
    content["annotations"][2]["valid3D"] = False
    content["annotations"][2]["center_cam"] = [-1, -1, -1]
    back = read(tmp_path, content)
    assert len(back.records) == 9
    assert "1 annotations say that they have no 3D box" in " ".join(back.notes)
    assert "2 boxes have lidar_pts" in " ".join(back.notes)


@pytest.mark.parametrize(
    "axes", SIGNED, ids=lambda axes: "".join(f"{int(v):+d}" for v in axes @ [1, 2, 3])
)
def test_a_file_in_any_loop_of_corners_is_read_rightly(
    tmp_path: Path, content: Content, axes: np.ndarray
) -> None:
    loop = np.array(
        [
            (-1, -1, -1),
            (1, -1, -1),
            (1, 1, -1),
            (-1, 1, -1),
            (-1, -1, 1),
            (1, -1, 1),
            (1, 1, 1),
            (-1, 1, 1),
        ]
    )
    order = [int(np.abs(loop - row @ axes).sum(1).argmin()) for row in loop]
    for annotation in content["annotations"]:
        annotation["bbox3D_cam"] = [annotation["bbox3D_cam"][k] for k in order]
    back = read(tmp_path, content)
    assert_boxes_are_those_written(back)
    documented = np.array_equal(axes, np.eye(3))
    assert ("are in the documented order" in " ".join(back.notes)) == documented
    assert ("documented loop on other axes" in " ".join(back.notes)) == (not documented)


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 4, 5, 7, 6), (3, 1, 4, 0, 5, 2, 6, 7)])
def test_a_file_in_no_known_loop_is_read_rightly(
    tmp_path: Path, content: Content, order: tuple[int, ...]
) -> None:
    for annotation in content["annotations"]:
        annotation["bbox3D_cam"] = [annotation["bbox3D_cam"][k] for k in order]
    back = read(tmp_path, content)
    assert_boxes_are_those_written(back)
    assert "no loop that is known" in " ".join(back.notes)


@pytest.mark.parametrize("order", [o for o in permutations(range(3)) if o != (0, 1, 2)])
def test_a_file_with_dimensions_in_another_order_is_read_rightly(
    tmp_path: Path, content: Content, order: tuple[int, ...]
) -> None:
    for annotation in content["annotations"]:
        annotation["dimensions"] = [annotation["dimensions"][k] for k in order]
    back = read(tmp_path, content)
    assert_boxes_are_those_written(back)
    listed = ", ".join("WHL"[k] for k in order)
    assert f"as [{listed}], not [W, H, L]" in " ".join(back.notes)


def test_a_file_whose_axes_have_other_names_is_read_rightly_if_corners_and_dimensions_agree(
    tmp_path: Path, content: Content
) -> None:
    for annotation in content[
        "annotations"
    ]:  # columns left, forward, up, instead of forward, down, left
        R = np.array(annotation["R_cam"])
        annotation["R_cam"] = np.stack((R[:, 2], R[:, 0], -R[:, 1]), axis=1).tolist()
    assert np.linalg.det(content["annotations"][0]["R_cam"]) == pytest.approx(-1)
    for annotation in content["annotations"]:  # columns left, back, up: a rotation
        R = np.array(annotation["R_cam"])
        annotation["R_cam"] = np.stack((R[:, 0], -R[:, 1], R[:, 2]), axis=1).tolist()
    back = read(tmp_path, content)
    assert_boxes_are_those_written(back)
    assert "R_cam's columns are other axes" in " ".join(back.notes)


@pytest.mark.parametrize("missing", [None, -1, -1.0, 0, [], [[-1.0] * 3] * 3, [[0.0] * 3] * 3])
def test_a_missing_rotation_is_read_off_the_corners(
    tmp_path: Path, content: Content, missing: object
) -> None:
    for annotation in content["annotations"][::2]:
        annotation["R_cam"] = missing
    back = read(tmp_path, content)
    assert_boxes_are_those_written(back)
    assert "R_cam is missing in 5 annotations" in " ".join(back.notes)


@pytest.mark.parametrize("missing", [None, -1, 0, [[-1.0] * 3] * 8])
def test_missing_corners_are_no_fault_and_rounded_numbers_neither(
    tmp_path: Path, content: Content, missing: object
) -> None:
    for annotation in content["annotations"]:
        annotation["bbox3D_cam"] = missing
        annotation["R_cam"] = np.round(annotation["R_cam"], 4).tolist()
    back = read(tmp_path, content)
    assert back.faults == ()
    assert_boxes_are_those_written(back, 1e-3)
    assert all(
        np.abs(record.rotation @ record.rotation.T - np.eye(3)).max() < 1e-12
        for record in back.records
    )


def test_ids_may_be_words(tmp_path: Path, content: Content) -> None:
    content["info"]["id"] = "herd_train"
    for image in content["images"]:
        image |= {"id": f"i{image['id']}", "dataset_id": "herd_train"}
    for annotation in content["annotations"]:
        annotation |= {
            "image_id": f"i{annotation['image_id']}",
            "dataset_id": "herd_train",
            "id": f"a{annotation['id']}",
        }
    back = read(tmp_path, content)
    assert back.faults == ()
    assert_boxes_are_those_written(back)


def test_a_box_so_thin_that_rounding_tells_its_sides_apart_is_read(tmp_path: Path) -> None:
    thin = simple_record(size=np.array([2.0, 0.001, 1.5]))
    write_omni3d(
        CuboidSet("labels", (thin, simple_record(sample_id="images/a.jpg#1")), ()),
        tmp_path / "a.json",
    )
    content = json.loads((tmp_path / "a.json").read_text())
    content["annotations"][0]["bbox3D_cam"] = np.round(
        content["annotations"][0]["bbox3D_cam"], 2
    ).tolist()
    back = read(tmp_path, content)
    assert back.faults == ()
    assert back.records[0].size.tolist() == [2.0, 0.001, 1.5]


def first(content: Content) -> Any:
    return content["annotations"][0]


def changed(key: str, change: Callable[[Any], object]) -> Callable[[Content], None]:
    def spoil(content: Content) -> None:
        first(content)[key] = change(first(content).get(key))

    return spoil


def image_changed(key: str, change: Callable[[Any], object]) -> Callable[[Content], None]:
    def spoil(content: Content) -> None:
        content["images"][0][key] = change(content["images"][0].get(key))

    return spoil


BOX, IMAGE = "images/0.jpg", "images/0.jpg"
BAD: dict[str, tuple[Callable[[Content], None], str, str]] = {
    "category not in meta": (
        changed("category_id", lambda _: 99),
        BOX,
        "category_id: 99 is not among",
    ),
    "another category's name": (
        changed("category_name", lambda _: "cow"),
        BOX,
        "category_name: is 'cow'",
    ),
    "unknown image": (
        changed("image_id", lambda _: 77),
        "annotation 0",
        "image_id: 77 is not among",
    ),
    "centre at the bottom": (
        changed("center_cam", lambda c: [c[0], c[1] + 0.4, c[2]]),
        BOX,
        "center_cam: is 0.4 away",
    ),
    "dimensions of another box": (
        changed("dimensions", lambda d: [d[0] * 1.2, d[1], d[2]]),
        BOX,
        "dimensions: [",
    ),
    "dimensions swapped": (
        changed("dimensions", lambda d: [d[2], d[1], d[0]]),
        BOX,
        "in the order of this file",
    ),
    "dimensions zero": (
        changed("dimensions", lambda d: [0, d[1], d[2]]),
        BOX,
        "dimensions: must be positive",
    ),
    "rotation of another box": (
        changed("R_cam", lambda R: [R[1], R[2], R[0]]),
        BOX,
        "R_cam: does not turn",
    ),
    "rotation transposed": (
        changed("R_cam", lambda R: np.array(R).T.tolist()),
        BOX,
        "its transpose does",
    ),
    "rotation mirrored": (
        changed("R_cam", lambda R: (np.array(R) * [1, 1, -1]).tolist()),
        BOX,
        "R_cam: has determinant -1",
    ),
    "rotation scaled": (
        changed("R_cam", lambda R: (np.array(R) * 1.1).tolist()),
        BOX,
        "R_cam: must be a rotation",
    ),
    "rotation of wrong shape": (changed("R_cam", lambda R: R[0]), BOX, "R_cam"),
    "corner moved": (
        changed("bbox3D_cam", lambda X: [[X[0][0] + 1, *X[0][1:]], *X[1:]]),
        BOX,
        "bbox3D_cam: is not a box",
    ),
    "corner twice": (
        changed("bbox3D_cam", lambda X: [X[1], X[0], *X[2:6], X[0], X[6]]),
        BOX,
        "bbox3D_cam",
    ),
    "rotation of one number": (changed("R_cam", lambda _: 5), BOX, "R_cam: must be 3 x 3 numbers"),
    "seven corners": (
        changed("bbox3D_cam", lambda X: X[:7]),
        BOX,
        "bbox3D_cam: must be 8 x 3 numbers",
    ),
    "no centre": (
        changed("center_cam", lambda _: [-1, -1, -1]),
        BOX,
        "center_cam: is missing or -1, but valid3D is true",
    ),
    "box turned round": (
        changed("bbox2D_tight", lambda b: [b[2], b[1], b[0], b[3]]),
        BOX,
        "bbox2D_tight: must be x1",
    ),
    "box of another camera": (
        changed("bbox2D_proj", lambda _: [1.0, 1.0, 9.0, 9.0]),
        BOX,
        "bbox2D_proj: is not where K projects",
    ),
    "truncation out of range": (
        changed("truncation", lambda _: 1.5),
        BOX,
        "truncation: must lie in 0 to 1",
    ),
    "a word for a number": (changed("center_cam", lambda _: "here"), BOX, "center_cam"),
    "K transposed": (
        image_changed("K", lambda K: np.array(K).T.tolist()),
        IMAGE,
        "K: K must be upper triangular",
    ),
    "K without focal length": (
        image_changed("K", lambda K: [[0, 0, 80], *K[1:]]),
        IMAGE,
        "K: K must have positive focal",
    ),
    "K missing": (image_changed("K", lambda _: [[-1.0] * 3] * 3), IMAGE, "K: is missing"),
    "image of no size": (
        image_changed("width", lambda _: 0),
        IMAGE,
        "height, width: must be positive",
    ),
    "path leads out": (
        image_changed("file_path", lambda _: "../../etc/passwd"),
        "../../etc/passwd",
        "file_path",
    ),
    "the same image twice": (
        image_changed("file_path", lambda _: "images/1.jpg"),
        "images/1.jpg",
        "file_path: is that of image",
    ),
    "the same id twice": (
        image_changed("id", lambda _: 2),
        "images/1.jpg",
        "id: 2 is another image's too",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_contradicts_itself_is_a_fault_that_names_sample_and_field(
    tmp_path: Path, content: Content, case: str
) -> None:
    spoil, sample, message = BAD[case]
    spoil(content)
    back = read(tmp_path, content)
    assert any(fault.sample_id == sample and message in str(fault) for fault in back.faults), [
        str(fault) for fault in back.faults
    ]
    assert len(back.faults) == (
        5 if case == "the same id twice" else 1
    )  # whose four boxes have lost their image
    assert {"images/3.jpg", "images/4.jpg"} <= {
        record.image_id for record in back.records
    }  # the others are read
    assert len(back.records) in (
        9,
        6,
        5,
    )  # without the box, without its image's four, without two images' five


def test_image_files_are_found_near_and_a_missing_one_is_a_fault(
    tmp_path: Path, content: Content
) -> None:
    (tmp_path / "images").mkdir()
    assert "no image file was found" in " ".join(read(tmp_path, content).notes)
    for n in range(4):
        Image.new("RGB", (8, 8)).save(tmp_path / "images" / f"{n}.jpg")
    back = read(tmp_path, content)
    assert [fault.sample_id for fault in back.faults] == ["images/4.jpg"]
    assert "3 annotations belong to faulty images" in " ".join(back.notes)
    assert back.records[0].image_path == (tmp_path / "images" / "0.jpg").resolve()


def test_files_that_are_no_omni3d_are_refused_as_a_whole(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError):
        read_omni3d(tmp_path / "none.json")
    for text in ("[]", "{}", '{"images": [], "categories": []}', '{"images": [NaN]}'):
        (tmp_path / "file.json").write_text(text)
        with pytest.raises(DatasetFormatError, match=r"file\.json"):
            read_omni3d(tmp_path / "file.json")


def test_the_pixel_origin_is_one_field_and_own_files_state_theirs(tmp_path: Path) -> None:
    write_omni3d(CuboidSet("labels", (simple_record(),), ()), tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["info"]["first_pixel"] == 0.5
    content["info"]["first_pixel"] = 0.0
    assert read(tmp_path, content).images[0].K[0, 2] == 80.0
    content["info"]["generator"] = "another"
    assert read(tmp_path, content).images[0].K[0, 2] == 79.5

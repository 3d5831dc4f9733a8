"""``animal3dbox check``.

What is wrong with labels and cuboids on disk, by the checks of training loops.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commands import labels_of_one_animal, ran
from cuboid_sets import random_set
from mesh_folder_dataset import camera_with, write_mesh_folder
from planted_file_faults import plant
from small_animals import model_of

from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.report.label_checks import ROW_CHECKS
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

Content = dict[str, Any]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Content:
    """The content of a labels.json with one label."""
    folder = labels_of_one_animal(tmp_path_factory.mktemp("good"))
    content: Content = json.loads((folder / "labels.json").read_text())
    return content


def checked(tmp_path: Path, content: Content, *options: str) -> tuple[int, str]:
    (tmp_path / "labels.json").write_text(json.dumps(content))
    return ran("check", tmp_path, *options)


def test_good_labels_pass(tmp_path: Path, good: Content) -> None:
    code, output = checked(tmp_path, good)
    assert (code, output.splitlines()[0]) == (0, f"1 animal in {tmp_path}: 0 faults")


SPOILT: dict[str, tuple[Callable[[Content], None], str, str]] = {
    "mirrored corners": (
        lambda a: a.update(corners_3d=[a["corners_3d"][k] for k in (3, 2, 1, 0, 7, 6, 5, 4)]),
        "corner_order",
        "corners_3d",
    ),
    "another K": (
        lambda a: a["K"][0].__setitem__(0, a["K"][0][0] * 1.5),
        "projection",
        "corners_2d",
    ),
    "opposite faces": (
        lambda a: a.update(face_visible=[True] * 6),
        "opposite_faces",
        "face_visible",
    ),
    "shares": (lambda a: a.update(face_share=[0.5] * 6), "shares", "face_share"),
    "truncation": (lambda a: a.update(truncation=0.5), "truncation", "truncation"),
    "box turned": (lambda a: a.update(box=[a["box"][k] for k in (2, 3, 0, 1)]), "boxes", "boxes"),
    "seven corners": (lambda a: a["corners_3d"].pop(), "shape", "corners_3d"),
    "ragged": (lambda a: a["rotation"][0].pop(), "reading", "rotation"),
    "side": (lambda a: a.update(side="front"), "side", "side"),
    "no side": (lambda a: a.update(side=None), "side", "side"),
    "a word for a side": (lambda a: a.update(side="sinister"), "side", "side"),
    "surface side": (lambda a: a.update(surface_side="bottom"), "side", "surface_side"),
    "azimuth": (lambda a: a.update(azimuth_deg=a["azimuth_deg"] + 1), "viewpoint", "azimuth_deg"),
    "elevation": (
        lambda a: a.update(elevation_deg=a["elevation_deg"] - 1),
        "viewpoint",
        "elevation_deg",
    ),
    "viewpoint": (
        lambda a: a.update(viewpoint="front" if a["viewpoint"] != "front" else "back"),
        "viewpoint",
        "viewpoint",
    ),
    "a word for a viewpoint": (lambda a: a.update(viewpoint="above"), "viewpoint", "viewpoint"),
    "confidence": (lambda a: a.update(confidence=7), "confidence", "confidence"),
    "negative confidence": (lambda a: a.update(confidence=-0.1), "confidence", "confidence"),
    "scale": (lambda a: a.update(scale_m_per_unit=0.0), "scale", "scale_m_per_unit"),
}


@pytest.mark.parametrize("case", SPOILT)
def test_spoilt_labels_are_named_with_their_check(tmp_path: Path, good: Content, case: str) -> None:
    spoil, check, field = SPOILT[case]
    content = json.loads(json.dumps(good))
    spoil(content["animals"][0])
    code, output = checked(tmp_path, content, "--json")
    assert code == 4
    report = json.loads(output)
    assert any(
        f["check"] == check and f["field"] == field and f["sample_id"] == "a.jpg"
        for f in report["faults"]
    ), report["faults"]
    code, output = checked(tmp_path, content)
    assert code == 4
    assert f" x {check}" in output
    assert f"a.jpg: {field}: " in output


UNREADABLE: dict[str, tuple[Callable[[Content], object], str, str]] = {
    "no box": (lambda a: a.update(box=None), "a.jpg#2", "box"),
    "without K": (lambda a: a.pop("K"), "a.jpg#2", "K"),
    "a nameless row": (lambda a: a.update(sample_id=None), "animals[1]", "sample_id"),
    "a name twice": (lambda a: a.update(sample_id="a.jpg"), "a.jpg", "sample_id"),
}


@pytest.mark.parametrize("case", UNREADABLE)
def test_a_row_that_cannot_be_used_is_named_and_the_others_are_checked_and_exported(
    tmp_path: Path, good: Content, case: str
) -> None:
    spoil, name, field = UNREADABLE[case]
    content = json.loads(json.dumps(good))
    content["animals"] += json.loads(json.dumps(content["animals"] * 2))
    for number, row in enumerate(content["animals"][1:], 2):
        row["sample_id"] = f"a.jpg#{number}"
    spoil(content["animals"][1])
    content["animals"][2]["confidence"] = 2
    code, output = checked(tmp_path, content, "--json")
    report = json.loads(output)
    assert (code, report["animals"], report["counts"]) == (4, 3, {"reading": 1, "confidence": 1})
    (fault,) = (fault for fault in report["faults"] if fault["check"] == "reading")
    assert (fault["sample_id"], fault["field"]) == (name, field)
    assert "take" in fault["problem"]
    code, output = ran("export", tmp_path, "--to", "coco", "--out", tmp_path / "coco.json")
    assert code == 4
    assert f"faulty: {name}: {field}: " in output
    assert len(json.loads((tmp_path / "coco.json").read_text())["annotations"]) == 2


@pytest.mark.parametrize(
    ("field", "order"),
    [("face_names", (0, 1, 3, 2, 4, 5)), ("corner_signs", (3, 2, 1, 0, 7, 6, 5, 4))],
)
def test_faces_or_corners_in_another_order_are_refused(
    tmp_path: Path, good: Content, field: str, order: tuple[int, ...]
) -> None:
    content = {**good, field: [good[field][k] for k in order]}
    code, output = checked(tmp_path, content)
    assert (code, f"labels.json: {field} must be [" in output, f"put {field} back" in output) == (
        3,
        True,
        True,
    )
    code, output = ran("export", tmp_path, "--to", "coco", "--out", tmp_path / "coco.json")
    assert (code, f"labels.json: {field} must be [" in output) == (3, True)
    assert not (tmp_path / "coco.json").exists()


def test_labels_of_a_scale_that_cannot_be_are_not_exported(tmp_path: Path, good: Content) -> None:
    content = {
        **good,
        "animals": [
            *good["animals"],
            {**good["animals"][0], "sample_id": "b.jpg", "scale_m_per_unit": -1.0},
        ],
    }
    (tmp_path / "labels.json").write_text(json.dumps(content))
    code, output = ran("export", tmp_path, "--to", "coco", "--out", tmp_path / "coco.json")
    assert code == 4
    assert "b.jpg: scale_m_per_unit: must be positive" in output


def test_every_check_of_rows_has_its_line_in_the_documents() -> None:
    page = (Path(__file__).parents[2] / "docs" / "checks.md").read_text()
    assert {check for _, check, _ in SPOILT.values()} >= set(ROW_CHECKS)
    assert [
        name for name, meaning in ROW_CHECKS.items() if f"| `{name}` | {meaning} |" not in page
    ] == []


def test_an_omni3d_file_is_checked_too(tmp_path: Path) -> None:
    write_omni3d(random_set(in_view=True), tmp_path / "a.json")
    assert ran("check", tmp_path / "a.json")[0] == 0
    content = json.loads((tmp_path / "a.json").read_text())
    content["annotations"][0]["center_cam"][0] += 1
    content["annotations"][1]["bbox2D_tight"] = [-50.0, -40.0, -30.0, -20.0]
    (tmp_path / "a.json").write_text(json.dumps(content))
    code, output = ran("check", tmp_path / "a.json", "--json")
    assert code == 4
    report = json.loads(output[output.index("{") :])
    assert report["animals"] == 10
    assert {(f["check"], f["sample_id"]) for f in report["faults"]} == {
        ("reading", "images/0.jpg"),
        ("reading", "images/0.jpg#1"),
    }


def test_nothing_to_check_is_an_input_error(tmp_path: Path) -> None:
    assert ran("check", tmp_path / "none.json")[0] == 3
    (tmp_path / "other.json").write_text("[]")
    assert ran("check", tmp_path / "other.json")[0] == 3


def test_a_dataset_is_labelled_and_checked(animals: Path) -> None:
    known = ("--model", str(model_of(animals)), "--stored-camera", "exact")
    code, output = ran("check", animals, *known, "--json")
    report = json.loads(output)
    assert (code, report["faults"]) == (0, [])
    assert report["animals"] == sum(
        len(json.loads((animals / name).read_text())["data"])
        for name in ("train.json", "test.json")
    )


def test_keypoints_whose_sides_were_exchanged_are_warned_of(copied: Path) -> None:
    file = copied / "test.json"
    content = json.loads(file.read_text())
    flip = VOCABULARIES["animal3d26"].flip
    for entry in content["data"]:
        entry["keypoint_2d"] = [entry["keypoint_2d"][i] for i in flip]
    file.write_text(json.dumps(content))
    code, output = ran("check", copied, "--model", str(model_of(copied)), "--json")
    report = json.loads(output)
    assert (code, report["faults"]) == (0, [])
    exchanged = [note for note in report["notes"] if "left and right are exchanged" in note]
    assert len(exchanged) == report["warnings"]["exchanged"] > 0
    assert "left_eye" in exchanged[0]


def test_a_dataset_s_bad_samples_are_named(copied: Path) -> None:
    image, _ = plant(copied, "train.json", 1, "image of words")
    code, output = ran(
        "check", copied, "--model", str(model_of(copied)), "--stored-camera", "exact"
    )
    assert code == 4
    assert f"{image}: image: " in output


def test_cuboids_are_not_taken_for_keypoints(tmp_path: Path) -> None:
    write_omni3d(random_set(), tmp_path / "boxes.json")
    code, output = ran("label", tmp_path / "boxes.json", "--out", tmp_path / "out")
    assert code == 2
    assert "nothing to label" in output


def test_labels_under_a_lens_are_checked_with_it_and_not_exported_without(tmp_path: Path) -> None:
    capture = write_mesh_folder(tmp_path / "capture")
    camera_with(distortion=[-0.2, 0.05, 0.001, 0.0])(capture)
    assert ran("label", capture, "--out", tmp_path / "out")[0] in (0, 4)
    content: Content = json.loads((tmp_path / "out" / "labels.json").read_text())
    lenses = [
        row["sample_id"]
        for row in content["animals"]
        if row["distortion"] and any(row["distortion"])
    ]
    assert lenses
    assert ran("check", tmp_path / "out")[0] == 0
    code, output = ran(
        "export",
        tmp_path / "out",
        "--to",
        "omni3d",
        "--out",
        tmp_path / "boxes.json",
        "--scale-free",
    )
    assert code == 4
    assert all(f"{name}: distortion: is a lens" in output for name in lenses)
    for row in content["animals"]:
        row["distortion"] = None
    (tmp_path / "labels.json").write_text(json.dumps(content))
    assert ran("check", tmp_path)[0] == 4

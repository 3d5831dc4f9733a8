"""``animal3dbox export``: labels and Omni3D files to every format, its refusals and exit codes."""

import io
import json
import sys
from pathlib import Path

import fsspec
import msgspec
import numpy as np
import pytest
from commands import labels_of_one_animal, ran
from cuboid_sets import random_set
from PIL import Image

from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.readers.omni3d.reader import read_omni3d
from animal3dbox.datasets.sightings import Sighting
from animal3dbox.geometry.box_visibility import visible_faces
from animal3dbox.geometry.cuboid import CORNER_SIGNS, FACE_NAMES
from animal3dbox.report.label_files import AnimalRow, write_labels_json
from animal3dbox.report.label_reading import read_labels_json


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """labels.json with the label of a synthetic animal."""
    return (labels_of_one_animal(tmp_path_factory.mktemp("labels")) / "labels.json").read_bytes()


@pytest.fixture
def labels(written: bytes, tmp_path: Path) -> Path:
    """A folder as ``label`` writes it, with one label and one animal without."""
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "labels.json").write_bytes(written)
    return tmp_path / "labels"


@pytest.fixture
def row(labels: Path) -> AnimalRow:
    return read_labels_json(labels / "labels.json").animals[0]


def test_labels_without_scale_are_refused_with_the_remedy_and_nothing_is_written(
    labels: Path, tmp_path: Path
) -> None:
    for to in ("omni3d", "kitti"):
        code, output = ran("export", labels, "--to", to, "--out", tmp_path / "out")
        assert code == 2
        assert "--metres-per-unit" in output
        assert "--scale-free" in output
    assert not (tmp_path / "out").exists()


def test_labels_become_omni3d_and_sides_keep_their_names(
    labels: Path, tmp_path: Path, row: AnimalRow
) -> None:
    code, output = ran(
        "export",
        labels / "labels.json",
        "--to",
        "omni3d",
        "--out",
        tmp_path / "out",
        "--metres-per-unit",
        "0.5",
    )
    assert code == 0
    assert "1 animals have no label" in output
    back = read_omni3d(tmp_path / "out" / "annotations.json").records[0]
    assert (back.image_id, back.category, back.heading_known, back.metric) == (
        "herd/a.jpg",
        "dog",
        True,
        True,
    )
    assert np.abs(back.size - 0.5 * np.array(row.size)).max() < 1e-9
    assert np.abs(back.center - 0.5 * np.array(row.center)).max() < 1e-9
    assert back.truncation == row.truncation
    corners = back.center + (np.array(CORNER_SIGNS) * back.size / 2) @ back.rotation.T
    assert [
        n
        for n, visible in zip(FACE_NAMES, visible_faces(corners, np.zeros(3)), strict=True)
        if visible
    ] == [n for n, visible in zip(FACE_NAMES, row.face_visible, strict=True) if visible]


def test_a_label_s_track_is_exported(labels: Path, tmp_path: Path) -> None:
    file = read_labels_json(labels / "labels.json")
    tracked = msgspec.structs.replace(file.animals[0], sighting=Sighting(track="mare"))
    write_labels_json(labels / "labels.json", msgspec.structs.replace(file, animals=[tracked]))
    out = tmp_path / "a.json"
    assert ran("export", labels, "--to", "omni3d", "--out", out, "--scale-free")[0] == 0
    assert json.loads(out.read_text())["annotations"][0]["track_id"] == "mare"


def test_labels_that_state_their_scale_are_metres_already(labels: Path, tmp_path: Path) -> None:
    file = read_labels_json(labels / "labels.json")
    scaled = msgspec.structs.replace(file.animals[0], scale_m_per_unit=0.5, scale_source="given")
    write_labels_json(labels / "labels.json", msgspec.structs.replace(file, animals=[scaled]))
    code, _ = ran("export", labels, "--to", "omni3d", "--out", tmp_path / "a.json")
    assert code == 0
    back = read_omni3d(tmp_path / "a.json").records[0]
    assert np.abs(back.size - np.array(file.animals[0].size)).max() < 1e-9
    assert (
        ran(
            "export",
            labels,
            "--to",
            "omni3d",
            "--out",
            tmp_path / "a.json",
            "--metres-per-unit",
            "2",
        )[0]
        == 2
    )


def test_labels_written_before_there_was_a_scale_are_read(labels: Path) -> None:
    content = json.loads((labels / "labels.json").read_text())
    for key in ("scale_m_per_unit", "scale_source"):
        del content["animals"][0][key]
    (labels / "labels.json").write_text(json.dumps(content))
    animal = read_labels_json(labels / "labels.json").animals[0]
    assert (animal.scale_m_per_unit, animal.scale_source) == (None, "unknown")


def test_labels_become_coco_and_kitti(labels: Path, tmp_path: Path, row: AnimalRow) -> None:
    assert ran("export", labels, "--to", "coco", "--out", tmp_path / "coco.json")[0] == 0
    keypoints = np.array(
        json.loads((tmp_path / "coco.json").read_text())["annotations"][0]["keypoints"]
    ).reshape(9, 3)
    assert np.abs(keypoints[:8, :2] - np.array(row.corners_2d)).max() < 1e-9
    code, output = ran(
        "export", labels, "--to", "kitti", "--out", tmp_path / "kitti", "--scale-free"
    )
    assert code == 0
    assert "at worst (1 boxes)" in output
    assert read_kitti(tmp_path / "kitti").records[0].category == "dog"


def test_kitti_has_the_pictures_of_labels_at_urls(
    labels: Path, tmp_path: Path, row: AnimalRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = "memory://herd/a.png"
    content = json.loads((labels / "labels.json").read_text())
    content["animals"][0]["image"] = url
    (labels / "labels.json").write_text(json.dumps(content))
    pixels = np.zeros((*row.image_hw, 3), dtype=np.uint8)
    picture = io.BytesIO()
    Image.fromarray(pixels + np.uint8(7)).save(picture, "PNG")
    memory = fsspec.filesystem("memory")
    memory.pipe(url, picture.getvalue())
    words = ("export", labels, "--to", "kitti", "--scale-free", "--out")
    assert ran(*words, tmp_path / "kitti")[0] == 0
    with Image.open(tmp_path / "kitti" / "image_2" / "000000.png") as image:
        assert np.array_equal(np.asarray(image), pixels + 7)
    monkeypatch.setitem(sys.modules, "fsspec", None)
    code, output = ran(*words, tmp_path / "without")
    assert (code, "pip install 'animal3dbox[remote]'" in output) == (2, True)
    memory.store.clear()


def test_an_omni3d_file_becomes_any_format_and_its_faults_set_the_exit_code(tmp_path: Path) -> None:
    write_omni3d(random_set(in_view=True), tmp_path / "in.json")
    for to in ("omni3d", "coco", "kitti"):
        code, output = ran("export", tmp_path / "in.json", "--to", to, "--out", tmp_path / to)
        assert (code, "10 boxes in 5 images" in output) == (0, True)
    assert (tmp_path / "omni3d" / "annotations.json").read_bytes() == (
        tmp_path / "in.json"
    ).read_bytes()
    content = json.loads((tmp_path / "in.json").read_text())
    content["annotations"][0]["category_id"] = 5
    (tmp_path / "in.json").write_text(json.dumps(content))
    code, output = ran("export", tmp_path / "in.json", "--to", "coco", "--out", tmp_path / "coco")
    assert code == 4
    assert "faulty: images/0.jpg: category_id: 5" in output


def test_a_foreign_file_needs_a_word_on_its_unit_to_be_exported_in_metres(tmp_path: Path) -> None:
    write_omni3d(random_set(in_view=True), tmp_path / "in.json")
    content = json.loads((tmp_path / "in.json").read_text())
    content["info"] = {"id": 0, "name": "made"}
    (tmp_path / "in.json").write_text(json.dumps(content))
    asked = ("export", tmp_path / "in.json", "--to", "omni3d", "--out", tmp_path / "out.json")
    code, output = ran(*asked)
    assert (code, "--metric yes" in output) == (2, True)
    assert not (tmp_path / "out.json").exists()
    assert ran(*asked, "--metric", "yes")[0] == 0
    assert all(record.metric for record in read_omni3d(tmp_path / "out.json").records)
    assert ran("check", tmp_path / "in.json", "--metric", "yes")[0] == 0


def test_wrong_use_of_export_has_its_exit_codes(labels: Path, tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text('{"data": []}')
    (tmp_path / "file").write_text("")
    cases: list[tuple[int, tuple[str | Path, ...]]] = [
        (3, (tmp_path / "none", "--to", "coco", "--out", tmp_path / "x")),
        (3, (tmp_path / "other.json", "--to", "coco", "--out", tmp_path / "x")),
        (3, (tmp_path, "--to", "coco", "--out", tmp_path / "x")),
        (2, (labels, "--to", "yolo", "--out", tmp_path / "x")),
        (2, (labels, "--to", "kitti", "--out", tmp_path / "file", "--scale-free")),
        (
            2,
            (
                labels,
                "--to",
                "kitti",
                "--out",
                tmp_path / "x",
                "--scale-free",
                "--metres-per-unit",
                "1",
            ),
        ),
        (2, (labels, "--to", "coco", "--out", tmp_path / "x", "--images", tmp_path)),
        (2, (labels, "--to", "coco", "--out", tmp_path / "x", "--metric", "yes")),
        (5, (labels, "--to", "coco", "--out", tmp_path / "file" / "x.json")),
    ]
    for expected, arguments in cases:
        code, output = ran("export", *arguments)
        assert code == expected, (arguments, output)
    assert not (tmp_path / "x").exists()

"""Projects of DeepLabCut: every row has its own video's picture, and all videos are read."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from animal3dbox.datasets.formats import read_dataset, recognised_format
from animal3dbox.datasets.readers.deeplabcut.reader import read_deeplabcut
from animal3dbox.smal.keypoints.vocabularies import AP10K

NAMES = list(AP10K)


def picture(path: Path, level: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((48, 64, 3), level, dtype=np.uint8)).save(path)


def table(path: Path, rows: dict[str, float], names: list[str] = NAMES) -> Path:
    """A table of pictures' names, each with its bodyparts in a row from a first x."""
    lines = [
        ",".join(["scorer", *["me"] * (2 * len(names))]),
        ",".join(["bodyparts", *[name for name in names for _ in "xy"]]),
        ",".join(["coords", *["x", "y"] * len(names)]),
    ]
    for name, first in rows.items():
        numbers = [n for i in range(len(names)) for n in (first + i, 20 + i)]
        lines.append(",".join([name, *map(str, numbers)]))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


FIRST, SECOND = "labeled-data/vid1/img001.png", "labeled-data/vid2/img001.png"


def test_rows_of_two_videos_have_each_its_own_picture(tmp_path: Path) -> None:
    for name, level in ((FIRST, 10), (SECOND, 200)):
        picture(tmp_path / name, level)
    for place in ("CollectedData.csv", "labeled-data/vid1/CollectedData.csv", "a/b/Collected.csv"):
        found = read_deeplabcut(table(tmp_path / place, {FIRST: 5.0, SECOND: 9.0}))
        assert found.faults == ()
        assert [record.image_path for record in found.records] == [
            tmp_path / FIRST,
            tmp_path / SECOND,
        ]


def test_a_row_whose_video_is_gone_does_not_get_anothers_picture(tmp_path: Path) -> None:
    picture(tmp_path / FIRST, 10)
    file = table(tmp_path / "labeled-data/vid1/CollectedData.csv", {FIRST: 5.0, SECOND: 9.0})
    found = read_deeplabcut(file)
    assert [record.image_id for record in found.records] == [FIRST]
    assert [fault.sample_id for fault in found.faults] == [SECOND]


def test_a_table_of_one_video_may_lie_among_its_pictures(tmp_path: Path) -> None:
    picture(tmp_path / "moved" / "img001.png", 10)
    found = read_deeplabcut(table(tmp_path / "moved" / "CollectedData.csv", {FIRST: 5.0}))
    assert [record.image_path for record in found.records] == [tmp_path / "moved" / "img001.png"]


def test_a_project_is_read_whole(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("Task: zoo\n")
    for name, level in ((FIRST, 10), (SECOND, 200)):
        picture(tmp_path / name, level)
    table(tmp_path / "labeled-data/vid1/CollectedData_Me.csv", {FIRST: 5.0})
    table(tmp_path / "labeled-data/vid2/CollectedData_Me.csv", {SECOND: 5.0}, NAMES[:5])
    table(tmp_path / "labeled-data/vid3/CollectedData_Me.csv", {"x.png": 5.0}, ["lamp", "chair"])
    assert recognised_format(tmp_path) == "deeplabcut"
    found = read_dataset(tmp_path).records
    assert [record.image_id for record in found.records] == [FIRST, SECOND]
    (fault,) = found.faults
    assert fault.sample_id == "labeled-data/vid3/CollectedData_Me.csv"
    assert "lamp" in fault.problem


def test_minus_one_is_missing_and_noted(tmp_path: Path) -> None:
    picture(tmp_path / FIRST, 10)
    file = table(tmp_path / "CollectedData.csv", {FIRST: 5.0})
    file.write_text(file.read_text().replace("5.0,20,", "-1,-1,"))
    found = read_deeplabcut(file)
    (record,) = found.records
    assert int((record.keypoints_2d[:, 2] > 0).sum()) == len(NAMES) - 1
    assert any("(-1, -1)" in note for note in found.notes)


def test_a_picture_of_two_tables_counts_once(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("Task: zoo\n")
    picture(tmp_path / FIRST, 10)
    table(tmp_path / "labeled-data/vid1/CollectedData_Me.csv", {FIRST: 5.0})
    table(tmp_path / "labeled-data/vid1/CollectedData_You.csv", {FIRST: 9.0})
    found = read_dataset(tmp_path).records
    assert len(found.records) == 1
    (fault,) = found.faults
    assert fault.field == "labeled-data/vid1/CollectedData_You.csv"
    assert "counts once" in fault.problem


def test_a_csv_that_is_no_table_is_a_fault_of_its_video(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("Task: zoo\n")
    picture(tmp_path / FIRST, 10)
    picture(tmp_path / SECOND, 10)
    table(tmp_path / "labeled-data/vid1/CollectedData_Me.csv", {FIRST: 5.0})
    other = table(tmp_path / "labeled-data/vid2/CollectedData_Me.csv", {SECOND: 5.0})
    other.write_text(other.read_text().replace(",", "|"))
    found = read_dataset(tmp_path).records
    assert len(found.records) == 1
    (fault,) = found.faults
    assert fault.sample_id == "labeled-data/vid2/CollectedData_Me.csv"


def test_zeros_are_missing_and_absolute_paths_do_not_travel(tmp_path: Path) -> None:
    picture(tmp_path / FIRST, 10)
    file = table(tmp_path / "CollectedData.csv", {f"/home/somebody/zoo/{FIRST}": 5.0})
    file.write_text(file.read_text().replace("5.0,20,", "0.0,0,"))
    (record,) = read_deeplabcut(file).records
    assert int((record.keypoints_2d[:, 2] > 0).sum()) == len(NAMES) - 1
    assert "somebody" not in record.image_id + record.sample_id


@pytest.mark.parametrize(("separator", "point"), [(";", "."), (";", ","), ("\t", ".")])
def test_tables_of_spreadsheets_are_read_the_same(
    tmp_path: Path, separator: str, point: str
) -> None:
    picture(tmp_path / FIRST, 10)
    file = table(tmp_path / "CollectedData.csv", {FIRST: 5.5})
    plain = read_dataset(file).records.records[0]
    text = file.read_text().replace(",", separator).replace(".5", f"{point}5")
    file.write_text(text)
    assert recognised_format(tmp_path) == "deeplabcut"
    assert np.array_equal(read_dataset(file).records.records[0].keypoints_2d, plain.keypoints_2d)

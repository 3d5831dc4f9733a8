"""KITTI's text files from anybody: what contradicts itself, results, tracking, other folders."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import ran
from cuboid_sets import random_set, standing_set, visible_part
from PIL import Image

from animal3dbox.datasets.cuboid_datasets import KittiDataset
from animal3dbox.datasets.exchange.kitti_writer import write_kitti
from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.datasets.readers.kitti.reader import read_kitti
from animal3dbox.datasets.records import CuboidSet
from animal3dbox.errors import ConfigError, DatasetNotFoundError, SampleError

Fields = list[str]
COLUMNS = ("kind", "truncated", "occluded", "alpha", "x1", "y1", "x2", "y2", "h", "w", "l")
PLACE = {name: number for number, name in enumerate((*COLUMNS, "x", "y", "z", "rotation_y"))}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A good folder of another program: label_2, calib, image_2."""
    home = tmp_path / "training"
    write_kitti(standing_set(), home)
    (home / "images.txt").unlink()
    (home / "image_2").mkdir(exist_ok=True)
    for number in range(2):
        Image.new("RGB", (160, 120)).save(home / "image_2" / f"{number:06d}.png")
    return home


def change(folder: Path, spoil: Callable[[Fields], Fields], lines: tuple[int, ...]) -> None:
    """Change the lines of some numbers in all label files together."""
    number = 0
    for path in sorted((folder / "label_2").glob("*.txt")):
        rows = [line.split() for line in path.read_text().splitlines()]
        for k, row in enumerate(rows):
            rows[k] = spoil(row) if number in lines else row
            number += 1
        path.write_text("".join(" ".join(row) + "\n" for row in rows))


def setting(**values: Callable[[float], float]) -> Callable[[Fields], Fields]:
    """Replaces some columns by functions of their own values."""

    def spoil(row: Fields) -> Fields:
        row = list(row)
        for name, value in values.items():
            row[PLACE[name]] = f"{value(float(row[PLACE[name]])):.6f}"
        return row

    return spoil


def permuted(*order: int) -> Callable[[Fields], Fields]:
    """Writes h, w, l in another order."""

    def spoil(row: Fields) -> Fields:
        return [*row[:8], *(row[8 + k] for k in order), *row[11:]]

    return spoil


def at_center(row: Fields) -> Fields:
    """Writes the centre for the middle of the bottom."""
    height = float(row[PLACE["h"]])
    return setting(y=lambda y: y - height / 2)(row)


def target_of(dataset: KittiDataset, index: int) -> dict[str, Any]:
    sample = dataset[index]
    assert not isinstance(sample, Skipped)
    image, target = sample
    assert tuple(image.shape) == (3, 120, 160)
    return target


def test_a_good_folder_is_read_whole(folder: Path) -> None:
    back = read_kitti(folder)
    assert back.faults == ()
    assert [record.sample_id for record in back.records] == [
        "image_2/000000.png", "image_2/000000.png#1", "image_2/000000.png#2", "image_2/000001.png",
    ]  # fmt: skip
    for ours, there in zip(back.records, standing_set().records, strict=True):
        assert np.abs(ours.center - there.center).max() < 1e-5
        assert np.abs(ours.size - there.size).max() < 1e-5
        assert np.abs(ours.rotation - there.rotation).max() < 1e-5
        assert ours.metric
        assert ours.heading_known


BAD: dict[str, tuple[Callable[[Fields], Fields], str, str]] = {
    "degrees": (setting(rotation_y=np.rad2deg), "rotation_y", "looks like degrees"),
    "alpha in degrees": (setting(alpha=lambda a: np.rad2deg(a) + 400), "alpha", "degrees"),
    "alpha off": (setting(alpha=lambda a: a + 0.6), "alpha", "write -10 if alpha is not known"),
    "alpha turned": (setting(alpha=lambda a: a + np.pi), "alpha", "by half a turn"),
    "alpha by a quarter": (setting(alpha=lambda a: a - np.pi / 2), "alpha", "by a quarter"),
    "alpha of the other sign": (setting(alpha=lambda a: -a), "alpha", "the other sign"),
    "z negative": (setting(z=lambda z: -z), "location", "not in front of the camera"),
    "z zero": (setting(z=lambda _: 0.0), "location", "not in front of the camera"),
    "2D box elsewhere": (
        setting(x1=lambda _: 1, y1=lambda _: 1, x2=lambda _: 9, y2=lambda _: 9),
        "bbox",
        "lies beside the projected cuboid",
    ),
    "no size": (setting(w=lambda _: 0.0), "dimensions", "must be positive"),
    "occluded unknown": (setting(occluded=lambda _: 7), "occluded", "must be 0, 1, 2 or 3"),
    "truncated too much": (setting(truncated=lambda _: 2), "truncated", "must lie in 0 to 1"),
    "a word": (lambda row: [*row[:5], "x", *row[6:]], "line", "no number"),
    "a field too few": (lambda row: row[:-1], "line", "must have 15 fields"),
    "not finite": (setting(h=lambda _: np.nan), "line", "not finite"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_line_that_contradicts_itself_is_a_fault_that_names_sample_field_and_cause(
    folder: Path, case: str
) -> None:
    spoil, field, words = BAD[case]
    change(folder, spoil, (1,))
    back = read_kitti(folder)
    (fault,) = back.faults
    assert (fault.sample_id, fault.field) == ("image_2/000000.png#1", field)
    assert words in fault.problem
    assert [record.sample_id for record in back.records] == [
        "image_2/000000.png", "image_2/000000.png#2", "image_2/000001.png",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("spoil", "field", "words"),
    [
        (permuted(2, 1, 0), "dimensions", "look like length, width, height,"),
        (permuted(1, 0, 2), "dimensions", "look like width, height, length,"),
        (permuted(2, 0, 1), "dimensions", "look like length, height, width,"),
        (at_center, "location", "looks like the box's centre"),
        (
            lambda row: permuted(2, 1, 0)(at_center(row)),
            "dimensions",
            "length, width, height, not height, width, length, and location like the box's centre",
        ),
    ],
)
def test_a_file_in_another_order_or_about_the_centre_is_faulty_in_every_line(
    folder: Path, spoil: Callable[[Fields], Fields], field: str, words: str
) -> None:
    change(folder, spoil, (0, 1, 2, 3))
    back = read_kitti(folder)
    assert back.records == ()
    assert [fault.field for fault in back.faults] == [field] * 4
    assert all(words in fault.problem for fault in back.faults)


@pytest.mark.parametrize(
    ("spoil", "field"), [(permuted(1, 0, 2), "dimensions"), (at_center, "location")]
)
def test_a_single_line_in_another_order_is_faulty_alone(
    folder: Path, spoil: Callable[[Fields], Fields], field: str
) -> None:
    change(folder, spoil, (3,))
    back = read_kitti(folder)
    (fault,) = back.faults
    assert (fault.sample_id, fault.field) == ("image_2/000001.png", field)
    assert len(back.records) == 3


def test_angles_from_zero_to_a_full_turn_and_an_unknown_alpha_are_read(folder: Path) -> None:
    change(folder, setting(rotation_y=lambda a: a % (2 * np.pi), alpha=lambda _: -10.0), (0, 1, 2))
    back = read_kitti(folder)
    assert (len(back.records), back.faults) == (4, ())
    assert np.abs(back.records[2].rotation - standing_set().records[2].rotation).max() < 1e-5


def test_marks_of_utf8_and_other_ends_of_lines_are_read(folder: Path) -> None:
    for path in (*folder.glob("label_2/*.txt"), *folder.glob("calib/*.txt")):
        text = path.read_text().replace(" ", "\t" if "label" in str(path) else " ")
        path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    back = read_kitti(folder)
    assert (len(back.records), back.faults) == (4, ())
    assert {record.category for record in back.records} == {"dog"}


def test_the_same_box_twice_is_a_fault(folder: Path) -> None:
    path = folder / "label_2" / "000001.txt"
    path.write_text(path.read_text() * 2)
    (fault,) = read_kitti(folder).faults
    assert (fault.sample_id, fault.field) == ("image_2/000001.png#1", "box")


def test_what_states_no_box_is_counted_and_shifts_no_name(folder: Path) -> None:
    path = folder / "label_2" / "000001.txt"
    nothing = "-1 -1 -10 1 1 9 9 -1 -1 -1 -1000 -1000 -1000 -10\n"
    path.write_text(f"DontCare {nothing}Van {nothing}" + path.read_text())
    back = read_kitti(folder)
    assert (len(back.records), back.faults) == (4, ())
    assert back.records[3].sample_id == "image_2/000001.png"
    assert back.notes == (
        "1 DontCare regions were left out",
        "1 boxes without a 3D location were left out",
    )


def test_a_size_is_read_off_the_header_alone(folder: Path) -> None:
    picture = folder / "image_2" / "000000.png"
    picture.write_bytes(picture.read_bytes()[:60])  # the pixels are gone
    back = read_kitti(folder)
    assert (len(back.records), back.faults) == (4, ())
    assert back.records[0].image_hw == (120, 160)


def test_an_image_that_is_missing_is_one_fault_and_its_lines_are_counted(folder: Path) -> None:
    (folder / "image_2" / "000000.png").unlink()
    back = read_kitti(folder)
    assert [fault.sample_id for fault in back.faults] == ["image_2/000000.png"]
    assert back.notes == ("3 lines of unusable images were left out",)
    (folder / "image_2" / "000001.png").rename(folder.parent / "000001.jpg")
    back = read_kitti(folder, folder.parent)
    assert [record.sample_id for record in back.records] == ["000001.jpg"]


def test_results_with_scores_are_read_from_a_folder_of_their_own(folder: Path) -> None:
    shutil.copytree(folder / "label_2", folder / "detector" / "data")
    for path in (folder / "detector" / "data").glob("*.txt"):
        lines = path.read_text().splitlines()
        path.write_text("".join(f"{line} 0.75\n" for line in lines))
    back = read_kitti(folder / "detector")
    assert (len(back.records), back.faults) == (4, ())
    assert {record.score for record in back.records} == {0.75}
    assert {record.score for record in read_kitti(folder).records} == {None}


def test_tracking_has_an_image_a_frame_and_a_name_a_track(folder: Path) -> None:
    home = folder.parent / "tracking"
    (home / "label_02").mkdir(parents=True)
    (home / "calib").mkdir()
    (home / "image_02" / "0000").mkdir(parents=True)
    shutil.copy(folder / "calib" / "000000.txt", home / "calib" / "0000.txt")
    rows = []
    for frame in range(2):
        shutil.copy(
            folder / "image_2" / f"{frame:06d}.png", home / "image_02" / "0000" / f"{frame:06d}.png"
        )
        for k, line in enumerate(
            (folder / "label_2" / f"{frame:06d}.txt").read_text().splitlines()
        ):
            kind, _, *others = line.split()
            rows.append(" ".join((str(frame), str(k + 5), kind, "2", *others)))
    (home / "label_02" / "0000.txt").write_text("\n".join(rows))
    back = read_kitti(home)
    assert back.faults == ()
    assert {record.sighting.sequence for record in back.records} == {"0000"}
    assert [(record.image_id, record.sighting.track) for record in back.records] == [
        ("image_02/0000/000000.png", "5"), ("image_02/0000/000000.png", "6"),
        ("image_02/0000/000000.png", "7"), ("image_02/0000/000001.png", "5"),
    ]  # fmt: skip
    assert {record.truncation for record in back.records} == {None}  # a level, no part
    target = target_of(KittiDataset(home), 1)
    assert target["meta"]["sightings"] == [{"sequence": "0000", "track": "5"}]


def test_the_dataset_gives_the_boxes_as_they_are(folder: Path) -> None:
    target = target_of(KittiDataset(folder), 0)
    assert (
        np.abs(target["center"].numpy() - [r.center for r in standing_set().records[:3]]).max()
        < 1e-5
    )
    assert target["scale_known"].all()
    assert "face_visible" in target
    assert "face_visible" not in target_of(KittiDataset(folder, heading_known=False), 0)
    assert not target_of(KittiDataset(folder, metric="no"), 0)["scale_known"].any()
    change(folder, BAD["degrees"][0], (1,))
    with pytest.raises(SampleError, match=r"image_2/000000\.png#1: rotation_y"):
        KittiDataset(folder)
    assert target_of(KittiDataset(folder, on_bad="skip"), 0)["center"].shape == (2, 3)


def test_lengths_that_an_export_says_are_no_metres_are_read_so(tmp_path: Path) -> None:
    unscaled = tuple(replace(one, metric=False) for one in standing_set().records)
    write_kitti(CuboidSet("labels", unscaled, ()), tmp_path, scale_free=True)
    assert {record.metric for record in read_kitti(tmp_path).records} == {False}
    assert {record.metric for record in read_kitti(tmp_path, metric="yes").records} == {True}
    with pytest.raises(ConfigError, match="metric must be one of"):
        read_kitti(tmp_path, metric="maybe")  # type: ignore[arg-type]


def test_headings_that_an_export_says_mean_nothing_are_read_so(tmp_path: Path) -> None:
    known, *others = standing_set().records
    write_kitti(CuboidSet("labels", (replace(known, heading_known=False), *others), ()), tmp_path)
    assert not any(record.heading_known for record in read_kitti(tmp_path).records)
    assert all(record.heading_known for record in read_kitti(tmp_path, heading_known=True).records)


def test_millimetres_are_noted(folder: Path) -> None:
    change(folder, setting(**dict.fromkeys("hwlxyz", lambda v: v * 1000)), (0, 1, 2, 3))
    back = read_kitti(folder)
    assert (len(back.records), back.faults) == (4, ())
    assert any("looks like millimetres" in note for note in back.notes)


def test_own_files_are_held_against_no_other_order(tmp_path: Path) -> None:
    tilted = next(
        record
        for record in random_set(4, in_view=True).records
        if record.sample_id == "images/4.jpg"
    )
    tilted = replace(tilted, box=visible_part(tilted, 0.03))
    write_kitti(CuboidSet("labels", (tilted,), ()), tmp_path)  # which loses pitch and roll
    assert read_kitti(tmp_path).faults == ()
    (tmp_path / "images.txt").unlink()
    (tmp_path / "image_2").mkdir()
    Image.new("L", tilted.image_hw[::-1]).save(tmp_path / "image_2" / "000000.png")
    assert [fault.field for fault in read_kitti(tmp_path).faults] == ["dimensions"]


def test_folders_without_labels_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"no label_2/\*\.txt"):
        read_kitti(tmp_path)
    with pytest.raises(DatasetNotFoundError, match="there is no folder"):
        read_kitti(tmp_path / "none")
    (tmp_path / "calib").mkdir()
    (tmp_path / "notes.txt").write_text("nothing of KITTI's")
    with pytest.raises(DatasetNotFoundError):
        read_kitti(tmp_path)


def test_commands_know_a_folder_of_kitti(folder: Path) -> None:
    code, output = ran("check", folder)
    assert (code, f"4 boxes in {folder}: 0 faults" in output) == (0, True)
    out = folder.parent / "omni.json"
    code, output = ran("export", folder.parent, "--to", "omni3d", "--out", out)
    assert (code, "4 boxes in 2 images" in output) == (0, True)
    code, output = ran("label", folder, "--out", folder.parent / "labels")
    assert (code, "KittiDataset" in output, "check" in output) == (2, True, True)
    code, output = ran("label", folder, "--format", "kitti", "--out", folder.parent / "labels")
    assert (code, "KittiDataset" in output) == (2, True)
    assert ran("check", folder, "--format", "kitti")[0] == 0
    assert ran("check", folder, "--format", "coco")[0] == 0  # recognised all the same
    assert ran("check", folder / "label_2", "--format", "kitti")[0] == 0
    assert ran("check", folder.parent, "--format", "omni3d")[0] == 3
    change(folder, BAD["degrees"][0], (1,))
    code, output = ran("check", folder)
    assert (code, "image_2/000000.png#1: rotation_y: must be in radians" in output) == (4, True)

"""The examples run, and what they write is a picture, a loss or a folder."""

import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from photo_dataset import add_photo, toy_scene, view_of, write_annotations

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize(
    ("example", "options", "shape"),
    [
        ("augment_your_own_cuboids.py", ["--out", "{out}"], (600, 1600)),
        ("augment_grid.py", ["{out}"], (600, 1000)),
    ],
)
def test_the_example_runs_and_writes_its_sheet(
    example: str, options: list[str], shape: tuple[int, int], tmp_path: Path
) -> None:
    out = tmp_path / "sheet.png"
    command = [
        sys.executable,
        str(ROOT / "examples" / example),
        *(option.format(out=out) for option in options),
    ]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    picture = cv2.imread(str(out))
    assert picture is not None
    assert picture.shape[:2] == shape
    assert float(picture.std()) > 10


def run_example(example: str, *options: str) -> str:
    ran = subprocess.run(
        [sys.executable, str(ROOT / "examples" / example), *options],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_the_training_loop_trains_on_every_sample() -> None:
    assert len((ROOT / "examples" / "train_loop.py").read_text().splitlines()) < 60
    lines = run_example("train_loop.py").splitlines()
    assert [line.split(":")[0] for line in lines] == ["epoch 0", "epoch 1", "epoch 2"]
    assert all(line.endswith("left out: nothing") for line in lines)


def test_the_side_filter_keeps_left_flanks_only(tmp_path: Path) -> None:
    scene = toy_scene()
    views = {
        "left": 90.0,
        "right": -90.0,
        "front": 0.0,
        "ahead_left": 60.0,
        "back": 180.0,
        "herd/left": 70.0,
    }
    write_annotations(
        tmp_path,
        [
            add_photo(tmp_path, view_of(scene, azimuth), f"{name}.jpg")
            for name, azimuth in views.items()
        ],
    )
    said = run_example("side_filter_for_reid.py", str(tmp_path), str(tmp_path / "kept"))
    assert {path.name for path in (tmp_path / "kept").iterdir()} == {
        "left.jpg",
        "ahead_left.jpg",
        "herd__left.jpg",
    }
    assert said.endswith(f"3 images with a left flank in {tmp_path / 'kept'}\n")

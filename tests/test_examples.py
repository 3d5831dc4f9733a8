"""The examples of docs/transforms.md run, and what they write is a picture."""

import subprocess
import sys
from pathlib import Path

import cv2
import pytest

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize(
    ("example", "options", "shape"),
    [("augment_your_own_cuboids.py", ["--out", "{out}"], (600, 1600)), ("augment_grid.py", ["{out}"], (600, 1000))],
)
def test_the_example_runs_and_writes_its_sheet(example: str, options: list[str], shape: tuple[int, int], tmp_path: Path) -> None:
    out = tmp_path / "sheet.png"
    command = [sys.executable, str(ROOT / "examples" / example), *(option.format(out=out) for option in options)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    picture = cv2.imread(str(out))
    assert picture is not None
    assert picture.shape[:2] == shape
    assert float(picture.std()) > 10

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from animal3dbox.cli.demo_page import compared_animal, true_flank, write_demo_page
from animal3dbox.cli.main import main
from animal3dbox.datasets.synthetic.scenes import synthetic_animal
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.labels.types import Rejection


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert isinstance(caught.value.code, int)
    return caught.value.code


def test_the_demo_labels_animals_close_to_the_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("demo", "--out", str(tmp_path), "--n", "5", "--json") == 0
    results = {row["method"]: row for row in json.loads(capsys.readouterr().out)}
    assert list(results) == ["basic", "paper (vector)", "paper (literal)", "default"]
    default = results["default"]
    assert default["labelled"] == default["sides_right"] == 5
    assert default["keypoint_px_median"] < 2
    assert default["corner_percent_median"] < 8
    assert default["axes_deg_median"] < 5
    assert (tmp_path / "gallery.html").stat().st_size < 5_000_000
    assert len(list((tmp_path / "overlays").glob("*.png"))) == 5
    assert json.loads((tmp_path / "demo.json").read_text()) == list(results.values())
    page = (tmp_path / "index.html").read_text()
    assert page.count("data:image/jpeg;base64,") == 10  # truth and label of five animals
    links = re.findall('href="([^"]+)"', page)
    assert links == ["gallery.html", "evaluation.html"]
    assert all((tmp_path / link).is_file() for link in links)
    assert "flank" in page
    assert "://" not in page


def test_without_noise_the_default_finds_every_keypoint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("demo", "--out", str(tmp_path), "--n", "2", "--noise-px", "0", "--json") == 0
    default = json.loads(capsys.readouterr().out)[-1]
    # The mask, which ends with whole pixels, is trusted to 0.7 px beside the keypoints' 2.
    assert default["keypoint_px_p95"] < 0.5


def test_the_table_names_each_method_and_the_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("demo", "--out", str(tmp_path), "--n", "1") == 0
    printed = capsys.readouterr().out
    assert all(
        method in printed
        for method in ("basic", "paper (vector)", "paper (literal)", "default", "index.html")
    )


@pytest.mark.parametrize(
    "options", [("--n", "0"), ("--noise-px", "-1"), ("--outliers", "1.5"), ("--noise-px", "nan")]
)
def test_impossible_options_are_wrong_usage(
    options: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("demo", "--out", str(tmp_path), *options) == 2
    assert "--noise-px not negative" in capsys.readouterr().err


def test_the_page_names_both_flanks_and_marks_a_wrong_one(tmp_path: Path) -> None:
    animal = synthetic_animal(seed=0, index=2)
    none = compared_animal(animal, Rejection("a.jpg", "no_pose", "<none>"))
    assert (none.flank, none.is_wrong) == (None, True)
    right = replace(none, flank=none.true_flank, words="as it is", title="first")
    other = {"left": "right", "right": "left"}[none.true_flank]
    wrong = replace(none, flank=other, words="the other one", title="second")
    undecided = replace(none, flank="undecided", words="not sure", title="third")
    assert [one.is_wrong for one in (right, wrong, undecided)] == [False, True, False]
    write_demo_page(tmp_path / "index.html", [right, wrong, undecided, none], "about")
    page = (tmp_path / "index.html").read_text()
    assert "1 of 4 flanks" in page
    assert '<figcaption class="wrong">label: the other one' in page
    assert "&lt;none&gt;" in page


def test_a_flank_is_that_which_the_camera_stands_on() -> None:
    size = torch.ones(3, dtype=torch.float64)
    ahead = torch.tensor([0.0, 0, 5], dtype=torch.float64)
    for degrees, expected in ((90, "right"), (-90, "left"), (0, "neither"), (15, "neither")):
        turn = math.radians(degrees)  # of the box about its up, which is the camera's -y
        forward = torch.tensor([math.sin(turn), 0, -math.cos(turn)], dtype=torch.float64)
        up = torch.tensor([0.0, -1, 0], dtype=torch.float64)
        rotation = torch.stack([forward, torch.linalg.cross(up, forward), up], 1)
        assert true_flank(Cuboid(ahead, rotation, size)) == expected


def test_a_list_of_pictures_that_is_a_folder_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def drawn_too_early(seed: int, index: int) -> None:
        raise AssertionError("an animal was drawn first")

    monkeypatch.setattr("animal3dbox.cli.demo.synthetic_animal", drawn_too_early)
    (tmp_path / ".label-pictures").mkdir()
    assert run("demo", "--out", str(tmp_path), "--n", "1") == 2
    assert ".label-pictures is not a file" in capsys.readouterr().err

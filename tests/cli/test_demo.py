import json
from pathlib import Path

import pytest

from animal3dbox.cli.main import main


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
        for method in ("basic", "paper (vector)", "paper (literal)", "default", "gallery.html")
    )


@pytest.mark.parametrize(
    "options", [("--n", "0"), ("--noise-px", "-1"), ("--outliers", "1.5"), ("--noise-px", "nan")]
)
def test_impossible_options_are_wrong_usage(
    options: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("demo", "--out", str(tmp_path), *options) == 2
    assert "--noise-px not negative" in capsys.readouterr().err

import json
from pathlib import Path

import pytest
from PIL import Image

from animal3dbox.cli.main import main

FILES = ("evaluation.json", "evaluation.txt", "evaluation.html")


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert isinstance(caught.value.code, int)
    return caught.value.code


def test_the_tables_are_the_same_bytes_for_the_same_seed_and_any_number_of_workers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("evaluate", "--out", str(tmp_path / "a"), "--n", "2", "--workers", "1") == 0
    assert "evaluation.html" in capsys.readouterr().out
    assert (
        run("evaluate", "--out", str(tmp_path / "b"), "--n", "2", "--workers", "2", "--no-pictures")
        == 0
    )
    for name in FILES[:2]:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    content = json.loads((tmp_path / "a" / "evaluation.json").read_text())
    assert list(content["tables"]) == [
        *("stability", "accuracy", "pose", "reproduction", "faces"),
        *("foreign", "reliability", "curve"),
    ]
    assert content["about"]["seed"] == 0
    for number in (1, 2, 3):
        with Image.open(tmp_path / "a" / f"picture-{number}.png") as picture:
            assert min(picture.size) > 400
    assert content["tables"]["curve"]["rows"] == []  # two animals are too few
    assert (tmp_path / "a" / FILES[2]).read_text().count("data:image/png") == 3 + 6
    assert (tmp_path / "b" / FILES[2]).read_text().count("data:image/png") == 6


@pytest.mark.parametrize(
    "options", [("--n", "0"), ("--workers", "0"), ("--seed", "-1"), ("--model", "x.pkl")]
)
def test_impossible_options_are_wrong_usage(options: tuple[str, str], tmp_path: Path) -> None:
    assert run("evaluate", "--out", str(tmp_path), *options) == 2


@pytest.mark.parametrize("format", ["animal3d", "stanfordextra"])
def test_a_dataset_is_evaluated_by_what_is_annotated_and_by_the_truth_beside_it(
    format: str, tmp_path: Path
) -> None:
    world, out = tmp_path / "world", tmp_path / "out"
    synth = f"synth --out {world} --n 6 --format {format} --width 160 --height 120"
    assert run(*synth.split()) == 0
    body = f"--model {tmp_path}/world-model.pkl" if format == "animal3d" else "--body dog"
    assert run(*f"evaluate {world} --out {out} {body}".split()) == 0
    assert all((out / name).is_file() for name in FILES)
    rows = {
        row["method"]: row
        for row in json.loads((out / "evaluation.json").read_text())["tables"]["dataset"]["rows"]
    }
    assert list(rows) == ["basic", "paper (vector)", "paper (literal)", "default"]
    default = rows["default"]
    assert default["animals"] >= default["labelled"] >= 1
    assert default["annotated median px"] is not None
    assert (
        (default["IoU3D median"] is not None)
        == (default["rotation median deg"] is not None)
        == (world / "truth.json").is_file()
    )
    if format == "animal3d":
        assert default["annotated median px"] < 1
        assert default["mask IoU median"] > 0.6
        assert default["rotation median deg"] < 10


def test_a_truth_that_is_none_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world = tmp_path / "world"
    assert run("synth", "--out", str(world), "--n", "6", "--width", "160", "--height", "120") == 0
    (world / "truth.json").write_text(
        '{"animals": [{"sample_id": "a", "center": [0, 0, 1], "size": [1, 1, 1], "rotation": [[2,'
        " 0, 0], [0, 1, 0], [0, 0, 1]]}]}"
    )
    assert (
        run(
            "evaluate",
            str(world),
            "--model",
            str(tmp_path / "world-model.pkl"),
            "--out",
            str(tmp_path / "out"),
        )
        == 3
    )
    assert "truth.json: a: rotation" in capsys.readouterr().err


def test_a_list_of_pictures_that_is_a_folder_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / ".evaluate-pictures").mkdir()
    assert run("evaluate", "--out", str(tmp_path), "--n", "1") == 2
    assert ".evaluate-pictures is not a file" in capsys.readouterr().err
    assert not (tmp_path / "evaluation.json").exists()

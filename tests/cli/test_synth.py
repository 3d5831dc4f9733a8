import json
from pathlib import Path

import pytest

from animal3dbox.cli.main import main
from animal3dbox.datasets.readers.animal3d.reader import read_animal3d

SMALL = ("--width", "160", "--height", "120")


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert isinstance(caught.value.code, int)
    return caught.value.code


def test_a_synthetic_animal3d_folder_is_written_and_labelled_with_its_own_bodies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, model, dropped = tmp_path / "made", tmp_path / "made-model.pkl", tmp_path / "dropped"
    assert run(*f"synth --out {made} --n 5 --seed 3 --mark-hidden".split(), *SMALL) == 0
    output = capsys.readouterr().out
    assert f"--model {model}" in output
    command = f"label {made} --model {model} --json --out".split()
    assert run(*command, str(tmp_path / "labels")) == 0
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert "camera frame is x right, y down, z forward" in captured.err
    assert report["animals"] >= 5
    assert report["faulty"] == 0
    labels = json.loads((tmp_path / "labels" / "labels.json").read_text())
    assert labels["body"].startswith("parameters:")
    assert run(*command, str(dropped), "--tail", "drop") == 0
    without = {
        animal["sample_id"]: animal
        for animal in json.loads((dropped / "labels.json").read_text())["animals"]
    }
    assert any(
        without[animal["sample_id"]]["size"][0] < 0.95 * animal["size"][0]
        for animal in labels["animals"]
        if animal["sample_id"] in without
    )
    assert {animal["quality"]["K_source"] for animal in labels["animals"]} == {"dataset"}
    truth = {
        box["sample_id"]: box for box in json.loads((made / "truth.json").read_text())["animals"]
    }
    sizes = [(animal["size"], truth[animal["sample_id"]]["size"]) for animal in labels["animals"]]
    assert all(a == pytest.approx(b, rel=0.25) for a, b in sizes)


def test_the_same_seed_writes_the_same_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert (
            run(
                "synth",
                "--out",
                str(tmp_path / name),
                "--n",
                "2",
                "--format",
                "stanfordextra",
                "--noise-px",
                "1",
                *SMALL,
            )
            == 0
        )
    files = sorted(
        path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file()
    )
    assert len(files) == 4
    assert all(
        (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
        for file in files
    )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--n", "0"), "at least one image"),
        (("--seed", "-1"), "must not be negative"),
        (("--outliers", "2"), "outliers must be a part"),
        (
            ("--format", "stanfordextra", "--model", "body.pkl"),
            "--model is for the parameters of animal3d",
        ),
    ],
)
def test_impossible_options_are_wrong_usage(
    options: tuple[str, ...], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("synth", "--out", str(tmp_path / "made"), *options) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "made").exists()


def test_a_folder_with_other_files_is_not_written_into(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other.txt").write_text("mine")
    assert run("synth", "--out", str(tmp_path), "--n", "1") == 2
    assert "must be a new or an empty folder" in capsys.readouterr().err


def test_a_model_and_a_body_at_once_are_wrong_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        run(
            "label",
            str(tmp_path),
            "--out",
            str(tmp_path / "labels"),
            "--model",
            "a.pkl",
            "--body",
            "dog",
        )
        == 2
    )
    assert "give one of them" in capsys.readouterr().err


def test_one_synthetic_image_can_be_read_back_although_one_split_is_empty(tmp_path: Path) -> None:
    assert (
        run(
            "synth",
            "--out",
            str(tmp_path / "made"),
            "--n",
            "1",
            "--model",
            str(tmp_path / "body.pkl"),
            *SMALL,
        )
        == 0
    )
    assert len(read_animal3d(tmp_path / "made").records.records) >= 1

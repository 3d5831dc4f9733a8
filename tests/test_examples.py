"""The examples run in every way their docstrings name, and write a picture, a loss or a folder."""

import ast
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
import torch
from photo_dataset import add_photo, toy_scene, view_of, write_annotations
from tyro.conf import OmitArgPrefixes
from tyro.extras import subcommand_cli_from_dict

from animal3dbox.cli.jobs import COMMANDS
from animal3dbox.datasets import SyntheticDataset
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.training.detector_targets import CropViews, StoredCrops
from animal3dbox.training.metrics import BoxMetrics

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
VALUES = {
    "FILE": "sheet.jpg",
    "FILE.png": "sheet.png",
    "FOLDER": "pictures",
    "OUT": "copies",
    "OUT_DIR": "pictures",
    "PHOTOS": "photos",
    "SEED": "3",
}
"""A value for each word that a usage line has."""


def ways_of(docstring: str) -> list[list[str]]:
    """The arguments that a usage line `python examples/x.py A [B] [--out C]` allows, B before C."""
    usage = re.search(r"python examples/\w+\.py([^`\n]*)", docstring)
    assert usage is not None, "the docstring has no line that says how the example is run"
    ways: list[list[str]] = [[]]
    for optional, option, word in re.findall(r"(\[?)(--\w+ )?([A-Z][\w.]*)\]?", usage[1]):
        longer = [*ways[-1], *([option.strip()] if option else []), VALUES[word]]
        ways = [*ways, longer] if optional else [longer]
    return ways


def shortest_and_longest(ways: list[list[str]]) -> list[list[str]]:
    """The ways with the fewest and with the most arguments: tests have time for no more."""
    return [ways[0], ways[-1]] if len(ways) > 1 else ways


WITH_OWN_TESTS = ("train_loop.py", "train_detector.py", "lightning_module.py")
"""Examples that train: the tests are below."""
SHAPES = {"augment_grid.py": (600, 1000), "augment_your_own_cuboids.py": (600, 1600)}
"""Height and width of the sheets that these draw."""
WAYS = [
    pytest.param(path.name, way, id=" ".join([path.stem, *way]))
    for path in EXAMPLES
    if path.name not in WITH_OWN_TESTS
    for way in shortest_and_longest(ways_of(ast.get_docstring(ast.parse(path.read_text())) or ""))
]


def run_example(example: str, *options: str, cwd: Path) -> str:
    """Run an example in a folder; what it printed."""
    process = subprocess.run(
        [sys.executable, str(ROOT / "examples" / example), *options],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
    )
    assert process.returncode == 0, process.stderr
    return process.stdout


def write_photos(root: Path) -> None:
    """One animal seen from six sides, in StanfordExtra's files."""
    scene = toy_scene()
    azimuths = {"left": 90.0, "right": -90.0, "front": 0.0, "ahead_left": 60.0, "back": 180.0}
    azimuths["herd/left"] = 70.0
    entries = [
        add_photo(root, view_of(scene, azimuth), f"{name}.jpg")
        for name, azimuth in azimuths.items()
    ]
    write_annotations(root, entries)


def test_usage_lines_are_read_with_and_without_their_options() -> None:
    assert ways_of("Run: python examples/a.py") == [[]]
    assert ways_of("Run: python examples/a.py [FILE] [SEED]\n\nFILE is") == [
        [],
        ["sheet.jpg"],
        ["sheet.jpg", "3"],
    ]
    assert ways_of("`python examples/a.py OUT_DIR`.") == [["pictures"]]
    assert ways_of("python examples/a.py [--out FILE.png]") == [[], ["--out", "sheet.png"]]


@pytest.mark.parametrize(("example", "options"), WAYS)
def test_the_example_runs_as_its_docstring_says(
    example: str, options: list[str], tmp_path: Path
) -> None:
    (tmp_path / "docs" / "images").mkdir(parents=True)  # where pictures go in a checkout
    if "photos" in options:
        write_photos(tmp_path / "photos")
    printed = run_example(example, *options, cwd=tmp_path)
    outputs = [tmp_path / word for word in options if word not in ("photos", "3", "--out")]
    assert all(path.is_file() or any(path.iterdir()) for path in outputs)
    pictures = [path for path in tmp_path.rglob("*") if path.suffix in (".jpg", ".png")]
    assert printed or pictures
    if example in SHAPES:
        (picture,) = (cv2.imread(str(path)) for path in pictures)
        assert picture is not None
        assert picture.shape[:2] == SHAPES[example]
        assert float(picture.std()) > 10


def test_the_training_loop_trains_on_every_sample(tmp_path: Path) -> None:
    assert len((ROOT / "examples" / "train_loop.py").read_text().splitlines()) < 90
    lines = run_example("train_loop.py", cwd=tmp_path).splitlines()
    assert [line.split(":")[0] for line in lines] == ["epoch 0", "epoch 1", "epoch 2"]
    assert all(line.endswith("left out: nothing") for line in lines)


def test_the_detector_s_example_trains_judges_and_draws(tmp_path: Path) -> None:
    assert len((ROOT / "examples" / "train_detector.py").read_text().splitlines()) <= 150
    options = ("--out", "kept", "--epochs", "1", "--seeds", "3")
    lines = run_example("train_detector.py", *options, cwd=tmp_path).splitlines()
    assert [line.split(":")[0] for line in lines] == ["seed 3, test-id", "seed 3, test-species"]
    for line in lines:
        heading, flank, count = (float(word) for word in line.split(" = ")[1].split())
        assert 0 < heading < 180
        assert 0 <= flank <= 1 < count
    names = {path.name for path in (tmp_path / "kept").iterdir()}
    assert names == {
        *("train", "test-id", "test-species", "seed-3.pt"),
        *("test-id-3.jpg", "test-species-3.jpg"),
    }
    assert run_example("train_detector.py", *options, cwd=tmp_path).splitlines() == lines


def test_a_detector_that_was_paused_ends_with_the_same_bytes(tmp_path: Path) -> None:
    example = runpy.run_path(str(ROOT / "examples" / "train_detector.py"))
    world = SyntheticDataset(10, seed=5, image_hw=(96, 128))
    crops, views = StoredCrops.kept(world, tmp_path / "crops"), CropViews()
    torch.set_num_threads(1)
    at_once = example["train"](crops, tmp_path / "a.pt", views, seed=1, epochs=3)
    paused = example["train"](crops, tmp_path / "b.pt", views, seed=1, epochs=3, pause=1)
    weights, early = at_once.state_dict(), paused.state_dict()
    assert any(not torch.equal(weights[name], early[name]) for name in weights)
    resumed = example["train"](crops, tmp_path / "b.pt", views, seed=1, epochs=3).state_dict()
    for name, weight in weights.items():
        assert weight.numpy().tobytes() == resumed[name].numpy().tobytes(), name
    others: list[tuple[StoredCrops, CropViews, int, int]] = [
        (crops, views, 1, 4),
        (crops, views, 2, 3),
        (crops, CropViews(mirror=False), 1, 3),
        (crops.at(torch.arange(len(crops)).flip(0)), views, 1, 3),
    ]
    for some, other_views, seed, epochs in others:
        with pytest.raises(SystemExit, match="take another --out, or delete it"):
            example["train"](some, tmp_path / "b.pt", other_views, seed=seed, epochs=epochs)
    with pytest.raises(SystemExit, match="epochs >= 1"):
        example["train"](crops, tmp_path / "new.pt", views, seed=1, epochs=0)


def test_errors_of_the_teaching_study_are_those_of_the_metrics() -> None:
    errors_of = runpy.run_path(str(ROOT / "benchmarks" / "teach.py"))["errors_of"]
    rng = torch.Generator().manual_seed(0)
    turns = 3 * torch.rand(2, 40, 3, generator=rng)
    true, said = rotation_from_axis_angle(turns)
    center = torch.rand(40, 3, generator=rng) + torch.tensor([-0.5, -0.5, 5])
    crops = StoredCrops(
        pixels=torch.zeros(40, 3, 1, 1, dtype=torch.uint8),
        K=torch.eye(3).expand(40, 3, 3),
        center=center,
        rotation=true,
        size=torch.ones(40, 3),
        boxes=torch.tensor([[0.0, 0, 9, 9]]).expand(40, 4),
        image=torch.arange(40),
        weight=torch.ones(40),
    )
    boxes = {"center": center + 0.1, "rotation": said, "size": crops.size}
    errors = {name: torch.tensor(values) for name, values in errors_of(boxes, crops).items()}
    metrics = BoxMetrics(pair_by="boxes", class_agnostic=True, relative=False, resamples=0)
    metrics.update(*crops.by_image({**boxes, "scores": torch.ones(40)}))
    result = metrics.compute()
    assert result["heading_error_deg"] == pytest.approx(float(errors["heading"].mean()), abs=1e-3)
    assert result["flank_accuracy"] == pytest.approx(float(errors["flank"].nanmean()), abs=1e-6)
    assert result["flank_count"] == int((~errors["flank"].isnan()).sum()) < 40


def test_the_lightning_module_trains_and_logs_the_metrics(tmp_path: Path) -> None:
    pytest.importorskip("pytorch_lightning", reason="make test-extras installs it")
    lines = run_example("lightning_module.py", cwd=tmp_path).splitlines()
    values = dict(line.split(": ") for line in lines if line.startswith("val_"))
    assert set(values) == {"val_heading_median_deg", "val_flank_accuracy", "val_pairs"}
    assert 0 < float(values["val_heading_median_deg"]) < 180
    assert float(values["val_pairs"]) > 10


def test_the_side_filter_keeps_left_flanks_only(tmp_path: Path) -> None:
    write_photos(tmp_path)
    printed = run_example("side_filter_for_reid.py", str(tmp_path), "kept", cwd=tmp_path)
    assert {path.name for path in (tmp_path / "kept").iterdir()} == {
        "left.jpg",
        "ahead_left.jpg",
        "herd__left.jpg",
    }
    assert printed.endswith("3 images with a left flank in kept\n")


def test_the_jobs_of_the_slurm_script_make_the_shards_of_one_table(tmp_path: Path) -> None:
    out, calls = tmp_path / "out", tmp_path / "calls"
    command = tmp_path / "animal3dbox"
    command.write_text(f'#!/bin/sh\necho "$@" >> "{calls}"\n')
    command.chmod(0o755)
    for task in ("1", "2"):
        slurm = {"SLURM_ARRAY_TASK_ID": task, "SLURM_ARRAY_TASK_COUNT": "2"}
        known = {**os.environ, **slurm, "SLURM_CPUS_PER_TASK": "4", "ANIMAL3DBOX": str(command)}
        script = [str(ROOT / "examples" / "slurm_label.sh"), "photos", str(out), "--body", "cat"]
        subprocess.run(script, env=known, check=True)
    lines = calls.read_text().splitlines()
    assert [line.split("--shard ")[1][:3] for line in lines] == ["1/2", "2/2"]
    for line in lines:
        job = subcommand_cli_from_dict(COMMANDS, args=line.split(), config=(OmitArgPrefixes,))
        assert (job.path, job.table) == (Path("photos"), out)
        assert (job.cache.resume, job.cache.workers) == (True, 4)

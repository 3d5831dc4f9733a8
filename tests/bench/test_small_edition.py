"""The small edition as continuous integration makes it, with 1 and 2 processes, and scores it."""

import json
import shutil
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from bench_folders import in_both, write_result
from commands import ran

from animal3dbox.bench import bench_plan, read_manifest, score_result, verify_bench
from animal3dbox.bench.card import card_text
from animal3dbox.datasets import read_omni3d
from animal3dbox.datasets.readers.coco.reader import read_coco

SPLITS = [split.name for split in bench_plan("small").splits]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bench") / "small"
    code, words = ran("bench", "make", out, "--edition", "small")
    assert code == 0, words
    return out


def test_made_twice_splits_have_the_same_digests_and_the_same_files(
    bench: Path, tmp_path: Path
) -> None:
    """By two processes the second time; `bench make` of all splits twice takes twice as long."""
    splits = ("test-crowd", "test-focal")
    code, _ = ran(
        *("bench", "make", tmp_path / "b", "--edition", "small", "--workers", "2"),
        *("--split", *splits),
    )
    assert code == 0
    made = [path for path in (tmp_path / "b").rglob("*") if path.is_file()]
    own = [path for path in made if any(split in path.as_posix() for split in splits)]
    assert len([path for path in own if path.suffix == ".png"]) == 60
    for path in own:
        assert path.read_bytes() == (bench / path.relative_to(tmp_path / "b")).read_bytes()
    digests = read_manifest(bench).splits
    assert {name: digests[name] for name in splits} == dict(read_manifest(tmp_path / "b").splits)
    assert verify_bench(tmp_path / "b").faults == ()


def test_it_verifies_and_has_300_images(bench: Path) -> None:
    code, words = ran("bench", "verify", bench)
    assert code == 0
    assert "37 files and 300 images: 0 faults" in words


def test_the_command_names_what_is_wrong_and_exits_with_4(bench: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(bench, tmp_path / "copy"))
    (copy / "images" / "val" / "000007.png").unlink()
    code, words = ran("bench", "verify", copy, "--split", "val")
    assert code == 4
    assert "images/val/000007.png: image: cannot be read" in words
    assert "7 files and 30 images: 1 fault" in words
    code, words = ran("bench", "make", copy, "--edition", "small", "--split", "val")
    assert code == 0
    assert ran("bench", "verify", copy, "--split", "val")[0] == 0


@pytest.mark.parametrize(("one", "other"), list(combinations(SPLITS, 2)))
def test_no_two_splits_share_a_body_a_scene_or_a_picture(bench: Path, one: str, other: str) -> None:
    assert in_both(bench, one, other) == (set(), set(), set())


def test_species_and_cameras_of_the_splits_are_as_the_card_says(bench: Path) -> None:
    truths = {name: read_omni3d(bench / "truth" / f"{name}.json") for name in SPLITS}
    species = {name: {one.category for one in truth.records} for name, truth in truths.items()}
    assert species.pop("test-species") == {"deer", "lion"}
    assert all(not names & {"deer", "lion"} for names in species.values())
    focal = {name: [image.K[0, 0] for image in truth.images] for name, truth in truths.items()}
    assert max(focal["test-focal"]) < 200 < 230 <= min(focal["train"])
    counts = {name: len(truth.records) / len(truth.images) for name, truth in truths.items()}
    assert counts["test-crowd"] > 2 * counts["train"]
    # The camera's height over the animal: how far its back (z) is turned towards it
    down = {
        name: np.median([-one.rotation[:, 2] @ one.center / np.linalg.norm(one.center)
                         for one in truth.records])
        for name, truth in truths.items()
    }  # fmt: skip
    assert down["test-aerial"] > 0.8 > 0.5 > down["train"]


def test_every_split_is_read_with_faces_and_keypoints(bench: Path) -> None:
    for name in SPLITS:
        truth = json.loads((bench / "truth" / f"{name}.json").read_text())
        animals = truth["annotations"]
        assert all(sum(animal["face_share"]) == pytest.approx(1) for animal in animals)
        keypoints = read_coco(bench / "keypoints" / f"{name}.json", bench)
        assert keypoints.faults == ()
        assert len(keypoints.records) == len(animals)
        boxes = read_omni3d(bench / "truth" / f"{name}.json")
        assert boxes.faults == ()
        for record, box in zip(keypoints.records, boxes.records, strict=True):
            assert record.sample_id == box.sample_id
            assert record.box is not None
            assert box.box is not None
            assert np.abs(record.box - box.box).max() < 1e-9


def test_the_truth_scores_1_in_every_split(bench: Path, tmp_path: Path) -> None:
    for name in SPLITS:
        records = read_omni3d(bench / "truth" / f"{name}.json").records
        result = write_result(tmp_path / name, bench, name, records)
        metrics = score_result(bench, result, resamples=0)[1][0].metrics
        assert metrics["ap_3d"] == metrics["ap_3d_h30"] == metrics["flank_accuracy"] == 1.0
        assert metrics["heading_error_deg"] == pytest.approx(0, abs=1e-6)


def test_the_baselines_without_pixels_run_on_every_test(bench: Path, tmp_path: Path) -> None:
    tests = [name for name in SPLITS if name.startswith("test-")]
    for baseline in ("constant", "nearest"):
        out = tmp_path / baseline
        assert ran("bench", "baseline", bench, baseline, "--split", *tests, "--out", out)[0] == 0
        code, words = ran("bench", "score", bench, out, "--out", tmp_path / f"{baseline}-score")
        assert code == 0
        assert all(name in words for name in tests)


def test_the_card_has_front_matter_with_its_licence(bench: Path) -> None:
    card = (bench / "README.md").read_text()
    assert card == card_text(bench_plan("small"))
    _, front, text = card.split("---\n", 2)
    keys = [line.split(":")[0] for line in front.splitlines() if line[0] not in " -"]
    assert keys == [
        "license", "pretty_name", "task_categories", "tags", "size_categories", "configs",
    ]  # fmt: skip
    assert front.startswith("license: cc0-1.0\n")
    listed = [line.split(": ")[1] for line in front.splitlines() if "path: " in line]
    assert listed == [f"truth/{name}.json" for name in SPLITS]
    assert all((bench / path).is_file() for path in listed)
    assert all(f"| {name} | " in text for name in SPLITS)
    assert set(read_manifest(bench).files) == {"README.md"}

"""Scoring: what the truth scores, what head for tail does, and which results are refused."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_folders import made, tiny_plan, write_result
from commands import ran
from PIL import Image

from animal3dbox.bench import read_manifest, run_baseline, score_result
from animal3dbox.datasets import CuboidRecord, read_omni3d
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError

HEAD_FOR_TAIL = np.diag([-1.0, -1.0, 1.0])
ERRORS = (
    *("heading_error_deg", "flip_rate", "corner_error", "nhd", "distance_error"),
    *("length_error", "width_error", "height_error", "face_share_error"),
)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("bench") / "bench", tiny_plan(train=6, test_id=4))


@pytest.fixture(scope="module")
def truth(bench: Path) -> tuple[CuboidRecord, ...]:
    return read_omni3d(bench / "truth" / "test-id.json").records


@pytest.fixture
def result(bench: Path, truth: tuple[CuboidRecord, ...], tmp_path: Path) -> Path:
    """The truth as a result, to spoil."""
    return write_result(tmp_path / "result", bench, "test-id", truth)


def scores(bench: Path, result: Path) -> dict[str, Any]:
    return score_result(bench, result, resamples=0)[1][0].metrics


def test_the_truth_scores_1_and_its_errors_are_0(bench: Path, result: Path) -> None:
    metrics = scores(bench, result)
    assert metrics["images"] == 4
    assert metrics["truths"] == metrics["predictions"] == metrics["pairs"] > 0
    for name in ("ap_3d", "ap_3d_50", "ap_3d_h30", "ap_3d_h45", "rel_ap_3d", "flank_accuracy"):
        assert metrics[name] == 1.0, name
    for name in ERRORS:
        assert metrics[name] == pytest.approx(0, abs=1e-6), name


def test_head_for_tail_has_an_ap_of_1_and_an_ap_with_heading_of_0(
    bench: Path, truth: tuple[CuboidRecord, ...], tmp_path: Path
) -> None:
    turned = [replace(one, rotation=one.rotation @ HEAD_FOR_TAIL) for one in truth]
    metrics = scores(bench, write_result(tmp_path / "turned", bench, "test-id", turned))
    assert metrics["ap_3d"] == 1.0
    assert metrics["ap_3d_h30"] == metrics["ap_3d_h45"] == 0.0
    assert metrics["flip_rate"] == 1.0
    assert metrics["flank_accuracy"] == 0.0
    assert metrics["heading_error_deg"] == pytest.approx(180, abs=1e-4)


def test_categories_do_not_count(
    bench: Path, truth: tuple[CuboidRecord, ...], tmp_path: Path
) -> None:
    """Not even where the animals of one image are said to be of two species."""
    assert len({one.image_id for one in truth}) < len(truth)
    called = [replace(one, category=("lion", "cat")[n % 2]) for n, one in enumerate(truth)]
    result = write_result(tmp_path / "called", bench, "test-id", called)
    assert scores(bench, result)["ap_3d"] == 1.0


def test_a_box_at_another_depth_keeps_its_pair_and_so_its_heading(
    bench: Path, truth: tuple[CuboidRecord, ...], tmp_path: Path
) -> None:
    """Scaled about the camera: the same projection, no overlap in space."""
    near = [replace(one, center=one.center / 2, size=one.size / 2, box=None) for one in truth]
    metrics = scores(bench, write_result(tmp_path / "near", bench, "test-id", near))
    assert metrics["ap_3d"] == 0.0
    assert (metrics["rel_ap_3d"], metrics["rel_scale"]) == (1.0, 2.0)
    assert metrics["pairs"] == metrics["truths"]
    assert metrics["flank_accuracy"] == 1.0
    assert metrics["distance_error"] == pytest.approx(0.5)


def test_boxes_that_state_their_2d_box_are_paired_by_it_and_else_by_their_projections(
    bench: Path, truth: tuple[CuboidRecord, ...], tmp_path: Path
) -> None:
    """Cuboids beside their animals: only what they were detected in says whose they are."""
    beside = [replace(one, center=one.center + np.array([2.5, 0, 0])) for one in truth]
    score = score_result(
        bench, write_result(tmp_path / "stated", bench, "test-id", beside), resamples=0
    )[1][0]
    assert score.paired_by == "bbox"
    assert score.metrics["pairs"] == len(truth)
    assert score.metrics["ap_3d"] == 0.0
    silent = [replace(one, box=None) for one in beside]
    score = score_result(
        bench, write_result(tmp_path / "silent", bench, "test-id", silent), resamples=0
    )[1][0]
    assert score.paired_by == "projection"
    assert score.metrics["pairs"] == 0


def test_images_without_boxes_may_have_empty_elements_and_cost_recall(
    bench: Path, truth: tuple[CuboidRecord, ...], tmp_path: Path
) -> None:
    first = [one for one in truth if one.image_id == truth[0].image_id]
    metrics = scores(bench, write_result(tmp_path / "few", bench, "test-id", first))
    assert metrics["images"] == 4
    assert 0 < metrics["ap_3d"] <= len(first) / len(truth) + 0.02


def elements(result: Path) -> list[dict[str, Any]]:
    content: list[dict[str, Any]] = json.loads((result / "test-id.json").read_text())
    return content


def rewritten(result: Path, content: Any, file: str = "test-id.json") -> None:
    (result / file).write_text(json.dumps(content))


def without_an_image(result: Path) -> None:
    rewritten(result, elements(result)[1:])


def with_an_image_twice(result: Path) -> None:
    rewritten(result, [*elements(result), elements(result)[0]])


def with_an_unknown_image(result: Path) -> None:
    rewritten(result, [*elements(result), {"image_id": 99, "instances": []}])


def with_ids_that_are_text(result: Path) -> None:
    rewritten(result, [{**image, "image_id": str(image["image_id"])} for image in elements(result)])


def with_a_name_for_an_id(result: Path) -> None:
    rewritten(result, [*elements(result), {"image_id": "dog.png", "instances": []}])


def with_a_flat_list(result: Path) -> None:
    rewritten(result, [box for image in elements(result) for box in image["instances"]])


def with_a_box_that_is_none(result: Path) -> None:
    content = elements(result)
    content[0]["instances"][0]["dimensions"] = [1, 1, -1]
    rewritten(result, content)


def with_a_box_of_another_image(result: Path) -> None:
    content = elements(result)
    content[0]["instances"][0]["image_id"] = 2
    rewritten(result, content)


def about(result: Path, **changes: Any) -> None:
    rewritten(result, {**json.loads((result / "about.json").read_text()), **changes}, "about.json")


def of_another_version(result: Path) -> None:
    about(result, version="bench-v0")


def of_another_edition(result: Path) -> None:
    about(result, edition="full")


def of_other_pixels(result: Path) -> None:
    about(result, splits={"test-id": "0" * 64})


def of_no_track(result: Path) -> None:
    about(result, track="depth")


def with_an_unknown_key(result: Path) -> None:
    about(result, metod="typo")


def of_no_split(result: Path) -> None:
    about(result, splits={})


def of_a_split_that_is_not_there(result: Path) -> None:
    about(result, splits={"val": "0" * 64})


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (without_an_image, r"1 images \(ids 1\) are missing: give each its element"),
        (with_an_image_twice, r"1 images \(ids 1\) are there more than once"),
        (with_an_unknown_image, r"1 images \(ids 99\) are not of this split"),
        (
            with_ids_that_are_text,
            r'4 images \(ids "1", "2", "3", "4"\) are not of this split: text stands where',
        ),
        (with_a_name_for_an_id, r'1 images \(ids "dog.png"\) are not of this split$'),
        (with_a_flat_list, "must be a list of images"),
        (with_a_box_that_is_none, "1 boxes cannot be used.*dimensions"),
        (
            with_a_box_of_another_image,
            "image 1, instance 0: image_id: is 2, and its element's is 1",
        ),
        (of_another_version, "the result is of bench-v0 small and the benchmark is bench-v1 small"),
        (of_another_edition, "the result is of bench-v1 full and the benchmark is bench-v1 small"),
        (of_other_pixels, "test-id was detected on other pixels: the result says 0000"),
        (of_no_track, "track"),
        (with_an_unknown_key, "metod"),
        (of_no_split, "splits is empty"),
        (of_a_split_that_is_not_there, "no whole split 'val'"),
    ],
)
def test_a_result_is_refused(
    bench: Path, result: Path, spoil: Callable[[Path], None], words: str
) -> None:
    spoil(result)
    with pytest.raises(DatasetFormatError, match=words):
        scores(bench, result)


def test_a_result_without_about_or_without_a_split_s_file_is_refused(
    bench: Path, result: Path
) -> None:
    shutil.copy(result / "test-id.json", result / "test-id.pth")
    with pytest.raises(DatasetNotFoundError, match=r"must hold .* and holds both"):
        scores(bench, result)
    (result / "test-id.json").unlink()
    (result / "test-id.pth").unlink()
    with pytest.raises(DatasetNotFoundError, match=r"must hold .* and holds neither"):
        scores(bench, result)
    (result / "about.json").unlink()
    with pytest.raises(DatasetNotFoundError, match=r"about\.json"):
        scores(bench, result)


def test_nothing_is_scored_against_a_changed_truth(
    bench: Path, result: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(bench, tmp_path / "copy"))
    path = copy / "truth" / "test-id.json"
    path.write_text(path.read_text() + " ")
    with pytest.raises(DatasetFormatError, match="not as it was made, so nothing is scored"):
        scores(copy, result)


def test_the_labeller_refuses_changed_keypoints(bench: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(bench, tmp_path / "copy"))
    path = copy / "keypoints" / "test-id.json"
    file = json.loads(path.read_text())
    file["annotations"][0]["keypoints"][0] += 1
    path.write_text(json.dumps(file))
    with pytest.raises(DatasetFormatError, match=r"keypoints/test-id\.json is not as it was made"):
        run_baseline(copy, "labels-preset", tmp_path / "result", splits=["test-id"])
    run_baseline(copy, "constant", tmp_path / "other", splits=["test-id"])  # reads no keypoints


def test_nothing_is_scored_by_a_changed_list_of_categories(
    bench: Path, result: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copytree(bench, tmp_path / "copy"))
    path = copy / "truth" / "test-id_category_meta.json"
    path.write_text(path.read_text() + " ")
    with pytest.raises(DatasetFormatError, match=r"category_meta\.json is not as it was made"):
        scores(copy, result)
    path.unlink()
    with pytest.raises(DatasetNotFoundError, match=r"no truth/test-id_category_meta\.json"):
        scores(copy, result)


@pytest.mark.parametrize("deleted", [1, 4])
def test_pictures_that_were_deleted_do_not_shrink_the_test(
    bench: Path, result: Path, tmp_path: Path, deleted: int
) -> None:
    copy = Path(shutil.copytree(bench, tmp_path / "copy"))
    expected = scores(copy, result)
    for path in sorted((copy / "images" / "test-id").glob("*.png"))[:deleted]:
        path.unlink()
    assert scores(copy, result) == expected
    assert expected["images"] == 4


def without_version(bench: Path) -> None:
    (bench / "VERSION").unlink()


def with_another_version(bench: Path) -> None:
    (bench / "VERSION").write_text("bench-v2\n")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [(without_version, "VERSION: file: cannot be read"), (with_another_version, "is 'bench-v2'")],
)
def test_score_and_baseline_refuse_a_version_that_is_not_the_manifest_s(
    bench: Path, result: Path, tmp_path: Path, spoil: Callable[[Path], None], words: str
) -> None:
    copy = Path(shutil.copytree(bench, tmp_path / "copy"))
    spoil(copy)
    with pytest.raises(DatasetFormatError, match=words):
        scores(copy, result)
    with pytest.raises(DatasetFormatError, match=words):
        run_baseline(copy, "constant", tmp_path / "other", splits=["test-id"])


def smaller(path: Path) -> None:
    with Image.open(path) as image:
        image.resize((128, 96)).save(path)


@pytest.mark.parametrize("baseline", ["nearest", "labels-preset"])
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (Path.unlink, "is missing"),
        (smaller, "is 128 x 96, not 256 x 192"),
        (lambda path: path.write_bytes(b"no picture"), ": "),
    ],
)
def test_a_baseline_refuses_pictures_that_are_missing_or_of_another_size(
    bench: Path, tmp_path: Path, baseline: str, spoil: Callable[[Path], None], words: str
) -> None:
    copy = Path(shutil.copytree(bench, tmp_path / "copy"))
    spoil(copy / "images" / "test-id" / "000002.png")
    arguments = ("bench", "baseline", copy, baseline, "--split", "test-id")
    code, said = ran(*arguments, "--out", tmp_path / "result")
    assert code == 3
    assert re.search(rf"1 of 4 pictures .*images/test-id/000002\.png.*({words})", flat(said))
    assert not (tmp_path / "result").exists()


def flat(text: str) -> str:
    """A command's words on one line."""
    return " ".join(text.split())


@pytest.mark.parametrize("baseline", ["constant", "nearest"])
def test_a_baseline_that_learns_answers_each_box_of_a_split(
    bench: Path, truth: tuple[CuboidRecord, ...], tmp_path: Path, baseline: Any
) -> None:
    head = run_baseline(bench, baseline, tmp_path / "result", splits=["test-id"])
    assert (head.track, head.method, head.notes) == ("box", baseline, {})
    metrics = scores(bench, tmp_path / "result")
    assert metrics["predictions"] == len(truth)
    assert metrics["heading_error_deg"] > 5  # six images teach little


def test_the_nearest_neighbour_knows_what_it_was_taught(bench: Path, tmp_path: Path) -> None:
    run_baseline(bench, "nearest", tmp_path / "result", splits=["train"])
    metrics = scores(bench, tmp_path / "result")
    assert metrics["ap_3d"] == metrics["ap_3d_h30"] == 1.0


def test_our_labeller_sees_the_right_flank_from_keypoints(bench: Path, tmp_path: Path) -> None:
    head = run_baseline(bench, "labels-preset", tmp_path / "result", splits=["train", "test-id"])
    assert head.track == "keypoints"
    without = [int(note.split()[0]) for note in head.notes.values()]
    found = [
        box
        for name in head.splits
        for image in json.loads((tmp_path / "result" / f"{name}.json").read_text())
        for box in image["instances"]
    ]
    animals = sum(read_manifest(bench).splits[name].animals for name in head.splits)
    assert len(found) == animals - sum(without)
    assert set(head.splits) == {"train", "test-id"}
    metrics = scores(bench, tmp_path / "result")
    assert metrics["heading_count"] > 3
    assert metrics["flank_accuracy"] == 1.0
    assert metrics["heading_error_deg"] < 25
    assert metrics["distance_error"] < 0.3  # K is known: three times the focal length would be 2


def test_the_commands_score_and_say_why_not(bench: Path, result: Path, tmp_path: Path) -> None:
    out = tmp_path / "score"
    code, words = ran("bench", "score", bench, result, "--out", out, "--resamples", "20")
    assert code == 0
    assert re.search(r"test-id +1\.00 +1\.00", words)
    tables = json.loads((out / "score.json").read_text())
    rows = {row["metric"]: row for row in tables["tables"]["metrics"]["rows"]}
    assert rows["ap_3d"] == {
        "split": "test-id", "metric": "ap_3d", "value": 1.0, "low": 1.0, "high": 1.0,
    }  # fmt: skip
    assert (out / "score.txt").read_text().startswith("a test's on bench-v1 (small), track image")
    without_an_image(result)
    code, words = ran("bench", "score", bench, result, "--out", tmp_path / "none")
    assert code == 3
    assert "are missing" in words
    assert not (tmp_path / "none").exists()

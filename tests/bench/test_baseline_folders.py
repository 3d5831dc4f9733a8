"""The folder that a baseline writes into: another result's is refused, its own is extended."""

import json
from pathlib import Path

import msgspec
import pytest
from bench_folders import made, tiny_plan
from commands import ran

from animal3dbox.bench import ResultHead, run_baseline, score_result, verify_bench, write_head


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("bench") / "bench", tiny_plan(train=3, val=2, test_id=2))


@pytest.mark.parametrize(
    ("field", "value"),
    [("method", "ours"), ("track", "image"), ("version", "bench-v0"), ("edition", "full")],
)
def test_a_folder_of_another_result_is_refused_and_stays(
    bench: Path, tmp_path: Path, field: str, value: str
) -> None:
    head = run_baseline(bench, "constant", tmp_path, splits=["val"])
    write_head(tmp_path, msgspec.structs.replace(head, **{field: value}))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    arguments = ("bench", "baseline", bench, "constant", "--split", "test-id", "--out", tmp_path)
    code, words = ran(*arguments)
    assert code == 2
    assert f"holds a result whose {field} is {value!r}" in words
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_about_names_every_split_that_is_there_and_the_notes_on_each(
    bench: Path, tmp_path: Path
) -> None:
    """Of a split that is made again the new note counts; one whose file was deleted is gone."""
    first = run_baseline(bench, "constant", tmp_path, splits=["val"])
    notes = {"val": "1 animals have no box (few)", "train": "2 animals have no box (few)"}
    gone = {**first.splits, "train": "0" * 64}
    write_head(tmp_path, msgspec.structs.replace(first, splits=gone, note="mine", notes=notes))
    second = run_baseline(bench, "constant", tmp_path, splits=["test-id"])
    assert list(second.splits) == ["val", "test-id"]
    assert (second.note, second.notes) == ("mine", {"val": "1 animals have no box (few)"})
    about = msgspec.convert(json.loads((tmp_path / "about.json").read_text()), ResultHead)
    assert about == second
    assert [one.split for one in score_result(bench, tmp_path, resamples=0)[1]] == [
        "val",
        "test-id",
    ]
    third = run_baseline(bench, "constant", tmp_path, splits=["val"])
    assert set(third.splits) == {"val", "test-id"}
    assert third.notes == {}


@pytest.mark.parametrize("place", [".", "images", "truth/deeper"])
@pytest.mark.parametrize("action", ["score", "baseline"])
def test_outputs_among_the_benchmark_s_own_files_are_refused(
    bench: Path, tmp_path: Path, action: str, place: str
) -> None:
    result = tmp_path / "result"
    run_baseline(bench, "constant", result, splits=["val"])
    before = sorted(bench.rglob("*"))
    of = result if action == "score" else "constant"
    code, words = ran("bench", action, bench, of, "--split", "val", "--out", bench / place)
    assert code == 2
    assert "is among the benchmark's own files" in " ".join(words.split())
    assert sorted(bench.rglob("*")) == before


def test_scores_in_the_result_s_own_folder_are_refused(bench: Path, tmp_path: Path) -> None:
    run_baseline(bench, "constant", tmp_path, splits=["val"])
    code, words = ran("bench", "score", bench, tmp_path, "--out", tmp_path / "x" / "..")
    assert code == 2
    assert "is the result's own folder" in " ".join(words.split())
    assert not (tmp_path / "score.json").exists()


def test_a_split_that_is_named_twice_is_one(bench: Path, tmp_path: Path) -> None:
    twice = ["val", "val"]
    assert list(run_baseline(bench, "constant", tmp_path, splits=twice).splits) == ["val"]
    scored = score_result(bench, tmp_path, splits=twice, resamples=0)[1]
    assert [one.split for one in scored] == ["val"]
    plan = tiny_plan(train=3, val=2, test_id=2)
    assert verify_bench(bench, splits=twice, plan=plan).images == 2

"""The command `label --table`: workers, shards, kills, and what it refuses."""

import json
import random
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ran
from killed_commands import can_kill, kill_at_random
from small_animals import model_of
from table_rows import Row, entries_of, sorted_rows


def command(animals: Path, table: Path, *more: str) -> list[str]:
    """The words of a command that writes a table; cameras are taken as known."""
    options = ["--model", str(model_of(animals)), "--stored-camera", "exact"]
    return ["label", str(animals), *options, "--table", str(table), *more]


@pytest.fixture(scope="module")
def whole(animals: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    """The rows of the table as one process makes it in one go."""
    folder = tmp_path_factory.mktemp("whole") / "table"
    code, output = ran(*command(animals, folder, "--json"))
    assert code == 0, output
    rows = sorted_rows(folder)
    told = json.loads(output.splitlines()[-1])
    assert told["status"] == {"labelled": len(rows)}
    assert len(rows) == entries_of(animals)
    return rows


def test_two_workers_make_the_same_table_as_one_process(
    animals: Path, tmp_path: Path, whole: list[Row]
) -> None:
    for shard in ("1/2", "2/2"):
        more = ("--workers", "2", "--part-rows", "2", "--shard", shard)
        assert ran(*command(animals, tmp_path, *more))[0] == 0
    assert sorted_rows(tmp_path) == whole


@pytest.mark.skipif(not can_kill(), reason="processes' children are told by Linux alone")
def test_a_table_that_was_killed_three_times_is_whole_after_resuming(
    animals: Path, tmp_path: Path, whole: list[Row]
) -> None:
    rng, table = random.Random(0), tmp_path / "table"
    words = command(animals, table, "--workers", "2", "--part-rows", "1", "--resume")
    for victim in ("worker", "driver", "worker"):
        code, told = kill_at_random(words, table, victim, rng)
        assert code in ((0, 5) if victim == "worker" else (0, -9)), told
        if code == 5:
            assert "a worker process ended before its work was done" in told
            assert "--resume" in told
        rows = sorted_rows(table)
        assert len({*rows}) == len(rows)
        assert {*rows} <= {*whole}
    assert ran(*command(animals, table, "--resume"))[0] == 0
    assert sorted_rows(table) == whole
    assert not [path.name for path in table.iterdir() if path.name.startswith(".shard-1-of-1-")]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--out", "o"), "not both"),
        (("--shard", "3/2"), "--shard must be i/n"),
        (("--workers", "-1"), "--workers must not be negative"),
        (("--part-rows", "0"), "a part must have rows"),
    ],
)
def test_options_that_contradict_are_refused(
    animals: Path, tmp_path: Path, options: tuple[str, ...], says: str
) -> None:
    code, output = ran(*command(animals, tmp_path / "t", *options))
    assert code == 2
    assert says in output


def test_shards_of_other_options_or_changed_annotations_are_refused(
    copied: Path, tmp_path: Path
) -> None:
    def shard(words: str, *more: str) -> tuple[int, str]:
        return ran(*command(copied, tmp_path / "t", "--shard", words, "--resume", *more))

    assert shard("1/2")[0] == 0
    code, output = shard("2/2", "--surface-share")
    assert code == 2
    assert "with other options or bodies" in output
    annotations = copied / "train.json"
    content = json.loads(annotations.read_text())
    content["data"] = content["data"][1:]
    annotations.write_text(json.dumps(content))
    code, output = shard("2/2")
    assert code == 2
    assert "the annotations have changed" in output


def test_a_shard_of_another_number_is_refused_while_one_is_written(
    animals: Path, tmp_path: Path
) -> None:
    other = (
        "import sys; from pathlib import Path\n"
        "from animal3dbox.report.table.parts import locked_shard\n"
        "with locked_shard(Path(sys.argv[1]), (1, 2)):\n"
        "    print('locked', flush=True); sys.stdin.read()\n"
    )
    words = [sys.executable, "-c", other, str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"locked\n"
        code, output = ran(*command(animals, tmp_path, "--resume"))
        assert code == 2
        assert "another process writes shard-1-of-2" in output
        assert ran(*command(animals, tmp_path, "--shard", "2/2", "--resume"))[0] == 0
        holder.communicate(timeout=60)
    assert ran(*command(animals, tmp_path, "--resume"))[0] == 0


def test_a_table_is_not_written_over(animals: Path, tmp_path: Path) -> None:
    assert ran(*command(animals, tmp_path, "--shard", "1/8"))[0] == 0
    code, output = ran(*command(animals, tmp_path))
    assert code == 2
    assert "go on with --resume, or give another folder" in output

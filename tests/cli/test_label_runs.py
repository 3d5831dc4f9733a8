"""`label --out` by workers, after a kill, and with fewer pictures: the same labels each time."""

import random
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ran
from killed_commands import can_kill, run_in_child
from small_animals import model_of

from animal3dbox.errors import WorkerError
from animal3dbox.files import ListedFiles
from animal3dbox.report.label_reading import read_labels_json
from animal3dbox.report.run import OVERLAYS, ROWS, RunWriter
from animal3dbox.report.run_rows import DrawnAnimal
from animal3dbox.report.table.parts import locked_shard


def command(animals: Path, out: Path, *more: str) -> list[str]:
    """The words of a command that labels, cameras taken as known."""
    options = ["--model", str(model_of(animals)), "--stored-camera", "exact", "--json"]
    return ["label", str(animals), *options, "--out", str(out), *more]


def contents(out: Path) -> dict[str, bytes]:
    """All files of a run's folder."""
    files = (path for path in out.rglob("*") if path.is_file())
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


def interrupt_before_the_end(animals: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Label until all rows and overlays are written, and no other file is."""

    def interrupted(writer: RunWriter) -> None:
        writer.spool.flush()
        raise WorkerError("killed at the end")

    with monkeypatch.context() as patched:
        patched.setattr(RunWriter, "finish", interrupted)
        assert ran(*command(animals, out))[0] == 5


@pytest.fixture(scope="module")
def whole(animals: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of a run by one process in one go."""
    out = tmp_path_factory.mktemp("whole") / "out"
    assert ran(*command(animals, out))[0] == 0
    return contents(out)


def test_workers_write_the_same_bytes(
    animals: Path, tmp_path: Path, whole: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("animal3dbox.cli.label.AT_ONCE", 1)
    assert ran(*command(animals, tmp_path / "out", "--workers", "2"))[0] == 0
    assert contents(tmp_path / "out") == whole


def test_an_interrupted_run_is_gone_on_with_to_the_same_bytes(
    animals: Path, tmp_path: Path, whole: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, add, added = tmp_path / "out", RunWriter.add, list[DrawnAnimal]()

    def add_until_full(writer: RunWriter, animals: list[DrawnAnimal]) -> None:
        if len(added) > 5:
            raise WorkerError("a worker was killed")
        added.extend(animals)
        add(writer, animals)

    monkeypatch.setattr("animal3dbox.cli.label.AT_ONCE", 1)
    with monkeypatch.context() as interrupted:
        interrupted.setattr(RunWriter, "add", add_until_full)
        assert ran(*command(animals, out))[0] == 5
    assert (out / ROWS).is_dir()
    assert not (out / "labels.json").exists()
    again = list[DrawnAnimal]()

    def add_and_note(writer: RunWriter, animals: list[DrawnAnimal]) -> None:
        again.extend(animals)
        add(writer, animals)

    monkeypatch.setattr(RunWriter, "add", add_and_note)
    assert ran(*command(animals, out, "--resume"))[0] == 0
    assert contents(out) == whole
    assert 0 < len(again) == sum(name.startswith("overlays/") for name in whole) - len(added)


@pytest.mark.skipif(not can_kill(), reason="the command is run in a fork")
def test_a_killed_run_is_gone_on_with_to_the_same_bytes(
    animals: Path, tmp_path: Path, whole: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, rng = tmp_path / "out", random.Random(1)
    monkeypatch.setattr("animal3dbox.cli.label.AT_ONCE", 1)
    monkeypatch.setattr("animal3dbox.report.row_spool.ROWS_AT_ONCE", 2)
    child = run_in_child(command(animals, out, "--workers", "1"), tmp_path / "errors")
    wanted = rng.randrange(1, 4)
    while child.is_alive() and len([*(out / ROWS).glob("*.rows")]) < wanted:
        child.join(0.001)
    child.kill()
    child.join()
    assert ran(*command(animals, out, "--resume"))[0] == 0
    assert contents(out) == whole


def test_rows_of_another_run_are_not_gone_on_with(
    animals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupt_before_the_end(animals, tmp_path, monkeypatch)
    code, output = ran(*command(animals, tmp_path, "--resume", "--tail", "drop"))
    assert code == 2
    assert "annotations, options or code have changed since" in output


@pytest.mark.parametrize("pictures", ["none", "flagged"])
def test_fewer_pictures_cost_no_label(
    animals: Path, tmp_path: Path, whole: dict[str, bytes], pictures: str
) -> None:
    earlier = ListedFiles(tmp_path, "label", OVERLAYS)
    for name in whole:
        if name.startswith("overlays/"):
            earlier.write(name, b"of an earlier run")
    (tmp_path / "overlays" / "mine.txt").write_bytes(b"a user's")
    assert ran(*command(animals, tmp_path, "--pictures", pictures))[0] == 0
    own = contents(tmp_path)
    assert own.pop("overlays/mine.txt") == b"a user's"
    assert own["labels.json"] == whole["labels.json"]
    assert own["labels.csv"] == whole["labels.csv"]
    drawn, page = sum(name.startswith("overlays/") for name in own), own["gallery.html"]
    rows = read_labels_json(tmp_path / "labels.json").animals
    assert drawn == page.count(b"<img ") < len(rows)
    assert drawn == (0 if pictures == "none" else own["gallery.html"].count(b'article class="flag'))


@pytest.mark.skipif(not can_kill(), reason="nothing is locked on Windows")
def test_a_folder_that_another_process_labels_into_is_refused(
    animals: Path, tmp_path: Path
) -> None:
    other = (
        "import sys; from pathlib import Path\n"
        "from animal3dbox.report.table.parts import locked_shard\n"
        "with locked_shard(Path(sys.argv[1])):\n"
        "    print('locked', flush=True); sys.stdin.read()\n"
    )
    words = [sys.executable, "-c", other, str(tmp_path / ROWS)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"locked\n"
        code, output = ran(*command(animals, tmp_path))
        holder.communicate(timeout=60)
    assert code == 2
    assert f"another process labels into {tmp_path}: wait for its end" in output
    assert "table" not in output
    assert "--shard" not in output


def test_a_folder_without_room_for_rows_is_named_as_that_of_the_results(
    animals: Path, tmp_path: Path
) -> None:
    (tmp_path / ROWS).write_bytes(b"a file")
    code, output = ran(*command(animals, tmp_path))
    assert code == 2
    assert f"the results' folder {tmp_path} cannot be written to" in output
    assert "table" not in output


def test_a_list_of_pictures_that_is_a_folder_is_refused_before_the_work(
    animals: Path, tmp_path: Path
) -> None:
    (tmp_path / ".label-pictures").mkdir()
    code, output = ran(*command(animals, tmp_path))
    assert code == 2
    assert f"{tmp_path / '.label-pictures'} is not a file" in output
    assert "delete it" in output
    assert not (tmp_path / ROWS).exists()


def test_overlays_deleted_before_the_end_are_counted_and_not_linked(
    animals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupt_before_the_end(animals, tmp_path, monkeypatch)
    first, *others = sorted((tmp_path / "overlays").iterdir())
    first.unlink()
    code, output = ran(*command(animals, tmp_path, "--resume"))
    assert code == 0
    assert "overlays that were deleted before the end of the run: 1;" in output
    page = (tmp_path / "gallery.html").read_text()
    assert f"overlays/{first.name}" not in page
    assert all(f"overlays/{other.name}" in page for other in others)
    assert first.name not in (tmp_path / ".label-pictures").read_text()


def test_a_link_in_the_place_of_the_lock_costs_no_other_file_its_bytes(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_bytes(b"a user's")
    (tmp_path / ".shard-1-of-1.lock").symlink_to(tmp_path / "mine.txt")
    with locked_shard(tmp_path):
        pass
    assert (tmp_path / "mine.txt").read_bytes() == b"a user's"

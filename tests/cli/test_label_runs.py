"""`label --out` by workers, after a kill, and with fewer pictures: the same labels each time."""

import random
from pathlib import Path

import pytest
from commands import ran
from killed_commands import can_kill, run_in_child
from small_animals import model_of

from animal3dbox.errors import WorkerError
from animal3dbox.files import OwnFiles
from animal3dbox.report.label_reading import read_labels_json
from animal3dbox.report.run import ROWS, RunWriter
from animal3dbox.report.run_rows import DrawnAnimal


def command(animals: Path, out: Path, *more: str) -> list[str]:
    """The words of a command that labels, cameras taken as known."""
    options = ["--model", str(model_of(animals)), "--stored-camera", "exact", "--json"]
    return ["label", str(animals), *options, "--out", str(out), *more]


def contents(out: Path) -> dict[str, bytes]:
    """All files of a run's folder."""
    files = (path for path in out.rglob("*") if path.is_file())
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


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
    def interrupted(writer: RunWriter) -> None:
        writer.spool.flush()
        raise WorkerError("killed at the end")

    with monkeypatch.context() as patched:
        patched.setattr(RunWriter, "finish", interrupted)
        assert ran(*command(animals, tmp_path))[0] == 5
    code, output = ran(*command(animals, tmp_path, "--resume", "--tail", "drop"))
    assert code == 2
    assert "annotations, options or code have changed since" in output


@pytest.mark.parametrize("pictures", ["none", "flagged"])
def test_fewer_pictures_cost_no_label(
    animals: Path, tmp_path: Path, whole: dict[str, bytes], pictures: str
) -> None:
    earlier = OwnFiles(tmp_path, "label")
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

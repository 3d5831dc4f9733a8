"""Every command that works for long shows a bar on a terminal, and none in a log."""

import os
import pty
import re
import sys
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from bench_folders import made, tiny_plan, write_result
from commands import ran
from detector_files import detected_set, written_pth, written_truth
from small_animals import write_small_animals

from animal3dbox.bench import verify
from animal3dbox.bench.made_files import truth_file
from animal3dbox.bench.manifest import read_manifest
from animal3dbox.cli import bench, doctor, evaluate
from animal3dbox.cli.doctor import folder_check
from animal3dbox.cli.jobs import COMMANDS
from animal3dbox.cli.main import main
from animal3dbox.datasets import read_omni3d
from animal3dbox.progress import progress_bars, watched, watched_steps

ROOT = Path(__file__).parent.parent.parent
CALLS = {
    "demo": "demo --n 1 --out {new}",
    "demo --json": "demo --n 1 --json --out {new}",
    "label": "label {animals} --body preset --pictures none --out {new}",
    "label --json": "label {animals} --body preset --pictures none --json --out {new}",
    "label --table": "label {animals} --body preset --table {new}",
    "label --cache": "label {animals} --body preset --cache {new}",
    "synth": "synth --n 2 --width 160 --height 120 --out {new}",
    "evaluate": "evaluate {animals} --out {new}",
    "export --to kitti": "export {truth} --to kitti --scale-free --out {new}",
    "export --to omni3d": "export {truth} --to omni3d --scale-free --out {new}",
    "export --to coco": "export {truth} --to coco --out {new}",
    "check": "check {animals} --body dog",
    "check --json of cuboids": "check {truth} --json",
    "compare": "compare {truth} --with {detections} --truth {truth} --out {new}",
    "bench make": "bench make {new}",
    "bench verify": "bench verify {bench}",
    "bench score": "bench score {bench} {result} --out {new}",
    "bench baseline": "bench baseline {bench} labels-preset --out {new}",
    "inspect": "inspect {animals}",
    "calibrate": "calibrate {animals} --out {new}",  # it teaches nothing, which ends in a code 2
    "gallery": "gallery {table}",
    "doctor": "doctor",
}
"""Calls of all commands that may take longer than two seconds."""
SHORT = {"convert-model", "vocabularies"}
"""Commands that read or print one thing."""


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """What the commands read."""
    root = tmp_path_factory.mktemp("places")
    animals = write_small_animals(root / "set", images=2)
    boxes = detected_set()
    truth = written_truth(root, boxes)
    small = made(root / "bench", tiny_plan(val=1))
    records = read_omni3d(truth_file(small, read_manifest(small), "val")).records
    assert ran("label", animals, "--body", "preset", "--table", root / "table")[0] == 0
    return {
        "animals": animals,
        "truth": truth,
        "detections": written_pth(root, truth),
        "bench": small,
        "result": write_result(root / "result", small, "val", records),
        "table": root / "table",
    }


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The benchmark has one image, the doctor starts no process, evaluate draws no figure."""
    monkeypatch.setattr(doctor, "process_check", lambda name, *_: folder_check(name, str, ""))
    monkeypatch.setattr(evaluate, "plots_of", lambda _: {})
    for module in (bench, verify):
        monkeypatch.setattr(module, "bench_plan", lambda _: tiny_plan(val=1))


@contextmanager
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[bytes]]:
    """Make stderr a pseudo-terminal; what appeared on it stands in the list afterwards."""
    leader, follower = pty.openpty()
    termios.tcsetwinsize(follower, (24, 80))
    shown: list[bytes] = []

    def read() -> None:
        while True:
            try:
                part = os.read(leader, 4096)
            except OSError:  # the other end is closed
                return
            if not part:
                return
            shown.append(part)

    reader = threading.Thread(target=read)
    reader.start()
    with monkeypatch.context() as patch, os.fdopen(follower, "w") as stderr:
        patch.setattr(sys, "stderr", stderr)
        yield shown
    reader.join(timeout=60)
    os.close(leader)


def called(call: str, places: dict[str, Path], new: Path) -> None:
    with pytest.raises(SystemExit) as caught:
        main(call.format(**places, new=new).split())
    assert caught.value.code in (0, 4) or call.startswith("calibrate")


def test_every_command_is_called_or_short() -> None:
    assert {name.split()[0] for name in CALLS} | SHORT == set(COMMANDS)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", CALLS)
def test_a_command_shows_a_bar_on_a_terminal_and_none_in_a_log(
    name: str,
    places: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    called(CALLS[name], places, tmp_path / "log")
    log = capfd.readouterr()
    assert "\r" not in log.err + log.out
    assert "%|" not in log.err + log.out
    if name == "synth":  # its model would be written again
        (tmp_path / "log-model.pkl").unlink()
    with terminal(monkeypatch) as shown:
        called(CALLS[name], places, tmp_path / "terminal")
    on_terminal = b"".join(shown).decode()
    assert "\r" in on_terminal
    assert "?" in on_terminal or "%|" in on_terminal
    assert capfd.readouterr().out == log.out.replace(
        str(tmp_path / "log"), str(tmp_path / "terminal")
    )


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", ["bench score", "compare"])
def test_the_scales_and_the_resampling_of_metrics_have_bars_too(
    name: str, places: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with terminal(monkeypatch) as shown:
        called(CALLS[name], places, tmp_path / "new")
    on_terminal = b"".join(shown).decode()
    assert re.search(r"matching.* 0/28 ", on_terminal)
    assert re.search(r"measuring.* 0/\d+ ", on_terminal)


def test_a_library_shows_no_bar_even_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal(monkeypatch) as shown:
        assert list(watched(range(3), "counting", unit="number")) == [0, 1, 2]
        with watched_steps("counting", unit="number") as watch:
            watch(1, 3)
    assert shown == []


def test_workers_of_a_command_show_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal(monkeypatch) as shown, progress_bars():
        mine = os.getpid()
        monkeypatch.setattr(os, "getpid", lambda: mine + 1)
        assert list(watched(range(3), "counting", unit="number")) == [0, 1, 2]
    assert shown == []


def test_steps_move_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        terminal(monkeypatch) as shown,
        progress_bars(),
        watched_steps("learning", unit="step") as watch,
    ):
        watch(1, 4)
    assert b"learning" in b"".join(shown)


def test_nothing_else_in_the_package_makes_bars() -> None:
    importers = [
        path.relative_to(ROOT).as_posix()
        for folder in ("animal3dbox", "datasets", "transforms")
        for path in (ROOT / folder).rglob("*.py")
        if re.search(r"^\s*(from|import) tqdm", path.read_text(), re.MULTILINE)
    ]
    assert importers == ["animal3dbox/progress.py"]

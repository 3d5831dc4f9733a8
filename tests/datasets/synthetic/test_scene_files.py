"""A synthetic dataset in files: by any number of processes, and what a killed one leaves behind."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from commands import ran

from animal3dbox.datasets import read_dataset
from animal3dbox.datasets.readers.animal3d.reader import read_animal3d
from animal3dbox.datasets.synthetic import scene_files
from animal3dbox.errors import ConfigError

FORMATS = ("animal3d", "stanfordextra")


def command(folder: Path, *more: str) -> list[str]:
    small = ["--n", "4", "--seed", "3", "--width", "80", "--height", "60", "--noise-px", "1"]
    return ["synth", "--out", str(folder), *small, *more]


def content(folder: Path) -> dict[str, bytes]:
    """All files of a dataset, hidden ones too."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For each format a dataset that one process wrote in one go."""
    folder = tmp_path_factory.mktemp("whole")
    for format in FORMATS:
        assert ran(*command(folder / format, "--format", format))[0] == 0
    return folder


@pytest.mark.process
@pytest.mark.parametrize("format", FORMATS)
def test_two_processes_write_the_same_files_as_one(
    tmp_path: Path, whole: Path, format: str
) -> None:
    assert ran(*command(tmp_path / "two", "--format", format, "--workers", "2"))[0] == 0
    one = content(whole / format)
    assert content(tmp_path / "two") == one
    assert not [name for name in one if name.startswith(scene_files.PARTS)]


class BrokenOffError(RuntimeError):
    """In place of a kill, in this process."""


def begin(folder: Path, format: str, scenes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write a dataset that is broken off when some scenes are there, and pictures of one more."""
    write = scene_files._write_part

    def broken_off(files: scene_files.SceneFiles, index: int) -> scene_files.SceneRows:
        if index == scenes:
            files.write_scene(index)
            raise BrokenOffError
        return write(files, index)

    with monkeypatch.context() as patched:
        patched.setattr(scene_files, "_write_part", broken_off)
        with pytest.raises(BrokenOffError):
            ran(*command(folder, "--format", format))


@pytest.mark.parametrize("format", FORMATS)
def test_what_was_broken_off_can_be_read_and_completed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: Path, format: str
) -> None:
    begun = tmp_path / "begun"
    begin(begun, format, 2, monkeypatch)
    read = read_dataset(begun, format)
    assert read.records.faults == ()
    assert len({record.image_id for record in read.records.records}) == 2
    (begun / ".half.jpg.x2y").write_bytes(b"of a file that was being written")
    code, output = ran(*command(begun, "--format", format))
    assert (code, "add --resume" in output) == (2, True)
    again = list[int]()
    write = scene_files._write_part

    def counted(files: scene_files.SceneFiles, index: int) -> scene_files.SceneRows:
        again.append(index)
        return write(files, index)

    monkeypatch.setattr(scene_files, "_write_part", counted)
    assert ran(*command(begun, "--format", format, "--resume"))[0] == 0
    assert again == [2, 3]
    assert content(begun) == content(whole / format)


def test_another_dataset_is_not_completed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: Path
) -> None:
    begin(tmp_path / "set", "animal3d", 0, monkeypatch)
    code, output = ran(*command(tmp_path / "set", "--resume", "--mark-hidden"))
    assert code == 2
    assert "was begun with other options" in output
    code, output = ran(*command(whole / "animal3d", "--resume"))
    assert code == 2
    assert "such as a whole dataset" in output


@pytest.mark.process
def test_a_run_that_is_killed_leaves_a_dataset_and_no_process(tmp_path: Path, whole: Path) -> None:
    folder = tmp_path / "set"
    code = "import sys; from animal3dbox.cli.main import main; main(sys.argv[1:])"
    arguments = [sys.executable, "-c", code, *command(folder, "--workers", "2")]
    with subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        limit = time.monotonic() + 120
        while not (folder / "train.json").exists() and time.monotonic() < limit:
            assert run.poll() is None, "it ended before it could be killed"
            time.sleep(0.02)
        workers = _children(run.pid)
        run.send_signal(signal.SIGKILL)
    assert len(workers) >= 2
    limit = time.monotonic() + 30
    while any(Path(f"/proc/{worker}").exists() for worker in workers):
        assert time.monotonic() < limit, "workers outlive their parent"
        time.sleep(0.05)
    assert len(read_animal3d(folder).records.records) >= 1
    assert ran(*command(folder, "--resume"))[0] == 0
    assert content(folder) == content(whole / "animal3d")


def _children(process: int) -> list[int]:
    """The processes that a process has started."""
    listed = Path(f"/proc/{process}/task/{process}/children")
    return [int(child) for child in listed.read_text().split()]


def test_no_process_is_too_few(tmp_path: Path) -> None:
    code, output = ran(*command(tmp_path / "set", "--workers", "0"))
    assert (code, "--workers must be at least 1" in output) == (2, True)
    assert not (tmp_path / "set").exists()
    with pytest.raises(ConfigError, match="workers must be at least 1"):
        scene_files.write_scenes(None, workers=0, resume=False)  # type: ignore[arg-type]

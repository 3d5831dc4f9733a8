"""Paths with "~" and readers that go away, for every command."""

import subprocess
import sys
from pathlib import Path

import pytest

from animal3dbox.cli.jobs import InspectJob
from animal3dbox.cli.main import main, with_user_paths
from animal3dbox.cli.options import KeypointDatasetOptions


def test_the_home_folder_is_meant_in_every_group_of_options(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    with pytest.raises(SystemExit) as caught:
        main(["inspect", "~/animals", "--images=~/photos"])
    assert caught.value.code == 3
    assert f"there is no file or folder {tmp_path / 'animals'}" in capsys.readouterr().err
    job = InspectJob(
        path=Path("~/a"), dataset=KeypointDatasetOptions(images=Path("~/b"), vocabulary="~/c.toml")
    )
    expanded = with_user_paths(job)
    assert expanded.path == tmp_path / "a"
    assert expanded.dataset.images == tmp_path / "b"
    assert expanded.dataset.vocabulary == str(tmp_path / "c.toml")


def test_a_file_whose_name_begins_so_for_nobody_is_itself() -> None:
    job = InspectJob(path=Path("~nobody-of-this-name/a"), dataset=KeypointDatasetOptions())
    assert with_user_paths(job) == job


def test_a_reader_that_goes_away_ends_the_command_quietly() -> None:
    command = subprocess.Popen(
        [sys.executable, "-m", "animal3dbox", "vocabularies"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert command.stdout is not None
    command.stdout.close()
    _, complaints = command.communicate(timeout=120)
    assert (command.returncode, complaints) == (141, b"")


def test_what_the_user_stops_ends_in_a_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(job: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("animal3dbox.cli.main.run_job", stopped)
    with pytest.raises(SystemExit) as caught:
        main(["vocabularies"])
    assert (caught.value.code, capsys.readouterr().err) == (130, "animal3dbox: interrupted\n")

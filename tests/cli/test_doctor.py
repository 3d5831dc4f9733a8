"""The command `doctor`: versions, extras, and whether things work here."""

import json
import re
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from animal3dbox.cli import doctor, extras
from animal3dbox.cli.doctor import (
    OPENCV_CHECK,
    extra_state,
    folder_check,
    process_check,
    requirements_check,
)
from animal3dbox.cli.extras import Requirement, is_admitted, of_extra, parsed_requirement
from animal3dbox.cli.main import main

ROOT = Path(__file__).parent.parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def ran(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        main(["doctor", *arguments])
    assert isinstance(caught.value.code, int)
    return caught.value.code


def test_here_all_works_and_the_json_says_what_is_installed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = ran("--json", "--cache", str(tmp_path / "new" / "cache"))
    report = json.loads(capsys.readouterr().out)
    assert [check for check in report["checks"] if not check["works"]] == []
    assert code == 0
    assert len(report["checks"]) == 6
    assert report["versions"]["torch"] == metadata.version("torch")
    core = {re.split("[<>=]", line)[0] for line in PROJECT["dependencies"]}
    assert core <= set(report["versions"])
    of_name = {extra["name"]: extra for extra in report["extras"]}
    assert of_name["metrics"]["installed"]  # the set-up has it
    assert list(tmp_path.iterdir()) == []


def test_what_is_broken_ends_in_a_code_and_a_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "TORCH_CHECK", "raise OSError('libtorch_cpu.so is missing')")
    monkeypatch.setattr(doctor, "OPENCV_CHECK", "import os, signal; os.kill(os.getpid(), 11)")
    monkeypatch.setattr(doctor, "BODY_CHECK", "print('fine')")
    (tmp_path / "file").write_text("")
    assert ran("--cache", str(tmp_path / "file")) == 4
    printed = capsys.readouterr().out
    assert "NO  torch computes: OSError: libtorch_cpu.so is missing\n      remedy: " in printed
    assert "NO  OpenCV reads pictures: the process ended with -11\n" in printed
    assert re.search(r"NO  the label cache's folder.*\n      remedy: .*--cache", printed)
    assert "yes the embedded body loads: fine" in printed


def test_the_current_folder_cannot_replace_a_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cv2.py").write_text("raise SystemExit('the wrong one')")
    monkeypatch.chdir(tmp_path)
    assert process_check("OpenCV", OPENCV_CHECK, "").works


def test_a_process_that_gives_no_answer_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "SECONDS", 0.1)
    check = process_check("waits", "import time; time.sleep(60)", "none")
    assert (check.works, check.remedy) == (False, "none")


def test_a_folder_that_cannot_be_had_is_told(tmp_path: Path) -> None:
    def no_folder() -> str:
        raise FileNotFoundError("no usable temporary directory")

    assert not folder_check("temporary", no_folder, "TMPDIR").works
    assert not folder_check("below a file", lambda: "/proc/nowhere", "another").works
    new = folder_check("new", lambda: str(tmp_path / "a" / "b"), "another")
    assert new.works
    assert str(tmp_path) in new.detail


def test_versions_that_are_missing_or_not_admitted_are_named_with_a_remedy() -> None:
    good, absent = Requirement("torch", ">=2,<3"), Requirement("no-such-thing", ">=1")
    old = Requirement("numpy", ">=99,<100")
    assert requirements_check([good]).works
    check = requirements_check([good, absent, old])
    assert not check.works
    assert "no-such-thing>=1 (here: none)" in check.detail
    assert check.remedy == "python -m pip install 'no-such-thing>=1' 'numpy>=99,<100'"
    assert not requirements_check([]).works


def test_an_extra_is_missing_what_it_brings_by_way_of_others_too() -> None:
    known = (
        parsed_requirement('animal3dbox[metrics]; extra == "lightning"'),
        parsed_requirement('no-such-thing<3,>=2.6; extra == "lightning"'),
        parsed_requirement('torchmetrics<2,>=99; extra == "metrics"'),
    )
    assert [one.name for one in of_extra("lightning", known)] == ["torchmetrics", "no-such-thing"]
    state = extra_state("lightning", known)
    assert not state.installed
    assert state.missing == ["no-such-thing<3,>=2.6", "torchmetrics<2,>=99"]
    assert not extra_state("plots", known).installed  # metadata without it: an older version


@pytest.mark.parametrize(
    ("version", "versions", "admitted"),
    [
        ("2.13.0+cpu", ">=2.13,<3", True),
        ("2.6.0", ">=2.13,<3", False),
        ("3", ">=2.13,<3", False),
        ("3.0.0rc1", "<3", False),
        ("0.9.2", "==0.9.2", True),
        ("1.10", ">1.9,<=1.10", True),
        ("unknown", "", True),
    ],
)
def test_a_version_is_admitted_by_its_numbers(version: str, versions: str, admitted: bool) -> None:
    assert is_admitted(version, versions) is admitted


def test_the_extras_are_those_of_the_project_and_the_page_says_what_each_costs() -> None:
    assert set(extras.WITHOUT) == set(PROJECT["optional-dependencies"])
    page = (ROOT / "docs" / "install.md").read_text()
    rows = re.findall(r"^\| `([\w-]+)` \| [^|]+ \| ([^|]+) \|$", page, re.MULTILINE)
    assert dict(rows) == extras.WITHOUT

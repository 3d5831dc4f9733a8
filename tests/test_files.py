"""Files of a command's own in a folder that others use too."""

from pathlib import Path

import pytest

from animal3dbox.files import OwnFiles


def names_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_only_the_command_s_own_files_are_removed(tmp_path: Path) -> None:
    labels, others = OwnFiles(tmp_path, "label"), OwnFiles(tmp_path, "compare")
    for name in ("overlays/0001.png", "overlays/two words ä.png", "overlays/b.png"):
        labels.write(name, b"label")
    others.write("overlays/0000.png", b"compare")
    (tmp_path / "overlays" / "mine.png").write_bytes(b"mine")
    labels.keep_only(["overlays/b.png"])
    lists = {".label-pictures", ".compare-pictures"}
    kept = {"overlays/b.png", "overlays/0000.png", "overlays/mine.png"}
    assert names_in(tmp_path) == {*lists, *kept}
    others.keep_only([])
    labels.keep_only(iter([]))
    assert names_in(tmp_path) == {"overlays/mine.png"}


def test_files_of_a_killed_run_are_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = OwnFiles(tmp_path, "label")
    own.write("a.png", b"a")
    with (tmp_path / ".label-pictures").open("ab") as names:
        names.write(b"\nhalf a na")  # killed while it wrote a name
    own.write("b.png", b"b")
    own.keep_only([])
    assert names_in(tmp_path) == set()


@pytest.mark.parametrize("name", ["../outside.png", "/outside.png", "a/../../outside.png", "."])
def test_a_list_that_somebody_changed_leads_nowhere_else(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (tmp_path / "outside.png").write_bytes(b"x")
    words = name.replace("/outside", f"{tmp_path}/outside") if name.startswith("/") else name
    (folder / ".label-pictures").write_text(words)
    OwnFiles(folder, "label").keep_only([])
    assert (tmp_path / "outside.png").exists()


def test_a_file_whose_name_differs_by_case_alone_is_not_removed(tmp_path: Path) -> None:
    own = OwnFiles(tmp_path, "label")
    own.write("A.png", b"old")
    own.keep_only(["a.png"])  # on some file systems the same file
    assert names_in(tmp_path) >= {"A.png"}

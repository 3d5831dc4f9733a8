"""Files of a command's own in a folder that others use too."""

from pathlib import Path

import pytest

from animal3dbox.errors import ConfigError
from animal3dbox.files import ListedFiles

PATTERN = r"(overlays/)?[A-Za-z0-9._-]{1,200}\.png"


def label_files(folder: Path) -> ListedFiles:
    return ListedFiles(folder, "label", PATTERN)


def names_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_only_the_command_s_own_files_are_removed(tmp_path: Path) -> None:
    labels, others = label_files(tmp_path), ListedFiles(tmp_path, "compare", PATTERN)
    for name in ("overlays/0001.png", "overlays/b.png"):
        labels.write(name, b"label")
    others.write("overlays/0000.png", b"compare")
    (tmp_path / "overlays" / "mine.png").write_bytes(b"mine")
    labels.keep_only(["overlays/b.png"])
    lists = {".label-pictures", ".compare-pictures"}
    left = {"overlays/b.png", "overlays/0000.png", "overlays/mine.png"}
    assert names_in(tmp_path) == {*lists, *left}
    others.keep_only([])
    labels.keep_only(iter([]))
    assert names_in(tmp_path) == {"overlays/mine.png"}


def test_files_of_a_killed_run_are_known(tmp_path: Path) -> None:
    files = label_files(tmp_path)
    files.write("a.png", b"a")
    with (tmp_path / ".label-pictures").open("ab") as names:
        names.write(b"\nhalf a na")  # killed while it wrote a name
    files.write("b.png", b"b")
    files.keep_only([])
    assert names_in(tmp_path) == set()


@pytest.mark.parametrize(
    "name",
    [
        *("../outside.png", "/outside.png", "a/../../outside.png", "overlays/../../outside.png"),
        *("link/outside.png", "overlays/link/outside.png"),
        *("labels.json", "notes/mine.png", "overlays/mine.txt", "overlays/mine.png "),
    ],
)
def test_a_list_that_somebody_changed_removes_nothing_else(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "out"
    for one in ("labels.json", "notes/mine.png", "overlays/mine.txt", "overlays/mine.png "):
        (folder / one).parent.mkdir(parents=True, exist_ok=True)
        (folder / one).write_bytes(b"x")
    (tmp_path / "outside.png").write_bytes(b"x")
    for link in (folder / "link", folder / "overlays" / "link"):
        link.symlink_to(tmp_path, target_is_directory=True)
    before = names_in(tmp_path)
    words = name.replace("/outside", f"{tmp_path}/outside") if name.startswith("/") else name
    (folder / ".label-pictures").write_text(words)
    label_files(folder).keep_only([])
    assert names_in(tmp_path) == before


def test_a_link_in_the_place_of_a_picture_goes_and_its_file_stays(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    label_files(folder).write("overlays/a.png", b"a")
    (folder / "overlays" / "a.png").unlink()
    (tmp_path / "outside.png").write_bytes(b"x")
    (folder / "overlays" / "a.png").symlink_to(tmp_path / "outside.png")
    label_files(folder).keep_only([])
    assert names_in(tmp_path) == {"outside.png"}
    assert not (folder / "overlays" / "a.png").is_symlink()


def test_damaged_lines_are_passed_over(tmp_path: Path) -> None:
    files = label_files(tmp_path)
    files.write("a.png", b"a")
    with (tmp_path / ".label-pictures").open("ab") as names:
        names.write(b"\n" + b"x" * 5000 + b".png\n\xff\x00.png\n")
    files.check_list()
    files.keep_only([])
    assert names_in(tmp_path) == set()


@pytest.mark.parametrize("kind", ["folder", "link", "link to nothing"])
def test_a_list_that_is_no_file_is_refused_with_the_remedy(tmp_path: Path, kind: str) -> None:
    path, target = tmp_path / "out" / ".label-pictures", tmp_path / "secret.txt"
    path.parent.mkdir()
    if kind == "folder":
        path.mkdir()
    else:
        path.symlink_to(target)
    if kind == "link":
        target.write_text("a secret")
    with pytest.raises(ConfigError, match=r"out/\.label-pictures is .*: delete it"):
        label_files(path.parent).check_list()


def test_a_list_that_may_not_be_read_is_refused_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(path: Path, mode: str) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    label_files(tmp_path).write("a.png", b"a")
    monkeypatch.setattr(Path, "open", refused)
    with pytest.raises(ConfigError, match=r"pictures cannot be .*Permission denied .*: delete it"):
        label_files(tmp_path).check_list()


def test_a_name_that_the_next_run_would_not_know_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="is no name of the files of label"):
        label_files(tmp_path).write("overlays/two words.png", b"x")
    assert names_in(tmp_path) == set()


def test_a_file_whose_name_differs_by_case_alone_is_not_removed(tmp_path: Path) -> None:
    files = label_files(tmp_path)
    files.write("A.png", b"old")
    files.keep_only(["a.png"])  # on some file systems the same file
    assert names_in(tmp_path) >= {"A.png"}

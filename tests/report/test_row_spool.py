"""The rows of a run on disk: a kill at any time loses none that is not made again."""

from pathlib import Path

import pytest

from animal3dbox.errors import DatasetFormatError
from animal3dbox.report.row_spool import RowSpool
from animal3dbox.report.run_rows import RunRow


def row(key: int) -> RunRow:
    return RunRow(key=str(key))


def filled(folder: Path, count: int) -> RowSpool:
    """Rows in files of one row each."""
    spool = RowSpool(folder)
    for key in range(count):
        spool.add([row(key)])
        spool.flush()
    return spool


def keys(folder: Path) -> list[str]:
    return [one.key for one in RowSpool(folder)]


def test_a_file_is_written_over_no_other_whichever_are_missing(tmp_path: Path) -> None:
    filled(tmp_path, 3)
    (tmp_path / "000000000.rows").unlink()
    spool = RowSpool(tmp_path)
    spool.add([row(9)])
    spool.flush()
    assert keys(tmp_path) == ["1", "2", "9"]


def test_a_kill_while_rows_are_removed_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool = filled(tmp_path / ".rows", 3)

    def killed(folder: Path, ignore_errors: bool) -> None:
        if folder.is_dir():
            min(folder.iterdir()).unlink()
            raise KeyboardInterrupt

    monkeypatch.setattr("shutil.rmtree", killed)
    with pytest.raises(KeyboardInterrupt):
        spool.remove()
    monkeypatch.undo()
    assert keys(tmp_path / ".rows") == []
    filled(tmp_path / ".rows", 1).remove()
    assert [*tmp_path.iterdir()] == []


def test_a_kill_while_rows_are_cleared_leaves_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool, unlink = filled(tmp_path, 3), Path.unlink

    def killed(path: Path) -> None:
        unlink(path)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "unlink", killed)
    with pytest.raises(KeyboardInterrupt):
        spool.clear()
    assert keys(tmp_path) == ["0", "1"]


def test_a_folder_that_cannot_be_renamed_goes_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(path: Path, target: Path) -> Path:
        raise PermissionError(13, "its lock's file is open")

    monkeypatch.setattr(Path, "rename", refused)
    filled(tmp_path / ".rows", 2).remove()
    assert [*tmp_path.iterdir()] == []


def test_a_flipped_bit_is_no_other_row(tmp_path: Path) -> None:
    filled(tmp_path, 1)
    file = tmp_path / "000000000.rows"
    whole = file.read_bytes()
    for place in range(len(whole)):
        changed = bytearray(whole)
        changed[place] ^= 1 << place % 8
        file.write_bytes(changed)
        with pytest.raises(DatasetFormatError, match=r"0\.rows is damaged.*without --resume"):
            keys(tmp_path)

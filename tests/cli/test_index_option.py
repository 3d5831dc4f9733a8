"""Where commands keep the index of a COCO file, and what becomes of a missing picture."""

import json
from pathlib import Path

import pytest
from coco_dataset import coco_content, write_coco
from commands import ran


def status_of_rows(path: Path, table: Path, *options: str) -> dict[str, int]:
    """How many rows of a table that is written have which status."""
    _, printed = ran("label", path, "--table", table, "--body", "dog", "--json", *options)
    status: dict[str, int] = json.loads(printed.strip().splitlines()[-1])["status"]
    return status


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Three animals, of which two are in a picture that is missing."""
    path = write_coco(tmp_path, coco_content(tmp_path))
    (tmp_path / "images" / "sub" / "b.jpg").unlink()
    return path


def test_every_animal_of_a_missing_picture_is_a_faulty_row(path: Path, tmp_path: Path) -> None:
    late = status_of_rows(path, tmp_path / "late")
    early = status_of_rows(path, tmp_path / "early", "--check-paths")
    assert late == early
    assert (sum(late.values()), late["faulty"]) == (3, 2)


def test_shards_of_a_table_share_the_index_in_its_folder(path: Path, tmp_path: Path) -> None:
    for shard in ("1/2", "2/2"):
        status_of_rows(path, tmp_path / "table", "--shard", shard)
    assert len([*(tmp_path / "table" / "_indexes").glob("*.index")]) == 1


def test_an_index_is_where_the_user_wants_it(path: Path, tmp_path: Path) -> None:
    status_of_rows(path, tmp_path / "table", "--index", str(tmp_path / "mine"))
    assert len([*(tmp_path / "mine").glob("*.index")]) == 1
    assert not (tmp_path / "table" / "_indexes").exists()

"""Which format a path is in, and what is said of one that is in none or in another."""

import json
from pathlib import Path

import pytest

from animal3dbox.datasets import read_dataset
from animal3dbox.datasets.formats import FORMATS
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError


@pytest.mark.parametrize(
    ("files", "holds"),
    [((), "is an empty folder"), (("a.txt", "b.jpg"), r"holds a\.txt, b\.jpg")],
    ids=["empty", "of other files"],
)
def test_a_folder_that_is_no_dataset_lists_all_formats(
    files: tuple[str, ...], holds: str, tmp_path: Path
) -> None:
    for name in files:
        (tmp_path / name).touch()
    with pytest.raises(DatasetFormatError, match=holds) as raised:
        read_dataset(tmp_path)
    assert [name for name in FORMATS if f"{name} (" not in str(raised.value)] == []


@pytest.mark.parametrize(
    ("content", "format", "looks"),
    [
        ([{"img_path": "a.jpg"}], "coco", "stanfordextra"),
        ([], "animal3d", "stanfordextra"),
        ({"images": [], "annotations": [], "categories": []}, "stanfordextra", "coco"),
        ({"images": [], "annotations": [], "categories": []}, "animal3d", "coco"),
        ({"data": []}, "coco", "animal3d"),
    ],
)
def test_a_file_of_another_format_says_which_it_looks_like(
    content: object, format: str, looks: str, tmp_path: Path
) -> None:
    file = tmp_path / "set.json"
    file.write_text(json.dumps(content))
    with pytest.raises(DatasetFormatError, match=f"it looks like {looks}: .*--format {looks}"):
        read_dataset(file, format)


@pytest.mark.parametrize("format", ["auto", *FORMATS])
def test_a_path_without_anything_is_not_found_whatever_the_format(
    format: str, tmp_path: Path
) -> None:
    with pytest.raises(DatasetNotFoundError, match="there is no file or folder"):
        read_dataset(tmp_path / "nowhere.json", format)

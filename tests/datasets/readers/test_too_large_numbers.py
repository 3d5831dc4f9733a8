"""Numbers that no float holds, as 1e999, spoil the elements that have them and no other."""

import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from coco_dataset import coco_content, write_coco

from animal3dbox.datasets.readers.coco.reader import read_coco

MARK = "TOO LARGE"
REMEDY = "Number out of range.*no number of 64 bits is so large; correct it in the file"


def coco_with(root: Path, key: str, values: Sequence[object]) -> Path:
    """A COCO file of three animals; a key of the only one of a.jpg begins with a huge number."""
    content = coco_content(root)
    content["annotations"][1][key] = [MARK, *values]
    path = write_coco(root, content)
    path.write_text(path.read_text().replace(f'"{MARK}"', "1e999"))
    return path


@pytest.mark.parametrize("check_paths", [True, False], ids=["plain", "indexed"])
@pytest.mark.parametrize("key", ["keypoints", "bbox"])
def test_a_coco_annotation_with_one_is_a_fault(tmp_path: Path, key: str, check_paths: bool) -> None:
    path = coco_with(tmp_path, key, [60.0, 2])
    found = read_coco(path, check_paths=check_paths)
    assert len(found.records) == 2
    (fault,) = found.faults
    assert str(fault).startswith(f"a.jpg: {key}")
    assert "annotation 1" in fault.problem
    assert re.search(REMEDY, fault.problem)


@pytest.mark.parametrize("check_paths", [True, False], ids=["plain", "indexed"])
def test_one_that_nobody_reads_costs_nothing(tmp_path: Path, check_paths: bool) -> None:
    path = coco_with(tmp_path, "note", [1])
    found = read_coco(path, check_paths=check_paths)
    assert (len(found.records), list(found.faults)) == (3, [])

"""The rows of a written table, sorted, and the animals of an Animal3D folder."""

import json
from pathlib import Path

from animal3dbox.report.table.columns import KINDS, Value
from animal3dbox.report.table.parts import parts_of, read_part

Row = tuple[Value, ...]


def sorted_rows(folder: Path) -> list[Row]:
    """All rows of a table's parts, by image and animal."""
    rows = [
        row
        for part in parts_of(folder)
        for row in zip(*read_part(part, [*KINDS]).values(), strict=True)
    ]
    place, animal = [*KINDS].index("image_index"), [*KINDS].index("animal")
    return sorted(rows, key=lambda row: (row[place], row[animal]))


def entries_of(folder: Path) -> int:
    """How many animals the files of an Animal3D folder list."""
    files = (folder / "train.json", folder / "test.json")
    return sum(len(json.loads(file.read_text())["data"]) for file in files)

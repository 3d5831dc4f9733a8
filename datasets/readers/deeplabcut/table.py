"""DeepLabCut's tables: keypoints of animals by image, as csv.

What an h5 file holds is brought into the same form (deeplabcut_h5.py).
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from animal3dbox.errors import DatasetFormatError

COORDS = ("x", "y", "likelihood")
LEVELS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
"""The header's rows, of one animal an image and of several."""


@dataclass(frozen=True)
class DlcTable:
    """A table of keypoints.

    Attributes:
        path: its file.
        columns: individual ("" of single-animal tables), bodypart, coordinate of each column.
        index: the image of each row, or the number of a video's frame.
        rows: the cells of each row, numbers or their text.
    """

    path: Path
    columns: tuple[tuple[str, str, str], ...]
    index: tuple[str | int, ...]
    rows: Sequence[Sequence[str | float]]

    @property
    def individuals(self) -> tuple[str, ...]:
        """In the order of the columns."""
        return tuple(dict.fromkeys(individual for individual, _, _ in self.columns))

    def bodyparts(self, individual: str) -> tuple[str, ...]:
        """Of an individual, in the order of the columns."""
        return tuple(dict.fromkeys(part for one, part, _ in self.columns if one == individual))

    def places(self, individual: str) -> list[tuple[int, int, int | None]]:
        """The columns of x, y and likelihood (None without) of each of its bodyparts."""
        at = {column: i for i, column in enumerate(self.columns)}
        keys = [(individual, part) for part in self.bodyparts(individual)]
        return [(at[(*key, "x")], at[(*key, "y")], at.get((*key, "likelihood"))) for key in keys]


def table_of(
    path: Path,
    header: Sequence[Sequence[str]],
    index: Sequence[str | int],
    rows: Sequence[Sequence[str | float]],
) -> DlcTable:
    """A table, its header checked.

    Args:
        path: named in errors.
        header: for each column its scorer, perhaps its individual, its bodypart and its coordinate.
        index: of the rows.
        rows: the cells.

    Raises:
        DatasetFormatError: the header is not DeepLabCut's, or there is no row.

    """
    if not header or {len(column) for column in header} not in ({3}, {4}):
        raise DatasetFormatError(
            f"{path} must have columns of {', '.join(LEVELS[0])}, and individuals if there are"
            " several animals"
        )
    scorers = {column[0] for column in header}
    if len(scorers) > 1:
        raise DatasetFormatError(
            f"{path} has the keypoints of several scorers ({', '.join(sorted(scorers))}): keep one"
        )
    columns = tuple(
        (column[1] if len(column) == 4 else "", column[-2], column[-1]) for column in header
    )
    if len(set(columns)) < len(columns):
        twice = next(column for column in columns if columns.count(column) > 1)
        raise DatasetFormatError(f"{path} has the column {' '.join(twice).strip()} more than once")
    odd = next((column for column in columns if column[2] not in COORDS), None)
    if odd is not None:
        raise DatasetFormatError(
            f"{path} has the coordinate {odd[2]!r} of {odd[1]}: it must be one of"
            f" {', '.join(COORDS)}"
        )
    for individual, part, _ in columns:
        if any((individual, part, needed) not in columns for needed in ("x", "y")):
            raise DatasetFormatError(
                f"{path} has no x and y of {part}{f' of {individual}' if individual else ''}"
            )
    if not index:
        raise DatasetFormatError(f"{path} has no row of keypoints")
    return DlcTable(path, columns, tuple(index), rows)


def is_csv_table(path: Path) -> bool:
    """Whether a csv begins as DeepLabCut's do."""
    try:
        with path.open("rb") as file:
            return file.read(16).lstrip(b"\xef\xbb\xbf").startswith(b"scorer,")
    except OSError:
        return False


def read_csv_table(path: Path) -> DlcTable:
    """The table of a csv; raises DatasetFormatError if it is none."""
    try:
        lines = [
            line
            for line in csv.reader(path.read_text(encoding="utf-8-sig").splitlines())
            if any(line)
        ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DatasetFormatError(f"{path} cannot be read as csv: {error}") from error
    depth = next((i + 1 for i, line in enumerate(lines[:6]) if line[0] == "coords"), 0)
    names = tuple(line[0] for line in lines[:depth])
    if names not in LEVELS:
        said = ", ".join(line[0] for line in lines[:4]) or "nothing"
        raise DatasetFormatError(
            f"{path} must begin with rows of {', '.join(LEVELS[1])} (individuals only with several"
            f" animals), got {said}"
        )
    before = 1 + len(
        list(takewhile(lambda cell: cell not in COORDS, lines[depth - 1][1:]))
    )  # one column of paths, or three of their parts
    short = next((line for line in lines[:depth] if len(line) != len(lines[0])), None)
    if short is not None:
        raise DatasetFormatError(
            f"{path}: the header's rows have {len(lines[0])} and {len(short)} cells"
        )
    header = list(zip(*(line[before:] for line in lines[:depth]), strict=True))
    return table_of(
        path,
        header,
        [_image(line[:before]) for line in lines[depth:]],
        [line[before:] for line in lines[depth:]],
    )


def _image(cells: Sequence[str]) -> str | int:
    """The image's path of one cell or of its parts, or a frame's number."""
    return int(cells[0]) if len(cells) == 1 and cells[0].isdecimal() else "/".join(cells)

"""DeepLabCut's tables: their form, and the reading of csv.

A table of an h5 file is brought into the same form (h5.py).
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from animal3dbox.errors import DatasetFormatError

COORDS = ("x", "y", "likelihood")
"""Names of a bodypart's columns; tables labelled by hand have no likelihood."""
SEPARATORS = (",", ";", "\t")
"""What may stand between two cells; spreadsheets write ";" where numbers have a comma."""
LEVELS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
"""Names of the header's rows, of a table of one animal an image and of several."""


@dataclass(frozen=True)
class DlcTable:
    """A table of the bodyparts of animals, a row an image.

    Attributes:
        path: the table's file.
        columns: individual ("" in tables of one animal), bodypart and coordinate of each column.
        index: the image of each row, or the number of a video's frame.
        rows: the cells of each row, numbers or their text.
    """

    path: Path
    columns: tuple[tuple[str, str, str], ...]
    index: tuple[str | int, ...]
    rows: Sequence[Sequence[str | float]]

    @property
    def individuals(self) -> tuple[str, ...]:
        """Names of the individuals, in the order of the columns."""
        return tuple(dict.fromkeys(individual for individual, _, _ in self.columns))

    def bodyparts(self, individual: str) -> tuple[str, ...]:
        """Names of an individual's bodyparts, in the order of the columns."""
        return tuple(dict.fromkeys(part for one, part, _ in self.columns if one == individual))

    def places(self, individual: str) -> list[tuple[int, int, int | None]]:
        """Numbers of the columns of x, y and likelihood (None without) of each bodypart."""
        at = {column: i for i, column in enumerate(self.columns)}
        keys = [(individual, part) for part in self.bodyparts(individual)]
        return [(at[(*key, "x")], at[(*key, "y")], at.get((*key, "likelihood"))) for key in keys]


def table_of(
    path: Path,
    header: Sequence[Sequence[str]],
    index: Sequence[str | int],
    rows: Sequence[Sequence[str | float]],
) -> DlcTable:
    """The table of a header and rows, its header checked.

    Args:
        path: the table's file, named in errors.
        header: for each column its scorer, perhaps its individual, its bodypart and its coordinate.
        index: the image of each row, or the number of a video's frame.
        rows: the cells of each row, numbers or their text.

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
        if any((individual, part, coord) not in columns for coord in ("x", "y")):
            raise DatasetFormatError(
                f"{path} has no x and y of {part}{f' of {individual}' if individual else ''}"
            )
    if not index:
        raise DatasetFormatError(f"{path} has no row of keypoints")
    return DlcTable(path, columns, tuple(index), rows)


def is_csv_table(path: Path) -> bool:
    """Whether a csv file begins as DeepLabCut's do."""
    try:
        with path.open("rb") as file:
            beginning = file.read(16).lstrip(b"\xef\xbb\xbf").replace(b'"', b"")
            return beginning[:7].decode("latin1") in {f"scorer{mark}" for mark in SEPARATORS}
    except OSError:
        return False


def read_csv_table(path: Path) -> DlcTable:
    """The table of a csv file; raises DatasetFormatError if it is not DeepLabCut's."""
    try:
        text = path.read_text(encoding="utf-8-sig").splitlines()
        separator = next((one for one in SEPARATORS if one in "".join(text[:1])), ",")
        lines = [line for line in csv.reader(text, delimiter=separator) if any(line)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DatasetFormatError(f"{path} cannot be read as csv: {error}") from error
    depth = next((i + 1 for i, line in enumerate(lines[:6]) if line[0] == "coords"), 0)
    names = tuple(line[0] for line in lines[:depth])
    if names not in LEVELS:
        first_cells = ", ".join(line[0] for line in lines[:4]) or "nothing"
        raise DatasetFormatError(
            f"{path} must begin with rows of {', '.join(LEVELS[1])} (individuals only with several"
            f" animals), got {first_cells}"
        )
    # The index is one column of paths, or three of their parts.
    index_width = 1 + len(list(takewhile(lambda cell: cell not in COORDS, lines[depth - 1][1:])))
    short = next((line for line in lines[:depth] if len(line) != len(lines[0])), None)
    if short is not None:
        raise DatasetFormatError(
            f"{path}: the header's rows have {len(lines[0])} and {len(short)} cells"
        )
    header = list(zip(*(line[index_width:] for line in lines[:depth]), strict=True))
    return table_of(
        path,
        header,
        [_image(line[:index_width]) for line in lines[depth:]],
        [_numbers(line[index_width:], separator) for line in lines[depth:]],
    )


def _numbers(cells: list[str], separator: str) -> list[str]:
    """The cells of numbers, which have a point even where a comma stands for it."""
    return cells if separator == "," else [cell.replace(",", ".") for cell in cells]


def _image(cells: Sequence[str]) -> str | int:
    """The path of a row's image, of one cell or of its parts, or the number of its frame."""
    return int(cells[0]) if len(cells) == 1 and cells[0].isdecimal() else "/".join(cells)

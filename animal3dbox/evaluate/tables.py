"""Tables of results, of which the text, the JSON and the page are made."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Cell = str | int | float | None
PAPER = "PAPER"
"""Marks the rows that are the paper's published figures, which nothing here computes."""


@dataclass(frozen=True)
class Table:
    """A table of results as the text, the JSON and the page show it.

    Attributes:
        name: its key in the JSON.
        title: one line.
        notes: whole sentences below it: what was measured, in which unit.
        columns: names, the unit last.
        rows: a cell a column; None is unknown or does not apply.

    Example:
        >>> table = Table("t", "Errors", (), ("method", "px"), (("default", 1.5), ("pca", None)))
        >>> table.records()[1]
        {'method': 'pca', 'px': None}
        >>> table.has_words
        [True, False]
    """

    name: str
    title: str
    notes: tuple[str, ...]
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def records(self) -> list[dict[str, Any]]:
        """A dictionary a row, numbers rounded to ten digits; anything not finite is None."""
        return [
            {column: _plain(cell) for column, cell in zip(self.columns, row, strict=True)}
            for row in self.rows
        ]

    @property
    def has_words(self) -> list[bool]:
        """For each column, whether it holds words and not numbers."""
        return [
            all(isinstance(row[i], str | None) for row in self.rows)
            for i in range(len(self.columns))
        ]

    @staticmethod
    def is_published(row: Sequence[Cell]) -> bool:
        """Whether a row is the paper's own figures."""
        return any(isinstance(cell, str) and PAPER in cell for cell in row)

    def text(self) -> str:
        """The table as aligned text."""
        lines = [self.columns, *(tuple(shown(cell) for cell in row) for row in self.rows)]
        widths = [max(len(line[i]) for line in lines) for i in range(len(self.columns))]
        lines_of_text = [
            "  ".join(
                cell.ljust(width) if word else cell.rjust(width)
                for cell, width, word in zip(line, widths, self.has_words, strict=True)
            ).rstrip()
            for line in lines
        ]
        return "\n".join(
            [
                self.title,
                "=" * len(self.title),
                *lines_of_text,
                *(f"  {note}" for note in self.notes),
            ]
        )


def table_from_records(
    name: str,
    title: str,
    records: Sequence[Mapping[str, Cell]],
    *,
    notes: Sequence[str],
    columns: Sequence[str] | None = None,
) -> Table:
    """A table whose rows are dictionaries; a column that a row does not have is unknown.

    Args:
        name: the table's key.
        title: one line.
        records: the rows.
        notes: whole sentences below the table.
        columns: in their order; None: those of the first row.

    Example:
        >>> records = [{"method": "default", "px": 1.5}, {"method": "(PAPER)"}]
        >>> table_from_records("t", "Errors", records, notes=()).rows[1]
        ('(PAPER)', None)
    """
    columns = tuple(records[0] if columns is None else columns)
    rows = tuple(tuple(record.get(column) for column in columns) for record in records)
    return Table(name, title, tuple(notes), columns, rows)


def shown(cell: Cell) -> str:
    """A cell as text: about four digits of a number, a dash for the unknown."""
    if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
        return "-"
    if isinstance(cell, str | int):
        return str(cell)
    size = abs(cell)
    if size == 0:
        return "0"
    if size < 1e-4 or size >= 1e5:
        return f"{cell:.1e}"
    return f"{cell:.1f}" if size >= 100 else f"{cell:.2f}" if size >= 1 else f"{cell:.4f}"


def mean(values: Iterable[float | None]) -> float | None:
    """The mean of those that are known; None if there is none."""
    known = _known(values)
    return float(np.mean(known)) if known else None


def quantile(values: Iterable[float | None], q: float) -> float | None:
    """A quantile of those that are known; None if there is none."""
    known = _known(values)
    return float(np.quantile(known, q)) if known else None


def percent(flags: Sequence[bool]) -> float | None:
    """How many of a hundred are true; None without any."""
    return 100.0 * sum(flags) / len(flags) if flags else None


def wilson_bounds(count: int, total: int) -> tuple[float, float]:
    """The 95 % bounds of a rate of which count of total were seen, by Wilson's score interval."""
    if not total:
        return 0.0, 1.0
    z, rate = 1.96, count / total
    middle = rate + z * z / (2 * total)
    half = z * math.sqrt(rate * (1 - rate) / total + z * z / (4 * total * total))
    return (middle - half) / (1 + z * z / total), (middle + half) / (1 + z * z / total)


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _plain(cell: Cell) -> Cell:
    if not isinstance(cell, float):
        return cell
    return float(f"{cell:.10g}") if math.isfinite(cell) else None

"""The files of an evaluation: evaluation.json, evaluation.txt and evaluation.html."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from animal3dbox.evaluate.tables import Table
from animal3dbox.files import write_whole

SCHEMA, VERSION = "animal3dbox.evaluation", 1


@dataclass(frozen=True)
class Evaluation:
    """What was evaluated and what came out.

    Attributes:
        title: one line.
        about: what was asked for, plain values by name.
        tables: in the order of the report.
    """

    title: str
    about: dict[str, Any]
    tables: tuple[Table, ...]


def write_json(path: Path, evaluation: Evaluation) -> None:
    """Everything as JSON; the same bytes for the same evaluation."""
    tables = {
        table.name: {"title": table.title, "notes": table.notes, "rows": table.records()}
        for table in evaluation.tables
    }
    content = {
        "schema": SCHEMA,
        "version": VERSION,
        "title": evaluation.title,
        "about": evaluation.about,
        "tables": tables,
    }
    write_whole(path, msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n")


def as_text(evaluation: Evaluation) -> str:
    """The report in words and aligned columns."""
    return "\n\n".join([evaluation.title, *(table.text() for table in evaluation.tables)]) + "\n"


def write_text(path: Path, evaluation: Evaluation) -> None:
    """The report as text; the same bytes for the same evaluation."""
    write_whole(path, as_text(evaluation).encode())


def table_of(evaluation: Evaluation, name: str) -> Table | None:
    """One of its tables, or None."""
    found: Sequence[Table] = [table for table in evaluation.tables if table.name == name]
    return found[0] if found else None

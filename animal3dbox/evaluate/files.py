"""The files of an evaluation: evaluation.json, evaluation.txt and evaluation.html."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from animal3dbox.evaluate.tables import Table
from animal3dbox.files import write_whole

SCHEMA, VERSION = "animal3dbox.evaluation", 1


@dataclass(frozen=True)
class Evaluation:
    """The results of an evaluation, and what they are of.

    Attributes:
        title: one line.
        about: the settings, plain values by name.
        tables: in the order of the report.

    Example:
        >>> evaluation = Evaluation("animal3dbox on 3 animals", {"seed": 0}, tables=())
        >>> evaluation.about["seed"]
        0
    """

    title: str
    about: dict[str, Any]
    tables: tuple[Table, ...]


def write_json(path: Path, evaluation: Evaluation) -> None:
    """Write evaluation.json; the same bytes for the same evaluation.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_json(Path(folder) / "evaluation.json", Evaluation("Title", {}, ()))
        ...     "animal3dbox.evaluation" in (Path(folder) / "evaluation.json").read_text()
        True
    """
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
    """The report in words and aligned columns.

    Example:
        >>> table = Table("t", "Errors", ("In pixels.",), ("method", "px"), (("default", 1.5),))
        >>> print(as_text(Evaluation("Three animals", {}, (table,))))
        Three animals
        <BLANKLINE>
        Errors
        ======
        method     px
        default  1.50
          In pixels.
        <BLANKLINE>
    """
    return "\n\n".join([evaluation.title, *(table.text() for table in evaluation.tables)]) + "\n"


def write_text(path: Path, evaluation: Evaluation) -> None:
    """Write evaluation.txt; the same bytes for the same evaluation."""
    write_whole(path, as_text(evaluation).encode())


def table_of(evaluation: Evaluation, name: str) -> Table | None:
    """One of its tables, or None."""
    return next((table for table in evaluation.tables if table.name == name), None)

"""The page of an evaluation: questions, answers and plots, then the tables; nothing to load."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from animal3dbox.evaluate.answers import PLOT_DESCRIPTIONS, QUESTIONS, answers_of
from animal3dbox.evaluate.files import Evaluation
from animal3dbox.evaluate.tables import shown
from animal3dbox.files import write_whole
from animal3dbox.report.html_page import render

NO_PLOTS = (
    "There are no plots: they need matplotlib. pip install 'animal3dbox[plots]' and evaluate again."
)


def write_page(
    path: Path,
    evaluation: Evaluation,
    plots: Mapping[str, bytes] | None,
    pictures: Mapping[str, bytes] | None = None,
) -> None:
    """Write evaluation.html as a report: what was asked, what came out, plots, and the tables.

    Every value is escaped, and there is nothing to load.

    Args:
        path: the HTML file.
        evaluation: what came out.
        plots: a table's name -> its plot as PNG; None without matplotlib, and the page says how to
            get them.
        pictures: caption -> PNG, shown first.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_page(Path(folder) / "e.html", Evaluation("<b>", {}, ()), plots={})
        ...     "<h1>&lt;b&gt;</h1>" in (Path(folder) / "e.html").read_text()
        True
    """
    page = render(
        "animal3dbox.evaluate",
        "page.html",
        title=evaluation.title,
        about="; ".join(f"{name}: {_in_words(v)}" for name, v in evaluation.about.items()),
        remedy=NO_PLOTS if plots is None else None,
        pictures=_in_base64({} if plots is None else pictures or {}),
        plots=_in_base64(plots or {}),
        tables=evaluation.tables,
        questions=QUESTIONS,
        descriptions=PLOT_DESCRIPTIONS,
        answers={table.name: answers_of(table) for table in evaluation.tables},
        shown=shown,
    )
    write_whole(path, page.encode())


def _in_words(value: Any) -> str:
    """A setting as people write it: "yes", "none", "480, 640"."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value)) or "none"
    return str(value)


def _in_base64(pictures: Mapping[str, bytes]) -> dict[str, str]:
    return {name: base64.b64encode(png).decode() for name, png in pictures.items()}

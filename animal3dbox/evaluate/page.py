"""The page of an evaluation: plots above their tables, with nothing to load from elsewhere."""

import base64
import html
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from string import Template

from animal3dbox.evaluate.files import Evaluation
from animal3dbox.evaluate.tables import PAPER, Table, shown
from animal3dbox.files import write_whole

NO_PLOTS = (
    "There are no plots: they need matplotlib. pip install 'animal3dbox[plots]' and evaluate again."
)


def write_page(
    path: Path,
    evaluation: Evaluation,
    plots: Mapping[str, bytes] | None,
    pictures: Mapping[str, bytes] | None = None,
) -> None:
    """Write the page.

    Args:
        path: the HTML file.
        evaluation: what came out.
        plots: a table's name -> its plot as PNG; None without matplotlib, and the page says how to
            get them.
        pictures: caption -> PNG, shown first.

    """
    template = Template(
        resources.files("animal3dbox.evaluate").joinpath("page.html").read_text(encoding="utf-8")
    )
    drawn = "".join(
        f"<h2>{html.escape(caption)}</h2>{_image(picture, caption)}"
        for caption, picture in (pictures or {}).items()
    )
    page = template.substitute(
        title=html.escape(evaluation.title),
        about=html.escape(
            "; ".join(f"{name}: {value}" for name, value in evaluation.about.items())
        ),
        pictures=drawn if plots is not None else f'<p class="note">{html.escape(NO_PLOTS)}</p>',
        sections="\n".join(
            _section(table, (plots or {}).get(table.name)) for table in evaluation.tables
        ),
    )
    write_whole(path, page.encode())


def _section(table: Table, plot: bytes | None) -> str:
    words = [
        all(isinstance(row[i], str | None) for row in table.rows) for i in range(len(table.columns))
    ]
    kinds = ['class="word"' if word else "" for word in words]
    head = "".join(
        f"<th {kind}>{html.escape(column)}</th>"
        for column, kind in zip(table.columns, kinds, strict=True)
    )
    body = ""
    for row in table.rows:
        published = any(isinstance(cell, str) and PAPER in cell for cell in row)
        cells = "".join(
            f"<td {kind}>{html.escape(shown(cell))}</td>"
            for cell, kind in zip(row, kinds, strict=True)
        )
        body += f'<tr class="{"paper" if published else ""}">{cells}</tr>\n'
    notes = "".join(f'<p class="note">{html.escape(note)}</p>' for note in table.notes)
    image = "" if plot is None else _image(plot, table.title)
    return (
        f"<h2>{html.escape(table.title)}</h2>{image}<div"
        f' class="wide"><table><tr>{head}</tr>\n{body}</table></div>{notes}'
    )


def _image(png: bytes, words: str) -> str:
    return (
        f'<p><img src="data:image/png;base64,{base64.b64encode(png).decode()}"'
        f' alt="{html.escape(words)}" loading="lazy"></p>'
    )

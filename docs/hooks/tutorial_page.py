"""The tutorial: docs/tutorial.py is run cell by cell, and becomes a page and a notebook.

The script is in the percent format that Jupytext, VS Code and PyCharm open as a notebook: a line
`# %% [markdown]` begins a cell of text, `# %%` one of code. What a cell prints is shown below it;
so is the value of its last line, a picture as a picture.

Run: python docs/hooks/tutorial_page.py FOLDER  (writes tutorial.md, tutorial.ipynb and pictures)
"""

import ast
import base64
import contextlib
import io
import json
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from PIL import Image

SCRIPT = Path(__file__).parents[1] / "tutorial.py"
CELL = re.compile(r"^# %%( \[markdown\])?[ \t]*\n", re.MULTILINE)
NOTEBOOK_LINK = "\n[This page as a notebook](tutorial.ipynb), with its pictures.\n"


@dataclass(frozen=True)
class Cell:
    """A cell of text or code, and what came out of it.

    Attributes:
        source: Markdown, or Python.
        is_text: whether it is Markdown.
        printed: what the code printed, and its last value in words.
        jpeg: the picture that is its last value, encoded; None: there is none.
    """

    source: str
    is_text: bool
    printed: str = ""
    jpeg: bytes | None = None


def cells_of(script: str) -> list[Cell]:
    r"""The cells of a script in the percent format; what stands before the first is left out.

    Example:
        >>> cells = cells_of("# %% [markdown]\n# # Title\n# Words.\n# %%\n1 + 1\n")
        >>> [(cell.is_text, cell.source) for cell in cells]
        [(True, '# Title\nWords.'), (False, '1 + 1')]
    """
    _, *parts = CELL.split(script)
    cells = []
    for marker, body in zip(parts[::2], parts[1::2], strict=True):
        text = re.sub(r"^# ?", "", body, flags=re.MULTILINE) if marker else body
        cells.append(Cell(text.strip(), is_text=bool(marker)))
    return cells


def run_cells(cells: Sequence[Cell]) -> list[Cell]:
    """The cells with what they print and show, run one after the other in one namespace."""
    names: dict[str, Any] = {"__name__": "__tutorial__"}
    return [cell if cell.is_text else _run(cell, names) for cell in cells]


def _run(cell: Cell, names: dict[str, Any]) -> Cell:
    body = ast.parse(cell.source).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(ast.Module(body, []), str(SCRIPT), "exec"), names)  # noqa: S102
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), str(SCRIPT), "eval"), names)  # noqa: S307
    if isinstance(value, Image.Image):
        return replace(cell, printed=printed.getvalue(), jpeg=_jpeg(value))
    shown = "" if value is None else f"{value!r}\n"
    return replace(cell, printed=printed.getvalue() + shown)


def _jpeg(picture: Image.Image) -> bytes:
    encoded = io.BytesIO()
    picture.convert("RGB").save(encoded, format="JPEG", quality=85, optimize=True)
    return encoded.getvalue()


def picture_name(number: int) -> str:
    """The file of a cell's picture, beside the page."""
    return f"images/tutorial_{number:02d}.jpg"


def page_of(cells: Sequence[Cell]) -> str:
    """The tutorial as Markdown."""
    parts = []
    for number, cell in enumerate(cells):
        if cell.is_text:
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        if cell.printed:
            parts.append(f"```text\n{cell.printed.rstrip()}\n```")
        if cell.jpeg:
            parts.append(f"![What the code above draws]({picture_name(number)})")
    return "\n\n".join([*parts, NOTEBOOK_LINK])


def notebook_of(cells: Sequence[Cell]) -> str:
    """The tutorial as a notebook (nbformat 4.5), with its outputs."""
    notebook_cells = [_notebook_cell(number, cell) for number, cell in enumerate(cells)]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    about = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return json.dumps(
        {"cells": notebook_cells, "metadata": about, "nbformat": 4, "nbformat_minor": 5}
    )


def _notebook_cell(number: int, cell: Cell) -> dict[str, Any]:
    about = {"id": f"cell-{number}", "metadata": {}, "source": cell.source}
    if cell.is_text:
        return {"cell_type": "markdown", **about}
    outputs: list[dict[str, Any]] = []
    if cell.printed:
        outputs.append({"output_type": "stream", "name": "stdout", "text": cell.printed})
    if cell.jpeg:
        data = {"image/jpeg": base64.b64encode(cell.jpeg).decode()}
        outputs.append({"output_type": "display_data", "metadata": {}, "data": data})
    return {"cell_type": "code", "execution_count": None, "outputs": outputs, **about}


def tutorial_files(cells: Sequence[Cell]) -> dict[str, str | bytes]:
    """File -> content of the page, the notebook and the pictures of cells that were run."""
    pictures = {picture_name(number): cell.jpeg for number, cell in enumerate(cells) if cell.jpeg}
    return {"tutorial.md": page_of(cells), "tutorial.ipynb": notebook_of(cells), **pictures}


def main() -> None:
    """Run the tutorial and write it into a folder."""
    folder = Path(sys.argv[1])
    (folder / "images").mkdir(parents=True, exist_ok=True)
    for name, content in tutorial_files(run_cells(cells_of(SCRIPT.read_text()))).items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)


if __name__ == "__main__":
    main()

"""What the package prints and raises is of use to who has only the wheel, without the documents."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from animal3dbox.cli.jobs import CompareJob
from animal3dbox.datasets.readers.predictions.layouts import LAYOUTS

ROOT = Path(__file__).parent.parent
SOURCES = sorted(
    path.relative_to(ROOT)
    for folder in ("animal3dbox", "datasets", "transforms")
    for path in (ROOT / folder).rglob("*.py")
)
PAGE = re.compile(r"docs/|(?<![\w-])(?!README\.md)[\w-]+\.md\b")
"""A page of the checkout. README.md is also a file that the benchmark writes."""


def printed_strings(source: str, *, classes_are_help: bool) -> Iterator[str]:
    """The strings of a module but for its docstrings, of which help texts are made in `cli`.

    Args:
        source: the module's text.
        classes_are_help: whether strings that stand by themselves in classes are printed.

    """
    tree = ast.parse(source)
    shown = {
        id(statement)
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and classes_are_help
        for statement in node.body
    }
    docstrings = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and id(node) not in shown
    }
    for node in ast.walk(tree):
        if id(node) not in docstrings and isinstance(node, ast.Constant):
            yield node.value if isinstance(node.value, str) else ""


def test_no_message_and_no_help_text_points_to_a_page_of_the_checkout() -> None:
    pointing = [
        (path.as_posix(), text)
        for path in SOURCES
        for text in printed_strings(
            (ROOT / path).read_text(), classes_are_help=path.is_relative_to("animal3dbox/cli")
        )
        if PAGE.search(text)
    ]
    assert pointing == []
    templates = sorted((ROOT / "animal3dbox").rglob("*.html"))
    assert len(templates) >= 4
    assert not [path for path in templates if PAGE.search(path.read_text())]


@pytest.mark.parametrize(
    ("source", "is_help", "count"),
    [
        ('"""See docs/a.md."""', False, 0),
        ('def f():\n    """See docs/a.md."""\n    raise ValueError("see docs/a.md")', False, 1),
        ('print(f"{1}: see formats.md")', False, 1),
        ('class Job:\n    a: int\n    """JSON (docs/a.md)"""', False, 0),
        ('class Job:\n    a: int\n    """JSON (docs/a.md)"""', True, 1),
        ('NAME = "README.md"', False, 0),
    ],
)
def test_a_message_that_points_to_a_page_is_found(source: str, is_help: bool, count: int) -> None:
    strings = printed_strings(source, classes_are_help=is_help)
    assert sum(bool(PAGE.search(text)) for text in strings) == count


def test_the_help_of_compare_names_every_layout() -> None:
    source = (ROOT / "animal3dbox" / "cli" / "jobs.py").read_text()
    (job,) = [
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.ClassDef) and node.name == CompareJob.__name__
    ]
    helps = "".join(
        statement.value.value
        for statement in job.body
        if isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )
    assert f"({', '.join(LAYOUTS)})" in " ".join(helps.split())

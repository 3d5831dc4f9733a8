"""What the site is made of: its pages, the tutorial, and links to what has no file."""

import ast
import doctest
import importlib
import json
import re
import tomllib
from pathlib import Path

import pytest
from api_pages import api_pages, doors, homes_of, page_name
from command_pages import command_names, commands_page
from page_links import anchors_of, external_links, targets_of
from site_links import ROOT_PAGES, loaded_from_elsewhere
from tutorial_page import SCRIPT, Cell, cells_of, notebook_of, page_of, run_cells, tutorial_files

ROOT = Path(__file__).parent.parent
NAV = (ROOT / "mkdocs.yml").read_text().partition("\nnav:")[2]
IN_NAV = re.findall(r": (\S+\.md)$", NAV, re.MULTILINE)


@pytest.mark.parametrize(
    "module",
    ["api_pages", "command_pages", "page_links", "site_check", "site_links", "tutorial_page"],
)
def test_examples_of_the_site_s_makers_give_what_they_show(module: str) -> None:
    failed, tried = doctest.testmod(importlib.import_module(module))
    assert tried > 0
    assert failed == 0


def test_every_page_is_in_the_navigation_once() -> None:
    written = {path.name for path in (ROOT / "docs").glob("*.md")}
    made = {"cli.md", "tutorial.md", *ROOT_PAGES.values(), *map(page_name, doors())}
    assert sorted(IN_NAV) == sorted(written | made)


def test_the_page_of_the_installation_has_a_row_for_every_extra() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    page = (ROOT / "docs" / "install.md").read_text()
    rows = re.findall(r"^\| `([\w-]+)` \| ", page, re.MULTILINE)
    assert sorted(rows) == sorted(project["optional-dependencies"])


def test_the_api_has_an_entry_for_every_name_of_every_door_and_describes_none_twice() -> None:
    pages = api_pages()
    described = [home for text in pages.values() for home in re.findall(r"^::: (\S+)$", text, re.M)]
    assert len(described) == len(set(described)) >= 200
    for door, path in doors().items():
        homes = homes_of(door, path.read_text())
        assert set(homes) == exported_by(door)
        entries = re.findall(r"^(?:::: \S+\.|## )(\w+)$", pages[page_name(door)], re.MULTILINE)
        assert sorted(entries) == sorted(homes)
        for target in targets_of(pages[page_name(door)]):
            page, _, home = target.partition("#")
            assert f"::: {home}\n" in pages[f"api/{page}"]


def exported_by(door: str) -> set[str]:
    """The names in a door's `__all__` that it does not define itself."""
    return set(importlib.import_module(door).__all__) - {"__version__"}


def test_every_command_has_a_heading_and_its_help_on_the_page_of_commands() -> None:
    page = commands_page()
    assert {"-".join(name) for name in command_names()} <= anchors_of(page)
    assert ("bench", "make") in command_names()
    for name in command_names():
        assert f"\nusage: animal3dbox {' '.join(name)} [-h]" in page


@pytest.fixture(scope="module")
def ran() -> list[Cell]:
    """The tutorial's cells with what they print and show."""
    return run_cells(cells_of(SCRIPT.read_text()))


def test_the_tutorial_runs_and_says_what_its_text_says(ran: list[Cell]) -> None:
    printed = "".join(cell.printed for cell in ran)
    assert float(re.findall(r"overlap with the true box: (.*)", printed)[0]) > 0.8
    assert "before: left - after the mirror: right" in printed
    assert "too_few_keypoints: 3 visible keypoints" in printed
    assert "K is not the camera of this picture any more" in printed
    pictures = [cell.jpeg for cell in ran if cell.jpeg]
    assert len(pictures) == 3
    assert all(10_000 < len(picture) < 300_000 for picture in pictures)


def test_the_tutorial_becomes_a_page_and_a_notebook_with_all_cells(ran: list[Cell]) -> None:
    files = tutorial_files(ran)
    pictures = {name for name in files if name.endswith(".jpg")}
    assert set(re.findall(r"\]\((images/\S+)\)", page_of(ran))) == pictures
    notebook = json.loads(notebook_of(ran))
    kinds = {"markdown": True, "code": False}
    assert [kinds[cell["cell_type"]] for cell in notebook["cells"]] == [
        cell.is_text for cell in ran
    ]
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            ast.parse(cell["source"])


def test_what_a_page_would_load_from_elsewhere_is_found() -> None:
    assert loaded_from_elsewhere('<link rel="stylesheet" href="https://fonts.org/a.css">')
    assert loaded_from_elsewhere('<link href="//fonts.org/a.css" rel="stylesheet">')
    assert loaded_from_elsewhere("<img src=https://a.org/b.png>")
    assert not loaded_from_elsewhere('<link rel="stylesheet" href="assets/a.css"><a href="//b">')


def test_external_links_are_listed_by_page() -> None:
    listed = list(external_links())
    assert ("docs/front.md", "https://cocodataset.org/#format-data") in listed
    assert [link for link in listed if not link[1].startswith("https://")] == []

"""The documents say what is so."""

import ast
import importlib
import re
import runpy
import sys
import textwrap
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest
import torch
from commands import ran
from page_links import anchors_of, is_external, pages, targets_of
from small_animals import model_of

from animal3dbox.labels.config import LabelConfig

ROOT = Path(__file__).parent.parent
ROW = re.compile(r"^\| .* \| (section [^|]+?) \| `([^`]+)` \| `([^`]+)` \|$", re.MULTILINE)


@lru_cache(maxsize=1)
def docstrings() -> dict[tuple[str, str], str]:
    """(file, qualified name) -> docstring of every function and class of the package."""
    found = {}
    for home in ("animal3dbox", "datasets", "transforms"):
        for path in sorted((ROOT / home).rglob("*.py")):
            if path.is_relative_to(ROOT / "animal3dbox" / "datasets") or path.is_relative_to(
                ROOT / "animal3dbox" / "transforms"
            ):
                continue
            stack: list[tuple[str, ast.AST]] = [("", ast.parse(path.read_text()))]
            while stack:
                prefix, node = stack.pop()
                for child in ast.iter_child_nodes(node):
                    if isinstance(child, (ast.FunctionDef, ast.ClassDef)):
                        found[path.relative_to(ROOT).as_posix(), prefix + child.name] = " ".join(
                            (ast.get_docstring(child) or "").split()
                        )
                        stack.append((f"{prefix}{child.name}.", child))
    return found


ROWS = ROW.findall((ROOT / "docs" / "paper.md").read_text())


def test_the_table_of_the_paper_has_its_steps() -> None:
    assert len(ROWS) >= 20


@pytest.mark.parametrize(("citation", "file", "function"), ROWS, ids=[row[0] for row in ROWS])
def test_each_step_of_the_paper_is_cited_by_exactly_the_docstring_named(
    citation: str, file: str, function: str
) -> None:
    citing = [
        key for key, text in docstrings().items() if re.search(rf"\({re.escape(citation)}\)", text)
    ]
    assert citing == [(file, function)]


def test_every_citation_of_an_equation_is_in_the_table() -> None:
    cited = {
        match
        for text in docstrings().values()
        for match in re.findall(r"\((section [0-9.]+, [^)]+)\)", text)
    }
    assert cited == {row[0] for row in ROWS}


PAGES = sorted(
    p.relative_to(ROOT).as_posix() for p in [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]
)
DOTTED = re.compile(r"(?<!schema `)(?<![\"\w./-])animal3dbox(?:\.[A-Za-z_]\w*)+")
"""A name of the package, in code or in prose; in quotation marks it is a file's schema."""
NAMES_IN = re.compile(r"((?:`\w+`(?:,|,? and)?\s+)+)in `(animal3dbox[.\w]*)`")
"""Names that a page says lie in a module: `a`, `b` and `c` in `animal3dbox.d`."""
FILE = re.compile(r"`((?:\w+/)+\w+\.py)`")
IMPORTED = re.compile(
    r"from (animal3dbox[.\w]*) import (?:\(([^)]*)\)|((?:\w+(?: as \w+)?)(?:, *\w+(?: as \w+)?)*))"
)


def names_in(text: str) -> set[str]:
    """The dotted names of the package that a page tells its reader."""
    names = set(DOTTED.findall(text))
    for module, in_brackets, in_line in IMPORTED.findall(text):
        words = re.sub(r"#.*", "", in_brackets or in_line).split(",")
        names |= {f"{module}.{word.split()[0]}" for word in words if word.strip()}
    for words, module in NAMES_IN.findall(text):
        names |= {f"{module}.{word}" for word in re.findall(r"`(\w+)`", words)}
    return names


def is_importable(name: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    module, attributes = name, list[str]()
    while True:
        try:
            thing = importlib.import_module(module)
            break
        except ModuleNotFoundError:
            module, _, attribute = module.rpartition(".")
            attributes.insert(0, attribute)
    for attribute in attributes:
        if not hasattr(thing, attribute):
            return False
        thing = getattr(thing, attribute)
    return True


@pytest.mark.parametrize("page", PAGES)
def test_every_name_of_the_package_in_a_page_can_be_imported(page: str) -> None:
    names = names_in((ROOT / page).read_text())
    assert [name for name in sorted(names) if not is_importable(name)] == []


@pytest.mark.parametrize("page", PAGES)
def test_every_python_file_that_a_page_names_exists(page: str) -> None:
    files = FILE.findall((ROOT / page).read_text())
    homes = (ROOT, ROOT / "animal3dbox")
    assert [name for name in files if not any((home / name).is_file() for home in homes)] == []


def test_names_are_recognised_in_code_and_in_prose() -> None:
    text = """`from animal3dbox.a import b, c as d` and animal3dbox.e.F.g; "animal3dbox.truth".
    `h`, `i` and `j` in `animal3dbox.k`.
    from animal3dbox import (
        x,  # of y
        z,
    )
    """
    assert names_in(text) == {
        "animal3dbox.a",
        "animal3dbox.a.b",
        "animal3dbox.a.c",
        "animal3dbox.e.F.g",
        "animal3dbox.k",
        *(f"animal3dbox.k.{name}" for name in "hij"),
        "animal3dbox.x",
        "animal3dbox.z",
    }
    assert is_importable("animal3dbox.labels.config.LabelConfig.method")
    assert not is_importable("animal3dbox.datasets.exchange.read_omni3d")
    assert not is_importable("animal3dbox.no_such_room.name")


SOLVER = (ROOT / "docs" / "solver.md").read_text()
FORMULAS = re.findall(r"^\| [^|]+ \| `(animal3dbox/[^`]+)` \| `([^`]+)` \|$", SOLVER, re.MULTILINE)
"""File and function of each formula."""
STATED = re.findall(r"`([A-Za-z_]\w*) = ([^`]+)`", SOLVER)
"""Names and values of the constants, in the code's words."""


def constants_of(file: str) -> dict[str, object]:
    """The numbers that a file names: those in capitals that it does not import."""
    module = importlib.import_module(file.removesuffix(".py").replace("/", "."))
    own = {
        name.id
        for node in ast.parse((ROOT / file).read_text()).body
        if isinstance(node, ast.Assign)
        for name in ast.walk(node)
        if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
    }
    return {
        name: value
        for name in own
        if name.isupper() and isinstance(value := getattr(module, name), int | float | tuple)
    }


def test_each_formula_of_the_solvers_is_the_function_named() -> None:
    known = set(docstrings())
    assert len(FORMULAS) >= 40
    assert [row for row in FORMULAS if row not in known] == []


def test_each_constant_of_the_solvers_is_stated_once_and_as_the_code_has_it() -> None:
    rooms = ("animal3dbox/labels/pose/", "animal3dbox/labels/fit/")
    files = {file for file, _ in FORMULAS if file.startswith(rooms)}
    in_code = {name: value for file in files for name, value in constants_of(file).items()}
    stated = {name: ast.literal_eval(value) for name, value in STATED if name.isupper()}
    assert len(STATED) == len({name for name, _ in STATED})
    assert stated == in_code


def test_each_number_of_the_config_in_the_solvers_is_its_default() -> None:
    stated = {name: ast.literal_eval(value) for name, value in STATED if not name.isupper()}
    assert len(stated) >= 14
    assert stated == {name: getattr(LabelConfig(), name) for name in stated}


def test_the_classes_of_an_animals_way_are_in_the_files_named_and_in_the_pictures_order() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| `([^`]+)` \|", page, re.MULTILINE)
    assert [row for row in rows if row[::-1] not in docstrings()] == []
    assert re.findall(r"^ ([A-Z]\w+) --", page, re.MULTILINE) == [name for name, _ in rows]


def broken_links(page: Path, text: str) -> list[str]:
    """Links of a page to files and headings that do not exist."""
    broken = []
    for target in targets_of(text):
        if is_external(target):
            continue
        path, _, anchor = target.partition("#")
        linked = page.parent / path if path else page
        if not linked.exists() or (anchor and anchor not in anchors_in(linked, page, text)):
            broken.append(target)
    return broken


def anchors_in(linked: Path, page: Path, text: str) -> set[str]:
    """The anchors of a page that is linked to; of the page itself by the text that it has."""
    return anchors_of(text if linked == page else linked.read_text())


@pytest.mark.parametrize("page", [page.relative_to(ROOT).as_posix() for page in pages()])
def test_links_of_the_documents_lead_to_files_and_headings_that_exist(page: str) -> None:
    assert broken_links(ROOT / page, (ROOT / page).read_text()) == []


def test_broken_links_are_found() -> None:
    text = "[a](paper.md), [b](no.md), [c](solver.md#the-problem), [d](solver.md#no), ![](no.png)"
    page = ROOT / "docs" / "paper.md"
    assert broken_links(page, text) == ["no.md", "solver.md#no", "no.png"]
    assert broken_links(page, "# One\n[e](#one) [f](#two)") == ["#two"]


@pytest.mark.parametrize("page", PAGES)
def test_code_in_a_page_is_python_and_not_indented_by_less_than_the_site_needs(page: str) -> None:
    """Python-Markdown takes a block for a part of a list's entry from four spaces on."""
    text = (ROOT / page).read_text()
    assert re.findall(r"^ {1,3}```.*$", text, re.MULTILINE) == []
    for indent, code in re.findall(r"^( *)```python\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL):
        ast.parse(textwrap.dedent(code) if indent else code)


def test_no_picture_of_the_documents_is_larger_than_300_kilobytes() -> None:
    pictures = [*(ROOT / "docs" / "images").iterdir()]
    assert len(pictures) >= 19
    assert [path.name for path in pictures if path.stat().st_size > 300_000] == []


@pytest.mark.parametrize(
    ("page", "example"),
    [("README.md", "label_a_photograph"), ("docs/from-arrays.md", "label_one_animal")],
)
def test_the_page_shows_the_example_that_is_run(page: str, example: str) -> None:
    code = (ROOT / "examples" / f"{example}.py").read_text().split('"""\n\n', 1)[1]
    assert f"```python\n{code}```" in (ROOT / page).read_text()
    assert len([line for line in code.splitlines() if line.strip()]) <= 20


def test_the_overlap_of_the_example_s_box_is_as_the_page_has_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    names = runpy.run_path(str(ROOT / "examples" / "label_one_animal.py"))
    assert "side, seen from" in capsys.readouterr().out
    exec(code_with("docs/from-arrays.md", "box_iou("), names)  # noqa: S102
    assert 0.5 < float(names["iou"]) <= 1


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


def test_the_readme_s_numbers_are_those_that_benchmarks_recorded() -> None:
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        record_numbers = importlib.import_module("record_numbers")
    finally:
        sys.path.pop(0)
    numbers = record_numbers.read_numbers()
    assert len(numbers) == len(record_numbers.NUMBERS)
    assert record_numbers.table(numbers) in (ROOT / "README.md").read_text()


def test_numbers_are_recorded_from_the_lines_that_benchmarks_print() -> None:
    record_numbers = runpy.run_path(str(ROOT / "benchmarks" / "record_numbers.py"))
    line = "own: fitted body    K known    n  305 (0 without) |   2.5 /   7.9 %"
    before = {"distance, own bodies": {"value": "9", "command": "c"}, "other": {"value": "1"}}
    after = record_numbers["recorded"]([line, "own: true body   K known n 305"], before)
    assert after["distance, own bodies"]["value"] == "2.5 / 7.9 % (n 305)"
    assert after["other"] == before["other"]
    assert before["distance, own bodies"]["value"] == "9"


def test_the_readmes_test_command_is_what_ci_runs() -> None:
    assert "make test" in (ROOT / "README.md").read_text()
    assert "make test" in (ROOT / ".ci" / "run").read_text()


def code_with(page: str, words: str) -> str:
    """The block of Python in a page that holds some words."""
    (block,) = [
        block
        for block in re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)
        if words in block
    ]
    return str(block)


def test_the_readme_s_code_runs_from_top_to_bottom(
    animals: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert ran("label", animals, "--out", "labels", "--body", "preset")[0] == 0
    known: dict[str, Any] = {"PATH": animals, "augment": None, "epoch": 0, "index": 0}
    for words in ("AnnotatedDataset(", "csv.DictReader(", "RandomVirtualCamera("):
        if words == "RandomVirtualCamera(":
            known["image"], known["target"] = known["dataset"][0]
        exec(code_with("README.md", words), known)  # noqa: S102
    known["images"], known["targets"] = known["dataset"].collate_fn([known["dataset"][0]])
    known["predictions"] = [{**one, "scores": one["labels"] * 0 + 0.5} for one in known["targets"]]
    exec(code_with("README.md", "check_targets("), known)  # noqa: S102
    printed = capsys.readouterr().out
    assert "left out: " in printed
    assert "undecided" in printed or "left" in printed
    assert printed.strip().endswith("1.0")
    assert (tmp_path / "labels-cache").is_dir()


def test_faces_of_the_viewers_page_lie_round_the_animal() -> None:
    page: dict[str, Any] = {}
    exec(code_with("docs/viewers.md", "def face_shapes"), page)  # noqa: S102
    shapes = torch.tensor(page["shapes"])
    assert shapes.shape == (6, 4, 2)
    height, width = page["image"].shape[-2:]
    x0, y0, x1, y1 = page["target"]["boxes"][0].tolist()
    low, high = shapes.reshape(-1, 2).amin(0), shapes.reshape(-1, 2).amax(0)
    assert low[0] * width < x0 + 2 < x1 - 2 < high[0] * width
    assert low[1] * height < y0 + 2 < y1 - 2 < high[1] * height
    assert (
        page["face_shapes"](page["image"], {"corner_in_front": shapes[None, :, 0, 0] > 9}, 0) == []
    )


def test_the_training_loop_of_the_datasets_page_runs(
    animals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = {"root": animals, "model": model_of(animals), "cache": tmp_path / "cache"}
    exec(code_with("docs/datasets.md", "EpochSampler("), known)  # noqa: S102
    assert "left out: " in capsys.readouterr().out

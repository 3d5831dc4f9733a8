"""No document names a command or an option that does not exist."""

import ast
import re
import shlex
from collections.abc import Iterator

import pytest
from command_pages import command_names, help_of, options_of
from page_links import FENCE, ROOT, pages

INLINE = re.compile(r"`([^`\n]+(?:\n[^`\n]+)?)`")
COMMANDS = frozenset(command_names())
SCRIPT = re.compile(r"((?:benchmarks|examples|docs/hooks)/\w+\.py)(.*)", re.DOTALL)
OF_OTHERS = frozenset(
    {
        "--doctest-modules",  # pytest
        "--help",  # of everything
        "--import-mode=importlib",  # pytest
        "--pyargs",  # pytest
        "--save_mesh",  # AniMer
        "--strict",  # mypy and mkdocs
        "--check",  # ruff
    }
)
"""Options of other programs that documents name by themselves."""


def code_of(text: str) -> Iterator[str]:
    """Every line of the blocks of code of a page, and every inline code; joined where continued."""
    for block in FENCE.findall(text):
        if block.startswith(("```sh", "```text")):
            yield from block.replace("\\\n", " ").splitlines()[1:-1]
    prose = FENCE.sub("", text)
    yield from re.findall(r"^    (\S.*)$", prose, re.MULTILINE)
    yield from (" ".join(code.split()) for code in INLINE.findall(prose))


def problems_of(code: str) -> list[str]:
    """What a piece of code names that does not exist: a command, an option, a script."""
    code = re.sub(r"(^|\s)#.*", "", code)
    script = SCRIPT.search(code)
    if script is not None:
        path = ROOT / script[1]
        source = path.read_text() if path.is_file() else ""
        named = re.findall(r"--[a-z][\w-]*", script[2])
        return [f"{script[1]} {option}" for option in named if f'"{option}"' not in source]
    try:
        words = shlex.split(code)
    except ValueError:  # an apostrophe: no command
        return []
    if words and words[0].endswith("animal3dbox"):
        return problems_of_command(words[1:])
    if words and (words[0],) in COMMANDS and any(word.startswith("--") for word in words):
        return problems_of_command(words)
    if re.fullmatch(r"--[a-z][\w-]*(=\S+)?( \S+)*", code) and code not in OF_OTHERS:
        option = re.split("[= ]", code)[0]
        return [] if option in OF_OTHERS or option in every_option() else [option]
    return []


def problems_of_command(words: list[str]) -> list[str]:
    """What the words after `animal3dbox` name that does not exist."""
    if not words or words[0].isupper() or words[0].startswith("-"):
        return []
    names = [name for name in COMMANDS if name == tuple(words[: len(name)])]
    if not names:
        return [f"animal3dbox {words[0]}"]
    command = max(names, key=len)
    options = [word.split("=")[0] for word in words if word.startswith("--")]
    return [
        f"{' '.join(command)} {option}" for option in options if option not in options_of(command)
    ]


def every_option() -> frozenset[str]:
    """The options of all commands, and of the scripts that documents name."""
    scripts = [*(ROOT / "benchmarks").glob("*.py"), *(ROOT / "examples").glob("*.py")]
    of_scripts = re.findall(r'"(--[a-z][\w-]*)"', "".join(path.read_text() for path in scripts))
    return frozenset().union(*(options_of(name) for name in COMMANDS), of_scripts)


@pytest.mark.parametrize("page", [page.relative_to(ROOT).as_posix() for page in pages()])
def test_every_command_and_option_that_a_page_names_exists(page: str) -> None:
    text = (ROOT / page).read_text()
    assert [problem for code in code_of(text) for problem in problems_of(code)] == []


@pytest.mark.parametrize("command", command_names(), ids=" ".join)
def test_the_examples_of_a_help_text_name_what_exists(command: tuple[str, ...]) -> None:
    text = help_of(command)
    examples = re.findall(
        r"Example: (animal3dbox .*(?:\n +\S.*)*)", text.partition("\n options")[0]
    )
    assert examples != []
    assert [problem for example in examples for problem in problems_of(example)] == []


@pytest.mark.parametrize("folder", ["benchmarks", "examples"])
def test_what_a_script_says_of_how_to_run_it_exists(folder: str) -> None:
    problems = [
        f"{path.name}: {problem}"
        for path in sorted((ROOT / folder).glob("*.py"))
        for line in (ast.get_docstring(ast.parse(path.read_text())) or "").splitlines()
        for problem in problems_of(line.removeprefix("Run: "))
    ]
    assert problems == []


def test_what_does_not_exist_is_found() -> None:
    page = """`animal3dbox label PATH --cache C`, `bench make --edition small`, `--keep location`.

    python benchmarks/teach.py --no-such-thing

```sh
animal3dbox label PATH \\
    --outt DIR  # --not-this
animal3dbox labels
```
`bench make --editions`, `--no-such-option`, `label --cach=x`, `python benchmarks/none.py --n 3`
"""
    found = [problem for code in code_of(page) for problem in problems_of(code)]
    assert sorted(found) == [
        "--no-such-option",
        "animal3dbox labels",
        "bench make --editions",
        "benchmarks/none.py --n",
        "benchmarks/teach.py --no-such-thing",
        "label --cach",
        "label --outt",
    ]

"""The page of the commands, written from the program's own `--help`.

Run: python docs/hooks/command_pages.py  (prints the page)
"""

import contextlib
import io
import os
import re
import sys
from functools import cache
from unittest import mock

from animal3dbox.cli.jobs import COMMANDS
from animal3dbox.cli.main import main as run_command

WIDTH = 90
"""Columns of the help texts."""
INTRODUCTION = """# Commands

What `animal3dbox COMMAND --help` prints, made from the program when this site was built. Exit codes
are in [formats](formats.md#exchange).
"""


def command_names() -> list[tuple[str, ...]]:
    """Every command, ("label",) or ("bench", "make"), in the order of `--help`.

    Example:
        >>> command_names()[:2]
        [('demo',), ('label',)]
    """
    names = list[tuple[str, ...]]()
    for name in COMMANDS:
        names += [(name,), *((name, below) for below in _subcommands_in(help_of((name,))))]
    return names


def _subcommands_in(text: str) -> list[str]:
    """The names that a help text lists in its box of subcommands."""
    _, _, listed = text.partition("\n subcommands\n")
    return re.findall(r"^ +[•*] (\S+)", listed, re.MULTILINE)


@cache
def help_of(command: tuple[str, ...]) -> str:
    """What a command prints when it is asked for help, at a width of 90 columns."""
    out = io.StringIO()  # it has no encoding, so boxes are not drawn
    columns = mock.patch.dict(os.environ, {"COLUMNS": str(WIDTH)})
    with columns, contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
        run_command([*command, "--help"])
    plain = re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue())
    return re.sub(r" +$", "", plain, flags=re.MULTILINE)


def options_of(command: tuple[str, ...]) -> frozenset[str]:
    """The options of a command, with their dashes.

    Example:
        >>> {"--out", "--noise-px"} <= options_of(("demo",)), "--nois" in options_of(("demo",))
        (True, False)
    """
    first_words = re.findall(r"^  (-\S.*)", help_of(command), re.MULTILINE)
    return frozenset(
        option
        for words in first_words
        for option in re.findall(r"--[a-z][\w-]*", words.split("  ")[0])
    )


def commands_page() -> str:
    """The page: a heading and a help text for each command."""
    parts = [INTRODUCTION]
    for command in command_names():
        parts.append(f"## {' '.join(command)}\n\n```text\n{help_of(command).strip()}\n```\n")
    return "\n".join(parts)


if __name__ == "__main__":
    sys.stdout.write(commands_page())

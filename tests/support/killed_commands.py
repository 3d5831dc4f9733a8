"""Tables whose making is killed at random moments, and made whole by --resume."""

import contextlib
import io
import multiprocessing
import os
import random
import signal
import sys
import time
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Literal

from animal3dbox.cli.main import main
from animal3dbox.report.table.parts import parts_of

Victim = Literal["driver", "worker"]
PATIENCE_S = 120.0
"""A command that lasts longer hangs."""


def run_in_child(arguments: Sequence[str], errors: Path) -> BaseProcess:
    """Start a command in a fork of this process, which has loaded everything already."""
    child = multiprocessing.get_context("fork").Process(target=_run, args=(arguments, errors))
    child.start()
    return child


def _run(arguments: Sequence[str], errors: Path) -> None:
    with (
        errors.open("w") as file,
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(file),
    ):
        try:
            main(arguments)
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
    os._exit(code)  # not the test runner's own end


def kill_at_random(
    arguments: Sequence[str], table: Path, victim: Victim, rng: random.Random
) -> tuple[int | None, str]:
    """Start a command, kill it or one of its workers when it has written some parts, and wait.

    Args:
        arguments: of the command, which writes many parts with workers.
        table: its folder.
        victim: who is killed.
        rng: draws the number of parts, from 0 to 9 more than there are, and a delay.

    Returns:
        The driver's exit code, -9 if it was killed itself, and what it said.

    """
    errors = table.with_suffix(".errors")
    wanted = len(parts_of(table)) + rng.randrange(10)
    child = run_in_child(arguments, errors)
    begin = time.monotonic()
    while child.is_alive() and time.monotonic() - begin < PATIENCE_S:
        workers = children_of(child.pid)
        if workers and len(parts_of(table)) >= wanted:
            time.sleep(rng.random() * 0.02)
            killed = child.pid if victim == "driver" else rng.choice(workers)
            with contextlib.suppress(ProcessLookupError):  # it has just ended by itself
                os.kill(killed or 0, signal.SIGKILL)
            break
        time.sleep(0.001)
    child.join(PATIENCE_S)
    if child.is_alive():
        child.kill()
        raise TimeoutError(f"{victim} killed: the command hangs")
    return child.exitcode, errors.read_text()


def children_of(pid: int | None) -> list[int]:
    """The processes that a process has started, and that run."""
    try:
        return [*map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())]
    except OSError:
        return []


def can_kill() -> bool:
    """Whether this system tells a process's children."""
    return sys.platform == "linux" and Path(f"/proc/self/task/{os.getpid()}/children").exists()

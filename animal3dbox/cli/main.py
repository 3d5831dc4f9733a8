"""The command line: parse a job, run it, and turn what it raises into an exit code.

`animal3dbox demo`, `label` and the others are in jobs.py and runners.py. Nothing heavy is imported
until a command runs, so that `--help` answers at once.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Annotated, Any

import tyro

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import COMMANDS, Job
from animal3dbox.cli.runners import run_job
from animal3dbox.errors import Animal3DBoxError, ConfigError, WorkerError
from animal3dbox.files import user_path
from animal3dbox.progress import progress_bars


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and exit with its code."""
    job: Job = tyro.cli(
        _any_job(),
        prog="animal3dbox",
        description="3D boxes with named faces for animals.",
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes,),  # --images, not --dataset.images
    )
    sys.exit(exit_code(with_user_paths(job)))


def _any_job() -> Any:
    """The type of all jobs, for tyro: each a subcommand by its name.

    It has a help text of its own: else tyro would look for one in the source of typing.py, which
    takes a tenth of the time of `--help`.
    """
    jobs = (
        Annotated[Any, tyro.conf.subcommand(name=name, constructor=job)]
        for name, job in COMMANDS.items()
    )
    return Annotated[reduce(or_, jobs), tyro.conf.arg(help="what to do")]


def with_user_paths(options: Any) -> Any:
    """Options, and groups of them, whose paths mean what shells mean by "~".

    A shell itself leaves it as it is in `--cache=~/labels`.
    """
    changes: dict[str, Any] = {}
    for field in fields(options):
        value = getattr(options, field.name)
        if isinstance(value, Path):
            changes[field.name] = user_path(value)
        elif isinstance(value, str) and value.startswith("~/"):  # of a body or a vocabulary
            changes[field.name] = str(user_path(value))
        elif is_dataclass(value):
            changes[field.name] = with_user_paths(value)
    return replace(options, **changes)


def exit_code(job: Job) -> ExitCode:
    """Run a job; what it raises on purpose becomes a line on stderr and a code."""
    try:
        with progress_bars():
            code = run_job(job)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # What is left in the buffer would be complained of when Python ends.
        sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115
        return ExitCode.CLOSED_PIPE
    except KeyboardInterrupt:
        print("animal3dbox: interrupted", file=sys.stderr)
        return ExitCode.INTERRUPTED
    except ConfigError as error:
        return _complain(error, ExitCode.USAGE)
    except WorkerError as error:
        return _complain(error, ExitCode.OUTPUT)
    except Animal3DBoxError as error:
        return _complain(error, ExitCode.INPUT)
    except OSError as error:  # a full disk, a folder that may not be written
        return _complain(error, ExitCode.OUTPUT)


def _complain(error: Exception, code: ExitCode) -> ExitCode:
    print(f"animal3dbox: {error}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()

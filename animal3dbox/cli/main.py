"""The command line: parse a job, run it, and turn what it raises into an exit code.

`animal3dbox demo`, `label` and the others are in jobs.py and runners.py. Nothing heavy is imported
until a command runs, so that `--help` answers at once.
"""

import sys
from collections.abc import Sequence

import tyro

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import COMMANDS, Job
from animal3dbox.cli.runners import run_job
from animal3dbox.errors import Animal3DBoxError, ConfigError


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and exit with its code."""
    job: Job = tyro.extras.subcommand_cli_from_dict(
        COMMANDS,
        prog="animal3dbox",
        description="3D boxes with named faces for animals.",
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes,),  # --images, not --dataset.images
    )
    sys.exit(exit_code(job))


def exit_code(job: Job) -> ExitCode:
    """Run a job; what it raises on purpose becomes a line on stderr and a code."""
    try:
        return run_job(job)
    except ConfigError as error:
        return _complain(error, ExitCode.USAGE)
    except Animal3DBoxError as error:
        return _complain(error, ExitCode.INPUT)
    except OSError as error:  # a full disk, a folder that may not be written
        return _complain(error, ExitCode.OUTPUT)


def _complain(error: Exception, code: ExitCode) -> ExitCode:
    print(f"animal3dbox: {error}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()

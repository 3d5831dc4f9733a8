"""Every command on the command line has a function that does its job."""

import typing

import pytest

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import COMMANDS
from animal3dbox.cli.runners import RUNNERS, runner


def test_all_commands_have_a_runner_and_no_other_has() -> None:
    assert set(RUNNERS) == set(COMMANDS.values())


@pytest.mark.parametrize("job", RUNNERS, ids=lambda job: job.__name__)
def test_a_runner_takes_its_own_job_and_returns_an_exit_code(job: type) -> None:
    hints = typing.get_type_hints(runner(job))
    assert hints == {"job": job, "return": ExitCode}

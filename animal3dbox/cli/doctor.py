"""The command `doctor`: what is installed here, what works, and what each missing extra costs.

The checks that load compiled code run in processes of their own: a library that crashes is told,
and cannot take the command with it. Nothing is fetched.
"""

import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.extras import (
    PACKAGE,
    WITHOUT,
    Requirement,
    installed_version,
    of_extra,
    requirements,
)
from animal3dbox.cli.setup_jobs import DoctorJob
from animal3dbox.progress import watched

CHECKS = 6
"""How many checks `_checks` makes, for the progress bar."""
SECONDS = 120
"""After which a check's process is ended."""
TORCH_CHECK = """
import torch
matrix = torch.tensor([[2.0, 1.0], [1.0, 3.0]])
assert torch.allclose(matrix @ torch.linalg.inv(matrix), torch.eye(2), atol=1e-5), "wrong inverse"
device = torch.cuda.get_device_name() if torch.cuda.is_available() else "CPU only"
print(f"threads: {torch.get_num_threads()}; {device}")
"""
OPENCV_CHECK = """
import cv2, numpy
picture = numpy.arange(48, dtype=numpy.uint8).reshape(4, 4, 3)
done, png = cv2.imencode(".png", picture)
assert done and numpy.array_equal(cv2.imdecode(png, cv2.IMREAD_COLOR), picture), "a PNG changes"
turned, _ = cv2.Rodrigues(numpy.array([0.0, 0.0, numpy.pi / 2]))
assert abs(turned[1, 0] - 1) < 1e-9, "a rotation is wrong"
print(f"threads: {cv2.getNumThreads()}")
"""
BODY_CHECK = """
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped
print(f"{len(load_quadruped().v_template)} vertices")
"""


class Check(msgspec.Struct, kw_only=True):
    """Something that has to work.

    Attributes:
        name: what was tried.
        works: whether it does.
        detail: what was seen, or what is wrong.
        remedy: what mends it; None if it works.
    """

    name: str
    works: bool
    detail: str
    remedy: str | None = None


class ExtraState(msgspec.Struct, kw_only=True):
    """An optional extra.

    Attributes:
        name: of the extra.
        installed: all that it brings is here, in versions that are admitted.
        missing: what of it is not.
        without: what its absence costs.
    """

    name: str
    installed: bool
    missing: list[str]
    without: str


class DoctorReport(msgspec.Struct, kw_only=True):
    """What `doctor --json` prints."""

    versions: dict[str, str | None]
    threads: dict[str, int | str | None]
    extras: list[ExtraState]
    checks: list[Check]


def run_doctor(job: DoctorJob) -> ExitCode:
    """Print what is installed and whether it works; the exit code says if something is broken."""
    needed = requirements()
    report = DoctorReport(
        versions=_versions(needed),
        threads=_threads(),
        extras=[extra_state(name, needed) for name in WITHOUT],
        checks=list(watched(_checks(needed, job.cache), "trying", unit="check", total=CHECKS)),
    )
    if job.json:
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    else:
        print("\n".join(report_lines(report)))
    return ExitCode.OK if all(check.works for check in report.checks) else ExitCode.FAULTY


def _versions(needed: Sequence[Requirement]) -> dict[str, str | None]:
    """The versions of Python, the package and all that it always needs."""
    core = {one.name: one.installed for one in needed if one.extra is None}
    return {
        "python": platform.python_version(),
        "system": platform.platform(),
        PACKAGE: installed_version(PACKAGE),
        **core,
    }


def _threads() -> dict[str, int | str | None]:
    """How many processors there are for this process, and what limits the threads on them."""
    affinity = getattr(os, "sched_getaffinity", None)  # Linux alone has it
    return {
        "processors": os.cpu_count() if affinity is None else len(affinity(0)),
        "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS"),
    }


def extra_state(name: str, needed: tuple[Requirement, ...]) -> ExtraState:
    """Whether an extra is installed.

    Args:
        name: of the extra.
        needed: what the package and its extras need.

    """
    brings = list(of_extra(name, needed))
    missing = sorted({str(one) for one in brings if not one.fits})
    return ExtraState(
        name=name,
        installed=bool(brings) and not missing,
        missing=missing,
        without=WITHOUT[name],
    )


def _checks(needed: tuple[Requirement, ...], cache: Path) -> Iterator[Check]:
    yield requirements_check([one for one in needed if one.extra is None])
    reinstall = "python -m pip install --force-reinstall --no-deps"
    yield process_check("torch computes", TORCH_CHECK, f"{reinstall} torch")
    yield process_check(
        "OpenCV reads pictures",
        OPENCV_CHECK,
        f"python -m pip uninstall opencv-python opencv-contrib-python, then {reinstall}"
        " opencv-python-headless (another OpenCV in its place needs libGL, or is half overwritten)",
    )
    yield process_check("the embedded body loads", BODY_CHECK, f"{reinstall} {PACKAGE}")
    yield folder_check(
        "the temporary folder can be written to",
        tempfile.gettempdir,
        "make room there, or set TMPDIR to a folder of yours",
    )
    yield folder_check(
        "the label cache's folder can be written to",
        lambda: str(cache),
        "make room there, or give --cache (and a Dataset's cache=) a folder of yours",
    )


def requirements_check(core: Sequence[Requirement]) -> Check:
    """Whether what the package always needs is installed, in versions that it admits."""
    name = "all that is needed is installed"
    if not core:
        return Check(
            name=name,
            works=False,
            detail="the package itself is not installed, so it does not tell what it needs",
            remedy="python -m pip install . in its folder",
        )
    unfit = [one for one in core if not one.fits]
    if not unfit:
        return Check(name=name, works=True, detail=f"{len(core)} packages")
    return Check(
        name=name,
        works=False,
        detail=", ".join(f"{one} (here: {one.installed or 'none'})" for one in unfit),
        remedy="python -m pip install " + " ".join(f"'{one}'" for one in unfit),
    )


def process_check(name: str, code: str, remedy: str) -> Check:
    """Whether a program works in a process of its own.

    Args:
        name: of the check.
        code: a program that prints a detail, or fails.
        remedy: for when it fails.

    """
    command = [sys.executable, "-P", "-c", code]  # -P: files of the current folder are no modules
    try:
        ran = subprocess.run(  # noqa: S603 (the programs stand above)
            command, capture_output=True, text=True, check=False, timeout=SECONDS
        )
    except subprocess.TimeoutExpired:
        return Check(name=name, works=False, detail=f"no answer within {SECONDS} s", remedy=remedy)
    if ran.returncode == 0:
        return Check(name=name, works=True, detail=ran.stdout.strip())
    lines = ran.stderr.strip().splitlines() or [f"the process ended with {ran.returncode}"]
    return Check(name=name, works=False, detail=lines[-1], remedy=remedy)


def folder_check(name: str, folder: Callable[[], str], remedy: str) -> Check:
    """Whether a file can be written to a folder, or to the nearest above that exists.

    Nothing is left there.

    Args:
        name: of the check.
        folder: gives its path; an OSError says that there is none.
        remedy: for when it fails.

    """
    try:
        path = Path(folder()).absolute()
        nearest = next(one for one in (path, *path.parents) if one.exists())
        with tempfile.NamedTemporaryFile(dir=nearest, prefix=".animal3dbox-doctor") as file:
            file.write(bytes(1 << 16))
            file.flush()
    except OSError as error:
        return Check(name=name, works=False, detail=str(error), remedy=remedy)
    note = "" if nearest == path else f" (would be made in {nearest})"
    return Check(name=name, works=True, detail=f"{path}{note}")


def report_lines(report: DoctorReport) -> Iterator[str]:
    """A report as lines for a terminal."""
    width = max(map(len, report.versions))
    yield from (f"{name:{width}}  {v or 'not installed'}" for name, v in report.versions.items())
    threads = report.threads
    yield (
        f"{threads['processors']} processors; OMP_NUM_THREADS"
        f" {threads['OMP_NUM_THREADS'] or 'is not set'} (label runs one thread a worker)"
    )
    yield ""
    yield "Optional extras:"
    for extra in report.extras:
        if extra.installed:
            yield f"  {extra.name}: installed"
        else:
            yield f"  {extra.name}: not installed; without it {extra.without}"
    if not all(extra.installed for extra in report.extras):
        yield "  (pip install 'animal3dbox[NAME]' brings one)"
    yield ""
    yield "Does it work here:"
    for check in report.checks:
        yield f"  {'yes' if check.works else 'NO '} {check.name}: {check.detail}"
        if check.remedy is not None:
            yield f"      remedy: {check.remedy}"

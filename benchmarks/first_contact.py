"""How long a stranger waits: the commands' start-up, and what an installation downloads.

start: medians of the CPU seconds of processes that run in turn, and their ratios. `--help` must not
wait for torch, and `import animal3dbox` must cost no more than `import torch`.

download: the wheels that `pip install` of this checkout resolves to, fetched by `pip download`
one by one and weighed. torch and what it alone needs stand apart: its CPU and CUDA builds differ
by gigabytes. It asks the package index that pip is set to.

Run: python benchmarks/first_contact.py start --runs 9
Run: python benchmarks/first_contact.py download
"""

import argparse
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from animal3dbox.cli.extras import requirements

ROOT = Path(__file__).parent.parent
PROGRAMS: Mapping[str, tuple[str, ...]] = {
    "python -c pass": ("-c", "pass"),
    "animal3dbox --help": ("-m", "animal3dbox", "--help"),
    "import torch": ("-c", "import torch"),
    "import animal3dbox": ("-c", "import animal3dbox"),
    "import animal3dbox, and a name": ("-c", "from animal3dbox import label_animal"),
}
"""What is started, by Python."""
LIMITS = (
    ("animal3dbox --help", "python -c pass", 6.0),
    ("import animal3dbox", "import torch", 1.1),
)
"""One program, another, and how many times the other's time it may take."""
MOST_MB = 150.0
"""Of the core's wheels besides torch's."""


def cpu_seconds(arguments: Sequence[str]) -> float:
    """The CPU seconds, of user and system, of a Python process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, *arguments],
        check=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def start(runs: int) -> bool:
    """Print the medians and ratios; whether they keep the limits."""
    seconds: dict[str, list[float]] = {name: [] for name in PROGRAMS}
    for arguments in PROGRAMS.values():
        cpu_seconds(arguments)  # files are read from the disk once, and not counted
    for _ in range(runs):
        for name, arguments in PROGRAMS.items():
            seconds[name].append(cpu_seconds(arguments))
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    for name, median in medians.items():
        print(f"{name:32} {median:6.3f} s")
    are_kept = True
    for name, other, limit in LIMITS:
        ratio = medians[name] / medians[other]
        are_kept &= ratio <= limit
        print(f"{name} is {ratio:.2f} x {other} (at most {limit:g})")
    return are_kept


def resolved() -> dict[str, dict[str, Any]]:
    """Distribution -> its metadata, of all that an installation of this checkout brings."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        _pip(
            *("install", "--dry-run", "--ignore-installed", "--report", str(report)),
            *("-c", str(ROOT / "constraints.txt"), str(ROOT)),
        )
        installed = json.loads(report.read_text())["install"]
    return {_name(one["metadata"]["name"]): one["metadata"] for one in installed}


def download() -> bool:
    """Print the wheels' sizes; whether the core's besides torch's keep the limit."""
    metadata = resolved()
    versions = {
        name: str(one["version"]) for name, one in metadata.items() if name != "animal3dbox"
    }
    core = {_name(one.name) for one in requirements() if one.extra is None} - {"torch"}
    ours = _with_needs(core, metadata)
    sizes = {name: wheel_mb(name, versions[name]) for name in sorted(ours - {"torch"})}
    of_torch = sorted(set(versions) - set(sizes))
    for name, size in sorted(sizes.items(), key=lambda item: -item[1]):
        print(f"{name} {versions[name]}: {size:.1f} MB")
    total = sum(sizes.values())
    print(f"{len(sizes)} wheels besides torch's: {total:.1f} MB (at most {MOST_MB:g})")
    print(f"of torch alone, not weighed: {', '.join(of_torch)}")
    return total <= MOST_MB


def _with_needs(names: set[str], metadata: Mapping[str, Mapping[str, Any]]) -> set[str]:
    """Distributions and all that they need, but for torch and what it needs."""
    whole, rest = set[str](), [name for name in names if name in metadata]
    while rest:
        name = rest.pop()
        if name in whole or name == "torch" or name not in metadata:
            continue
        whole.add(name)
        rest += [
            _name(parts[0])
            for line in metadata[name].get("requires_dist", [])
            if "extra ==" not in line and (parts := re.match(r"[\w.-]+", line)) is not None
        ]
    return whole


def wheel_mb(name: str, version: str) -> float:
    """The megabytes of a distribution's wheel, which is fetched, weighed and removed."""
    with tempfile.TemporaryDirectory() as folder:
        _pip("download", "--no-deps", "--only-binary", ":all:", "-d", folder, f"{name}=={version}")
        return sum(path.stat().st_size for path in Path(folder).iterdir()) / 1e6


def _name(distribution: str) -> str:
    """A distribution's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", distribution).lower()


def _pip(*arguments: str) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    subprocess.run(command, check=True)


def main() -> None:
    """Measure what the command line names; exit code 1 if a limit is passed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("what", choices=("start", "download"))
    parser.add_argument("--runs", type=int, default=9)
    options = parser.parse_args()
    is_kept = start(options.runs) if options.what == "start" else download()
    sys.exit(0 if is_kept else 1)


if __name__ == "__main__":
    main()

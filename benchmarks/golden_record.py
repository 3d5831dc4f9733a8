"""Digests of every kind of value that the package gives, to show that a refactoring changes none.

Run: python benchmarks/golden_record.py compare OLD_REV [--new REV] [--keep FOLDER]

It takes the code of two commits (by default the new one is this checkout as it stands), lets the
old code write small synthetic datasets, reads them with both in one run on one machine, and tells
which labels, targets and files differ, are missing, or were added. It exits with 1 if an old value
differs or is missing. What has been renamed is found by golden_names.py.

Single steps: ``inputs FOLDER`` writes the datasets, ``record FOLDER OUT.json`` makes a record with
the code that PYTHONPATH leads to, ``diff OLD.json NEW.json`` compares two records.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent))

SHOWN = 60
"""So many names of a kind are printed at most."""
CHECKOUT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class RecordDifference:
    """How a new record differs from an old one.

    Attributes:
        changed: names whose value is another, with both summaries.
        missing: names that only the old record has.
        added: names that only the new record has.
        errors: parts that failed, with the last line of what was said; of either record.
        equal: how many names have the same value.
    """

    changed: dict[str, tuple[str, str]]
    missing: list[str]
    added: list[str]
    errors: dict[str, str]
    equal: int

    @property
    def holds(self) -> bool:
        """Whether every old value is there and the same; an empty record shows nothing."""
        return self.equal > 0 and not (self.changed or self.missing or self.errors)


def difference(old: dict[str, Any], new: dict[str, Any]) -> RecordDifference:
    """The difference of two records as they are read from their files."""
    before, after = old["values"], new["values"]
    both = [name for name in before if name in after]
    others = [name for name in both if before[name][0] != after[name][0]]
    changed = {name: (before[name][1], after[name][1]) for name in others}
    errors: dict[str, str] = {}
    for which, record in (("old", old), ("new", new)):
        for part, text in record["errors"].items():
            errors[f"{which}: {part}"] = text.strip().splitlines()[-1]
    missing = [name for name in before if name not in after]
    added = [name for name in after if name not in before]
    return RecordDifference(changed, missing, added, errors, len(both) - len(changed))


def print_difference(found: RecordDifference) -> None:
    """Say what differs, kind by kind."""
    changed = [f"{name}\n    old {a}\n    new {b}" for name, (a, b) in found.changed.items()]
    errors = [f"{part}\n    {text}" for part, text in found.errors.items()]
    kinds = {
        "fail": errors,
        "differ": changed,
        "are missing": found.missing,
        "were added": found.added,
    }
    for kind, lines in kinds.items():
        if lines:
            print(f"{len(lines)} {kind}:")
            print("\n".join(f"  {line}" for line in lines[:SHOWN]))
        if len(lines) > SHOWN:
            print(f"  and {len(lines) - SHOWN} more")
    counts = ", ".join(f"{len(lines)} {kind}" for kind, lines in kinds.items())
    print(f"{found.equal} values are the same; {counts}")


def write_record(inputs: Path, out: Path) -> int:
    """Record what the package on the path gives for the inputs; returns how many parts failed."""
    import cv2
    import torch
    from golden_commands import record_commands
    from golden_datasets import record_datasets, record_loading, record_options
    from golden_labels import record_labels, record_vocabularies
    from golden_targets import record_augmented, record_bare
    from golden_values import GoldenValues

    import animal3dbox

    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    parts: tuple[Callable[[GoldenValues, Path, Path], None], ...] = (
        record_vocabularies, record_labels, record_datasets, record_options, record_loading,
        record_augmented, record_bare, record_commands,
    )  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="golden-") as folder:
        values = GoldenValues({str(inputs): "INPUTS", folder: "SCRATCH"})
        for part in parts:
            begin = time.perf_counter()
            with values.section(part.__name__):
                part(values, inputs, Path(folder))
            print(f"{part.__name__}: {time.perf_counter() - begin:.1f} s", file=sys.stderr)
    values.written(out, Path(animal3dbox.__file__).parents[1])
    print(f"{len(values.digests)} values, {len(values.errors)} parts failed", file=sys.stderr)
    for name, text in values.errors.items():
        print(f"{name}:\n{text}", file=sys.stderr)
    return len(values.errors)


def checked_out(revision: str, folder: Path) -> Path:
    """A clone of this repository at a commit, in a new folder; the repository stays as it is."""
    commit = subprocess.run(
        ["git", "-C", str(CHECKOUT), "rev-parse", "--verify", f"{revision}^{{commit}}"],
        check=True, capture_output=True, text=True,
    ).stdout.strip()  # fmt: skip
    clone = ["git", "clone", "--quiet", "--shared", "--no-checkout", str(CHECKOUT), str(folder)]
    subprocess.run(clone, check=True)
    git = ["git", "-C", str(folder), "checkout", "--quiet", "--detach", commit]
    subprocess.run(git, check=True)
    return folder


def run_step(package: Path, *words: str | Path) -> int:
    """Run a step of this very file with the package of a checkout; returns its exit code."""
    paths = {"PYTHONPATH": str(package), "PYTHONSAFEPATH": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, str(Path(__file__).resolve()), *map(str, words)]
    return subprocess.run(command, env={**os.environ, **paths}, check=False).returncode


def recorded(package: Path, inputs: Path, out: Path) -> dict[str, Any]:
    """The record of a checkout's code; raises RuntimeError if there is none, or of other code."""
    code = run_step(package, "record", inputs, out)
    if not out.is_file():
        raise RuntimeError(f"no record could be made with {package}: exit code {code}")
    record: dict[str, Any] = json.loads(out.read_text())
    if Path(record["package"]).resolve() != package.resolve():
        raise RuntimeError(f"{record['package']} was recorded instead of {package}")
    return record


def compare(old: str, new: str | None, folder: Path) -> int:
    """Compare the code of two commits, this checkout being the new one unless told."""
    before = checked_out(old, folder / "old")
    after = CHECKOUT if new is None else checked_out(new, folder / "new")
    inputs = folder / "inputs"
    if run_step(before, "inputs", inputs):
        raise RuntimeError(f"the inputs could not be made with {old}")
    old_record = recorded(before, inputs, folder / "old-record.json")
    found = difference(old_record, recorded(after, inputs, folder / "new-record.json"))
    print_difference(found)
    return 0 if found.holds else 1


def main() -> int:
    """Run a step; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    steps = parser.add_subparsers(dest="step", required=True)
    places = {"inputs": ("folder",), "record": ("inputs", "out"), "diff": ("old", "new")}
    for step, names in places.items():
        words = steps.add_parser(step)
        for name in names:
            words.add_argument(name, type=Path)
    both = steps.add_parser("compare")
    both.add_argument("old", help="the old commit")
    both.add_argument("--new", help="the new commit; by default this checkout as it stands")
    both.add_argument("--keep", type=Path, help="a new folder for inputs and records, which stays")
    given = parser.parse_args()
    if given.step == "inputs":
        from golden_inputs import write_inputs

        write_inputs(given.folder.resolve())
        return 0
    if given.step == "record":
        return 1 if write_record(given.inputs.resolve(), given.out) else 0
    if given.step == "diff":
        found = difference(json.loads(given.old.read_text()), json.loads(given.new.read_text()))
        print_difference(found)
        return 0 if found.holds else 1
    if given.keep is not None:
        given.keep.mkdir(parents=True)
        return compare(given.old, given.new, given.keep.resolve())
    with tempfile.TemporaryDirectory(prefix="golden-") as folder:
        return compare(given.old, given.new, Path(folder).resolve())


if __name__ == "__main__":
    sys.exit(main())

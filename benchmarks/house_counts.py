"""Count how readable the code base is, as ../shared/house.md measured it.

Run: python benchmarks/house_counts.py [--against REV] [--json FILE] [--photographs FOLDER]
[--no-trace]

The checkout counted is the one this file lies in; `--against REV` counts a temporary worktree of
that revision too and prints both side by side, "before" and "after". How each thing is counted is
said where it is counted: text and syntax in house_text.py, imports in house_imports.py, the trace
of `dataset[0]` and the doors in house_trace.py, which runs in a process of its own with the
checkout on PYTHONPATH, so that both revisions are traced by this revision's script.

The trace needs photographs: `animal3dbox synth` with SYNTH_OPTIONS writes them, of the revision
before if there is one, so that both read the same files. The first photograph
has four animals, the second one; calls grow with them.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from house_imports import import_counts
from house_text import text_counts

ROOT = Path(__file__).resolve().parents[1]
SYNTH_OPTIONS = [
    *("--format", "stanfordextra", "--n", "3", "--seed", "0"),
    *("--width", "320", "--height", "240", "--noise-px", "2"),
]
BARE_SHAPES = (
    "Bare tuples, dicts and keyword arguments are seen by no trace and do not count. Before issue",
    "13 they were label_many's keyword arguments, label_dataset.Made and the target.",
)
"""What the trace cannot see, noted by hand."""
Counts = dict[str, Any]
"""Of one checkout: "counts" by name, "lists" of sentences by name."""


def run_in(checkout: Path, *arguments: str) -> str:
    """Run Python with a checkout's package on its path; its standard output."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(checkout),
        "PYTHONSAFEPATH": "1",
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, *arguments]
    process = subprocess.run(
        command, env=environment, cwd=checkout, stdout=subprocess.PIPE, text=True, check=False
    )
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} failed in {checkout}")
    return process.stdout


def write_photographs(checkout: Path, folder: Path) -> None:
    """Write the StanfordExtra folder that is traced, with a checkout's own command."""
    run_in(checkout, "-m", "animal3dbox", "synth", "--out", str(folder), *SYNTH_OPTIONS)


def count(checkout: Path, photographs: Path | None) -> Counts:
    """Everything that is counted of a checkout; without photographs, nothing is traced."""
    counts, lists = import_counts(checkout)
    counts = {**text_counts(checkout), **counts}
    if photographs is not None:
        script = str(Path(__file__).with_name("house_trace.py"))
        trace = json.loads(run_in(checkout, script, str(checkout), str(photographs)))
        counts |= trace["counts"]
        lists["shapes"] = [shape_line(s) for s in trace["shapes"] if not s["not a shape"]]
        lists["made, but not shapes"] = [shape_line(s) for s in trace["shapes"] if s["not a shape"]]
        return {"counts": counts, "lists": lists, "shapes": trace["shapes"]}
    return {"counts": counts, "lists": lists}


def shape_line(shape: Counts) -> str:
    """One shape as a line: its name, its fields, how it counts, and where it is made."""
    remarks = [f"{shape['fields']} fields", f"{shape['instances']} made"]
    if shape["counts"] == 2 and not shape["not a shape"]:
        changing = shape["None in one stage and set in another"]
        remarks.append(f"counts double{' for ' + ', '.join(changing) if changing else ''}")
    if shape["not a shape"]:
        remarks.append(shape["not a shape"])
    places = ", ".join(f"{place} x{count}" for place, count in shape["made in"].items())
    return f"{shape['module']}.{shape['name']}: {'; '.join(remarks)}; by {places}"


@contextmanager
def worktree(revision: str, folder: Path) -> Iterator[Path]:
    """A checkout of a revision, which is removed afterwards."""
    git = ["git", "-C", str(ROOT), "worktree"]
    subprocess.run([*git, "add", "--quiet", "--detach", str(folder), revision], check=True)
    try:
        yield folder
    finally:
        subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def print_table(columns: dict[str, Counts]) -> None:
    """Print the numbers of all columns side by side, then the lists, column by column."""
    names = dict.fromkeys(name for column in columns.values() for name in column["counts"])
    width = max(map(len, names))
    print(f"{'':{width}}" + "".join(f"{title:>10}" for title in columns))
    for name in names:
        cells = [column["counts"].get(name, "-") for column in columns.values()]
        print(f"{name:{width}}" + "".join(f"{cell:>10}" for cell in cells))
    for title, column in columns.items():
        for name, lines in column["lists"].items():
            print(f"\n{title}: {name} ({len(lines)})")
            for line in lines:
                print(f"  {line}")
    print("\n" + " ".join(BARE_SHAPES))


def columns_of(revision: str | None, photographs: Path | None, trace: bool) -> dict[str, Counts]:
    """What is counted of this checkout, and of a revision before it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        if revision is None:
            if trace and photographs is None:
                photographs = folder / "photographs"
                write_photographs(ROOT, photographs)
            return {"now": count(ROOT, photographs if trace else None)}
        with worktree(revision, folder / "before") as before:
            if trace and photographs is None:
                photographs = folder / "photographs"
                write_photographs(before, photographs)
            traceable = photographs if trace else None
            return {"before": count(before, traceable), "after": count(ROOT, traceable)}


def main() -> None:
    """Count, print, and write JSON if it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--against", metavar="REV", help="count this revision too, as before")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all that is counted here")
    parser.add_argument("--photographs", type=Path, metavar="FOLDER", help="trace these instead")
    parser.add_argument("--no-trace", action="store_true", help="count text and imports only")
    options = parser.parse_args()
    photographs = None if options.photographs is None else options.photographs.resolve()
    table = columns_of(options.against, photographs, not options.no_trace)
    print_table(table)
    if options.json is not None:
        options.json.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()

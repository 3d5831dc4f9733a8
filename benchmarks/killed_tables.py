"""Kill `animal3dbox label --table` at random moments, driver and workers, and resume it each time.

Run: python benchmarks/killed_tables.py [--kills K] [--images N] [--seed S]

After each kill every row that is there must be one of the table that was made in one go, none
twice; at the end the table must be that table to the last bit.
"""

import argparse
import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from killed_commands import Victim, kill_at_random, run_in_child
from small_animals import model_of, write_small_animals
from table_rows import sorted_rows


def killed(folder: Path, *, kills: int, images: int, seed: int) -> Counter[str]:
    """Kill a table's making so many times, with checks after each; gives how the commands ended.

    A table that is whole is begun anew.
    """
    rng = random.Random(seed)
    animals = write_small_animals(folder / "set", images)
    words = ["label", str(animals), "--model", str(model_of(animals)), "--stored-camera", "exact"]
    process = run_in_child([*words, "--table", str(folder / "whole")], folder / "whole.errors")
    process.join()
    whole = sorted_rows(folder / "whole")
    ends: Counter[str] = Counter()
    table = folder / "table-0"
    for kill in range(kills):
        victim: Victim = rng.choice(("driver", "worker"))
        more = ["--table", str(table), "--workers", "2", "--part-rows", "2", "--resume"]
        code, words_of_end = kill_at_random([*words, *more], table, victim, rng)
        ends[f"{victim} killed, exit code {code}"] += 1
        rows = sorted_rows(table)
        if len({*rows}) != len(rows) or not {*rows} <= {*whole}:
            raise SystemExit(f"kill {kill}: rows twice, or other rows: {words_of_end}")
        if rows == whole:
            ends["tables made whole"] += 1
            table = folder / f"table-{kill + 1}"
    last = run_in_child([*words, "--table", str(table), "--resume"], folder / "last.errors")
    last.join()
    if sorted_rows(table) != whole:
        raise SystemExit("the last table is not the one that was made in one go")
    ends["tables made whole"] += 1
    return ends


def main() -> None:
    """Kill, resume, compare, and print how the commands ended."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--images", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        ends = killed(Path(name), kills=options.kills, images=options.images, seed=options.seed)
    for end, count in sorted(ends.items()):
        print(f"{count:4} {end}")
    print(f"the same tables, nothing lost, nothing twice ({time.perf_counter() - begin:.0f} s)")


if __name__ == "__main__":
    main()

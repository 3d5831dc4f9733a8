"""How many flipped bits of a table's part are noticed, and what verifying a part costs.

Run: python benchmarks/flipped_bits.py [--rows N] [--flips F]

The rows of eight synthetic animals, repeated with other keys and numbers, are written as one part
in Parquet (where pyarrow is installed) and one in CSV. Each of F random bits of the part, and in
Parquet of its footer, is flipped alone; then the part is verified and four of its columns are read.
Processor time of the process.
"""

import argparse
import os
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from animal3dbox.datasets import SyntheticDataset
from animal3dbox.errors import DatasetFormatError
from animal3dbox.report import label_table, write_part
from animal3dbox.report.table import parts as table_parts
from animal3dbox.report.table.columns import KINDS
from animal3dbox.report.table.parts import Part, check_part, parts_of, read_part

COLUMNS = ["key", "status", "confidence", "center_2"]


def long_table(rows: int) -> dict[str, list[Any]]:
    """A table of so many rows, whose numbers are all different."""
    table = label_table(SyntheticDataset(8, seed=0, image_hw=(120, 160)), range(8))
    rng, count = np.random.default_rng(0), len(table["key"])
    long: dict[str, list[Any]] = {}
    for name, values in table.items():
        repeated = [values[row % count] for row in range(rows)]
        if KINDS[name] == "number" and values[0] is not None:
            noise = rng.normal(size=rows).tolist()
            repeated = [value + one for value, one in zip(repeated, noise, strict=True)]
        long[name] = repeated
    return {**long, "key": [f"{row:032x}" for row in range(rows)]}


def flip(part: Part, places: range, flips: int) -> Counter[str]:
    """What becomes of flips in some bytes of a part, verified whole and read in COLUMNS."""
    whole, rng, counts = part.path.read_bytes(), np.random.default_rng(1), Counter[str]()
    columns = read_part(part, COLUMNS)
    for place, bit in zip(rng.choice(places, flips), rng.integers(8, size=flips), strict=True):
        changed = bytearray(whole)
        changed[place] ^= 1 << int(bit)
        part.path.write_bytes(changed)
        try:
            check_part(part)
            counts["pass verification"] += 1
        except DatasetFormatError:
            counts["refused by verification"] += 1
        try:
            words = "read right" if read_part(part, COLUMNS) == columns else "READ WRONG"
        except DatasetFormatError:
            words = "refused in reading"
        counts[words] += 1
    part.path.write_bytes(whole)
    return counts


def measure(folder: Path, table: dict[str, list[Any]], flips: int) -> None:
    """Print what is noticed in a part, and the processor time of verifying it."""
    write_part(folder, table)
    (part,) = parts_of(folder)
    size = part.path.stat().st_size
    start = time.process_time()
    check_part(part)
    seconds = time.process_time() - start
    print(f"{part.format}: {size} bytes, verified in {seconds:.2f} s")
    if flips:
        print(f"  anywhere: {dict(flip(part, range(size), flips))}")
    if flips and part.format == "parquet":
        footer = int.from_bytes(part.path.read_bytes()[-8:-4], "little") + 8
        print(f"  in the footer ({footer} bytes): {dict(flip(part, range(size)[-footer:], flips))}")


def main() -> None:
    """Measure as the command line asks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=4096)
    parser.add_argument("--flips", type=int, default=200)
    arguments = parser.parse_args()
    table = long_table(arguments.rows)
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder, "first"), table, arguments.flips)
        if table_parts.part_format(Path(folder)) == "parquet":
            with patch.object(table_parts, "find_spec", return_value=None):
                measure(Path(folder, "csv"), table, arguments.flips)


if __name__ == "__main__":
    main()

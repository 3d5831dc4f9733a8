"""Print the study of poses on the foreign world for many animals, with paired comparisons.

    python benchmarks/foreign_world.py --n 200 --workers 2

Seeds from 1000 on; constants were tuned on seeds below 300 of other dials.
"""

import argparse
from multiprocessing import get_context

import torch

from animal3dbox.evaluate.foreign_study import (
    MISFITS_DEG,
    VIEWS,
    ForeignRow,
    foreign_rows,
    foreign_table,
    paired_loss,
)
from animal3dbox.evaluate.tables import shown


def rows_of(index: int) -> list[ForeignRow]:
    """One animal under every setting, on one thread."""
    torch.set_num_threads(1)
    return foreign_rows(index)


def main() -> None:
    """Study and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.n)
    with get_context("spawn").Pool(options.workers) as pool:
        rows = [row for rows in pool.imap(rows_of, numbers) for row in rows]
    table = foreign_table(rows)
    print(table.title)
    for record in (table.columns, *table.rows):
        print(f"{record[0]!s:42}" + " ".join(f"{shown(cell):>10.10}" for cell in record[1:]))
    print("\nloss of the mean against the reference, and its 95 % upper bound")
    pairs = [
        (f"joints off by {deg:g} deg, jittered mask", f"joints off by {deg:g} deg, no mask")
        for deg in MISFITS_DEG
    ]
    pairs += [
        (view + body, f"{view}{body}, no prior") for view in VIEWS for body in ("", ", preset")
    ]
    for setting, reference in pairs:
        for name, value in (
            ("rotation", lambda row: row.rotation_deg),
            ("clean px", lambda row: row.clean_px),
        ):
            loss = paired_loss(rows, setting, reference, value=value)
            if loss is not None:
                print(f"{setting:38} {name:9} {loss[0]:+.1%} {loss[1]:+.1%}")


if __name__ == "__main__":
    main()

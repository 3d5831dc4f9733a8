"""Print the study of poses on the foreign world for many animals, with paired comparisons.

    python benchmarks/foreign_world.py --n 200 --workers 2
    python benchmarks/foreign_world.py --n 1000 --groups exchanges

Seeds from 1000 on; constants were tuned on seeds below 300 of other dials.
"""

import argparse
from collections.abc import Sequence
from functools import partial
from multiprocessing import get_context

import torch

from animal3dbox.evaluate.foreign_study import (
    GROUPS,
    MISFITS_DEG,
    SELDOM,
    ForeignRow,
    foreign_rows,
    foreign_table,
    paired_loss,
)
from animal3dbox.evaluate.tables import shown, wilson_bounds


def rows_of(index: int, groups: Sequence[str]) -> list[ForeignRow]:
    """One animal under the settings of some groups, on one thread."""
    torch.set_num_threads(1)
    return foreign_rows(index, groups)


def print_rates(rows: list[ForeignRow]) -> None:
    """How often sides are mended, wrongly mended, and boxes more than 90 degrees off."""
    print("\nrates with 95 % bounds (Wilson): mended wrongly; over 90 deg; elevation")
    for setting in dict.fromkeys(row.setting for row in rows):
        group = [row for row in rows if row.setting == setting]
        made = setting.removeprefix("exchanged: ") if setting.startswith("exch") else "as given"
        flags = (
            [row.labeling not in (made, "as given") for row in group],
            [row.rotation_deg is not None and row.rotation_deg > 90 for row in group],
            [row.is_above for row in group if row.is_above is not None],
        )
        cells = []
        for flag in flags:
            low, high = wilson_bounds(sum(flag), len(flag))
            cells.append(f"{sum(flag)}/{len(flag)} ({low:.1%} to {high:.1%})")
        print(f"{setting:42}", "  ".join(cells))


def main() -> None:
    """Study and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--groups", nargs="*", choices=GROUPS, default=[])
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.n)
    rows_with = partial(rows_of, groups=options.groups)
    with get_context("spawn").Pool(options.workers) as pool:
        rows = [row for rows in pool.imap(rows_with, numbers) for row in rows]
    table = foreign_table(rows)
    print(table.title)
    for record in (table.columns, *table.rows):
        print(f"{record[0]!s:42}" + " ".join(f"{shown(cell):>10.10}" for cell in record[1:]))
    print_rates(rows)
    print("\nloss of the mean against the reference, and its 95 % upper bound")
    pairs = [
        (f"joints off by {deg:g} deg, jittered mask", f"joints off by {deg:g} deg, no mask")
        for deg in MISFITS_DEG
    ]
    pairs += [
        (view + body, f"{view}{body}, no prior") for view in SELDOM for body in ("", ", preset")
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

"""Rows of a table by Ray's actors: two against one, and against one process without Ray.

Run: python benchmarks/ray_tables.py [--images N] [--repeats R] [--rounds K]   (needs the extra ray)

The synthetic Animal3D world with its stored cameras taken as known; its images are asked for again
and again, which no cache shortens. The time is that of the clock from the first batch that comes
back to the last one: starting Ray and opening the dataset do not count. Medians of the rounds,
which take turns. It wants a machine with two cores and nothing else to do.
"""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import torch
from loader import write_dataset
from tyro.conf import OmitArgPrefixes
from tyro.extras import subcommand_cli_from_dict

from animal3dbox.cli.fill import dataset_of
from animal3dbox.cli.jobs import COMMANDS, LabelJob
from animal3dbox.cli.ray_tables import ray_tables
from animal3dbox.report import label_table
from animal3dbox.report.table.columns import Table

AT_ONCE = 32
"""Images that are labelled together: of so few that there are many batches to count."""


def job_of(root: Path, model: Path) -> LabelJob:
    """The job of a table of the dataset, its stored cameras known."""
    words = ["label", str(root), "--model", str(model), "--table", "none"]
    job = subcommand_cli_from_dict(
        COMMANDS, args=[*words, "--stored-camera", "exact"], config=(OmitArgPrefixes,)
    )
    assert isinstance(job, LabelJob)  # noqa: S101
    return job


def plain_tables(job: LabelJob, indices: list[int]) -> Iterable[Table]:
    """The rows made by this process."""
    dataset = dataset_of(job)
    for first in range(0, len(indices), AT_ONCE):
        yield label_table(dataset, indices[first : first + AT_ONCE])


def seconds_a_row(tables: Iterable[Table]) -> float:
    """The time of the clock a row, from the first batch to the last."""
    begin, rows = 0.0, 0
    for table in tables:
        if begin:
            rows += len(table["key"])
        else:
            begin = time.monotonic()
    return (time.monotonic() - begin) / rows


def main() -> None:
    """Print milliseconds a row by each engine, and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--images", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        root, model = write_dataset(Path(folder), options.images)
        job = job_of(root, model)
        indices = [*range(options.images)] * options.repeats
        engines = {"one process": 0, "one actor": 1, "two actors": 2}
        seconds: dict[str, list[float]] = {name: [] for name in engines}
        for _ in range(options.rounds):
            for name, actors in engines.items():
                ray_job = replace(job, cache=replace(job.cache, workers=actors, engine="ray"))
                tables = (
                    ray_tables(ray_job, indices, AT_ONCE) if actors else plain_tables(job, indices)
                )
                seconds[name].append(seconds_a_row(tables))
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    for name, value in medians.items():
        rounds = ", ".join(f"{1e3 * one:.2f}" for one in seconds[name])
        print(f"{name:12} {1e3 * value:6.2f} ms a row ({rounds})")
    two = medians["two actors"]
    print(f"two actors: {medians['one actor'] / two:.2f} times one actor,", end=" ")
    print(f"{medians['one process'] / two:.2f} times one process")


if __name__ == "__main__":
    main()

"""Rows of a table by Ray's actors: two against one, and against one process without Ray.

Run: python benchmarks/ray_tables.py [--images N] [--repeats R] [--rounds K]   (needs the extra ray)
     python benchmarks/ray_tables.py --repeats 8 --fit

The synthetic Animal3D world with its stored cameras taken as known, or with bodies fitted (--fit);
its images are asked for again and again, which no cache shortens, in batches as `label --table`
makes them. The time is that of the clock from the first rows that come back to the last: starting
Ray and opening the dataset do not count. Medians of the rounds, which take turns. Two workers of
the package's own (`--workers 2`) show what the machine's second core is worth without Ray. It
wants a machine with two cores and nothing else to do.
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
from animal3dbox.cli.table import TableBatches
from animal3dbox.cli.worker_batches import AT_ONCE, worker_batches
from animal3dbox.report.table.columns import Table

ENGINES = {"one process": 0, "two workers": 2, "Ray, one actor": 1, "Ray, two actors": 2}
"""Name -> its workers or actors; 0: the process itself."""


def job_of(root: Path, model: Path, *, is_fitted: bool) -> LabelJob:
    """The job of a table of the dataset: its stored cameras known, or its bodies fitted."""
    exact = ["--model", str(model), "--stored-camera", "exact"]
    words = ["label", str(root), "--table", "none", *(["--body", "fit"] if is_fitted else exact)]
    job = subcommand_cli_from_dict(COMMANDS, args=words, config=(OmitArgPrefixes,))
    assert isinstance(job, LabelJob)  # noqa: S101
    return job


def seconds_of(name: str, job: LabelJob, indices: list[int]) -> float:
    """The seconds a row that an engine takes."""
    workers = ENGINES[name]
    if name.startswith("Ray"):
        ray_job = replace(job, cache=replace(job.cache, workers=workers, engine="ray"))
        return seconds_a_row(ray_tables(ray_job, indices, AT_ONCE))
    batches = TableBatches(dataset_of(job), indices, AT_ONCE)
    with worker_batches(batches, workers, "") as tables:
        return seconds_a_row(tables)


def seconds_a_row(tables: Iterable[Table]) -> float:
    """The time of the clock a row, from the first rows to the last."""
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
    parser.add_argument("--repeats", type=int, default=160)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--fit", action="store_true", help="fit the bodies")
    options = parser.parse_args()
    torch.set_num_threads(1)
    seconds: dict[str, list[float]] = {name: [] for name in ENGINES}
    with tempfile.TemporaryDirectory() as folder:
        job = job_of(*write_dataset(Path(folder), options.images), is_fitted=options.fit)
        indices = [*range(options.images)] * options.repeats
        for _ in range(options.rounds):
            for name, values in seconds.items():
                values.append(seconds_of(name, job, indices))
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    for name, value in medians.items():
        rounds = ", ".join(f"{1e3 * one:.2f}" for one in seconds[name])
        ratio = medians["one process"] / value
        print(f"{name:16} {1e3 * value:7.2f} ms a row ({rounds}), {ratio:.2f} times one process")
    ratio = medians["Ray, one actor"] / medians["Ray, two actors"]
    print(f"Ray: two actors are {ratio:.2f} times one")


if __name__ == "__main__":
    main()

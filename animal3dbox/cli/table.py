"""The command `label --table`: a row for every animal of a dataset, in parts of a folder."""

import sys
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, closing
from pathlib import Path

import msgspec
import torch
from torch.utils.data import Dataset

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.fill import dataset_of, shard_of
from animal3dbox.cli.jobs import LabelJob
from animal3dbox.cli.ray_tables import ray_tables
from animal3dbox.cli.worker_batches import AT_ONCE, worker_batches
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.errors import ConfigError
from animal3dbox.plurals import counted
from animal3dbox.progress import watched
from animal3dbox.report.table.columns import Table
from animal3dbox.report.table.label_table import label_table
from animal3dbox.report.table.part_writer import PartWriter
from animal3dbox.report.table.parts import locked_shard
from animal3dbox.report.table.plan import table_plan
from animal3dbox.report.table.source_file import write_source

REMEDY = "the same command with --resume goes on from the rows that are there"


class TableBatches(Dataset[Table]):
    """The rows of some indices of a dataset's table, so many indices at a time."""

    def __init__(self, dataset: LabelDataset, indices: Sequence[int], at_once: int) -> None:
        self.dataset, self.indices, self.at_once = dataset, indices, at_once

    def __len__(self) -> int:
        return -(-len(self.indices) // self.at_once)

    def __getitem__(self, place: int) -> Table:
        first = place * self.at_once
        return label_table(self.dataset, self.indices[first : first + self.at_once])


def run_table(job: LabelJob) -> ExitCode:
    """Write the rows of a dataset's table, or of a shard of it, that are not there yet."""
    folder, shard = _checked_folder(job), shard_of(job.cache.shard)
    torch.set_num_threads(1)
    dataset = dataset_of(job)
    for note in dataset.notes:
        print(note, file=sys.stderr)
    with locked_shard(folder, shard):
        plan = table_plan(dataset, folder, shard=shard, resume=job.cache.resume)
        write_source(folder, dataset, job.path)
        writer = PartWriter(plan, job.cache.part_rows)
        at_once = min(AT_ONCE, job.cache.part_rows)
        with _tables(dataset, plan.indices, at_once, job) as tables, writer:
            unit, total = f"{at_once} images", -(-len(plan.indices) // at_once)
            for table in watched(tables, "labelling", unit=unit, total=total):
                writer.add(table)
    return _report(writer, job, folder)


def _tables(
    dataset: LabelDataset, indices: Sequence[int], at_once: int, job: LabelJob
) -> AbstractContextManager[Iterable[Table]]:
    """The rows of some indices, so many at a time, by the engine that the job names."""
    if job.cache.engine == "ray":
        return closing(ray_tables(job, indices, at_once))
    return worker_batches(TableBatches(dataset, indices, at_once), job.cache.workers, REMEDY)


def _checked_folder(job: LabelJob) -> Path:
    """The folder of the table; raises a ConfigError for options that are for other outputs."""
    if job.table is None:
        raise ConfigError("give --table for a table of labels")
    if job.cache.address is not None and job.cache.engine != "ray":
        raise ConfigError("--address is of a cluster of --engine ray: give it, or leave both out")
    if job.out is not None:
        raise ConfigError("give --out for labels and pictures, or --table for a table, not both")
    return job.table


def _report(writer: PartWriter, job: LabelJob, folder: Path) -> ExitCode:
    """Print what became of the animals; the exit code says if some were faulty."""
    counts = {status: writer.status[status] for status in sorted(writer.status)}
    if job.json:
        content = {"table": str(folder), "rows": sum(counts.values()), "status": counts}
        sys.stdout.write(msgspec.json.encode(content).decode() + "\n")
    else:
        words = ", ".join(f"{count} {status}" for status, count in counts.items())
        print(f"{counted(sum(counts.values()), 'row')} in {folder}: {words or 'none'}")
    return ExitCode.FAULTY if counts.get("faulty") else ExitCode.OK

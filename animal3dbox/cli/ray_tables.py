"""Ray Data as the engine of `label --table`: its actors make the rows, on one machine or on many.

Ray (extra `ray`, Apache-2.0) places the actors, feeds them, and starts anew those that die. What a
row is, which rows are there, and how they are written is the table's own (report/table): this
module only moves indices out and rows back.
"""

import logging
import os
from collections.abc import Generator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from animal3dbox.cli.fill import dataset_of
from animal3dbox.cli.jobs import LabelJob
from animal3dbox.errors import ConfigError, WorkerError
from animal3dbox.report.table.columns import Table
from animal3dbox.report.table.label_table import label_table
from animal3dbox.report.table.parts import arrow_table

if TYPE_CHECKING:
    import pyarrow

EXTRA = "pip install 'animal3dbox[ray]'"
MOST_BLOCKS = 2000
"""Into so many pieces the indices are divided at most: Ray's own cost grows with their number."""
BATCHES_OF_BLOCK, BLOCKS_OF_ACTOR = 8, 8
"""Batches of a piece, which share Ray's cost of a task, as long as each actor has so many pieces:
with fewer, one actor would be left to work on the last while others have ended."""
INDEX = "data"
"""The column that Ray gives the numbers of an array."""


class TableActor:
    """One process of the pool: it opens the dataset once, then makes the rows of batches.

    Args:
        job: what is labelled and how; paths and numbers alone, no dataset and no model travels.
        folder: the driver's working folder, which the job's relative paths start from.

    """

    def __init__(self, job: LabelJob, folder: str) -> None:
        os.chdir(folder)
        torch.set_num_threads(1)
        self.dataset = dataset_of(job)

    def __call__(self, batch: dict[str, Any]) -> "pyarrow.Table":
        """The rows of a batch's indices."""
        return arrow_table(label_table(self.dataset, batch[INDEX].tolist()))


def ray_tables(job: LabelJob, indices: Sequence[int], at_once: int) -> Generator[Table, None, None]:
    """The rows of indices, so many indices at a time, in the order in which they are finished.

    Args:
        job: with the number of actors (workers; 0: as many as the cluster has processors) and the
            cluster's address; without one a local cluster is started, and stopped at the end.
        indices: see label_table.
        at_once: indices that are labelled together.

    Raises:
        ConfigError: Ray is not installed, or there is no cluster at the address.
        WorkerError: an actor failed again and again, or cannot open the dataset.

    """
    if len(indices) == 0:
        return
    ray = _ray()
    actors = _started(ray, job)
    try:
        rows = ray.data.from_numpy(_blocks(np.asarray(indices), at_once, actors)).map_batches(
            TableActor,
            fn_constructor_args=(job, str(Path.cwd())),
            batch_size=at_once,
            compute=ray.data.ActorPoolStrategy(size=actors),
            num_cpus=1,
        )
        for batch in rows.iter_batches(batch_size=None, batch_format="pyarrow"):
            yield batch.to_pydict()
    except ray.exceptions.RayError as error:
        raise WorkerError(
            f"Ray could not make the rows ({_last_line(error)}): the same command with --resume"
            " goes on from the rows that are there"
        ) from error
    finally:
        if job.cache.address is None:
            ray.shutdown()


def _ray() -> Any:
    """Ray with its Data library, which has no types of its own that hold without it."""
    try:
        ray = import_module("ray")
        import_module("ray.data")
    except ImportError as error:
        raise ConfigError(f"--engine ray needs Ray Data ({error}): {EXTRA}") from error
    return ray


def _started(ray: Any, job: LabelJob) -> int:
    """Connect to the cluster, or start one here; how many actors are to run."""
    address, workers = job.cache.address, job.cache.workers
    local_cluster = (
        {"num_cpus": workers or None, "include_dashboard": False} if address is None else {}
    )
    try:
        ray.init(
            address=address,
            log_to_driver=False,
            ignore_reinit_error=True,
            logging_level=logging.WARNING,
            **local_cluster,
        )
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise ConfigError(
            f"there is no Ray cluster at {address} ({error}): give --address of one that runs, or"
            " leave it out for a local one"
        ) from error
    ray.data.DataContext.get_current().enable_progress_bars = False
    logging.getLogger("ray.data").setLevel(logging.WARNING)
    return workers or max(1, int(ray.cluster_resources().get("CPU", 1)))


def _blocks(indices: np.ndarray[Any, Any], at_once: int, actors: int) -> list[np.ndarray[Any, Any]]:
    """The indices in pieces of whole batches."""
    batches = -(-len(indices) // at_once)
    shared = min(BATCHES_OF_BLOCK, batches // (BLOCKS_OF_ACTOR * actors))
    each = at_once * max(shared, -(-batches // MOST_BLOCKS), 1)
    return [indices[start : start + each] for start in range(0, len(indices), each)]


def _last_line(error: Exception) -> str:
    """What an actor raised, without Ray's account of the way that it took."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__

"""Batches of a dataset that worker processes make, for the commands that label whole datasets."""

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

from torch.utils.data import DataLoader, Dataset

from animal3dbox.errors import ConfigError, DatasetFormatError, WorkerError

T = TypeVar("T")
AT_ONCE = 64
"""Images that are labelled together."""


@contextmanager
def worker_batches(batches: "Dataset[T]", workers: int, remedy: str) -> Iterator["DataLoader[T]"]:
    """Give the batches in order, made by so many worker processes, or by none here.

    What uses them stands in the ``with`` block: a worker's death interrupts it wherever it is.

    Args:
        batches: has a length and gives batches by index.
        workers: processes.
        remedy: of a worker that ends early, a clause.

    Raises:
        ConfigError: a negative number of workers.
        WorkerError: a worker ended early.
        DatasetFormatError: a worker found a damaged or changed file.

    """
    if workers < 0:
        raise ConfigError(f"--workers must not be negative, got {workers}")
    try:
        yield DataLoader(
            batches,
            batch_size=None,
            num_workers=workers,
            worker_init_fn=partial(_end_without_driver, os.getpid()),
        )
    except DatasetFormatError as error:
        if "DataLoader worker" not in str(error):
            raise
        *_, last = str(error).strip().splitlines()  # above it stands the worker's own traceback
        raise DatasetFormatError(last.partition(": ")[2]) from error
    except RuntimeError as error:
        if "DataLoader worker" not in str(error):
            raise
        raise WorkerError(
            f"a worker process ended before its work was done ({str(error).strip()}): it was"
            f" killed, perhaps because the machine ran out of memory; {remedy}"
        ) from error


def _end_without_driver(driver: int, worker: int) -> None:
    """Let a worker end soon after the process that started it.

    torch's own watch takes whoever is the parent when it begins for that process: a worker whose
    driver is killed while it starts would sleep for ever.
    """
    thread = threading.Thread(target=_watch, args=(driver,), name=f"watch {worker}", daemon=True)
    thread.start()


def _watch(driver: int) -> None:
    while os.getppid() == driver:
        time.sleep(0.5)
    os._exit(1)

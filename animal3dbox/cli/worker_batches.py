"""Batches of a dataset that worker processes make, for the commands that label whole datasets."""

from collections.abc import Iterator
from typing import Any, TypeVar

from torch.utils.data import DataLoader, Dataset

from animal3dbox.errors import ConfigError, WorkerError

T = TypeVar("T")
AT_ONCE = 64
"""Images that are labelled together."""


def worker_batches(batches: "Dataset[T]", workers: int, remedy: str) -> Iterator[T]:
    """The batches in order, made by so many worker processes, or by none here.

    Args:
        batches: has a length and gives batches by index.
        workers: processes.
        remedy: of a worker that ends early, a clause.

    Raises:
        ConfigError: a negative number of workers.
        WorkerError: a worker ended early.

    """
    if workers < 0:
        raise ConfigError(f"--workers must not be negative, got {workers}")
    loader: DataLoader[Any] = DataLoader(batches, batch_size=None, num_workers=workers)
    try:
        yield from loader
    except RuntimeError as error:
        if "DataLoader worker" not in str(error):
            raise
        raise WorkerError(
            f"a worker process ended before its work was done ({error}): it was killed, perhaps"
            f" because the machine ran out of memory; {remedy}"
        ) from error

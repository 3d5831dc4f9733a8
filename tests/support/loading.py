"""What tests of loading run in processes of their own: importable by spawned workers and ranks."""

import gc
import os
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
import torch.distributed as dist
from numpy.typing import NDArray
from small_animals import small_dataset
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, DistributedSampler

from animal3dbox.datasets import LabelDataset, collate
from animal3dbox.training.sampler import EpochSampler
from animal3dbox.transforms import ColorJitter, Compose, RandomHorizontalFlip, RandomResizedCrop

Sample = tuple[Tensor, dict[str, Any]]


def augmented(folder: Path, **options: Any) -> LabelDataset:
    """The small dataset under random transforms."""
    return small_dataset(
        folder,
        transform=Compose(
            [RandomHorizontalFlip(), RandomResizedCrop(64), ColorJitter(0.2)], seed=7
        ),
        **options,
    )


def in_bytes(value: Any) -> Any:
    """A sample or target with its tensors as bytes, to compare."""
    if isinstance(value, Tensor):
        return (str(value.dtype), tuple(value.shape), value.contiguous().numpy().tobytes())
    if isinstance(value, dict):
        return {name: in_bytes(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [in_bytes(part) for part in value]
    return value


def one_by_one(batches: Any) -> Iterator[Sample]:
    """The samples of a loader's batches."""
    for images, targets in batches:
        yield from zip(images, targets, strict=True)


def loaded(
    dataset: Dataset[Any], workers: int, context: str | None = None, **options: Any
) -> list[Any]:
    """Everything of a loader, as bytes."""
    loader = DataLoader(
        dataset,
        batch_size=3,
        collate_fn=collate,
        num_workers=workers,
        multiprocessing_context=context if workers else None,
        **options,
    )
    return [in_bytes(sample) for sample in one_by_one(loader)]


def busy_parent(folder: str) -> None:
    """Fork workers after torch and OpenCV have used threads in the parent.

    Prints what was loaded.
    """
    torch.set_num_threads(2)
    cv2.setNumThreads(2)
    for _ in range(3):
        big = torch.rand(1500, 1500)
        (big @ big).sin().sum()
        cv2.GaussianBlur(big.numpy(), (31, 31), 5)
    loader = DataLoader(
        augmented(Path(folder)),
        batch_size=2,
        collate_fn=collate,
        num_workers=2,
        multiprocessing_context="fork",
    )
    images = [str(target["image_id"]) for _, target in one_by_one(loader)]
    print("loaded", len(images), "threads", torch.get_num_threads(), cv2.getNumThreads())


def rank(number: int, world_size: int, folder: str, out: str) -> None:
    """One rank of a training on the small dataset, with a cache that all share.

    Writes what it got.
    """
    dist.init_process_group(
        "gloo", init_method=f"file://{out}/meeting", rank=number, world_size=world_size
    )
    torch.set_num_threads(1)
    found: dict[str, list[Any]] = {"distributed": [], "epochs": []}
    dataset = augmented(Path(folder), cache=Path(out) / "cache")
    shared: DistributedSampler[Any] = DistributedSampler(dataset, shuffle=True, seed=1)
    own = EpochSampler(dataset, seed=1, rank=number, world_size=world_size)
    for epoch in range(2):
        dataset.set_epoch(epoch)
        shared.set_epoch(epoch)
        own.set_epoch(epoch)
        for name, sampler in (("distributed", shared), ("epochs", own)):
            loader = DataLoader(
                dataset,
                batch_size=2,
                sampler=sampler,
                collate_fn=collate,
                num_workers=1,
                multiprocessing_context="fork",
            )
            found[name] += [in_bytes((image, target)) for image, target in one_by_one(loader)]
    everyone: list[Any] = [None] * world_size
    dist.all_gather_object(everyone, [target["image_id"] for _, target in found["epochs"]])
    (Path(out) / f"rank{number}.pickle").write_bytes(pickle.dumps((found, everyone)))
    dist.barrier()
    dist.destroy_process_group()


def private_bytes() -> int:
    """Memory that this process alone has, written or copied."""
    text = Path("/proc/self/smaps_rollup").read_text()
    return sum(
        int(line.split()[1]) * 1024
        for line in text.splitlines()
        if line.startswith(("Private_Dirty", "Private_Clean"))
    )


class Records(Dataset[tuple[int, int, int]]):
    """Only the annotations of a Dataset.

    Process, records read so far and memory that is the process's own.
    """

    def __init__(self, dataset: LabelDataset) -> None:
        self.dataset = dataset
        self.read = 0

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, index: int) -> tuple[int, int, int]:
        sample = self.dataset.source.sample(index)
        for record in sample.records:
            assert sample.bodies is not None
            sample.bodies.content(record.sample_id)
        self.read += len(sample.records)
        return os.getpid(), self.read, private_bytes() if index % 500 < 2 else 0


if __name__ == "__main__":
    busy_parent(sys.argv[1])


def memory_told(dataset: LabelDataset, context: str) -> NDArray[np.int64]:
    """What the workers of a loader tell of their memory: rows of process, number, bytes."""
    loader = DataLoader(
        Records(dataset), batch_size=None, num_workers=2, multiprocessing_context=context
    )
    Records(dataset)[0]  # what is imported when it is first used is no growth
    gc.collect()
    gc.freeze()  # what this process has is not looked through, and so not copied, by workers
    return np.array([row for row in loader if row[2]])

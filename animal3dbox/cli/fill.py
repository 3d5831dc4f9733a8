"""``animal3dbox label --cache``.

Fill a Dataset's label cache offline, on one machine or in shards on many.
"""

import re
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import msgspec
import torch
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import LabelJob
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.label_store import NOT_STORED
from animal3dbox.datasets.labelling.load_report import Case
from animal3dbox.errors import ConfigError

AT_ONCE = 64
"""So many images are labelled together."""


class Warmed(Dataset[tuple[Case, ...]]):
    """The samples of a shard, some at a time.

    Asking for them stores their labels and gives what was left out.
    """

    def __init__(self, dataset: LabelDataset, indices: Sequence[int]) -> None:
        self.dataset, self.indices = dataset, indices

    def __len__(self) -> int:
        return -(-len(self.indices) // AT_ONCE)

    def __getitem__(self, place: int) -> tuple[Case, ...]:
        return self.dataset.warm(self.indices[place * AT_ONCE : (place + 1) * AT_ONCE])


def run_fill(job: LabelJob) -> ExitCode:
    """Fill the cache; returns the exit code."""
    if job.out is not None:
        raise ConfigError(
            "give --out for labels and pictures, or --cache to fill a Dataset's label cache, not"
            " both"
        )
    if job.cache.workers < 0:
        raise ConfigError(f"--workers must not be negative, got {job.cache.workers}")
    torch.set_num_threads(1)
    body = job.body.source(job.dataset.model)
    config = replace(
        job.config,
        surface_share=False,
        mask_iou=job.cache.mask_iou or job.camera.stored_camera == "hypothesis",
    )
    dataset = AnnotatedDataset(
        job.path,
        format=job.dataset.format,
        images=job.dataset.images,
        model=job.dataset.model,
        vocabulary=job.dataset.vocabulary,
        body=body,
        on_bad="skip",
        focal_px=job.camera.focal_px,
        config=config,
        scale=job.scale_source,
        pose=job.camera.stored_camera,
        cache=job.cache.folder,
        reuse=job.cache.resume,
    )
    first, step = shard_of(job.cache.shard)
    indices = range(first, len(dataset), step)
    loader = DataLoader(Warmed(dataset, indices), batch_size=None, num_workers=job.cache.workers)
    for _ in tqdm(loader, desc="labelling", unit=f"{AT_ONCE} images", disable=job.json or None):
        pass
    return _told(dataset, job, len(indices), sum(dataset.source.animals(i) for i in indices))


def shard_of(shard: str | None) -> tuple[int, int]:
    """First index and step of a shard "i/n", counted from 1."""
    if shard is None:
        return 0, 1
    found = re.fullmatch(r"(\d+)/(\d+)", shard)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise ConfigError(f"--shard must be i/n with i from 1 to n, such as 3/8, got {shard!r}")
    return int(found[1]) - 1, int(found[2])


def _told(dataset: LabelDataset, job: LabelJob, images: int, animals: int) -> ExitCode:
    """Say what was done, and in which words a Dataset uses it."""
    report = dataset.report()
    counts = Counter(case.kind for case in report.cases)
    unread = {fault.sample_id for fault in dataset.source.faults}
    lost = {case.sample_id for case in report.of("cache") if case.problem.startswith(NOT_STORED)}
    stored = animals - len(({case.sample_id for case in report.of("fault")} - unread) | lost)
    if job.json:
        told = {
            "images": images,
            "animals": animals,
            "stored": stored,
            "counts": counts,
            "cases": report.cases,
        }
        sys.stdout.write(msgspec.json.encode(told).decode() + "\n")
    else:
        print(
            f"{images} images, {animals} animals: {stored} in the cache {job.cache.folder}"
            " (rejections are kept too)"
        )
        for case in report.cases:
            print(f"  {case.kind}: {case}")
        print(
            f"use them: AnnotatedDataset({str(job.path)!r}, cache={str(job.cache.folder)!r}, ...)"
            " with the same options"
        )
    return ExitCode.FAULTY if counts["fault"] or lost else ExitCode.OK

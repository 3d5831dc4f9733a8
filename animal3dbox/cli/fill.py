"""The command `label --cache`: fill a Dataset's label cache offline, on one machine or on many."""

import re
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import torch
from torch.utils.data import Dataset

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import LabelJob
from animal3dbox.cli.worker_batches import AT_ONCE, worker_batches
from animal3dbox.datasets.format_datasets import INDEXES, AnnotatedDataset
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.label_store import NOT_STORED
from animal3dbox.datasets.labelling.load_report import Case
from animal3dbox.errors import ConfigError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.plurals import counted
from animal3dbox.progress import watched

REMEDY = "--resume keeps the labels that are in the cache"


class LabelledShard(Dataset[tuple[Case, ...]]):
    """The samples of a shard, AT_ONCE images at a time.

    Reading a batch of them stores its labels and gives the cases that were left out.
    """

    def __init__(self, dataset: LabelDataset, indices: Sequence[int]) -> None:
        self.dataset, self.indices = dataset, indices

    def __len__(self) -> int:
        return -(-len(self.indices) // AT_ONCE)

    def __getitem__(self, place: int) -> tuple[Case, ...]:
        return self.dataset.warm(self.indices[place * AT_ONCE : (place + 1) * AT_ONCE])


def run_fill(job: LabelJob) -> ExitCode:
    """Fill the cache of a Dataset with the labels of a shard."""
    if job.out is not None:
        raise ConfigError(
            "give --out for labels and pictures, or --cache to fill a Dataset's label cache, not"
            " both"
        )
    torch.set_num_threads(1)
    dataset = dataset_of(job)
    number, of = shard_of(job.cache.shard)
    indices = range(number - 1, len(dataset), of)
    with worker_batches(LabelledShard(dataset, indices), job.cache.workers, REMEDY) as batches:
        for _ in watched(batches, "labelling", unit=f"{AT_ONCE} images"):
            pass
    animals = sum(dataset.source.animals(index) for index in indices)
    return _report(dataset, job, len(indices), animals)


def dataset_config(job: LabelJob) -> LabelConfig:
    """How a Dataset of the job's options labels: what is dear to measure only where it is asked."""
    return replace(
        job.config,
        surface_share=job.cache.surface_share,
        mask_iou=job.cache.mask_iou or job.camera.stored_camera == "hypothesis",
    )


def dataset_of(job: LabelJob, config: LabelConfig | None = None) -> AnnotatedDataset:
    """The job's Dataset, whose bad samples are counted, not raised.

    Args:
        job: its options.
        config: how it labels; None: dataset_config(job).

    """
    body = job.body.source(job.dataset.model)
    return AnnotatedDataset(
        job.path,
        format=job.dataset.format,
        images=job.dataset.images,
        model=None if job.body.fits else job.dataset.model,
        vocabulary=job.dataset.vocabulary,
        body=body,
        on_bad="skip",
        focal_px=job.camera.focal_px,
        config=config or dataset_config(job),
        scale=job.scale_source,
        stored_cameras=job.camera.stored_camera,
        misplaced=job.misplaced,
        optional=job.dataset.optional or ("drop" if job.cache.folder is None else "fault"),
        visibility=job.dataset.visibility,
        categories=job.dataset.categories,
        keep=job.dataset.keep,
        apply_orientation=job.dataset.applies_orientation,
        check_paths=job.dataset.check_paths,
        index=_index_folder(job),
        cache=job.cache.folder,
        reuse=job.cache.resume,
        calibration=job.calibration,
    )


def _index_folder(job: LabelJob) -> Path | None:
    """The folder of the index of a job's annotations, which all shards and workers can share."""
    if job.dataset.index is None and job.cache.folder is None and job.table is not None:
        return job.table / f"_{INDEXES}"  # readers of a folder of Parquet pass over such names
    return job.dataset.index


def shard_of(shard: str | None) -> tuple[int, int]:
    """The numbers of a shard "i/n", counted from 1; without one, the whole is the only shard."""
    if shard is None:
        return 1, 1
    parts = re.fullmatch(r"(\d+)/(\d+)", shard)
    if parts is None or not 1 <= int(parts[1]) <= int(parts[2]):
        raise ConfigError(f"--shard must be i/n with i from 1 to n, such as 3/8, got {shard!r}")
    return int(parts[1]), int(parts[2])


def _report(dataset: LabelDataset, job: LabelJob, images: int, animals: int) -> ExitCode:
    """Print the counts and how a Dataset uses the cache; the exit code says if all was stored."""
    report = dataset.report()
    counts = Counter(case.kind for case in report.cases)
    unreadable = {fault.sample_id for fault in dataset.source.faults}
    lost = {case.sample_id for case in report.of("cache") if case.problem.startswith(NOT_STORED)}
    stored = animals - len(({case.sample_id for case in report.of("fault")} - unreadable) | lost)
    if job.json:
        content = {
            "images": images,
            "animals": animals,
            "stored": stored,
            "counts": counts,
            "cases": report.cases,
        }
        sys.stdout.write(msgspec.json.encode(content).decode() + "\n")
    else:
        print(
            f"{counted(images, 'image')}, {counted(animals, 'animal')}: {stored} in the cache"
            f" {job.cache.folder} (rejections are kept too)"
        )
        for case in report.cases:
            print(f"  {case.kind}: {case}")
        print(
            f"use them: AnnotatedDataset({str(job.path)!r}, cache={str(job.cache.folder)!r}, ...)"
            " with the same options"
        )
    return ExitCode.FAULTY if counts["fault"] or lost else ExitCode.OK

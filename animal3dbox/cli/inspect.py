"""``animal3dbox inspect``: what is in a user's own copy of a dataset."""

import sys
from dataclasses import dataclass
from pathlib import Path

import msgspec
import torch

from animal3dbox.datasets.formats import ReadOptions
from animal3dbox.datasets.inspection.inspect import inspect_dataset
from animal3dbox.datasets.inspection.text import as_text
from animal3dbox.smal.keypoints.vocabularies import vocabulary_of_option

EXIT_OK, EXIT_FAULTY = 0, 4


@dataclass(frozen=True)
class InspectJob:
    """What ``inspect`` was asked to do; the fields are its options."""

    path: Path
    format: str
    images: Path | None
    model: Path | None
    vocabulary: str | None
    json: bool


def run_inspect(job: InspectJob) -> int:
    """Inspect a dataset; returns the exit code."""
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    vocabulary = None if job.vocabulary is None else vocabulary_of_option(job.vocabulary)
    found = inspect_dataset(job.path, job.format, ReadOptions(job.images, job.model, vocabulary))
    sys.stdout.write(msgspec.json.encode(found).decode() + "\n" if job.json else as_text(found))
    return EXIT_FAULTY if found.faults.count else EXIT_OK

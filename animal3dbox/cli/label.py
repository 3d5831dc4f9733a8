"""``animal3dbox label``: a dataset in, labels and pictures out."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import torch
from tqdm import tqdm

from animal3dbox.datasets.bodies import BodySource
from animal3dbox.datasets.body_options import DEFAULT_BODY, bodies_for, body_source
from animal3dbox.datasets.images import read_photo
from animal3dbox.datasets.labelling import label_record
from animal3dbox.datasets.reading import ReadOptions, read_dataset
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.report.run import Labelled, write_run
from animal3dbox.report.summary import Summary
from animal3dbox.smal.vocabularies import vocabulary_of_option

EXIT_OK, EXIT_FAULTY = 0, 4


@dataclass(frozen=True)
class LabelJob:
    """What ``label`` was asked to do; the fields are its options."""

    path: Path
    out: Path
    format: str
    images: Path | None
    model: Path | None
    body: str | None
    landmarks: Path | None
    vocabulary: str | None
    config: LabelConfig
    json: bool


def run_label(job: LabelJob) -> int:
    """Label a dataset; returns the exit code."""
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    own_body = None if job.body is None and job.landmarks is None else body_source(job.body or DEFAULT_BODY, job.landmarks)
    if own_body is not None and job.model is not None:
        raise ConfigError("--model takes each animal's own body from the dataset's parameters, --body one for all: give one of them")
    vocabulary = None if job.vocabulary is None else vocabulary_of_option(job.vocabulary)
    dataset = read_dataset(job.path, job.format, ReadOptions(job.images, job.model, vocabulary))
    bodies, records = bodies_for(dataset, own_body), dataset.records
    for note in records.notes:
        print(note, file=sys.stderr)
    if job.out.exists() and not job.out.is_dir():
        raise ConfigError(f"--out {job.out} is a file: give a folder")
    summary = write_run(job.out, str(job.path), bodies.name, job.config, _results(records, bodies, job))
    _print(summary, job)
    return EXIT_FAULTY if summary.faulty else EXIT_OK


def _results(records: RecordSet, bodies: BodySource, job: LabelJob) -> Iterator[Labelled | SampleError]:
    yield from records.faults
    for record in tqdm(records.records, desc="labelling", unit="animal", disable=job.json or None):
        yield _one(record, bodies, job.config)


def _one(record: AnimalRecord, bodies: BodySource, config: LabelConfig) -> Labelled | SampleError:
    try:
        if record.image_path is None:
            raise SampleError(record.sample_id, "image", "is only in memory: write the dataset first (animal3dbox synth)")
        photo = read_photo(record.image_path, record.sample_id, record.image_hw)
        return Labelled(label_record(record, bodies, config, photo.facts), record.image_id, record.category, photo.pixels)
    except SampleError as error:
        return error


def _print(summary: Summary, job: LabelJob) -> None:
    if job.json:
        sys.stdout.write(msgspec.json.encode(summary).decode() + "\n")
        return
    print(f"{summary.animals} animals: {summary.kept} kept, {summary.flagged} flagged, {summary.rejected} rejected, {summary.faulty} faulty")
    for reason, count in {**summary.flags, **summary.reasons}.items():
        print(f"  {count} x {reason}")
    for fault in summary.faults:
        print(f"  faulty: {fault.sample_id}: {fault.field}: {fault.problem}")
    if summary.median_reprojection_error_px is not None:
        print(f"median keypoint error {summary.median_reprojection_error_px:.2f} px (fit, not accuracy)")
    if summary.median_mask_iou is not None:
        print(f"median mask IoU {summary.median_mask_iou:.3f}")
    print(f"look at {job.out / 'gallery.html'}")

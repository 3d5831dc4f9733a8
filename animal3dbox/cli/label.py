"""The command `label`: a dataset in, labels and pictures out."""

import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import torch
from tqdm import tqdm

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import LabelJob
from animal3dbox.datasets.bodies.options import bodies_for
from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.images.photos import read_photo
from animal3dbox.datasets.labelling.label_records import (
    check_pose_policy,
    label_record,
    posed_as_stored,
)
from animal3dbox.datasets.labelling.sources import has_camera
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.report.run import Labelled, write_run
from animal3dbox.report.summary import Summary


def run_label(job: LabelJob) -> ExitCode:
    """Label the animals of a dataset and write labels, pictures and a report."""
    if job.out is None:
        raise ConfigError(
            "give --out for labels, pictures and a report, or --cache to fill a Dataset's label"
            " cache"
        )
    for name, value in (
        ("--shard", job.cache.shard),
        ("--resume", job.cache.resume),
        ("--workers", job.cache.workers),
    ):
        if value:
            raise ConfigError(f"{name} is for filling a label cache: give --cache, or leave it out")
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    own_body = job.body.source(job.dataset.model)
    options = job.dataset.read_options(job.camera.focal_px)
    dataset = read_dataset(job.path, job.dataset.format, options)
    bodies, records = bodies_for(dataset, own_body), dataset.records
    for note in records.notes:
        print(note, file=sys.stderr)
    check_pose_policy(
        job.camera.stored_camera,
        any(has_camera(record) for record in records.records),
        records.notes,
    )
    if job.out.exists() and not job.out.is_dir():
        raise ConfigError(f"--out {job.out} is a file: give a folder")
    summary = write_run(
        job.out, str(job.path), bodies.name, job.config, _results(records, bodies, job)
    )
    _print(summary, job, job.out)
    return ExitCode.FAULTY if summary.faulty else ExitCode.OK


def _results(
    records: RecordSet, bodies: BodySource, job: LabelJob
) -> Iterator[Labelled | SampleError]:
    yield from records.faults
    for record in tqdm(records.records, desc="labelling", unit="animal", disable=job.json or None):
        yield _one(record, bodies, job)


def _one(record: AnimalRecord, bodies: BodySource, job: LabelJob) -> Labelled | SampleError:
    try:
        if record.image_path is None:
            raise SampleError(
                record.sample_id,
                "image",
                "is only in memory: write the dataset first (animal3dbox synth)",
            )
        photo = read_photo(record.image_path, record.sample_id, record.image_hw)
        outcome = label_record(
            posed_as_stored(record, job.camera.stored_camera),
            bodies,
            job.config,
            photo.facts,
            job.scale_source,
        )
        return Labelled(outcome, record.image_id, record.category, photo.pixels)
    except SampleError as error:
        return error


def _print(summary: Summary, job: LabelJob, out: Path) -> None:
    if job.json:
        sys.stdout.write(msgspec.json.encode(summary).decode() + "\n")
        return
    print(
        f"{summary.animals} animals: {summary.kept} kept, {summary.flagged} flagged,"
        f" {summary.rejected} rejected, {summary.faulty} faulty"
    )
    for reason, count in {**summary.flags, **summary.reasons}.items():
        print(f"  {count} x {reason}")
    for fault in summary.faults:
        print(f"  faulty: {fault.sample_id}: {fault.field}: {fault.problem}")
    if summary.median_reprojection_error_px is not None:
        print(
            f"median keypoint error {summary.median_reprojection_error_px:.2f} px (fit, not"
            " accuracy)"
        )
    if summary.median_mask_iou is not None:
        print(f"median mask IoU {summary.median_mask_iou:.3f}")
    print(f"look at {out / 'gallery.html'}")

"""``animal3dbox label``: a dataset in, labels and pictures out."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import torch
from tqdm import tqdm

from animal3dbox.datasets.bodies.options import DEFAULT_BODY, bodies_for, body_source
from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.formats import ReadOptions, read_dataset
from animal3dbox.datasets.images.photos import Photo, read_photo
from animal3dbox.datasets.labelling.label_records import (
    CameraPolicy,
    LabelRequest,
    check_camera_policy,
    label_records,
    request_of_record,
)
from animal3dbox.datasets.labelling.scale import (
    AltitudeScale,
    KnownScale,
    ScaleSource,
    SpeciesScale,
)
from animal3dbox.datasets.labelling.sources import has_camera
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.report.run import Labelled, RunWriter
from animal3dbox.report.summary import Summary
from animal3dbox.smal.keypoints.vocabularies import vocabulary_of_option

EXIT_OK, EXIT_FAULTY = 0, 4
AT_ONCE = 16
"""Animals labelled together."""


@dataclass(frozen=True)
class LabelJob:
    """What ``label`` was asked to do; the fields are its options."""

    path: Path
    out: Path | None
    format: str
    images: Path | None
    model: Path | None
    body: str | None
    landmarks: Path | None
    vocabulary: str | None
    config: LabelConfig
    json: bool
    scale: ScaleSource | None = None
    stored_pose: CameraPolicy = "hypothesis"
    cache: Path | None = None
    shard: str | None = None
    resume: bool = False
    workers: int = 0
    mask_iou: bool = False
    focal_px: float | None = None


def scale_of(
    metres_per_unit: float | None, species_scale: bool, altitude_m: float | None
) -> ScaleSource | None:
    """The scale that the options ask for; raises ConfigError if they ask for two."""
    asked: list[ScaleSource] = []
    if metres_per_unit is not None:
        asked.append(KnownScale(metres_per_unit))
    if species_scale:
        asked.append(SpeciesScale())
    if altitude_m is not None:
        asked.append(AltitudeScale(altitude_m))
    if len(asked) > 1:
        raise ConfigError(
            "give one of --metres-per-unit, --species-scale and --altitude-m: they may disagree"
        )
    return asked[0] if asked else None


def run_label(job: LabelJob) -> int:
    """Label a dataset; returns the exit code."""
    if job.out is None:
        raise ConfigError(
            "give --out for labels, pictures and a report, or --cache to fill a Dataset's label"
            " cache"
        )
    for name, value in (
        ("--shard", job.shard),
        ("--resume", job.resume),
        ("--workers", job.workers),
    ):
        if value:
            raise ConfigError(f"{name} is for filling a label cache: give --cache, or leave it out")
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    own_body = (
        None
        if job.body is None and job.landmarks is None
        else body_source(job.body or DEFAULT_BODY, job.landmarks)
    )
    if own_body is not None and job.model is not None:
        raise ConfigError(
            "--model takes each animal's own body from the dataset's parameters, --body one for"
            " all: give one of them"
        )
    vocabulary = None if job.vocabulary is None else vocabulary_of_option(job.vocabulary)
    dataset = read_dataset(
        job.path, job.format, ReadOptions(job.images, job.model, vocabulary, job.focal_px)
    )
    bodies, records = bodies_for(dataset, own_body), dataset.records
    for note in records.notes:
        print(note, file=sys.stderr)
    check_camera_policy(
        job.stored_pose, any(has_camera(record) for record in records.records), records.notes
    )
    if job.out.exists() and not job.out.is_dir():
        raise ConfigError(f"--out {job.out} is a file: give a folder")
    writer = RunWriter(job.out, source=str(job.path), body=bodies.name, config=job.config)
    writer.add(records.faults)
    progress = tqdm(
        total=len(records.records), desc="labelling", unit="animal", disable=job.json or None
    )
    for first in range(0, len(records.records), AT_ONCE):
        batch = records.records[first : first + AT_ONCE]
        writer.add(_labelled(batch, bodies, job))
        progress.update(len(batch))
    progress.close()
    summary = writer.finish()
    _print(summary, job, job.out)
    return EXIT_FAULTY if summary.faulty else EXIT_OK


def _labelled(
    records: Sequence[AnimalRecord], bodies: BodySource, job: LabelJob
) -> list[Labelled | SampleError]:
    """Animals read and labelled together, in order."""
    results: list[Labelled | SampleError | None] = [None] * len(records)
    photos: dict[int, Photo] = {}
    requests: dict[int, LabelRequest] = {}
    for place, record in enumerate(records):
        try:
            photos[place] = _photo(record)
            requests[place] = request_of_record(record, bodies, photos[place].facts)
        except SampleError as error:
            results[place] = error
    outcomes = label_records(
        list(requests.values()),
        job.config,
        scale=job.scale,
        stored_cameras=job.stored_pose,
    )
    for place, outcome in zip(requests, outcomes, strict=True):
        if isinstance(outcome, SampleError):
            results[place] = outcome
        else:
            record, pixels = records[place], photos[place].pixels
            results[place] = Labelled(outcome, record.image_id, record.category, pixels)
    return [result for result in results if result is not None]


def _photo(record: AnimalRecord) -> Photo:
    """The picture of an animal; raises SampleError."""
    if record.image_path is None:
        raise SampleError(
            record.sample_id,
            "image",
            "is only in memory: write the dataset first (animal3dbox synth)",
        )
    return read_photo(record.image_path, record.sample_id, record.image_hw)


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

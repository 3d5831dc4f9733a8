"""The command `label`: a dataset in, labels and pictures out."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import torch
from tqdm import tqdm

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.fill import run_fill
from animal3dbox.cli.jobs import LabelJob
from animal3dbox.cli.table import run_table
from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.presets import PresetBodies, species_notes
from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.formats import bodies_for, read_dataset
from animal3dbox.datasets.images.photos import Photo, read_photo
from animal3dbox.datasets.labelling.calibrate import lesson_notes
from animal3dbox.datasets.labelling.file_source import has_camera
from animal3dbox.datasets.labelling.label_records import check_camera_policy, label_records
from animal3dbox.datasets.labelling.label_requests import LabelRequest, requests_of_image
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import portable_path
from animal3dbox.labels.calibration import Calibration, calibration_of
from animal3dbox.report.run import Labelled, RunWriter
from animal3dbox.report.summary import Summary

AT_ONCE = 16
"""Animals labelled together."""


def run_label(job: LabelJob) -> ExitCode:
    """Write labels and pictures of a dataset, or a table, or fill a cache for one."""
    _ = job.config, job.scale_source  # made now, so that what they refuse is told at once
    if job.table is not None:
        return run_table(job)
    return _write_labels(job) if job.cache.folder is None else run_fill(job)


def _write_labels(job: LabelJob) -> ExitCode:
    """Label the animals of a dataset and write labels, pictures and a report."""
    out = _checked_folder(job)
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    calibration = calibration_of(job.calibration)
    own_body = job.body.source(job.dataset.model)
    options = job.body.read_options(job.dataset, job.camera.focal_px)
    dataset = read_dataset(job.path, job.dataset.format, options)
    bodies, records = bodies_for(dataset, own_body), dataset.records
    for note in _notes(records, bodies, calibration):
        print(note, file=sys.stderr)
    check_camera_policy(
        job.camera.stored_camera,
        any(has_camera(record) for record in records.records),
        records.notes,
    )
    writer = RunWriter(
        out,
        source=portable_path(job.path),
        body=bodies.name,
        config=job.config,
        fitted=bodies.model if job.outline and isinstance(bodies, FittedBodies) else None,
    )
    writer.add(records.faults)
    turned: set[str] = set()
    progress = tqdm(
        total=len(records.records), desc="labelling", unit="animal", disable=job.json or None
    )
    for batch in image_batches(records.records):
        writer.add(_labelled(batch, bodies, job, calibration, turned=turned))
        progress.update(len(batch))
    progress.close()
    if job.dataset.applies_orientation:
        print(f"{len(turned)} pictures were turned by their EXIF orientation", file=sys.stderr)
    summary = writer.finish()
    _print(summary, job, out)
    has_none = summary.animals > 0 and not summary.kept + summary.flagged
    return ExitCode.FAULTY if summary.faulty or has_none else ExitCode.OK


def _notes(
    records: RecordSet, bodies: BodySource, calibration: Calibration | None
) -> Iterator[str]:
    """What a careful person should know before the labels, in whole sentences."""
    words = {record.vocabulary.name: record.vocabulary for record in records.records}
    yield from records.notes
    yield from lesson_notes(calibration, bodies, words.values())
    for vocabulary in words.values():
        yield from vocabulary.notes
    if isinstance(bodies, FittedBodies | PresetBodies):
        yield from species_notes(bodies.species, records.records)


def image_batches(records: Sequence[AnimalRecord]) -> Iterator[list[AnimalRecord]]:
    """Records in order, AT_ONCE or more at a time: those of an image, if they follow, together."""
    batch: list[AnimalRecord] = []
    for record in records:
        if len(batch) >= AT_ONCE and record.image_id != batch[-1].image_id:
            yield batch
            batch = []
        batch.append(record)
    if batch:
        yield batch


def _checked_folder(job: LabelJob) -> Path:
    """The folder that is written to; raises a ConfigError for options that are for a cache."""
    if job.out is None:
        raise ConfigError(
            "give --out for labels, pictures and a report, --table for a table, or --cache to fill"
            " a Dataset's label cache"
        )
    for name, value in (
        ("--shard", job.cache.shard),
        ("--resume", job.cache.resume),
        ("--workers", job.cache.workers),
    ):
        if value:
            raise ConfigError(
                f"{name} is for filling a label cache or writing a table: give --cache or --table,"
                " or leave it out"
            )
    if job.out.exists() and not job.out.is_dir():
        raise ConfigError(f"--out {job.out} is a file: give a folder")
    return job.out


def _labelled(
    records: Sequence[AnimalRecord],
    bodies: BodySource,
    job: LabelJob,
    calibration: Calibration | None,
    *,
    turned: set[str],
) -> list[Labelled | SampleError]:
    """Animals read and labelled together, in order; images that were turned join `turned`.

    The animals of an image are one sample: a focal length that nothing tells is one for all.
    """
    results: list[Labelled | SampleError | None] = [None] * len(records)
    photos: dict[int, Photo] = {}
    requests: dict[int, LabelRequest] = {}
    for place, record in enumerate(records):
        try:
            photos[place] = _photo(record)
            turned |= {record.image_id} if photos[place].facts.upright else set()
        except SampleError as error:
            results[place] = error
    by_image: dict[str, list[int]] = {}
    for place in photos:
        by_image.setdefault(records[place].image_id, []).append(place)
    for places in by_image.values():
        facts = [photos[place].facts for place in places]
        own = requests_of_image([records[place] for place in places], bodies, facts)
        requests |= dict(zip(places, own, strict=True))
    outcomes = label_records(
        list(requests.values()),
        job.config,
        scale=job.scale_source,
        stored_cameras=job.camera.stored_camera,
        calibration=calibration,
        misplaced=job.misplaced,
        optional=job.dataset.optional or "drop",
    )
    for place, outcome in zip(requests, outcomes, strict=True):
        if isinstance(outcome, SampleError):
            results[place] = outcome
        else:
            record, photo = records[place], photos[place]
            sighting = record.sighting.with_picture_time(photo.facts.time)
            results[place] = Labelled(
                outcome,
                record.image_id,
                record.category,
                photo.pixels,
                sighting=sighting,
                upright=photo.facts.upright,
            )
    return [result for result in results if result is not None]


def _photo(record: AnimalRecord) -> Photo:
    """The picture of an animal; raises SampleError."""
    if record.image_path is None:
        raise SampleError(
            record.sample_id,
            "image",
            "is only in memory: write the dataset first (animal3dbox synth)",
        )
    return read_photo(record.image_path, record.sample_id, record.image_hw, upright=record.upright)


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
    if summary.masks_left_out:
        print(f"  {summary.masks_left_out} masks cannot be used and are left out (gallery: why)")
    if summary.reasons.get("too_few_keypoints"):
        print(f"  (labels are made from {job.config.min_keypoints} on: --min-keypoints)")
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

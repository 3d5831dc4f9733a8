"""The command `label`: a dataset in, labels and pictures out."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import torch
from torch.utils.data import Dataset

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.fill import dataset_of, run_fill
from animal3dbox.cli.jobs import LabelJob
from animal3dbox.cli.table import run_table
from animal3dbox.cli.worker_batches import worker_batches
from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.presets import PresetBodies, species_notes
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.animal_outcomes import AnimalOutcome
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import portable_path
from animal3dbox.plurals import counted
from animal3dbox.progress import watched
from animal3dbox.report.run import ROWS, RunWriter, make_results_folder
from animal3dbox.report.run_rows import DrawnAnimal, Labelled, Pictures, drawn_animal
from animal3dbox.report.summary import Summary
from animal3dbox.report.table.keys import (
    animal_key,
    missing_indices,
    table_length,
    unread_animal,
)
from animal3dbox.report.table.parts import locked_shard
from animal3dbox.report.table.plan import check_known
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel

AT_ONCE = 16
"""Images labelled and drawn together."""
REMEDY = "the same command with --resume goes on from the animals that are labelled"


def run_label(job: LabelJob) -> ExitCode:
    """Write labels and pictures of a dataset, or a table, or fill a cache for one."""
    _ = job.config, job.scale_source  # made now, so that what they refuse is told at once
    if job.table is not None:
        return run_table(job)
    return _write_labels(job) if job.cache.folder is None else run_fill(job)


class DrawnBatches(Dataset[list[DrawnAnimal]]):
    """The animals of some indices of a dataset's table, labelled and drawn, AT_ONCE at a time.

    Args:
        dataset: whose animals.
        indices: as label_table has them.
        pictures: which animals get some.
        fitted: the model that was fitted, whose outlines are drawn; None: no outlines.

    """

    def __init__(
        self,
        dataset: LabelDataset,
        indices: Sequence[int],
        *,
        pictures: Pictures,
        fitted: SmalModel | None,
    ) -> None:
        self.dataset, self.indices = dataset, indices
        self.pictures, self.fitted = pictures, fitted

    def __len__(self) -> int:
        return -(-len(self.indices) // AT_ONCE)

    def __getitem__(self, place: int) -> list[DrawnAnimal]:
        indices = self.indices[place * AT_ONCE : (place + 1) * AT_ONCE]
        count, digest = len(self.dataset), self.dataset.labels_digest
        outcomes = self.dataset.outcomes(
            [index for index in indices if index < count], pictures=self.pictures != "none"
        )
        unread = (unread_animal(self.dataset, index) for index in indices if index >= count)
        return [
            *(self._drawn(one, digest) for one in outcomes),
            *(
                drawn_animal(one.fault, one.number, key=one.key(digest), is_unread=True)
                for one in unread
            ),
        ]

    def _drawn(self, animal: AnimalOutcome, digest: str) -> DrawnAnimal:
        outcome = animal.outcome
        result = (
            outcome
            if isinstance(outcome, SampleError)
            else Labelled(
                outcome,
                animal.image_id,
                animal.entry.category,
                animal.pixels,
                sighting=animal.sighting,
                upright=animal.facts.upright,
            )
        )
        return drawn_animal(
            result,
            animal.number,
            key=animal_key(digest, animal.image_id, animal.number, animal.entry),
            fitted=self.fitted,
            pictures=self.pictures,
        )


def _write_labels(job: LabelJob) -> ExitCode:
    """Label the animals of a dataset and write labels, pictures and a report."""
    out = _checked_folder(job)
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    dataset = dataset_of(job, job.config)
    bodies = dataset.bodies
    for note in _notes(dataset):
        print(note, file=sys.stderr)
    make_results_folder(out)
    with locked_shard(out / ROWS, results=out):
        writer = RunWriter(
            out,
            source=portable_path(job.path),
            body=bodies.name,
            config=job.config,
            resume=job.cache.resume,
        )
        fitted = bodies.model if job.outline and isinstance(bodies, FittedBodies) else None
        _label_all(dataset, writer, job, fitted)
        summary = writer.finish()
    if job.dataset.applies_orientation:
        print(
            f"{len(writer.turned)} pictures were turned by their EXIF orientation", file=sys.stderr
        )
    if writer.deleted_overlays:
        print(
            f"overlays that were deleted before the end of the run: {len(writer.deleted_overlays)};"
            " gallery.html has no links to them; label again without --resume to draw them",
            file=sys.stderr,
        )
    _print(summary, job, out)
    has_none = summary.animals > 0 and not summary.kept + summary.flagged
    return ExitCode.FAULTY if summary.faulty or has_none else ExitCode.OK


def _label_all(
    dataset: LabelDataset, writer: RunWriter, job: LabelJob, fitted: SmalModel | None
) -> None:
    """Give a run's writer all animals that it does not have yet."""
    indices: Sequence[int] = range(table_length(dataset))
    if writer.known_keys:
        check_known(dataset, indices, writer.known_keys, writer.out)
        indices = missing_indices(dataset, indices, writer.known_keys)
    drawn_batches = DrawnBatches(dataset, indices, pictures=job.pictures, fitted=fitted)
    with worker_batches(drawn_batches, job.cache.workers, REMEDY) as batches, writer:
        for animals in watched(batches, "labelling", unit=f"{AT_ONCE} images"):
            writer.add([one for one in animals if one.row.key not in writer.known_keys])


def _notes(dataset: AnnotatedDataset) -> Iterator[str]:
    """What a careful person should know before the labels, in whole sentences."""
    yield from dataset.notes
    categories, words = Counter[str](), dict[str, Vocabulary]()
    for index in watched(range(len(dataset)), "reading", unit="image"):
        for entry in dataset.source.sample(index).animals:
            categories[entry.category] += 1
            if entry.vocabulary is not None:
                words[entry.vocabulary.name] = entry.vocabulary
    for vocabulary in words.values():
        yield from vocabulary.notes
    if isinstance(dataset.bodies, FittedBodies | PresetBodies):
        yield from species_notes(dataset.bodies.species, categories.elements())


def _checked_folder(job: LabelJob) -> Path:
    """The folder that is written to; raises a ConfigError for options that are for others."""
    if job.out is None:
        raise ConfigError(
            "give --out for labels, pictures and a report, --table for a table, or --cache to fill"
            " a Dataset's label cache"
        )
    if job.cache.shard:
        raise ConfigError(
            "--shard is for filling a label cache or writing a table: give --cache or --table, or"
            " leave it out"
        )
    if job.out.exists() and not job.out.is_dir():
        raise ConfigError(f"--out {job.out} is a file: give a folder")
    return job.out


def _print(summary: Summary, job: LabelJob, out: Path) -> None:
    if job.json:
        sys.stdout.write(msgspec.json.encode(summary).decode() + "\n")
        return
    print(
        f"{counted(summary.animals, 'animal')}: {summary.kept} kept, {summary.flagged} flagged,"
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

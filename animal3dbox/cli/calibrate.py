"""The command `calibrate`: what a dataset teaches about itself, into a file."""

import sys
from dataclasses import replace
from pathlib import Path

import torch

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import CalibrateJob
from animal3dbox.cli.lessons_in_words import print_bodies
from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.formats import ReadDataset, bodies_for, read_dataset
from animal3dbox.datasets.labelling.calibrate import LearnedCalibration, calibrate_animals
from animal3dbox.datasets.labelling.learned_bodies import (
    LearnedBodies,
    learn_from_records,
    remove_fits,
)
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import ConfigError
from animal3dbox.labels.axes.placement import LEAST_ANIMALS
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.learning.rounds import LEAST_TAUGHT
from animal3dbox.plurals import counted
from animal3dbox.progress import watched, watched_steps

PLACEMENT = "placement"
OF_FITS = ("places", "shapes")
"""What is learned of bodies that are fitted."""


def run_calibrate(job: CalibrateJob) -> ExitCode:
    """Learn a calibration from a dataset and write it.

    Raises:
        ConfigError: no animal teaches what was asked for, or it is nothing that can be learned.

    """
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    wanted = sections(job.learn)
    if job.out.is_dir():
        raise ConfigError(f"--out {job.out} is a folder: name the file to be written")
    dataset = read_dataset(
        job.path, job.dataset.format, job.body.read_options(job.dataset, job.focal_px)
    )
    bodies = bodies_for(dataset, job.body.source(job.dataset.model))
    placement = _placement(job, dataset, bodies) if PLACEMENT in wanted else None
    of_fits = tuple(name for name in OF_FITS if name in wanted)
    fitted = _fitted(job, dataset, bodies, of_fits) if of_fits else None
    calibration = Calibration() if placement is None else placement.calibration
    if fitted is not None:
        places, shapes = fitted.calibration.places, fitted.calibration.shapes
        calibration = replace(calibration, places=places, shapes=shapes)
    calibration.save(job.out)
    remove_fits(_fits_folder(job))
    if job.json:
        sys.stdout.write(job.out.read_text(encoding="utf-8"))
        for error in () if fitted is None else fitted.faults:
            print(f"faulty: {error}", file=sys.stderr)
    else:
        _print(job, placement, fitted)
    for fault in dataset.records.faults:
        print(f"faulty: {fault}", file=sys.stderr)
    faults = len(dataset.records.faults) + (0 if placement is None else placement.faulty)
    faults += 0 if fitted is None else len(fitted.faults)
    return ExitCode.FAULTY if faults else ExitCode.OK


def sections(learn: str) -> tuple[str, ...]:
    """The parts of a calibration that --learn names.

    Raises:
        ConfigError: there is no such part.

    Example:
        >>> sections("places, shapes")
        ('places', 'shapes')
    """
    names = tuple(name.strip() for name in learn.split(","))
    known = (PLACEMENT, *OF_FITS)
    for name in names:
        if name not in known:
            raise ConfigError(f"--learn must be of {', '.join(known)}, got {name!r}")
    return names


def _placement(job: CalibrateJob, dataset: ReadDataset, bodies: BodySource) -> LearnedCalibration:
    records = watched(dataset.records.records, "reading", unit="animal")
    learned = calibrate_animals((record, bodies) for record in records)
    if not learned.used:
        raise ConfigError(
            f"{job.path} teaches nothing about its keypoints' placement: none of {learned.animals}"
            f" animals has a body of its own without a template ({learned.faulty} could not be"
            " read); such bodies come from a folder with images/ and, under their names, meshes/."
            " Of photographs, --learn places,shapes learns for bodies that are fitted"
        )
    return learned


def _fitted(
    job: CalibrateJob, dataset: ReadDataset, bodies: BodySource, learn: tuple[str, ...]
) -> LearnedBodies:
    """What the fits of a dataset's animals teach, with a progress bar."""
    if not isinstance(bodies, FittedBodies):
        raise ConfigError(
            f"--learn {','.join(learn)} is for bodies that are fitted, and {job.path} has"
            f" {bodies.name}: give --body fit, or --learn placement"
        )
    records = [one for one in dataset.records.records if isinstance(one, AnimalRecord)]
    with watched_steps("learning", unit="step") as watch:
        learned = learn_from_records(
            records, bodies, LabelConfig(), learn=learn, folder=_fits_folder(job), watch=watch
        )
    if not learned.used:
        first = f", the first because {learned.faults[0]}" if learned.faults else ""
        counts = ", ".join(f"{n} of {name}" for name, n in sorted(learned.few.items())) or "none"
        raise ConfigError(
            f"{job.path} has too few animals that a body can be fitted to ({counts};"
            f" {learned.left_out} with too few keypoints or a lens, {len(learned.faults)} could not"
            f" be read{first}): places and shapes are learned from {LEAST_TAUGHT} of a vocabulary"
            " on"
        )
    return learned


def _fits_folder(job: CalibrateJob) -> Path:
    """Where fits are kept until what they teach is written."""
    return job.out.with_name(f"{job.out.name}.fits")


def _print(
    job: CalibrateJob, placement: LearnedCalibration | None, fitted: LearnedBodies | None
) -> None:
    """Print the placement's lines, then places and shapes, as far as they were learned."""
    if placement is not None:
        _print_placement(placement)
    if fitted is not None:
        print_bodies(fitted)
    print(f"give it to labels: animal3dbox label {job.path} --calibration {job.out} --out labels")


def _print_placement(learned: LearnedCalibration) -> None:
    print(
        f"{counted(learned.animals, 'animal')}: {learned.used} used,"
        f" {learned.faulty} could not be read"
    )
    for entry in learned.calibration.placement:
        who = entry.species or "all species"
        print(
            f"  {entry.vocabulary}, {who}: {entry.line} rises by {entry.pitch_deg:g} degrees"
            f" ({counted(entry.animals, 'animal')})"
        )
    if learned.used < LEAST_ANIMALS:
        print(f"  few: a pitch from fewer than {LEAST_ANIMALS} animals may be off by some degrees")

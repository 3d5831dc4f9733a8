"""The command `calibrate`: what a dataset teaches about itself, into a file."""

import sys

import torch

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import CalibrateJob
from animal3dbox.datasets.formats import bodies_for, read_dataset
from animal3dbox.datasets.labelling.calibrate import LearnedCalibration, calibrate_animals
from animal3dbox.errors import ConfigError
from animal3dbox.labels.axes.placement import LEAST_ANIMALS


def run_calibrate(job: CalibrateJob) -> ExitCode:
    """Learn a calibration from a dataset and write it.

    Raises:
        ConfigError: no animal teaches anything.

    """
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    dataset = read_dataset(job.path, job.dataset.format, job.dataset.read_options())
    bodies = bodies_for(dataset, job.body.source(job.dataset.model))
    learned = calibrate_animals((record, bodies) for record in dataset.records.records)
    if not learned.used:
        raise ConfigError(
            f"{job.path} teaches nothing about its keypoints' places: none of {learned.animals}"
            f" animals has a body of its own without a template ({learned.faulty} could not be"
            " read); such bodies come from a folder of meshes (docs/formats.md)"
        )
    learned.calibration.save(job.out)
    if job.json:
        sys.stdout.write(job.out.read_text(encoding="utf-8"))
    else:
        _print(learned, job)
    return ExitCode.FAULTY if learned.faulty else ExitCode.OK


def _print(learned: LearnedCalibration, job: CalibrateJob) -> None:
    print(f"{learned.animals} animals: {learned.used} used, {learned.faulty} could not be read")
    for entry in learned.calibration.placement:
        who = entry.species or "all species"
        print(
            f"  {entry.vocabulary}, {who}: {entry.line} rises by {entry.pitch_deg:g} degrees"
            f" ({entry.animals} animals)"
        )
    if learned.used < LEAST_ANIMALS:
        print(f"  few: a pitch from fewer than {LEAST_ANIMALS} animals may be off by some degrees")
    print(f"give it to labels: animal3dbox label {job.path} --calibration {job.out} --out labels")

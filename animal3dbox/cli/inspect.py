"""The command `inspect`: a description of a user's own copy of a dataset."""

import sys

import msgspec
import torch

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import InspectJob
from animal3dbox.datasets.inspection.inspect import inspect_dataset
from animal3dbox.datasets.inspection.text import as_text
from animal3dbox.errors import ConfigError


def run_inspect(job: InspectJob) -> ExitCode:
    """Print what a copy of a dataset holds, in words or as JSON."""
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    if job.fits and job.dataset.model is None:
        raise ConfigError(
            "--fits compares stored parameters with fits: give --model, whose they are"
        )
    inspection = inspect_dataset(
        job.path, job.dataset.format, job.dataset.read_options(), fits=job.fits
    )
    text = msgspec.json.encode(inspection).decode() + "\n" if job.json else as_text(inspection)
    sys.stdout.write(text)
    without_label = inspection.faults.count + inspection.keypoint_places.misplaced
    return ExitCode.FAULTY if without_label else ExitCode.OK

"""The command `synth`: a synthetic dataset in the files that users have."""

from dataclasses import replace

import torch

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import SynthJob
from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d
from animal3dbox.datasets.synthetic.scene_files import can_resume
from animal3dbox.datasets.synthetic.stanfordextra_writer import write_stanfordextra
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, animal3d_world
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError
from animal3dbox.plurals import counted
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES


def run_synth(job: SynthJob) -> ExitCode:
    """Write a synthetic dataset, and print how it is labelled."""
    faults = job.annotation.config()
    _check_folder(job)
    if job.format != "animal3d" and job.model is not None:
        raise ConfigError(f"--model is for the parameters of animal3d, and {job.format} has none")
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    world = replace(WorldConfig(), image_hw=(job.height, job.width))
    is_animal3d = job.format == "animal3d"
    world = (
        animal3d_world(world)
        if is_animal3d
        else replace(world, vocabulary=VOCABULARIES["stanfordextra24"])
    )
    pictures = SyntheticSet(
        job.seed, job.n, world, faults, "marked" if job.mark_hidden else "unmarked"
    )
    if is_animal3d:
        model = job.model or job.out.parent / f"{job.out.name}-model.pkl"
        count = write_animal3d(pictures, job.out, model, workers=job.workers, resume=job.resume)
        print(f"{_content(job, count)} in {job.out}; the model of their bodies is {model}")
        print(f"label them: animal3dbox label {job.out} --model {model} --out {job.out}-labels")
    else:
        count = write_stanfordextra(pictures, job.out, workers=job.workers, resume=job.resume)
        print(f"{_content(job, count)} in {job.out}")
        print(f"label them: animal3dbox label {job.out} --body dog --out {job.out}-labels")
    return ExitCode.OK


def _content(job: SynthJob, animals: int) -> str:
    """What was written, in words."""
    return f"{counted(job.n, 'image')}, {counted(animals, 'animal')}"


def _check_folder(job: SynthJob) -> None:
    """Raise a ConfigError unless the folder can take a dataset, or the rest of one."""
    if job.workers < 1:
        raise ConfigError(f"--workers must be at least 1, got {job.workers}")
    is_used = job.out.exists() and (not job.out.is_dir() or any(job.out.iterdir()))
    if not is_used or (job.resume and can_resume(job.out)):
        return
    if can_resume(job.out):
        raise ConfigError(f"--out {job.out} holds the beginning of a dataset: add --resume")
    whole = ", such as a whole dataset, to which --resume adds nothing" if job.resume else ""
    raise ConfigError(
        f"--out {job.out} must be a new or an empty folder{whole}: files of another dataset would"
        " stay among its own"
    )

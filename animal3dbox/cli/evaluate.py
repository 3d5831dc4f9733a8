"""The command `evaluate`: the paper's evaluation on our world, or what of it a dataset allows."""

import sys
from pathlib import Path

import torch

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.jobs import EvaluateJob
from animal3dbox.datasets.formats import bodies_for, read_dataset
from animal3dbox.errors import ConfigError
from animal3dbox.evaluate.config import EvaluateConfig
from animal3dbox.evaluate.dataset_study import dataset_rows, dataset_table, true_boxes
from animal3dbox.evaluate.files import Evaluation, as_text, write_json, write_text
from animal3dbox.evaluate.page import write_page
from animal3dbox.evaluate.pictures import pictures_of
from animal3dbox.evaluate.plots import plots_of
from animal3dbox.evaluate.run import evaluate_world, world_tables
from animal3dbox.files import ListedFiles
from animal3dbox.plurals import counted

PICTURES = r"picture-[0-9]{1,9}\.png"
"""The names of the pictures in the folder of the results."""


def run_evaluate(job: EvaluateJob) -> ExitCode:
    """Evaluate and write the files."""
    if job.workers < 1:
        raise ConfigError(f"--workers must be at least 1, got {job.workers}")
    if job.out.exists() and not job.out.is_dir():
        raise ConfigError(f"--out {job.out} is a file: give a folder")
    if job.path is None and (
        job.dataset.model is not None
        or job.body.name is not None
        or job.body.landmarks is not None
        or job.dataset.images is not None
    ):
        raise ConfigError(
            "--model, --body, --landmarks and --images belong to a dataset: give its PATH"
        )
    if job.path is not None and job.fits:
        raise ConfigError("--fits is for our world, whose bodies are known: leave out the PATH")
    picture_files = ListedFiles(job.out, "evaluate", PICTURES)
    picture_files.check_list()
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    evaluation = _world(job) if job.path is None else _dataset(job, job.path)
    write_json(job.out / "evaluation.json", evaluation)
    write_text(job.out / "evaluation.txt", evaluation)
    pictures = pictures_of(job.seed) if job.path is None and job.pictures else None
    names = [f"picture-{number + 1}.png" for number in range(len(pictures or {}))]
    for name, picture in zip(names, (pictures or {}).values(), strict=True):
        picture_files.write(name, picture)
    picture_files.keep_only(names)
    write_page(job.out / "evaluation.html", evaluation, plots_of(evaluation.tables), pictures)
    sys.stdout.write(as_text(evaluation))
    print(f"look at {job.out / 'evaluation.html'}")
    return ExitCode.FAULTY if evaluation.about.get("faulty") else ExitCode.OK


def _world(job: EvaluateJob) -> Evaluation:
    config = EvaluateConfig(animals=job.n, seed=job.seed, fits=job.fits)
    rows = evaluate_world(config, job.workers)
    about = {
        "animals": config.animals,
        "seed": config.seed,
        "every": config.every,
        **({"fits": config.fits} if config.fits else {}),
        "image_hw": list(config.world.image_hw),
    }
    return Evaluation(
        f"animal3dbox on {counted(job.n, 'synthetic animal')}, seed {job.seed}",
        about,
        world_tables(rows),
    )


def _dataset(job: EvaluateJob, path: Path) -> Evaluation:
    own_body = job.body.source(job.dataset.model)
    dataset = read_dataset(path, job.dataset.format, job.body.read_options(job.dataset))
    bodies = bodies_for(dataset, own_body)
    for note in dataset.records.notes:
        print(note, file=sys.stderr)
    truths = true_boxes(path)
    rows = dataset_rows(dataset.records, bodies, truths)
    faulty = len({row.sample_id for row in rows if row.reason == "faulty"})
    about = {
        "dataset": path.name,
        "format": dataset.records.name,
        "body": bodies.name,
        "truth": truths is not None,
        "faulty": faulty,
    }
    return Evaluation(f"animal3dbox on {path.name}", about, (dataset_table(rows),))

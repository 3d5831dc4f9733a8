"""An evaluation from its config to its tables, on one or several processes with the same result."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context

import torch

from animal3dbox.evaluate.accuracy import AccuracyRow, accuracy_rows, accuracy_table
from animal3dbox.evaluate.confidence_mix import judged_cases
from animal3dbox.evaluate.config import EvaluateConfig
from animal3dbox.evaluate.face_study import FaceRow, face_rows, face_table
from animal3dbox.evaluate.fit_study import FitRow, fit_rows, fit_table
from animal3dbox.evaluate.foreign_study import ForeignRow, foreign_rows, foreign_table
from animal3dbox.evaluate.orientation import StabilityRow, stability_rows, stability_table
from animal3dbox.evaluate.pose_study import DIAL, EVERYWHERE, PoseRow, pose_rows, pose_table
from animal3dbox.evaluate.reliability import Judged, curve_table, reliability_table
from animal3dbox.evaluate.reproduction import ReproductionRow, reproduction_rows, reproduction_table
from animal3dbox.evaluate.subject import subject
from animal3dbox.evaluate.tables import Table
from animal3dbox.progress import watched


@dataclass(frozen=True)
class StudyRows:
    """The results of every study, a row a sample.

    Attributes:
        stability: orientation under noise.
        accuracy: orientation against the truth.
        pose: camera poses.
        reproduction: the paper's baseline as it fails.
        faces: against ray-casting.
        foreign: camera poses on a foreign world.
        judged: confidences beside the truth.
        fits: fitted, rigid and true bodies.

    Example:
        >>> StudyRows(stability=(), accuracy=(), pose=(), reproduction=(), faces=()).pose
        ()
    """

    stability: tuple[StabilityRow, ...]
    accuracy: tuple[AccuracyRow, ...]
    pose: tuple[PoseRow, ...]
    reproduction: tuple[ReproductionRow, ...]
    faces: tuple[FaceRow, ...]
    foreign: tuple[ForeignRow, ...] = ()
    judged: tuple[Judged, ...] = ()
    fits: tuple[FitRow, ...] = ()


def animal_rows(config: EvaluateConfig, index: int) -> StudyRows:
    """Everything about one animal; a pure function of the config and the index."""
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    who, in_full = subject(config, index), index % config.every == 0
    return StudyRows(
        stability=tuple(stability_rows(who)) if in_full else (),
        accuracy=tuple(accuracy_rows(who)),
        pose=tuple(pose_rows(who, {**EVERYWHERE, **DIAL} if in_full else EVERYWHERE)),
        reproduction=tuple(reproduction_rows(who)) if in_full else (),
        faces=tuple(face_rows(who)),
        foreign=tuple(foreign_rows(index)) if in_full else (),
        judged=tuple(judged_cases(range(index, index + 1))),
        fits=tuple(fit_rows(index)) if index < config.fits else (),
    )


def evaluate_world(config: EvaluateConfig, workers: int = 1) -> StudyRows:
    """Everything about all animals, in their order whatever the number of workers.

    Args:
        config: what is evaluated.
        workers: processes.

    Example:
        >>> from dataclasses import replace
        >>> from animal3dbox.datasets.synthetic.world.config import WorldConfig
        >>> small = replace(WorldConfig(), image_hw=(120, 160))
        >>> rows = evaluate_world(EvaluateConfig(animals=1, world=small))
        >>> [row.view for row in rows.faces if row.booleans_right == 6]
        ['in frame', 'truncated', 'corners behind the camera', 'UAV nadir']
    """
    each = _each_animal(config, workers)
    animals = list(watched(each, "evaluating", unit="animal", total=config.animals))
    return StudyRows(
        stability=tuple(row for rows in animals for row in rows.stability),
        accuracy=tuple(row for rows in animals for row in rows.accuracy),
        pose=tuple(row for rows in animals for row in rows.pose),
        reproduction=tuple(row for rows in animals for row in rows.reproduction),
        faces=tuple(row for rows in animals for row in rows.faces),
        foreign=tuple(row for rows in animals for row in rows.foreign),
        judged=tuple(row for rows in animals for row in rows.judged),
        fits=tuple(row for rows in animals for row in rows.fits),
    )


def world_tables(rows: StudyRows) -> tuple[Table, ...]:
    """The tables of an evaluation, beside the paper's figures; that of fits if there are any.

    Example:
        >>> tables = world_tables(StudyRows((), (), (), (), ()))
        >>> [table.name for table in tables][:4]
        ['stability', 'accuracy', 'pose', 'reproduction']
    """
    return (
        stability_table(rows.stability),
        accuracy_table(rows.accuracy),
        pose_table(rows.pose),
        reproduction_table(rows.reproduction),
        face_table(rows.faces),
        foreign_table(rows.foreign),
        reliability_table(rows.judged),
        curve_table(rows.judged),
        *((fit_table(rows.fits),) if rows.fits else ()),
    )


def _each_animal(config: EvaluateConfig, workers: int) -> Iterator[StudyRows]:
    if workers == 1:
        yield from map(partial(animal_rows, config), range(config.animals))
        return
    with get_context("spawn").Pool(workers) as pool:
        yield from pool.imap(partial(animal_rows, config), range(config.animals))

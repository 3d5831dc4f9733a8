"""Fits of the embedded quadruped as a JSON file of their own, written and read back.

Example:
    >>> SCHEMA
    'animal3dbox.quadruped_fits'
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

import msgspec
import numpy as np

from animal3dbox.datasets.exchange.export import ExportSummary
from animal3dbox.datasets.exchange.fitted_animals import FittedAnimal
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import ConfigError, DatasetFormatError, ShapeError
from animal3dbox.files import write_whole
from animal3dbox.geometry.checks import (
    check_image_hw,
    check_intrinsics,
    check_rotation,
    check_shape,
)
from animal3dbox.labels.fit_parameters import FitParameters, check_whose
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

SCHEMA: Final = "animal3dbox.quadruped_fits"
Row = tuple[float, float, float]


class _Animal(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """One animal; see FittedAnimal and FitParameters."""

    sample_id: str
    image: str
    image_hw: tuple[int, int]
    category: str
    body: str
    vocabulary: str
    betas: list[float]
    pose: list[Row]
    K: tuple[Row, Row, Row]
    R: tuple[Row, Row, Row]
    t: Row
    keypoints: list[Row]
    box: tuple[float, float, float, float]


class _File(msgspec.Struct, kw_only=True):
    """The JSON file: the body's name and digest, and the parameters of each fitted animal."""

    schema: Literal["animal3dbox.quadruped_fits"] = SCHEMA
    version: Literal[1] = 1
    body: str
    digest: str
    joint_names: tuple[str, ...]
    animals: list[_Animal]


def write_quadruped(animals: Sequence[FittedAnimal], path: Path) -> ExportSummary:
    """Write fits of the embedded quadruped with the body's name and digest.

    Args:
        animals: fits of the quadruped.
        path: the JSON file; one that is there is replaced.

    Raises:
        ConfigError: there are no animals, or one is a fit of another body.

    Example:
        >>> write_quadruped([], Path("fits.json"))
        Traceback (most recent call last):
            ...
        animal3dbox.errors.ConfigError: there is no fitted body to write: label with --body fit
    """
    if not animals:
        raise ConfigError("there is no fitted body to write: label with --body fit")
    model = load_quadruped()
    for animal in animals:
        if not animal.parameters.is_of_quadruped:
            raise ConfigError(
                f"{animal.sample_id} is a fit of a model of yours, not of the embedded quadruped:"
                " export --to animal3d --model with its file"
            )
        check_whose(animal.parameters, model)
    file = _File(
        body="quadruped",
        digest=model.digest,
        joint_names=model.joint_names,
        animals=[_row(animal) for animal in animals],
    )
    write_whole(path, msgspec.json.encode(file))
    images = len({animal.image_id for animal in animals})
    return ExportSummary(files=(path,), images=images, boxes=len(animals), faults=(), notes=())


def read_quadruped(path: Path) -> tuple[FittedAnimal, ...]:
    """The fits of a file that write_quadruped wrote; `vertices_cam` of each poses it.

    Raises:
        DatasetNotFoundError: no such file.
        DatasetFormatError: not of this schema, or an animal's numbers do not fit the body.
        ConfigError: the parameters are of another version of the body.

    Example:
        >>> read_quadruped(Path("nowhere.json"))
        Traceback (most recent call last):
            ...
        animal3dbox.errors.DatasetNotFoundError: there is no file nowhere.json
    """
    file: _File = decode_json(path, _File)
    animals = tuple(_animal(row, file.digest) for row in file.animals)
    model = load_quadruped()
    for animal in animals:
        check_whose(animal.parameters, model)
        try:
            check_shape("betas", animal.parameters.betas, f"{model.beta_count}")
            check_shape("pose", animal.parameters.pose, f"{model.joint_count} 3")
            check_image_hw("image_hw", animal.image_hw)
            check_rotation("R", animal.R)
            check_intrinsics("K", animal.K)
        except (ShapeError, ValueError) as error:
            raise DatasetFormatError(f"{path}: {animal.sample_id}: {error}") from error
    if file.joint_names != tuple(model.joint_names):
        raise DatasetFormatError(
            f"{path}: joint_names are not those of the body, in its order: rows of pose could not"
            " be told apart"
        )
    return animals


def _row(animal: FittedAnimal) -> _Animal:
    """An animal as it is written."""
    parameters = animal.parameters
    numbers = {
        "betas": parameters.betas,
        "pose": parameters.pose,
        "K": animal.K,
        "R": animal.R,
        "t": animal.t,
        "keypoints": animal.keypoints_2d,
        "box": animal.box,
    }
    return _Animal(
        sample_id=animal.sample_id,
        image=animal.image_id,
        image_hw=animal.image_hw,
        category=animal.category,
        body=parameters.body,
        vocabulary=parameters.vocabulary,
        **{name: array.tolist() for name, array in numbers.items()},
    )


def _animal(row: _Animal, digest: str) -> FittedAnimal:
    """An animal as it was written."""
    betas, pose = np.array(row.betas), np.array(row.pose).reshape(-1, 3)
    return FittedAnimal(
        sample_id=row.sample_id,
        image_id=row.image,
        image_hw=row.image_hw,
        category=row.category,
        parameters=FitParameters(row.body, digest, row.vocabulary, betas, pose),
        K=np.array(row.K),
        R=np.array(row.R),
        t=np.array(row.t),
        keypoints_2d=np.array(row.keypoints).reshape(-1, 3),
        box=np.array(row.box),
    )

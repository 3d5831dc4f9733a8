"""The writer of a user's SMAL fits in Animal3D's keys, as read_animal3d reads them back."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch

from animal3dbox.datasets.exchange.export import ExportSummary
from animal3dbox.datasets.exchange.fitted_animals import Array, FittedAnimal
from animal3dbox.datasets.readers.animal3d.entries import SHAPE, VOCABULARY
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import write_whole
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.rigid_transforms import axis_angle_from_rotation
from animal3dbox.labels.fit_parameters import check_whose
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_LANDMARKS, VOCABULARIES
from animal3dbox.smal.model import SmalModel

JOINTS = (35, 33)
"""Numbers of joints of which Animal3D's keys hold a pose."""
SAME_CAMERA = 1e-9
"""Greatest difference of a K from the file's own, by its focal length, that is none."""


def write_animal3d_fits(
    animals: Sequence[FittedAnimal], path: Path, model: SmalModel
) -> ExportSummary:
    """Write fits of a SMAL model in Animal3D's keys.

    The root's turn and trans carry the camera: posed by pose, shape and trans, the body stands in
    the camera frame, x right, y down, z forward. ``flength`` is the animals' median focal length;
    an animal whose camera is another has its ``K``, a key of our own, which read_animal3d reads and
    others overlook. Keypoints of other vocabularies are written where Animal3D has one at the same
    place; masks are not written, for labels do not hold them.

    Args:
        animals: of this model.
        path: the JSON file; one that is there is replaced.
        model: the user's, which was fitted.

    Returns:
        The summary; its faults are the animals that were left out.

    Raises:
        ConfigError: there are no animals, a fit is of the embedded quadruped or of another model,
            or the model has another number of joints than SMAL.

    Example:
        >>> from animal3dbox.smal import load_quadruped
        >>> write_animal3d_fits([], Path("train.json"), load_quadruped())
        Traceback (most recent call last):
            ...
        animal3dbox.errors.ConfigError: there is no fitted body to write: label with --body fit
    """
    check_fits_of_model(animals)
    _check_model(animals, model)
    categories = sorted({animal.category for animal in animals})
    focal = float(np.median([animal.K[0, 0] for animal in animals]))
    entries: list[dict[str, Any]] = []
    faults: list[SampleError] = []
    for animal in animals:
        try:
            entry = _entry(animal, model)
        except SampleError as error:
            faults.append(error)
            continue
        entry["category"] = categories.index(animal.category)
        apart_px = np.abs(animal.K - intrinsics(focal, animal.image_hw).numpy()).max()
        if apart_px > SAME_CAMERA * focal:
            entry["K"] = animal.K.tolist()
        entries.append(entry)
    head = {
        "flength": focal,
        "categories": [{"id": i, "name": name} for i, name in enumerate(categories)],
        "info": f"fits by animal3dbox of the model with digest {model.digest}",
    }
    if set(ANIMAL3D_LANDMARKS) <= set(model.landmarks):
        head["keypoint_vids"] = [list(model.landmarks[name]) for name in ANIMAL3D_LANDMARKS]
    write_whole(path, msgspec.json.encode({"data": entries, **head}))
    own = sum("K" in entry for entry in entries)
    return ExportSummary(
        files=(path,),
        images=len({entry["img_path"] for entry in entries}),
        boxes=len(entries),
        faults=tuple(faults),
        notes=(
            *_camera_note(own, len(entries)),
            "the file has no masks: give each entry its mask_path if you have them",
        ),
    )


def check_fits_of_model(animals: Sequence[FittedAnimal]) -> None:
    """Raise a ConfigError unless there are animals, and all are fits of a model of the user's."""
    if not animals:
        raise ConfigError("there is no fitted body to write: label with --body fit")
    for animal in animals:
        if animal.parameters.is_of_quadruped:
            raise ConfigError(
                f"{animal.sample_id} is a fit of the embedded quadruped, whose parameters mean"
                " another animal on a SMAL model: export --to quadruped, or label with --body fit"
                " --model and your SMAL model"
            )


def _check_model(animals: Sequence[FittedAnimal], model: SmalModel) -> None:
    """Raise a ConfigError unless all animals are fits of a model with SMAL's joints."""
    for animal in animals:
        check_whose(animal.parameters, model)
    if model.joint_count not in JOINTS:
        raise ConfigError(
            f"Animal3D holds poses of {' or '.join(map(str, JOINTS))} joints, and the model has"
            f" {model.joint_count}"
        )


def _entry(animal: FittedAnimal, model: SmalModel) -> dict[str, Any]:
    """The element of "data" for one animal; raises SampleError."""
    parameters = animal.parameters
    betas = torch.from_numpy(parameters.betas.copy())[None]
    root = as_numpy(model.J_regressor[0] @ model.shaped(betas)[0])
    pose = parameters.pose.copy()
    pose[0] = as_numpy(axis_angle_from_rotation(torch.from_numpy(animal.R.copy())))
    x1, y1, x2, y2 = animal.box.tolist()
    height, width = animal.image_hw
    return {
        "img_path": animal.image_id,
        "bbox": [x1 + 0.5, y1 + 0.5, x2 - x1, y2 - y1],
        "keypoint_2d": _keypoints(animal).tolist(),
        "pose": pose.ravel().tolist(),
        "shape": parameters.betas[:SHAPE].tolist(),
        "shape_extra": parameters.betas[SHAPE:].tolist(),
        # R (v - root) + root + trans = R v + t
        "trans": (animal.t + animal.R @ root - root).tolist(),
        "height": height,
        "width": width,
        "with_tail": 1,
    }


def _keypoints(animal: FittedAnimal) -> Array:
    """Animal3D's keypoints (26, 3): those of the animal's that are at the same places."""
    name = animal.parameters.vocabulary
    if name not in VOCABULARIES:
        raise SampleError(
            animal.sample_id,
            "vocabulary",
            f"{name!r} is your own, and what of it Animal3D has is not known: label with one of"
            f" {', '.join(VOCABULARIES)}",
        )
    places = VOCABULARIES[name].landmarks
    keypoints = np.zeros((len(VOCABULARY), 3))
    for k, place in enumerate(VOCABULARY.landmarks):
        if place in places:
            keypoints[k] = animal.keypoints_2d[places.index(place)]
    keypoints[:, 2] = keypoints[:, 2] > 0
    return keypoints


def _camera_note(own: int, count: int) -> tuple[str, ...]:
    """A sentence on animals whose camera is not the file's."""
    if not own:
        return ()
    return (
        f"{own} of {count} animals have another camera than the file's one focal length: their K is"
        " a key of our own, which other tools overlook",
    )

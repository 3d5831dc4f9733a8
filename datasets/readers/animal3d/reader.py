"""The reader of Animal3D: photographs with 26 keypoints, masks, and fitted SMAL parameters.

Relatives of the dataset are read, too: files without parameters, with one split, with sizes left
out, with landmarks of another model.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.readers.animal3d import many_animals
from animal3dbox.datasets.readers.animal3d.betas import with_betas_of
from animal3dbox.datasets.readers.animal3d.camera import stored_camera
from animal3dbox.datasets.readers.animal3d.collected_animals import CollectedAnimals, read_splits
from animal3dbox.datasets.readers.animal3d.entries import (
    VOCABULARY,
    category_names,
    find_splits,
)
from animal3dbox.datasets.readers.distinct_animals import distinct_animals, elsewhere_notes
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.errors import (
    ConfigError,
    DatasetFormatError,
    SampleError,
    ShapeError,
)
from animal3dbox.smal.files.model_files import load_model
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_LANDMARKS
from animal3dbox.smal.model import SmalModel

FORMAT = "animal3d"
"""The format's name in reports and for --format."""


@dataclass(frozen=True)
class Animal3D:
    """The animals of a dataset and, if its model is known, their bodies.

    Attributes:
        records: the animals in the files' order, train first.
        bodies: posed by the animals' parameters; None without a model or parameters.
        zero_notes: of the records' notes that on poses that are all zero, if there are any.
    """

    records: RecordSet
    bodies: ParametersBody | None
    zero_notes: tuple[str, ...] = ()


def read_animal3d(
    path: Path,
    model: Path | None = None,
    images: Path | None = None,
    tolerance: Tolerance | None = None,
    *,
    focal_px: float | None = None,
) -> Animal3D:
    """The animals of an Animal3D folder or file.

    Args:
        path: the folder, or one of its json files.
        model: the SMAL file that the parameters belong to; without it there are keypoints and masks
            only.
        images: the folder that img_path is relative to; None: the json's.
        tolerance: how bad masks, and scores, are taken; None: not at all.
        focal_px: the user's focal length, which notes must not contradict; None without.

    Raises:
        DatasetNotFoundError: no such file or folder.
        DatasetFormatError: not JSON, or without data.
        ConfigError: nothing tells where the model has its landmarks.
        ModelFileError: the model is refused.

    """
    tolerance = tolerance or Tolerance()
    splits, animals = read_splits(path, images, tolerance)
    # An empty split beside another one is a small dataset.
    if not animals.records and not animals.faults:
        raise DatasetFormatError(
            f"{' and '.join(str(file) for file in find_splits(path))} has an empty data list"
        )
    kept, same_files = distinct_animals(animals.records, tolerance)
    records, faults = list(kept), (*animals.faults, *same_files)
    bodies, notes = None, tuple[str, ...]()
    if model is not None and animals.parameters:
        vids = next((split.keypoint_vids for split in splits if split.keypoint_vids), None)
        posed = _posed(records, animals, _model_with_landmarks(model, vids))
        records, bodies, notes = posed.records, posed.bodies, posed.notes
        faults = (*faults, *posed.faults)
    return Animal3D(
        RecordSet(
            name=FORMAT,
            records=tuple(records),
            faults=faults,
            notes=(*notes, *_notes(records, animals, focal_px), *tolerance.notes()),
            categories=tuple(
                dict.fromkeys(name for split in splits for name in category_names(split).values())
            ),
        ),
        bodies,
        _zero_notes(animals),
    )


class _Posed(NamedTuple):
    """The animals of a dataset with their bodies.

    Attributes:
        records: those that have a body, and those that come without parameters.
        bodies: posed by the animals' parameters; None if the model can pose none.
        faults: of the animals whose parameters the model cannot pose.
        notes: in whole sentences.
    """

    records: list[AnimalRecord]
    bodies: ParametersBody | None
    faults: tuple[SampleError, ...]
    notes: tuple[str, ...]


def _posed(records: Sequence[AnimalRecord], animals: CollectedAnimals, model: SmalModel) -> _Posed:
    """The animals with their bodies of a model, and with the camera that these were fitted for."""
    parameters, beta_faults, notes = with_betas_of(
        model, animals.parameters, animals.keypoints_3d, VOCABULARY
    )
    unusable = {**beta_faults, **animals.body_faults}
    usable = [record for record in records if record.sample_id not in unusable]
    if not parameters:
        return _Posed(usable, None, tuple(unusable.values()), notes)
    bodies = ParametersBody(model, parameters)
    if not any(record.sample_id in parameters for record in usable):
        return _Posed(usable, bodies, tuple(unusable.values()), notes)
    pose, camera_notes = stored_camera(usable, bodies, animals.keypoints_3d)
    notes = (*camera_notes, *notes)
    if animals.without_tail:
        notes = (*notes, _tail_note(len(animals.without_tail), len(parameters)))
    with_pose = [
        replace(record, stored_pose=pose)
        if record.sample_id in parameters and record.K is not None
        else record
        for record in usable
    ]
    return _Posed(with_pose, bodies, tuple(unusable.values()), notes)


def _notes(
    records: Sequence[AnimalRecord], animals: CollectedAnimals, focal_px: float | None
) -> tuple[str, ...]:
    """Sentences on masks, parameters and images that are not what they seem."""
    return (
        *_mask_notes(records),
        *_zero_notes(animals),
        *_notes_of_many(animals, focal_px),
        *elsewhere_notes(records),
    )


def _notes_of_many(animals: CollectedAnimals, focal_px: float | None) -> tuple[str, ...]:
    """Sentences on images of several animals, and on their focal lengths but for the user's."""
    focal, close = many_animals.ASSUMED_FOCAL, many_animals.CLOSE_PX
    taken = f"and {focal:g} px is taken for it: with it"
    if focal_px is not None:
        taken = f"and {focal_px:g} px is given for it; with {focal:g} px"
    sentences = (
        (
            animals.merged_masks,
            "images have one mask of several animals together: it is nobody's and not used",
        ),
        (animals.without_animals, "entries say that no animal is in their image"),
        (
            animals.assumed_focals,
            f"images have no focal length, {taken} their keypoint_3d lie within {close:g} px of"
            " keypoint_2d",
        ),
        (
            animals.unknown_focals if focal_px is None else [],
            f"images have no focal length, and {focal:g} px does not fit them: theirs is"
            " estimated, unless --focal-px or EXIF tell it",
        ),
    )
    return tuple(
        f"{len(images)} {words}; the first is {images[0]}" for images, words in sentences if images
    )


def _mask_notes(records: Sequence[AnimalRecord]) -> tuple[str, ...]:
    """A sentence on animals whose mask is the rendered one, if there are any."""
    rendered = sum(record.mask_source == "rendered" for record in records)
    if not rendered:
        return ()
    return (
        (
            f"{rendered} of {len(records)} animals have no mask of their own (mask_path missing, or"
            " its file): the rendered one is used"
        ),
    )


def _zero_notes(animals: CollectedAnimals) -> tuple[str, ...]:
    """A sentence on animals whose pose is all zero, the root's with it."""
    if not animals.without_parameters:
        return ()
    return (
        f"the pose of {len(animals.without_parameters)} animals is all zero, which stands for no"
        f" parameters; the first is {animals.without_parameters[0]}",
    )


def _tail_note(without: int, animals: int) -> str:
    """A sentence on the bodies that were fitted without their tail."""
    return (
        f"{without} of {animals} bodies were fitted without their tail (with_tail 0), but have the"
        " model's straight one: boxes that hold it are too long; label the dataset with --tail"
        " drop"
    )


def _model_with_landmarks(path: Path, vids: list[list[int]] | None) -> SmalModel:
    """The model of a file, with landmarks of its own or else of the dataset.

    A pickle of another topology than SMAL's has none of its own.

    Args:
        path: the model's file.
        vids: the dataset's keypoint_vids, vertex ids of each keypoint; None without.

    Raises:
        ConfigError: there are none.
        DatasetFormatError: the dataset's do not belong to the model.

    """
    model = load_model(path)
    if model.landmarks:
        return model
    if not vids:
        raise ConfigError(
            f"{path} has no landmarks (its vertices are not SMAL's) and the dataset no"
            " keypoint_vids: nothing tells its nose from its tail"
        )
    if len(vids) != len(ANIMAL3D_LANDMARKS):
        raise DatasetFormatError(
            f"keypoint_vids must be {len(ANIMAL3D_LANDMARKS)} lists of vertex ids, got {len(vids)}"
        )
    try:
        return replace(
            model,
            landmarks={
                name: tuple(ids) for name, ids in zip(ANIMAL3D_LANDMARKS, vids, strict=True)
            },
        )
    except ShapeError as error:
        raise DatasetFormatError(
            f"keypoint_vids do not belong to the model {path}: {error}"
        ) from error

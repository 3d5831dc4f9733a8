"""The reader of Animal3D: photographs with 26 keypoints, masks, and fitted SMAL parameters.

Relatives of the dataset are read, too: files without parameters, with one split, with sizes left
out, with landmarks of another model.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.readers.animal3d.camera import stored_camera
from animal3dbox.datasets.readers.animal3d.entries import (
    Animal3DEntry,
    SplitFile,
    category_names,
    find_splits,
    numbered_id,
    parameters_of_entry,
    record_of_entry,
)
from animal3dbox.datasets.readers.elements import decoded
from animal3dbox.datasets.readers.tolerance import Tolerance, elsewhere_notes, one_name_a_file
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import (
    ConfigError,
    DatasetFormatError,
    DatasetNotFoundError,
    SampleError,
    ShapeError,
)
from animal3dbox.smal.files.model_files import load_model
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_LANDMARKS
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.parameters import SmalParameters

FORMAT = "animal3d"
"""The format's name in reports and for --format."""
_SCALED_LIMBS = (
    "scales the limbs, as dog models do and SMAL does not: the body would be wrong. Leave --model"
    " out, or remove the key to pose it without"
)


@dataclass(frozen=True)
class Animal3D:
    """The animals of a dataset and, if its model is known, their bodies.

    Attributes:
        records: the animals in the files' order, train first.
        bodies: posed by the animals' parameters; None without a model or parameters.
    """

    records: RecordSet
    bodies: ParametersBody | None


def read_animal3d(
    path: Path,
    model: Path | None = None,
    images: Path | None = None,
    tolerance: Tolerance | None = None,
) -> Animal3D:
    """The animals of an Animal3D folder or file.

    Args:
        path: the folder, or one of its json files.
        model: the SMAL file that the parameters belong to; without it there are keypoints and masks
            only.
        images: the folder that img_path is relative to; None: the json's.
        tolerance: how bad masks, and scores, are taken; None: not at all.

    Raises:
        DatasetNotFoundError: no such file or folder.
        DatasetFormatError: not JSON, or without data.
        ConfigError: nothing tells where the model has its landmarks.
        ModelFileError: the model is refused.

    """
    tolerance = tolerance or Tolerance()
    splits, animals = _read_splits(path, images, tolerance)
    # An empty split beside another one is a small dataset.
    if not animals.records and not animals.faults:
        raise DatasetFormatError(
            f"{' and '.join(str(file) for file in find_splits(path))} has an empty data list"
        )
    kept, same_files = one_name_a_file(animals.records)
    records, faults = list(kept), (*animals.faults, *same_files)
    if model is not None and animals.limb_scale_faults:
        records = [
            record for record in records if record.sample_id not in animals.limb_scale_faults
        ]
        faults = (*faults, *animals.limb_scale_faults.values())
    bodies, notes = None, tuple[str, ...]()
    if model is not None and animals.parameters:
        vids = next((split.keypoint_vids for split in splits if split.keypoint_vids), None)
        bodies = ParametersBody(_model_with_landmarks(model, vids), animals.parameters)
        pose, notes = stored_camera(records, bodies, animals.keypoints_3d)
        if animals.without_tail:
            notes = (*notes, _tail_note(len(animals.without_tail), len(animals.parameters)))
        records = [
            replace(record, stored_pose=pose) if record.sample_id in animals.parameters else record
            for record in records
        ]
    return Animal3D(
        RecordSet(
            name=FORMAT,
            records=tuple(records),
            faults=faults,
            notes=(*notes, *_notes(records, animals), *tolerance.notes()),
            categories=tuple(
                dict.fromkeys(name for split in splits for name in category_names(split).values())
            ),
        ),
        bodies,
    )


def _notes(records: Sequence[AnimalRecord], animals: "_Animals") -> tuple[str, ...]:
    """Sentences on masks, parameters and images that are not what they seem."""
    return (*_mask_notes(records), *_zero_notes(animals), *elsewhere_notes(records))


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


def _are_zero(parameters: SmalParameters) -> bool:
    """Whether all of a body's parameters are zero, which stands for none."""
    numbers = (parameters.pose, parameters.betas, parameters.trans)
    return not any(bool(part.any()) for part in numbers)


def _zero_notes(animals: "_Animals") -> tuple[str, ...]:
    """A sentence on animals whose parameters are all zero."""
    if not animals.without_parameters:
        return ()
    return (
        f"the parameters of {len(animals.without_parameters)} animals are all zero, which stands"
        f" for none; the first is {animals.without_parameters[0]}",
    )


def _tail_note(without: int, animals: int) -> str:
    """A sentence on the bodies that were fitted without their tail."""
    return (
        f"{without} of {animals} bodies were fitted without their tail (with_tail 0), but have the"
        " model's straight one: boxes that hold it are too long; label the dataset with --tail"
        " drop"
    )


@dataclass(frozen=True)
class _Animals:
    """The animals of the splits, collected one by one.

    Attributes:
        records: the sound ones, in the files' order.
        faults: the others, in the files' order.
        parameters: sample id -> the body's parameters.
        keypoints_3d: sample id -> the stored landmarks (26, 3).
        without_tail: sample ids of bodies that were fitted without a tail.
        limb_scale_faults: sample id -> the error that scales of single limbs are to a model.
        image_counts: image -> number of its entries.
        without_parameters: sample ids of animals whose parameters are all zero.
        places: content of an entry -> where it stands.
    """

    records: list[AnimalRecord] = field(default_factory=list)
    faults: list[SampleError] = field(default_factory=list)
    parameters: dict[str, SmalParameters] = field(default_factory=dict)
    keypoints_3d: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    without_tail: set[str] = field(default_factory=set)
    limb_scale_faults: dict[str, SampleError] = field(default_factory=dict)
    image_counts: Counter[str] = field(default_factory=Counter)
    without_parameters: list[str] = field(default_factory=list)
    places: dict[bytes, str] = field(default_factory=dict)


def _read_splits(
    path: Path, images: Path | None, tolerance: Tolerance
) -> tuple[list[SplitFile], _Animals]:
    """The files of a dataset and all their animals; see read_animal3d."""
    splits, animals = list[SplitFile](), _Animals()
    for file in find_splits(path):
        root = images or file.parent
        if not root.is_dir():
            raise DatasetNotFoundError(f"there is no folder of images {root}")
        splits.append(decode_json(file, SplitFile))
        _read_split(splits[-1], file.name, root, animals, tolerance=tolerance)
    return splits, animals


def _read_split(
    split: SplitFile, name: str, root: Path, animals: _Animals, *, tolerance: Tolerance
) -> None:
    """Add the animals of a split; those of one image after its first get "#1", "#2", ...

    Args:
        split: the file's content.
        name: the file's name.
        root: the folder that img_path is relative to.
        animals: the collection that they are added to.
        tolerance: how bad parts are taken.

    """
    for i, raw in enumerate(split.data):
        try:
            place = f"{name} entry {i}"
            sample_id = numbered_id(raw, place, animals.image_counts, root)
            if (first := animals.places.setdefault(bytes(raw), place)) != place:
                raise SampleError(
                    sample_id,
                    "entry",
                    f"{place} is {first} once more: remove one, or it counts twice",
                )
            entry = decoded(raw, Animal3DEntry, sample_id)
            record = record_of_entry(entry, sample_id, root, split, tolerance=tolerance)
            parameters = parameters_of_entry(entry, sample_id)
        except SampleError as error:
            animals.faults.append(error)
            continue
        animals.records.append(record)
        if parameters is not None and _are_zero(parameters):
            animals.without_parameters.append(sample_id)
        elif parameters is not None:
            animals.parameters[sample_id] = parameters
            if not entry.with_tail:
                animals.without_tail.add(sample_id)
            if any(entry.bone or ()):
                animals.limb_scale_faults[sample_id] = SampleError(sample_id, "bone", _SCALED_LIMBS)
        if entry.keypoint_3d is not None and {len(row) for row in entry.keypoint_3d} == {3}:
            animals.keypoints_3d[sample_id] = np.array(entry.keypoint_3d, dtype=np.float64)


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

"""Animal3D: photographs with 26 keypoints, masks, and SMAL parameters fitted to them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.images.photos import resolve_inside, stored_size
from animal3dbox.datasets.readers.animal3d.camera import stored_camera
from animal3dbox.datasets.readers.elements import decoded, image_size, read_rows
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import (
    ConfigError,
    DatasetFormatError,
    DatasetNotFoundError,
    SampleError,
    ShapeError,
)
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.smal.files.model_files import load_model
from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26, VOCABULARIES
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.parameters import SmalParameters

FORMAT = "animal3d"
SPLITS = ("train.json", "test.json")
VOCABULARY = VOCABULARIES["animal3d26"]
PARAMETERS = ("pose", "shape", "shape_extra", "trans")
SHAPE = 20
"""So many betas are in shape where others are in shape_extra."""
SCALED = (
    "scales the limbs, as dog models do and SMAL does not: the body would be wrong. Leave --model"
    " out, or remove the key to pose it without"
)


class SplitFile(msgspec.Struct):
    """A split's file; only data is required."""

    data: list[msgspec.Raw]
    flength: float | None = None
    categories: object = None
    keypoint_vids: list[list[int]] | None = None


class _Named(msgspec.Struct):
    """What names a sample, readable even where the rest is not."""

    img_path: str


class Animal3DEntry(_Named):
    """One element of "data"; other keys are left alone.

    2D-only sets have no parameters, and relatives no sizes.
    """

    keypoint_2d: list[list[float | None]]
    height: int | None = None
    width: int | None = None
    mask_path: str | None = None
    rd_mask_path: str | None = None
    category: int | str | None = None
    pose: list[float] | None = None
    shape: list[float] | None = None
    shape_extra: list[float] | None = None
    trans: list[float] | None = None
    keypoint_3d: list[list[float]] | None = None
    with_tail: int | bool = 1
    bone: list[float] | None = None


@dataclass(frozen=True)
class Animal3D:
    """A dataset and, if its model was given, the bodies of its animals.

    Attributes:
        records: in the files' order, train first.
        bodies: by their parameters; None without a model.
    """

    records: RecordSet
    bodies: ParametersBody | None


def find_splits(path: Path) -> list[Path]:
    """The files of a dataset given by its root or by one of its files.

    Raises DatasetNotFoundError if there are none.
    """
    if path.is_file():
        return [path]
    found = [path / name for name in SPLITS if (path / name).is_file()]
    if not found:
        raise DatasetNotFoundError(
            f"{path} must hold {' or '.join(SPLITS)}: download Animal3D there first (see"
            " docs/formats.md)"
        )
    return found


def read_animal3d(path: Path, model: Path | None = None, images: Path | None = None) -> Animal3D:
    """The animals of an Animal3D folder or file.

    Args:
        path: the folder, or one of its json files.
        model: the SMAL file that the parameters belong to; without it there are keypoints and masks
            only.
        images: the folder that img_path is relative to; None: the json's.

    Raises:
        DatasetNotFoundError: no such file or folder.
        DatasetFormatError: not JSON, or without data.
        ConfigError: nothing tells where the model has its landmarks.
        ModelFileError: the model is refused.

    """
    found = _Found([], [], {}, {}, set(), {}, Counter())
    vids: list[list[int]] | None = None
    names: list[str] = []
    for file in find_splits(path):
        root = images or file.parent
        if not root.is_dir():
            raise DatasetNotFoundError(f"there is no folder of images {root}")
        split: SplitFile = decode_json(file, SplitFile)
        vids = vids or split.keypoint_vids
        names += [name for name in _names(split).values() if name not in names]
        _read_split(split, file.name, root, found)
    if not found.records and not found.faults:  # one empty split beside another is a small dataset
        raise DatasetFormatError(
            f"{' and '.join(str(file) for file in find_splits(path))} has an empty data list"
        )
    records, faults = found.records, tuple(found.faults)
    if model is not None and found.scaled:
        records = [record for record in records if record.sample_id not in found.scaled]
        faults = (*faults, *found.scaled.values())
    if model is None or not found.parameters:
        return Animal3D(
            RecordSet(FORMAT, tuple(records), faults, _about_masks(records), tuple(names)), None
        )
    bodies = ParametersBody(_model_with_landmarks(model, vids), found.parameters)
    pose, notes = stored_camera(records, bodies, found.keypoints_3d)
    if found.tailless:
        notes = (*notes, _about_tails(len(found.tailless), len(found.parameters)))
    posed = tuple(
        replace(record, stored_pose=pose) if record.sample_id in found.parameters else record
        for record in records
    )
    return Animal3D(
        RecordSet(FORMAT, posed, faults, (*notes, *_about_masks(records)), tuple(names)), bodies
    )


def _about_masks(records: Sequence[AnimalRecord]) -> tuple[str, ...]:
    rendered = sum(record.mask_source == "rendered" for record in records)
    if not rendered:
        return ()
    return (
        (
            f"{rendered} of {len(records)} animals have no mask of their own (mask_path missing, or"
            " its file): the rendered one is used"
        ),
    )


def _about_tails(without: int, animals: int) -> str:
    return (
        f"{without} of {animals} bodies were fitted without their tail (with_tail 0), but have the"
        " model's straight one: boxes that hold it are too long; label the dataset with --tail"
        " drop"
    )


@dataclass(frozen=True)
class _Found:
    """What has been read so far.

    Attributes:
        records: in the files' order.
        faults: likewise.
        parameters: by sample id.
        keypoints_3d: by sample id.
        tailless: those fitted without a tail.
        scaled: those whose limbs have scales of their own, and the error that this is.
        seen: image -> entries.
    """

    records: list[AnimalRecord]
    faults: list[SampleError]
    parameters: dict[str, SmalParameters]
    keypoints_3d: dict[str, NDArray[np.float64]]
    tailless: set[str]
    scaled: dict[str, SampleError]
    seen: Counter[str]


def _read_split(split: SplitFile, name: str, root: Path, found: _Found) -> None:
    """Add a file's animals; several of one image are told apart by "#1", "#2"."""
    for i, raw in enumerate(split.data):
        try:
            sample_id = numbered_id(raw, f"{name} entry {i}", found.seen)
            entry = decoded(raw, Animal3DEntry, sample_id)
            record, fitted = _record(entry, sample_id, root, split), _parameters(entry, sample_id)
        except SampleError as error:
            found.faults.append(error)
            continue
        found.records.append(record)
        if fitted is not None:
            found.parameters[sample_id] = fitted
            if not entry.with_tail:
                found.tailless.add(sample_id)
            if any(entry.bone or ()):
                found.scaled[sample_id] = SampleError(sample_id, "bone", SCALED)
        if entry.keypoint_3d is not None and {len(row) for row in entry.keypoint_3d} == {3}:
            found.keypoints_3d[sample_id] = np.array(entry.keypoint_3d, dtype=np.float64)


def numbered_id(raw: msgspec.Raw, place: str, seen: Counter[str]) -> str:
    """An entry's sample id, and one more of its image seen.

    Raises SampleError, which names its place, if it has no image.
    """
    image = decoded(raw, _Named, place).img_path
    if not image.strip():
        raise SampleError(place, "img_path", f"is {image!r}, which names no file")
    seen[image] += 1
    return image if seen[image] == 1 else f"{image}#{seen[image] - 1}"


def _model_with_landmarks(path: Path, vids: list[list[int]] | None) -> SmalModel:
    """The model.

    One without landmarks, as a pickle of another topology than SMAL's is, gets the dataset's.
    """
    model = load_model(path)
    if model.landmarks:
        return model
    if not vids:
        raise ConfigError(
            f"{path} has no landmarks (its vertices are not SMAL's) and the dataset no"
            " keypoint_vids: nothing tells its nose from its tail"
        )
    if len(vids) != len(ANIMAL3D_26):
        raise DatasetFormatError(
            f"keypoint_vids must be {len(ANIMAL3D_26)} lists of vertex ids, got {len(vids)}"
        )
    try:
        return replace(
            model, landmarks={name: tuple(ids) for name, ids in zip(ANIMAL3D_26, vids, strict=True)}
        )
    except ShapeError as error:
        raise DatasetFormatError(
            f"keypoint_vids do not belong to the model {path}: {error}"
        ) from error


def _record(entry: Animal3DEntry, sample_id: str, root: Path, split: SplitFile) -> AnimalRecord:
    """One record, checked."""
    image = resolve_inside(root, entry.img_path, sample_id, "img_path")
    unsaid = entry.height is None or entry.width is None
    image_hw = (
        stored_size(image, sample_id)
        if unsaid
        else image_size(entry.height or 0, entry.width or 0, sample_id)
    )
    if split.flength is not None and not (np.isfinite(split.flength) and split.flength > 0):
        raise SampleError(
            sample_id, "flength", f"must be a focal length in px, got {split.flength}"
        )
    mask_path, mask_source = _mask_path(entry, root, sample_id)
    return AnimalRecord(
        sample_id=sample_id,
        image_id=entry.img_path,
        image_path=image,
        image_hw=image_hw,
        vocabulary=VOCABULARY,
        keypoints_2d=_keypoints(entry.keypoint_2d, sample_id),
        mask_runs=None,
        category=_category(entry.category, split),
        mask_path=mask_path,
        mask_source=mask_source,
        K=None if split.flength is None else intrinsics(split.flength, image_hw).numpy(),
        K_source="dataset",
    )


def _keypoints(rows: list[list[float | None]], sample_id: str) -> NDArray[np.float64]:
    """(26, 3) with visibility 0 or 1: the format has 0 and 1, converted sets 2."""
    keypoints = read_rows(rows, len(VOCABULARY), sample_id, "keypoint_2d")
    if not np.isin(keypoints[:, 2], (0, 1, 2)).all():
        raise SampleError(
            sample_id,
            "keypoint_2d",
            f"visibility must be 0, 1 or 2, got {sorted(set(keypoints[:, 2].tolist()))}",
        )
    return np.concatenate((keypoints[:, :2], keypoints[:, 2:] > 0), axis=1)


def _mask_path(entry: Animal3DEntry, root: Path, sample_id: str) -> tuple[Path | None, str]:
    """The mask's file, or else the rendered one's, and which it is."""
    for field in ("mask_path", "rd_mask_path"):
        path = getattr(entry, field)
        if path:
            try:
                return resolve_inside(root, path, sample_id, field), (
                    "dataset" if field == "mask_path" else "rendered"
                )
            except SampleError:
                if field == "rd_mask_path" or not entry.rd_mask_path:
                    raise
    return None, "dataset"


def _category(category: int | str | None, split: SplitFile) -> str:
    """The animal's name, as the file names its category; else what the entry says."""
    return _names(split).get(str(category), "animal" if category is None else str(category))


def _names(split: SplitFile) -> dict[str, str]:
    """Category id -> name, by the file's list of names or of {id, name}, or its dictionary by id."""
    listed = split.categories
    if isinstance(listed, dict):
        named = {str(key): value for key, value in listed.items()}
    else:
        entries = listed if isinstance(listed, list) else []
        named = {
            str(e.get("id", i) if isinstance(e, dict) else i): (
                e.get("name") if isinstance(e, dict) else e
            )
            for i, e in enumerate(entries)
        }
    return {key: value for key, value in named.items() if isinstance(value, str)}


def _parameters(entry: Animal3DEntry, sample_id: str) -> SmalParameters | None:
    """The body's parameters; None in 2D-only sets."""
    if not entry.pose and not entry.shape and not entry.trans:
        return None
    for field in ("pose", "shape", "trans"):
        if getattr(entry, field) is None:
            raise SampleError(
                sample_id, field, "is missing, though there are other parameters of a body"
            )
    values = {name: np.array(getattr(entry, name) or [], dtype=np.float64) for name in PARAMETERS}
    for field, array in values.items():
        if not np.isfinite(array).all():
            raise SampleError(sample_id, field, "must be finite")
    if len(values["shape_extra"]) and len(values["shape"]) != SHAPE:
        said = (
            f"comes after {SHAPE} betas, but shape has {len(values['shape'])}: which of the model's"
            " they are cannot be told"
        )
        raise SampleError(
            sample_id,
            "shape_extra",
            f"{said}; give all betas in order in shape, and no shape_extra",
        )
    if len(values["trans"]) != 3 or len(values["pose"]) not in (105, 99):
        raise SampleError(
            sample_id,
            "pose, trans",
            f"must have 105 or 99 and 3 numbers, got {len(values['pose'])} and"
            f" {len(values['trans'])}",
        )
    pose, betas, trans = (
        torch.from_numpy(a)
        for a in (
            values["pose"],
            np.concatenate((values["shape"], values["shape_extra"])),
            values["trans"],
        )
    )
    return SmalParameters(pose, betas, trans)

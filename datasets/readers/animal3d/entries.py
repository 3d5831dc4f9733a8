"""The entries of Animal3D's files: their form, and the checks that make a record of each."""

from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.datasets.images.named_files import portable_name, resolve_inside
from animal3dbox.datasets.images.photos import stored_size
from animal3dbox.datasets.readers.elements import (
    Matrix,
    decoded,
    image_size,
    read_box,
    read_matrix,
    read_rows,
)
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.sightings import SightingKeys, sighting_of
from animal3dbox.errors import DatasetNotFoundError, SampleError, ShapeError
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.checks import check_intrinsics
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.parameters import SmalParameters

SPLITS = ("train.json", "test.json")
"""The files of a dataset's folder, in the order in which they are read."""
MANY = "*_multi_animal.json"
"""The files of a folder that has none of SPLITS: SMAL+'s, whose entries are of several animals."""
VOCABULARY = VOCABULARIES["animal3d26"]
"""The keypoints of every animal."""
PARAMETERS = ("pose", "shape", "shape_extra", "trans")
"""The keys of an entry that hold its body's parameters, as errors name them."""
SHAPE = 20
"""Number of betas in shape, where further ones are in shape_extra."""


class SplitFile(msgspec.Struct):
    """The file of a split, of which only data is required."""

    data: list[msgspec.Raw]
    flength: float | None = None
    categories: object = None
    keypoint_vids: list[list[int]] | None = None


class _ImageName(SightingKeys):
    """The part of an entry that names its sample, readable even where the rest is not."""

    img_path: str


class Animal3DEntry(_ImageName):
    """One element of "data", by the keys that we use; others are left alone.

    Sets of 2D annotations have no parameters, and some relatives no sizes.
    """

    keypoint_2d: list[list[float | None]]
    height: int | None = None
    width: int | None = None
    mask_path: Any = None
    rd_mask_path: Any = None
    category: int | str | None = None
    pose: list[float | list[float]] | None = None
    shape: list[float | list[float]] | None = None
    shape_extra: list[float | list[float]] | None = None
    trans: list[float | list[float]] | None = None
    keypoint_3d: list[list[float]] | None = None
    with_tail: int | bool = 1
    bone: list[float] | None = None
    K: Matrix | None = None  # our own key, of exports of fits


class AnimalOfMany(Animal3DEntry):
    """One animal's element of an entry of several, whose box is its own."""

    bbox: list[float] | None = None
    has_zero_pose: bool = False  # our own key, of a row of zeros that was left out


class EntryOfMany(_ImageName):
    """An entry of which only its image and its number of animals are read, if it tells one."""

    num_animals: object = msgspec.UNSET


def find_splits(path: Path) -> list[Path]:
    """The files of a dataset given by its root or by one of its files.

    Raises DatasetNotFoundError if there are none.
    """
    if path.is_file():
        return [path]
    splits = [path / name for name in SPLITS if (path / name).is_file()]
    splits = splits or sorted(path.glob(MANY))
    if not splits:
        raise DatasetNotFoundError(
            f"{path} must hold {' or '.join(SPLITS)}: download Animal3D and unzip it there, the"
            " annotations beside the folders of images and masks that they name"
        )
    return splits


def numbered_id(raw: msgspec.Raw, place: str, image_counts: Counter[str], root: Path) -> str:
    """The sample id of an entry: its image, and "#k" for the animals after the first.

    Args:
        raw: the entry.
        place: the file and the entry's number, named in the error.
        image_counts: image -> number of its entries so far, to which this one is added.
        root: the folder of images, from which on absolute paths are taken.

    Raises:
        SampleError: the entry has no image.

    """
    image = decoded(raw, _ImageName, place).img_path
    if not image.strip():
        raise SampleError(place, "img_path", f"is {image!r}, which names no file")
    image = portable_name(root, image)
    image_counts[image] += 1
    return image if image_counts[image] == 1 else f"{image}#{image_counts[image] - 1}"


def record_of_entry(
    entry: Animal3DEntry, sample_id: str, root: Path, split: SplitFile, *, tolerance: Tolerance
) -> AnimalRecord:
    """The record of one entry, checked; raises SampleError."""
    name = portable_name(root, entry.img_path)
    image = resolve_inside(root, name, sample_id, "img_path")
    if entry.height is None or entry.width is None:
        image_hw = stored_size(image, sample_id, upright=tolerance.upright)
    else:
        image_hw = image_size(entry.height, entry.width, sample_id)
    if split.flength is not None and not (np.isfinite(split.flength) and split.flength > 0):
        raise SampleError(
            sample_id, "flength", f"must be a focal length in px, got {split.flength}"
        )
    is_of_many = isinstance(entry, AnimalOfMany)
    mask_path, mask_source = tolerance.part(lambda: _mask_path(entry, root, sample_id, image)) or (
        None,
        "dataset",
    )
    return AnimalRecord(
        sample_id=sample_id,
        image_id=name,
        image_path=image,
        image_hw=image_hw,
        vocabulary=VOCABULARY,
        keypoints_2d=_keypoints(entry.keypoint_2d, sample_id, tolerance),
        mask_runs=None,
        category=_category(entry.category, split),
        mask_path=mask_path,
        mask_source=mask_source,
        K=_intrinsics(entry, split, image_hw, sample_id),
        K_source="given" if entry.K is not None or is_of_many else "dataset",
        box=_box(entry, sample_id, tolerance) if isinstance(entry, AnimalOfMany) else None,
        sighting=sighting_of(entry),
        upright=tolerance.upright,
    )


def _box(entry: AnimalOfMany, sample_id: str, tolerance: Tolerance) -> NDArray[np.float64] | None:
    """The animal's own box (4,) xyxy px; None without."""
    numbers = entry.bbox
    return None if numbers is None else tolerance.part(lambda: read_box(numbers, sample_id, "bbox"))


def _intrinsics(
    entry: Animal3DEntry, split: SplitFile, image_hw: tuple[int, int], sample_id: str
) -> NDArray[np.float64] | None:
    """The entry's own K, else that of the file's focal length; None without either."""
    if entry.K is None:
        return None if split.flength is None else intrinsics(split.flength, image_hw).numpy()
    try:
        K = read_matrix(entry.K)
        check_intrinsics("K", K)
    except (ShapeError, ValueError) as error:
        raise SampleError(sample_id, "K", str(error)) from error
    return K


def _keypoints(
    rows: list[list[float | None]], sample_id: str, tolerance: Tolerance
) -> NDArray[np.float64]:
    """Keypoints (26, 3) with visibility 0 or 1, or scores.

    The format has 0 and 1; sets converted from others have 2 as well.
    """
    keypoints = read_rows(rows, len(VOCABULARY), sample_id, "keypoint_2d")
    marked = tolerance.keypoints(keypoints, sample_id, "keypoint_2d")
    return np.concatenate((marked[:, :2], np.minimum(marked[:, 2:], 1.0)), axis=1)


def _mask_path(
    entry: Animal3DEntry, root: Path, sample_id: str, picture: Path
) -> tuple[Path | None, str]:
    """The file of the mask, or else of the rendered one, and the record's mask_source.

    A mask_path that is the picture's own path, as one converter writes it, is no mask.
    """
    for field in ("mask_path", "rd_mask_path"):
        path = getattr(entry, field)
        if path and path != entry.img_path:
            try:
                if not isinstance(path, str):
                    raise SampleError(sample_id, field, f"must be a path, got {path!r}")
                mask = resolve_inside(root, path, sample_id, field)
                if mask == picture:
                    continue  # its own name, written otherwise
                return mask, "dataset" if field == "mask_path" else "rendered"
            except SampleError:
                if field == "rd_mask_path" or not entry.rd_mask_path:
                    raise
    return None, "dataset"


def _category(category: int | str | None, split: SplitFile) -> str:
    """The category's name by the file's list, or else as it stands in the entry."""
    return category_names(split).get(str(category), "animal" if category is None else str(category))


def category_names(split: SplitFile) -> dict[str, str]:
    """Category id -> name, by the file's list of names or of {id, name}, or its dictionary."""
    categories = split.categories
    if isinstance(categories, dict):
        names = {str(key): value for key, value in categories.items()}
    else:
        entries = categories if isinstance(categories, list) else []
        names = {
            str(e.get("id", i) if isinstance(e, dict) else i): (
                e.get("name") if isinstance(e, dict) else e
            )
            for i, e in enumerate(entries)
        }
    return {key: value for key, value in names.items() if isinstance(value, str)}


def _flat(
    numbers: list[float | list[float]] | None, sample_id: str, field: str
) -> NDArray[np.float64]:
    """Parameters as one array, of a list of numbers or of rows of them, such as three a joint."""
    try:
        return np.array(numbers or [], dtype=np.float64).reshape(-1)
    except ValueError as error:
        raise SampleError(sample_id, field, "must be numbers, or rows as long") from error


def stored_landmarks(entry: Animal3DEntry) -> NDArray[np.float64] | None:
    """The landmarks (26, 3) of an entry, NaN where a fourth number says that there is none.

    None if it has none, or of another form.
    """
    rows = entry.keypoint_3d
    if rows is None or {len(row) for row in rows} not in ({3}, {4}):
        return None
    points = np.array(rows, dtype=np.float64)
    if points.shape[1] == 4:
        points[points[:, 3] <= 0] = np.nan
    return points[:, :3]


def parameters_of_entry(entry: Animal3DEntry, sample_id: str) -> SmalParameters | None:
    """The parameters of an entry's body; None in sets of 2D annotations; raises SampleError."""
    if not entry.pose and not entry.shape and not entry.trans:
        return None
    for field in ("pose", "shape", "trans"):
        if getattr(entry, field) is None:
            raise SampleError(
                sample_id, field, "is missing, though there are other parameters of a body"
            )
    values = {name: _flat(getattr(entry, name), sample_id, name) for name in PARAMETERS}
    for field, array in values.items():
        if not np.isfinite(array).all():
            raise SampleError(sample_id, field, "must be finite")
    if len(values["shape_extra"]) and len(values["shape"]) != SHAPE:
        raise SampleError(
            sample_id,
            "shape_extra",
            f"comes after {SHAPE} betas, but shape has {len(values['shape'])}: which of the model's"
            " they are cannot be told; give all betas in order in shape, and no shape_extra",
        )
    if len(values["trans"]) != 3 or len(values["pose"]) not in (105, 99):
        raise SampleError(
            sample_id,
            "pose, trans",
            f"must have 105 or 99 and 3 numbers, got {len(values['pose'])} and"
            f" {len(values['trans'])}",
        )
    betas = np.concatenate((values["shape"], values["shape_extra"]))
    return SmalParameters(
        torch.from_numpy(values["pose"]), torch.from_numpy(betas), torch.from_numpy(values["trans"])
    )

"""Entries of several animals, as SMAL+'s files write them: one an image, with a row an animal.

Such an entry is taken apart into one element an animal, in the form of Animal3D's own entries, so
that each animal is read, or is faulty, by itself.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError
from animal3dbox.smal.parameters import SmalParameters

COUNT = "num_animals"
"""The key by which an entry of several animals is told from one of Animal3D's own."""
ROWS = ("bbox", "keypoint_2d", "keypoint_3d", "pose", "shape", "shape_extra", "trans", "bone")
"""Keys whose value is a list of one row an animal; null or absent stands for none of all."""
EITHER = ("category", "supercategory", "with_tail")
"""Keys whose value may be one for all animals, or a list of one an animal."""
MASKS = ("mask_path", "rd_mask_path")
"""Keys whose value is the picture of a mask, or a list of one an animal."""
ASSUMED_FOCAL = 5000.0
"""Focal length in px that several mesh regressors are trained with and their files do not tell."""
CLOSE_PX = 5.0
"""Median distance of keypoints from the projected landmarks up to which it is believed."""
Array = NDArray[np.float64]


def is_of_many(entry: object) -> bool:
    """Whether a decoded entry is of several animals."""
    return isinstance(entry, dict) and COUNT in entry


def animals_of_entry(entry: dict[str, Any], sample_id: str) -> list[dict[str, Any]]:
    """One element an animal, each in the form of Animal3D's own entries.

    A mask that is the picture's, of several animals together, is nobody's: the elements have none.
    A row of zeros in pose stands for no parameters, and one in bbox for no box.

    Args:
        entry: of several animals, decoded.
        sample_id: named in every error.

    Raises:
        SampleError: num_animals is no count, or a list has another length.

    Example:
        >>> entry = {"img_path": "a.jpg", "num_animals": 2, "trans": [[0, 0, 5], [1, 0, 6]]}
        >>> [animal["trans"] for animal in animals_of_entry(entry, "a.jpg")]
        [[0, 0, 5], [1, 0, 6]]
    """
    count = entry[COUNT]
    if isinstance(count, float) and count.is_integer():
        count = int(count)
    if isinstance(count, bool) or not isinstance(count, int) or count < 0:
        raise SampleError(sample_id, COUNT, f"must be the number of animals, got {count!r}")
    common = {key: value for key, value in entry.items() if key != COUNT}
    lists: dict[str, Sequence[Any]] = {}
    for key in (*ROWS, *EITHER, *MASKS):
        value = common.get(key)
        if value is None or (key in (*EITHER, *MASKS) and not isinstance(value, list)):
            continue
        if not isinstance(value, list) or len(value) != count:
            length = len(value) if isinstance(value, list) else "no list"
            raise SampleError(
                sample_id,
                key,
                f"must be a list of one row for each of {count} animals ({COUNT}), got {length}",
            )
        lists[key] = value
    if count > 1:
        common |= dict.fromkeys(MASKS)
    animals = [common | {key: rows[k] for key, rows in lists.items()} for k in range(count)]
    return [_without_zero_rows(animal) for animal in animals]


def has_merged_mask(entry: dict[str, Any]) -> bool:
    """Whether an entry of several animals has one mask for all of them."""
    paths = [entry.get(key) for key in MASKS]
    return entry.get(COUNT, 0) > 1 and any(isinstance(path, str) and path for path in paths)


def _without_zero_rows(animal: dict[str, Any]) -> dict[str, Any]:
    """An animal's element without the parameters and the box that zeros stand for."""
    if _is_zero(animal.get("pose")):
        animal |= dict.fromkeys(("pose", "shape", "shape_extra", "trans", "keypoint_3d"))
        animal["has_zero_pose"] = True
    return animal | ({"bbox": None} if _is_zero(animal.get("bbox")) else {})


def _is_zero(row: object) -> bool:
    """Whether a row holds zeros alone, nested or not."""
    if isinstance(row, list):
        return bool(row) and all(_is_zero(part) for part in row)
    return row == 0 and not isinstance(row, bool)


def encoded(animal: dict[str, Any]) -> msgspec.Raw:
    """An animal's element as a file of single animals would hold it."""
    return msgspec.Raw(msgspec.json.encode(animal))


def assumed_intrinsics(
    records: Sequence[AnimalRecord],
    landmarks: Mapping[str, Array],
    parameters: Mapping[str, SmalParameters],
) -> Array | None:
    """K (3, 3) of ASSUMED_FOCAL about the image's middle, if an image's animals fit it.

    The stored landmarks, moved by trans, must project onto the marked keypoints, in the median of
    all animals together to within CLOSE_PX.

    Args:
        records: the animals of one image.
        landmarks: sample id -> keypoint_3d (26, 3), without trans; NaN where there is none.
        parameters: sample id -> the animal's parameters.

    """
    distances: list[Array] = []
    K = np.zeros((3, 3))
    for record in records:
        height, width = record.image_hw
        K = np.array([[ASSUMED_FOCAL, 0, width / 2], [0, ASSUMED_FOCAL, height / 2], [0, 0, 1]])
        if record.sample_id not in landmarks or record.sample_id not in parameters:
            continue
        points = landmarks[record.sample_id] + parameters[record.sample_id].trans.numpy()
        marked = (record.keypoints_2d[:, 2] > 0) & np.isfinite(points).all(axis=1)
        if not (points[marked, 2] > 0).all():
            return None
        px = points[marked] @ K.T
        away = px[:, :2] / px[:, 2:] - record.keypoints_2d[marked, :2]
        distances.append(np.linalg.norm(away, axis=1))
    every = np.concatenate([np.zeros(0), *distances])
    return K if every.size and float(np.median(every)) <= CLOSE_PX else None

"""Detections with eight corners: lists an image (Cube R-CNN), or one flat list (3D-MOOD, DetAny3D).

Both have Omni3D's fields under names of their own: bbox3D for bbox3D_cam, and pose for R_cam.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import Floats
from animal3dbox.datasets.readers.elements import Matrix, converted, read_box
from animal3dbox.datasets.readers.omni3d.elements import checked_rotation, numbers
from animal3dbox.datasets.readers.omni3d.schema import Key
from animal3dbox.datasets.readers.predictions.layouts import PICKLES
from animal3dbox.datasets.readers.predictions.pickled import read_pickled
from animal3dbox.datasets.readers.predictions.plain_json import plain_json
from animal3dbox.datasets.readers.predictions.stated import (
    DetectionReading,
    StatedDetection,
    checked_dimensions,
    checked_score,
    is_dummy,
)
from animal3dbox.datasets.records import CuboidImage
from animal3dbox.errors import DatasetFormatError, SampleError

SAME_K = 1e-3
"""Greatest difference of two intrinsics that are one, as a part of the focal length."""


class _Image(msgspec.Struct, kw_only=True):
    """One image of a nested file; what it says of the camera is only compared, so it may be bad."""

    image_id: Key
    K: Any = None
    width: Any = None
    height: Any = None
    instances: list[Any]


class _Detection(msgspec.Struct, kw_only=True):
    """One detection, as Omni3D's evaluators take it."""

    image_id: Key
    category_id: Key
    score: float | None = None
    bbox: list[float] | None = None
    corners: Matrix | None = msgspec.field(default=None, name="bbox3D")
    center_cam: list[float] | None = None
    dimensions: list[float] | None = None
    pose: Matrix | float | None = None
    R_cam: Matrix | float | None = None

    def __post_init__(self) -> None:
        """Take a single -1 or 0 in the place of a rotation for None."""
        self.pose = None if self.pose in (-1, 0) else self.pose
        self.R_cam = None if self.R_cam in (-1, 0) else self.R_cam


def read_corner_file(path: Path, reading: DetectionReading, category_ids: str) -> None:
    """Read the detections of a file of Cube R-CNN's, 3D-MOOD's or DetAny3D's.

    Args:
        path: a .pth, which is never run, or a JSON file.
        reading: to which the boxes and faults are added.
        category_ids: "dataset" or "contiguous".

    Raises:
        DatasetFormatError: the file is no list, or a pickle with more than plain values.

    """
    is_pickle = path.suffix.lower() in PICKLES
    content = read_pickled(path) if is_pickle else plain_json(path)
    if not isinstance(content, list):
        raise DatasetFormatError(
            f"{path} must hold a list of detections, or of images with instances, got"
            f" {type(content).__name__}"
        )
    flat: list[Any] = []
    different: list[str] = []
    for number, element in enumerate(content):
        if not isinstance(element, dict) or "instances" not in element:
            flat.append(element)
            continue
        try:
            flat += _instances(element, number, reading, different)
        except SampleError as error:
            reading.faults.append(error)
    if different:
        reading.notes.append(
            f"K or the size of {len(different)} images differ from the truth's (first:"
            f" {different[0]}): boxes are shown with the truth's, though the detector saw others"
        )
    _read_detections(flat, reading, category_ids)


def _instances(
    element: dict[str, Any], number: int, reading: DetectionReading, different: list[str]
) -> list[Any]:
    """The detections of one image of a nested file, each with the image's id.

    One that names another image is a fault, and left out.

    Args:
        element: the image.
        number: its place in the file.
        reading: with the truth.
        different: the names of images with another camera, to which it may be added.

    Raises:
        SampleError: naming the field that is missing or wrong.

    """
    stated = converted(element, _Image, f"image {number}")
    image = reading.truth.images.get(stated.image_id)
    if image is not None and not _is_camera_of(stated, image, reading):
        different.append(image.image_id)
    instances: list[Any] = []
    for place, one in enumerate(stated.instances):
        if not isinstance(one, dict):
            instances.append(one)
        elif one.get("image_id", stated.image_id) != stated.image_id:
            reading.faults.append(
                SampleError(
                    f"image {stated.image_id!r}, instance {place}",
                    "image_id",
                    f"is {one['image_id']!r}, and its element's is {stated.image_id!r}: whose box"
                    " it is cannot be told; give both the image's id, or the element alone",
                )
            )
        else:
            instances.append({**one, "image_id": stated.image_id})
    return instances


def _is_camera_of(stated: _Image, image: CuboidImage, reading: DetectionReading) -> bool:
    """Whether what a file says of an image's camera, if anything, is what the truth says."""
    height, width = image.image_hw
    is_size = stated.height in (None, height) and stated.width in (None, width)
    try:
        K = numbers(stated.K, (3, 3), image.image_id, "K")
    except (SampleError, TypeError):
        return False
    if K is None:
        return is_size
    off = np.abs(reading.truth.convention.K_in(K) - image.K).max()
    return bool(is_size and off <= SAME_K * image.K[0, 0])


def _read_detections(elements: Sequence[Any], reading: DetectionReading, ids: str) -> None:
    """Read detections one by one; a bad one is a fault, and spoils no other."""
    for number, element in enumerate(elements):
        sample_id = f"detection {number}"
        try:
            if not isinstance(element, dict):
                raise SampleError(
                    sample_id, "entry", "must be a dictionary of a detection's fields"
                )
            key = converted(element, _ImageOf, sample_id).image_id
            image = reading.truth.image(key, sample_id)
            sample_id = reading.sample_id(image)
            stated = converted(element, _Detection, sample_id)
            reading.keys.update(_own_keys(stated))
            box = _stated_box(stated, sample_id, image=image, reading=reading, ids=ids)
        except SampleError as error:
            reading.faults.append(error)
            continue
        if box is None:
            reading.dummies.append(sample_id)
        else:
            reading.boxes.append(box)


class _ImageOf(msgspec.Struct):
    """The key of a detection that is needed before the others are checked."""

    image_id: Key


def _own_keys(stated: _Detection) -> dict[str, str]:
    """Omni3D's names of a detection's fields, and its own."""
    return {"bbox3D_cam": "bbox3D", **({} if stated.pose is None else {"R_cam": "pose"})}


def _stated_box(
    stated: _Detection,
    sample_id: str,
    *,
    image: CuboidImage,
    reading: DetectionReading,
    ids: str,
) -> StatedDetection | None:
    """The box that a detection states; None of a dummy. Raises SampleError."""
    category = reading.truth.category(stated.category_id, ids, sample_id)
    corners = numbers(stated.corners, (8, 3), sample_id, "bbox3D")
    center = numbers(stated.center_cam, (3,), sample_id, "center_cam")
    dimensions = numbers(stated.dimensions, (3,), sample_id, "dimensions")
    if is_dummy(corners, center, dimensions):
        return None
    rotation = _rotation(stated, sample_id)
    if corners is None and rotation is None:
        raise SampleError(sample_id, "bbox3D", "is missing, and so is the rotation (pose, R_cam)")
    if dimensions is None:
        raise SampleError(sample_id, "dimensions", "are missing")
    if center is None and corners is None:
        raise SampleError(sample_id, "center_cam", "is missing, and so are the corners")
    box = None
    if stated.bbox is not None and stated.bbox != [-1, -1, -1, -1]:
        # read_box is for files whose (0, 0) is the image's corner; the truth may count otherwise
        moved = 0.5 - reading.truth.convention.first_pixel
        box = read_box(stated.bbox, sample_id, "bbox") + moved
    return StatedDetection(
        sample_id=sample_id,
        image=image,
        category=category,
        score=checked_score(stated.score, sample_id, "score"),
        box=box,
        center=_middle(corners) if center is None else center,
        dimensions=checked_dimensions(dimensions, sample_id, "dimensions"),
        rotation=np.full((3, 3), np.nan) if rotation is None else rotation,
        corners=np.full((8, 3), np.nan) if corners is None else corners,
    )


def _middle(corners: Floats | None) -> Floats:
    """The mean (3,) of corners (8, 3)."""
    return np.full(3, np.nan) if corners is None else np.asarray(corners.mean(0))


def _rotation(stated: _Detection, sample_id: str) -> Floats | None:
    """The rotation (3, 3) of a detection under either of its names; None without."""
    field = "R_cam" if stated.pose is None else "pose"
    rotation = numbers(getattr(stated, field), (3, 3), sample_id, field)
    return None if rotation is None else checked_rotation(rotation, sample_id, field)

"""The elements of an Omni3D file, each checked by itself; a -1 becomes None or NaN."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from animal3dbox.datasets.images.named_files import portable_name
from animal3dbox.datasets.readers.cuboid_checks import check_pixels
from animal3dbox.datasets.readers.cuboid_conventions import Convention, Floats
from animal3dbox.datasets.readers.elements import decoded, image_size
from animal3dbox.datasets.readers.omni3d.image_roots import image_path
from animal3dbox.datasets.readers.omni3d.schema import (
    Key,
    Omni3DAnnotation,
    Omni3DCategory,
    Omni3DImage,
    StatedAnnotation,
)
from animal3dbox.datasets.records import CuboidImage
from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting, SightingKeys, sighting_of
from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.checks import check_intrinsics

ROTATION_TOLERANCE = 1e-3
"""Greatest entry of R Rᵀ - I of a rotation that is only rounded."""


@dataclass(frozen=True)
class StatedBox:
    """The box that one annotation states, in arrays of the right shapes.

    Attributes:
        sample_id: the image, and "#k" for the boxes after its first.
        image: the box's image.
        category: the category's name.
        annotation: the annotation itself.
        corners: (8, 3) camera frame, in the file's order; NaN if missing.
        center: (3,) camera frame.
        dimensions: (3,) in the file's order.
        rotation: (3, 3), a rotation; NaN if missing.
        box: (4,) xyxy in our px; None if it is not known.
        truncation: 0 to 1; None if it is not known.
        visibility: likewise.
        sighting: when and of whom the picture is, as the file says.
    """

    sample_id: str
    image: CuboidImage
    category: str
    annotation: StatedAnnotation
    corners: Floats
    center: Floats
    dimensions: Floats
    rotation: Floats
    box: Floats | None
    truncation: float | None
    visibility: float | None
    sighting: Sighting = NO_SIGHTING


def sighting_in(raw: msgspec.Raw, image: Sighting = NO_SIGHTING) -> Sighting:
    """When and of whom an element of "images" or "annotations" is, as the file says; never where.

    Args:
        raw: the element, which has been decoded before.
        image: what its image says.

    """
    return sighting_of(msgspec.json.decode(raw, type=SightingKeys), image).without_place()


def cuboid_image(
    raw: msgspec.Raw, number: int, *, annotations: Path, root: Path | None, convention: Convention
) -> tuple[Key, CuboidImage]:
    """The id and the image of an element of "images".

    Args:
        raw: the element.
        number: its place in the list.
        annotations: the annotation file.
        root: the folder that file_path is relative to; None if it is not known.
        convention: of the file.

    Raises:
        SampleError: naming the field that is missing or wrong.

    """
    element = decoded(raw, Omni3DImage, f"image {number}")
    name = element.file_path or f"image {element.id}"
    image_hw = image_size(element.height, element.width, name)
    K = numbers(element.K, (3, 3), name, "K")
    if K is None:
        raise SampleError(name, "K", "is missing; cuboids need the intrinsics of their image")
    K = convention.K_in(K)
    try:
        check_intrinsics("K", K)
    except ShapeError as error:
        raise SampleError(name, "K", str(error)) from error
    check_pixels(K, image_hw, name, "K")
    path = image_path(root, annotations, element.file_path, name)
    name = name if root is None else portable_name(root, name)
    upright = element.turned_upright is True
    return element.id, CuboidImage(name, path, image_hw, K, upright)


def category_names(raws: Sequence[msgspec.Raw]) -> tuple[dict[Key, str], list[SampleError]]:
    """Names of the categories by id, and an error for each that is faulty."""
    names: dict[Key, str] = {}
    faults = []
    for number, raw in enumerate(raws):
        try:
            category = decoded(raw, Omni3DCategory, f"category {number}")
            if names.setdefault(category.id, category.name) != category.name:
                raise SampleError(
                    f"category {number}",
                    "id",
                    f"{category.id} names both {names[category.id]!r} and {category.name!r}",
                )
        except SampleError as error:
            faults.append(error)
    return names, faults


def stated_box(
    annotation: StatedAnnotation,
    sample_id: str,
    *,
    image: CuboidImage,
    categories: dict[Key, str],
    convention: Convention,
) -> StatedBox:
    """The box that an annotation states, checked for form.

    Args:
        annotation: with valid3D true.
        sample_id: named in every error.
        image: the annotation's.
        categories: names by id.
        convention: of the file.

    Raises:
        SampleError: naming the field that is missing or wrong.

    """
    category = _category(annotation, sample_id, categories)
    center = _needed(
        numbers(annotation.center_cam, (3,), sample_id, "center_cam"), sample_id, "center_cam"
    )
    dimensions = _needed(
        numbers(annotation.dimensions, (3,), sample_id, "dimensions"), sample_id, "dimensions"
    )
    if dimensions.min() <= 0:
        raise SampleError(sample_id, "dimensions", f"must be positive, got {dimensions.tolist()}")
    corners, rotation = _corners_and_rotation(annotation, sample_id)
    return StatedBox(
        sample_id=sample_id,
        image=image,
        category=category,
        annotation=annotation,
        corners=corners,
        center=center,
        dimensions=dimensions,
        rotation=rotation,
        box=box_2d(annotation.bbox2D_tight, sample_id, "bbox2D_tight", convention),
        truncation=_part(annotation.truncation, sample_id, "truncation"),
        visibility=_part(annotation.visibility, sample_id, "visibility"),
    )


def _part(value: float | None, sample_id: str, field: str) -> float | None:
    """A part, 0 to 1, of a thing; None if it is not known. Raises SampleError."""
    if value is None or value == -1:
        return None
    if not 0 <= value <= 1:
        raise SampleError(
            sample_id, field, f"must lie in 0 to 1, or be -1 if unknown, got {value:g}"
        )
    return value


def _category(annotation: Omni3DAnnotation, sample_id: str, categories: dict[Key, str]) -> str:
    """The name of an annotation's category; raises SampleError."""
    category = categories.get(annotation.category_id)
    if category is None:
        raise SampleError(
            sample_id,
            "category_id",
            f"{annotation.category_id} is not among the file's categories: trainers would drop it"
            " unsaid",
        )
    if annotation.category_name not in (None, category):
        raise SampleError(
            sample_id,
            "category_name",
            f"is {annotation.category_name!r}, but category {annotation.category_id} is"
            f" {category!r}",
        )
    return category


def _corners_and_rotation(annotation: Omni3DAnnotation, sample_id: str) -> tuple[Floats, Floats]:
    """Corners (8, 3) and rotation (3, 3), of which one may be NaN; raises SampleError."""
    corners = numbers(annotation.bbox3D_cam, (8, 3), sample_id, "bbox3D_cam")
    rotation = numbers(annotation.R_cam, (3, 3), sample_id, "R_cam")
    rotation = (
        np.full((3, 3), np.nan)
        if rotation is None or not rotation.any()
        else checked_rotation(rotation, sample_id, "R_cam")
    )
    if np.isnan(rotation).any() and corners is None:
        raise SampleError(
            sample_id, "R_cam", "is missing, and so are the corners that could stand for it"
        )
    return np.full((8, 3), np.nan) if corners is None else corners, rotation


def box_2d(
    value: list[float] | None, sample_id: str, field: str, convention: Convention
) -> Floats | None:
    """A file's 2D box (4,) as xyxy in our px; None if it is not known.

    Args:
        value: as the file has it.
        sample_id: named in the error.
        field: the file's key, named in the error.
        convention: of the file.

    Raises:
        SampleError: no four numbers of a positive area.

    """
    box = numbers(value, (4,), sample_id, field)
    if box is None:
        return None
    if not (box[2:] > box[:2]).all():
        raise SampleError(
            sample_id,
            field,
            f"must be x1, y1, x2, y2 with x2 > x1 and y2 > y1, got {box.tolist()}; unknown is four"
            " times -1",
        )
    return convention.boxes_2d_in(box)


def numbers(value: object, shape: tuple[int, ...], sample_id: str, field: str) -> Floats | None:
    """The finite numbers of a field, of a shape; None if it is missing, empty or all -1.

    Args:
        value: as the file has it: rows, or a matrix row by row in one list.
        shape: that the numbers must have.
        sample_id: named in the error.
        field: the file's key, named in the error.

    Raises:
        SampleError: of another shape, or not finite.

    """
    if value is None or value == []:
        return None
    try:
        values = np.array(value, dtype=np.float64)
    except ValueError as error:  # rows of different lengths
        raise SampleError(
            sample_id,
            field,
            f"must be {' x '.join(map(str, shape))} numbers, got rows of different lengths",
        ) from error
    if (values == -1).all():
        return None
    if len(shape) == 2 and values.shape == (shape[0] * shape[1],):
        values = values.reshape(shape)
    if values.shape != shape:
        raise SampleError(
            sample_id,
            field,
            f"must be {' x '.join(map(str, shape))} numbers, got shape {values.shape}",
        )
    if not np.isfinite(values).all():
        raise SampleError(sample_id, field, "holds values that are not finite")
    return values


def _needed(values: Floats | None, sample_id: str, field: str) -> Floats:
    """The numbers of a field that no box may be without; raises SampleError if there are none."""
    if values is None:
        raise SampleError(
            sample_id,
            field,
            "is missing or -1, but valid3D is true; an annotation without a 3D box says valid3D"
            " false",
        )
    return values


def checked_rotation(R: Floats, sample_id: str, field: str) -> Floats:
    """The exact rotation (3, 3) that a file's rounded one stands for.

    Args:
        R: (3, 3), finite.
        sample_id: named in the error.
        field: the file's key, named in the error.

    Raises:
        SampleError: not orthogonal, or mirrored.

    """
    off = np.abs(R @ R.T - np.eye(3)).max()
    if off > ROTATION_TOLERANCE:
        raise SampleError(
            sample_id,
            field,
            f"must be a rotation matrix, but R R^T differs from the identity by {off:.2g}",
        )
    if np.linalg.det(R) < 0:
        raise SampleError(
            sample_id,
            field,
            "has determinant -1, a mirrored frame: negate the axis that points the wrong way",
        )
    if off < 1e-9:
        return R
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(U @ Vt)

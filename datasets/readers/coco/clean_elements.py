"""Images and annotations of a COCO file read many at a time, as far as nothing about them is odd.

A clean element is one of which plain.py would say nothing: no error, no remark, no part left out.
What is clean by itself is judged here; whatever is not, with all that shares its image, is read
plainly. The line of benchmarks/opening.py that pays for it is "first opening".
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.photos import MAX_PIXELS
from animal3dbox.datasets.images.picture_folder import PictureFolder
from animal3dbox.datasets.readers.coco.file import Species
from animal3dbox.datasets.readers.distinct_animals import may_be_corners
from animal3dbox.datasets.readers.tolerance import LEAST_SCORE, Visibility
from animal3dbox.datasets.sightings import SightingKeys, is_silent, sighting_of
from animal3dbox.datasets.storage.json_ranges import ElementRanges

BATCH = 4096
"""Elements that are decoded at once."""
Flags = NDArray[np.bool_]
Places = NDArray[np.int64]
NO_ID = int(np.iinfo(np.int64).min)
"""The number of an id that is not there."""
_Element = TypeVar("_Element", bound=msgspec.Struct)


class _CleanImage(SightingKeys):
    """An element of "images" that says all that we use, each in its own type."""

    file_name: str
    id: int | str
    height: int
    width: int


class _CleanAnnotation(SightingKeys):
    """An element of "annotations" that says all that we use, each in its own type."""

    image_id: int | str
    category_id: int | str
    keypoints: list[float]
    id: int | str | None = None
    num_keypoints: int | None = None
    bbox: list[float] | None = None
    segmentation: Any = None
    iscrowd: int | bool | None = 0


def id_number(value: int | str | None) -> int:
    """A number by which ids are compared in this process: of 1 and "1" it is the same.

    Two ids of one number are nearly always one; whoever needs to know compares them.
    """
    if isinstance(value, str):
        is_canonical = value.isascii() and value.isdecimal() and str(int(value)) == value
        value = int(value) if is_canonical and len(value) < 19 else hash(value)
    if value is None:
        return NO_ID
    return value if abs(value) < 2**63 else hash(value)


@dataclass(frozen=True)
class CleanImages:
    """The images of a file.

    Attributes:
        names: of those that can be decoded and are plain, "" of others.
        numbers: (N,) their ids, by id_number; NO_ID of those that cannot be decoded.
        image_hw: (N, 2) int32.
        is_clean: (N,).
        has_place: (N,) whether the file says where it was taken.
    """

    names: list[str]
    numbers: Places
    image_hw: NDArray[np.int32]
    is_clean: Flags
    has_place: Flags


def clean_images(data: bytes, ranges: ElementRanges, pictures: PictureFolder) -> CleanImages:
    """The images of a file that are clean by themselves, and that no other shares its name with.

    Args:
        data: the file.
        ranges: of its images.
        pictures: the folder of pictures, which knows the names that need no looking up.

    """
    names: list[str] = []
    numbers = np.full(len(ranges), NO_ID, dtype=np.int64)
    image_hw = np.zeros((len(ranges), 2), dtype=np.int64)
    has_place = np.zeros(len(ranges), dtype=np.bool_)
    for first, elements in _batches(data, ranges, _CleanImage):
        for i, element in enumerate(elements, first):
            if element is None:
                names.append("")
                continue
            name = element.file_name
            numbers[i] = id_number(element.id)
            names.append(name if name.strip() and pictures.takes_plainly(name) else "")
            if max(element.height, element.width) <= MAX_PIXELS:
                image_hw[i] = element.height, element.width
            if not is_silent(element):
                has_place[i] = sighting_of(element).place is not None
    has_size = (image_hw > 0).all(1) & (image_hw.prod(1) <= MAX_PIXELS)
    is_clean = has_size & np.fromiter(map(bool, names), np.bool_, len(names))
    if len(set(names)) < len(names):
        counts = Counter(names)
        is_clean &= np.fromiter((counts[name] == 1 for name in names), np.bool_, len(names))
    return CleanImages(names, numbers, image_hw.astype(np.int32), is_clean, has_place)


@dataclass(frozen=True)
class CleanAnnotations:
    """The annotations of a file.

    Attributes:
        is_clean: (N,).
        image: (N,) place of the image of each that is clean, -1 of others.
        number: (N,) id of each, by id_number.
        category: (N,) number of its category among all that are read, -1 of one that is not.
        left_out: name of each category that is not read -> the clean annotations of it.
        content: (N,) of those a number that is the same for the same keypoints.
        keypoints: (N, J, 2) float32 px, NaN where none is marked.
        is_empty: (N,) whether no keypoint is marked.
        is_graded: (N,) whether one has the visibility 2.
        is_miscounted: (N,) whether num_keypoints is another number than of those marked.
        has_box: (N,).
        has_possible_corners: (N,) whether its box may be two corners.
        has_evident_corners: (N,) whether it evidently is.
        has_place: (N,) whether the file says where it was.
    """

    is_clean: Flags
    image: Places
    number: Places
    category: NDArray[np.int16]
    left_out: dict[str, Places]
    content: Places
    keypoints: NDArray[np.float32]
    is_empty: Flags
    is_graded: Flags
    is_miscounted: Flags
    has_box: Flags
    has_possible_corners: Flags
    has_evident_corners: Flags
    has_place: Flags


class AnnotationScan:
    """Reads the clean annotations of a file, batch by batch.

    Args:
        images: of the file.
        species: category id -> species.
        read: names of the categories that are read.
        visibility: what stands beside a keypoint.

    """

    def __init__(
        self,
        images: CleanImages,
        species: dict[str, Species],
        read: frozenset[str],
        visibility: Visibility,
    ) -> None:
        self.images, self.visibility = images, visibility
        self.kinds = [*species.values()]
        self._kind_of = {key: k for k, key in enumerate(species)}
        self._read = [kind.name in read for kind in self.kinds]
        clean = np.nonzero(images.is_clean)[0]
        order = clean[np.argsort(images.numbers[clean], kind="stable")]
        self._image_numbers, self._image_places = images.numbers[order], order

    def annotations(self, data: bytes, ranges: ElementRanges) -> CleanAnnotations:
        """The annotations of a file.

        Args:
            data: the file.
            ranges: of its annotations.

        """
        count, flags = len(ranges), {name: np.zeros(len(ranges), np.bool_) for name in _FLAGS}
        joints = max((len(k.match.columns) for k in self.kinds if k.match is not None), default=0)
        kinds = np.full(count, -1, dtype=np.int16)
        arrays = CleanAnnotations(
            image=np.full(count, -1, dtype=np.int64),
            number=np.full(count, NO_ID, dtype=np.int64),
            category=np.full(count, -1, dtype=np.int16),
            left_out={},
            content=np.zeros(count, dtype=np.int64),
            keypoints=np.full((count, joints, 2), np.nan, dtype=np.float32),
            **flags,
        )
        for first, elements in _batches(data, ranges, _CleanAnnotation):
            self._read_batch(first, elements, arrays, kinds)
        for k, kind in enumerate(self.kinds):
            if not self._read[k] and len(places := np.nonzero(kinds == k)[0]):
                arrays.left_out[kind.name] = np.append(
                    arrays.left_out.get(kind.name, np.zeros(0, np.int64)), places
                )
        return arrays

    def _read_batch(
        self,
        first: int,
        elements: list[_CleanAnnotation | None],
        arrays: CleanAnnotations,
        kinds: NDArray[np.int16],
    ) -> None:
        """Write what a batch of annotations says into the arrays of all."""
        places, whole = list[int](), list[_CleanAnnotation]()
        for i, element in enumerate(elements, first):
            if element is not None and not element.iscrowd and element.segmentation in (None, []):
                places.append(i)
                whole.append(element)
        if not whole:
            return
        at = np.array(places)
        arrays.number[at] = [id_number(element.id) for element in whole]
        image = self._images_of([id_number(element.image_id) for element in whole])
        kind = np.array([self._kind(element.category_id) for element in whole])
        arrays.has_place[at] = [
            not is_silent(element) and sighting_of(element).place is not None for element in whole
        ]
        has_both = (image >= 0) & (kind >= 0)
        arrays.has_place[at[has_both]] |= self.images.has_place[image[has_both]]
        for k in np.unique(kind[has_both]).tolist():
            rows = np.nonzero(has_both & (kind == k))[0]
            group = [whole[row] for row in rows.tolist()]
            if self._read[k]:
                self._read_animals(k, group, (at[rows], image[rows]), arrays)
            else:
                arrays.is_clean[at[rows]] = True
                arrays.image[at[rows]], kinds[at[rows]] = image[rows], k
                arrays.content[at[rows]] = [hash(tuple(one.keypoints)) for one in group]

    def _kind(self, category_id: int | str) -> int:
        return self._kind_of.get(str(category_id), -1)

    def _images_of(self, numbers: list[int]) -> Places:
        """The places of clean images by the numbers of their ids; -1 of others."""
        ids = np.array(numbers, dtype=np.int64)
        if not len(self._image_numbers):
            return np.full(len(ids), -1)
        near = np.minimum(self._image_numbers.searchsorted(ids), len(self._image_numbers) - 1)
        places: Places = np.where(self._image_numbers[near] == ids, self._image_places[near], -1)
        return places

    def _read_animals(
        self,
        k: int,
        elements: list[_CleanAnnotation],
        where: tuple[Places, Places],
        arrays: CleanAnnotations,
    ) -> None:
        """Check the animals of one category and write what they say.

        Args:
            k: the category's number.
            elements: its annotations.
            where: (M,) their places, and those of their images.
            arrays: the arrays of all.

        """
        kind, (at, image) = self.kinds[k], where
        has_form = np.array([_has_form(one, kind.keypoints) for one in elements])
        if kind.match is None or not has_form.any():
            return
        elements = [one for one, is_sound in zip(elements, has_form, strict=True) if is_sound]
        at, image = at[has_form], image[has_form]
        numbers = np.array([one.keypoints for one in elements]).reshape(len(elements), -1, 3)
        marked, is_sound = _marked_keypoints(numbers, self.visibility)
        image_hw = self.images.image_hw[image]
        boxes, has_box, has_sound_box = _boxes(elements, image_hw)
        is_sound &= has_sound_box
        points = _in_order(marked, kind.match.columns)
        possible, evident = may_be_corners(boxes, points, image_hw)
        counts = (marked[:, :, 2] > 0).sum(1).tolist()
        stated = [one.num_keypoints for one in elements]
        values = {
            "is_clean": is_sound,
            "is_empty": ~points.any((1, 2)),
            "is_graded": (points[:, :, 2] > 1).any(1),
            "is_miscounted": np.array(
                [n not in (None, count) for n, count in zip(stated, counts, strict=True)]
            ),
            "has_box": has_box,
            "has_possible_corners": possible & has_box,
            "has_evident_corners": evident & has_box,
        }
        for name, value in values.items():
            getattr(arrays, name)[at] = value & is_sound
        at, image, points = at[is_sound], image[is_sound], points[is_sound]
        arrays.image[at], arrays.category[at] = image, k
        places = np.where(points[..., 2:] > 0, points[..., :2], np.nan)
        arrays.keypoints[at, : points.shape[1]] = places


_FLAGS = (
    *("is_clean", "is_empty", "is_graded", "is_miscounted"),
    *("has_box", "has_possible_corners", "has_evident_corners", "has_place"),
)
"""The arrays of CleanAnnotations that hold one truth value an annotation."""


def _has_form(element: _CleanAnnotation, keypoints: int) -> bool:
    """Whether an annotation has so many keypoints, and a box of four numbers or none."""
    has_box_form = element.bbox is None or len(element.bbox) == 4
    return len(element.keypoints) == 3 * keypoints and has_box_form


def _in_order(marked: NDArray[np.float64], columns: Sequence[int | None]) -> NDArray[np.float64]:
    """The vocabulary's keypoints (M, J, 3) of the file's (M, N, 3); see NameMatch.rows."""
    points = np.zeros((len(marked), len(columns), 3))
    for j, column in enumerate(columns):
        if column is not None:
            points[:, j] = marked[:, column]
    return points


def _marked_keypoints(
    points: NDArray[np.float64], visibility: Visibility
) -> tuple[NDArray[np.float64], Flags]:
    """Keypoints (M, N, 3) with zeros where none is marked, and whether (M,) nothing is odd.

    See Tolerance.keypoints, of which this is the part that needs no remark.
    """
    marks, at_minus_one = points[..., 2], (points[..., :2] == -1).all(2)
    if visibility == "scores":
        is_sound, is_missing = (marks >= 0) & (marks <= 1), marks < LEAST_SCORE
    else:
        is_sound, is_missing = (marks == 0) | (marks == 1) | (marks == 2), marks == 0
    return np.where(is_missing[..., None], 0.0, points), (is_sound & ~at_minus_one).all(1)


def _boxes(
    elements: list[_CleanAnnotation], image_hw: NDArray[np.int32]
) -> tuple[NDArray[np.float64], Flags, Flags]:
    """The boxes (M, 4) xyxy px, whether (M,) there is one, and whether (M,) it is sound if so.

    See read_box, and the box of animal.py.
    """
    has_box = np.array([one.bbox is not None for one in elements])
    boxes = np.array([one.bbox or (0.0, 0.0, 0.0, 0.0) for one in elements])
    boxes[:, 2:] += boxes[:, :2]
    is_sound = np.isfinite(boxes).all(1) & (boxes[:, 2:] > boxes[:, :2]).all(1)
    boxes -= 0.5
    is_sound &= (boxes[:, :2] < image_hw[:, ::-1]).all(1) & (boxes[:, 2:] > 0).all(1)
    return boxes, has_box, is_sound | ~has_box


def _batches(
    data: bytes, ranges: ElementRanges, kind: type[_Element]
) -> Iterator[tuple[int, list[_Element | None]]]:
    """The elements of a list in batches, each with its first place; None of those of other form."""
    many, one = msgspec.json.Decoder(list[kind]), msgspec.json.Decoder(kind)  # type: ignore[valid-type]
    for first in range(0, len(ranges), BATCH):
        last = min(first + BATCH, len(ranges))
        try:
            yield first, many.decode(ranges.part(data, first, last))
        except (msgspec.DecodeError, UnicodeDecodeError):
            elements: list[_Element | None] = []
            for place in range(first, last):
                try:
                    elements.append(one.decode(ranges.element(data, place)))
                except (msgspec.DecodeError, UnicodeDecodeError):
                    elements.append(None)
            yield first, elements

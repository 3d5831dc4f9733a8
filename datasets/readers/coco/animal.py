"""One annotation of a COCO file as a record, checked; what is wrong with it spoils no other."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.picture_folder import PictureFolder
from animal3dbox.datasets.images.segmentation import read_segmentation
from animal3dbox.datasets.readers.coco.file import CocoImage, Species
from animal3dbox.datasets.readers.elements import image_size, read_box, read_rows
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.sightings import SightingKeys, sighting_of
from animal3dbox.errors import SampleError

HIDDEN_CONFIDENCE = 0.4
"""Confidence of a keypoint that is labelled but hidden (v = 1).

It is below LabelConfig.occluded_below, so that the keypoint weighs less than a visible one.
"""


class CocoEntry(SightingKeys):
    """One element of "annotations", by the keys that we use; others are left alone."""

    category_id: int | str
    keypoints: list[float | list[float | None] | None] | None = None
    num_keypoints: int | None = None
    bbox: Any = None
    segmentation: Any = None


@dataclass(frozen=True)
class AnnotatedAnimal:
    """A record whose keypoints still have COCO's visibility 0, 1, 2, and its place in its file.

    Attributes:
        record: of the animal.
        image: place of its image in the file's list.
        number: which of its image's annotations it is.
        annotation: place of its annotation in the file's list.
        miscounted: whether num_keypoints is not the number of marked keypoints.
        without_box: whether the box that it had has been left out since.
    """

    record: AnimalRecord
    image: int
    number: int
    annotation: int
    miscounted: bool
    without_box: bool = False

    def changed_to(self, record: AnimalRecord) -> "AnnotatedAnimal":
        """The same animal with what is left of its record."""
        is_without = self.record.box is not None and record.box is None
        return replace(self, record=record, without_box=is_without)


@dataclass(frozen=True)
class AnimalReading:
    """How the annotations of one file are read.

    Attributes:
        species: category id -> species.
        pictures: the folder of images.
        tolerance: how bad parts are taken.
        has_corners: whether bbox holds two corners, as AnimalPose's do.
    """

    species: dict[str, Species]
    pictures: PictureFolder
    tolerance: Tolerance
    has_corners: bool = False

    def animal(
        self, entry: CocoEntry, image: CocoImage, number: int, annotation: int
    ) -> AnnotatedAnimal:
        """The animal of one annotation; raises SampleError.

        Args:
            entry: the annotation.
            image: the annotation's image.
            number: which of its image's annotations it is.
            annotation: its place in the file's list.

        """
        sample_id, tolerance = sample_name(image.name, number), self.tolerance
        kind = self.species.get(str(entry.category_id))
        if kind is None:
            problem = f"no category has the id {entry.category_id}"
            raise SampleError(sample_id, "category_id", problem)
        if kind.match is None:
            raise SampleError(sample_id, "keypoints", kind.problem)
        path = self.pictures.path(image.name, sample_id)
        image_hw = self._image_hw(image, sample_id)
        marked = _keypoints(entry, kind.keypoints, sample_id, tolerance)
        form = "xmin, ymin, xmax, ymax" if self.has_corners else "x, y, w, h"
        record = AnimalRecord(
            sample_id=sample_id,
            image_id=image.name,
            image_path=path,
            image_hw=image_hw,
            vocabulary=kind.match.vocabulary,
            keypoints_2d=kind.match.rows(marked),
            mask_runs=tolerance.part(
                partial(read_segmentation, entry.segmentation, image_hw, sample_id)
            ),
            category=kind.name,
            box=tolerance.part(lambda: _box(entry.bbox, image_hw, sample_id, form)),
            sighting=sighting_of(entry, image.sighting),
            upright=tolerance.upright,
        )
        miscounted = entry.num_keypoints not in (None, int((marked[:, 2] > 0).sum()))
        return AnnotatedAnimal(record, image.place, number, annotation, miscounted)

    def _image_hw(self, image: CocoImage, sample_id: str) -> tuple[int, int]:
        """Height and width of an image, by its picture's header if the file does not say them."""
        height, width = image.image_hw
        if height is None or width is None:
            return self.pictures.stored_size(image.name, sample_id, upright=self.tolerance.upright)
        return image_size(height, width, sample_id, "width, height of the image")


def sample_name(image: str, number: int) -> str:
    """The name of an image's animal: the image's own, and "#k" after the first."""
    return image if number == 0 else f"{image}#{number}"


def _keypoints(
    entry: CocoEntry, count: int, sample_id: str, tolerance: Tolerance
) -> NDArray[np.float64]:
    """The keypoints (N, 3) of an annotation: x, y and COCO's visibility, in the category's order.

    They are zeros if there are none, and where they are not marked (visibility 0).
    AnimalPose nests them, three numbers a list.
    """
    items = entry.keypoints or [0.0] * (3 * count)
    if len(items) == 3 * count and {list, type(None)}.isdisjoint(map(type, items)):
        # As in most files; in rows, one by one, a sample would take 0.24 instead of 0.18 ms
        # (benchmarks/opening.py, "shard of 100").
        rows = np.array(items, dtype=np.float64).reshape(count, 3)
        return tolerance.keypoints(rows, sample_id, "keypoints")
    flat: list[float | None] = []
    for item in items:
        flat += item if isinstance(item, list) else [item]
    nested = isinstance(items[0], list)
    odd = any(
        isinstance(item, list) is not nested or (isinstance(item, list) and len(item) != 3)
        for item in items
    )
    if odd or len(flat) != 3 * count:
        raise SampleError(
            sample_id,
            "keypoints",
            f"must be x, y, visibility for {count} keypoints, got {len(flat)} numbers",
        )
    rows = read_rows(
        [flat[i : i + 3] for i in range(0, len(flat), 3)], count, sample_id, "keypoints"
    )
    return tolerance.keypoints(rows, sample_id, "keypoints")


def _box(
    numbers: Any, image_hw: tuple[int, int], sample_id: str, form: str
) -> NDArray[np.float64] | None:
    """The box (4,) xyxy px of an animal; raises a SampleError if it lies outside its image."""
    if numbers is None:
        return None
    box = read_box(numbers, sample_id, "bbox", form)
    height, width = image_hw
    if not (box[0] < width and box[1] < height and box[2] > 0 and box[3] > 0):
        raise SampleError(
            sample_id,
            "bbox",
            f"lies outside the image of {width} x {height}: are these pixels of this image?",
        )
    return box


def with_confidence(record: AnimalRecord, graded: bool) -> AnimalRecord:
    """The record with confidences in the place of COCO's visibility.

    Visible keypoints get 1, hidden ones less. In a file that is not graded, which never says 2,
    a visibility of 1 means visible.
    """
    rows = record.keypoints_2d
    hidden = HIDDEN_CONFIDENCE if graded else 1.0
    is_visible, is_marked = rows[:, 2] >= 2, rows[:, 2] >= 1
    keypoints = rows.copy()
    keypoints[:, 2] = np.where(is_visible, 1.0, np.where(is_marked, hidden, 0.0))
    return replace(record, keypoints_2d=keypoints)

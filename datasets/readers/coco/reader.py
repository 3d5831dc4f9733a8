"""The reader of COCO keypoints: images of animals with named keypoints, boxes and masks.

AP-10K, AnimalPose and what is converted to them are read alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.photos import is_file, resolve_inside, stored_size
from animal3dbox.datasets.images.segmentation import read_segmentation
from animal3dbox.datasets.readers.coco.file import (
    CocoImage,
    CocoParts,
    Species,
    read_coco_file,
    species_by_id,
    take_apart,
)
from animal3dbox.datasets.readers.elements import (
    decoded,
    image_size,
    read_box,
    read_rows,
)
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.errors import DatasetNotFoundError, SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

FORMAT = "coco"
"""The format's name in reports and for --format."""
FILES = ("annotations.json", "keypoints.json")
"""Names of the file in a folder that is given as the dataset; keypoints.json is AnimalPose's."""
HIDDEN_CONFIDENCE = 0.4
"""Confidence of a keypoint that is labelled but hidden (v = 1).

It is below LabelConfig.occluded_below, so that the keypoint weighs less than a visible one.
"""


class CocoEntry(msgspec.Struct):
    """One element of "annotations", by the keys that we use; others are left alone."""

    category_id: int | str
    keypoints: list[float | list[float | None] | None] | None = None
    num_keypoints: int | None = None
    bbox: list[float] | None = None
    segmentation: Any = None


@dataclass(frozen=True)
class _Animal:
    """A record whose keypoints still have COCO's visibility 0, 1, 2.

    Attributes:
        record: of the animal.
        miscounted: whether num_keypoints is not the number of marked keypoints.
    """

    record: AnimalRecord
    miscounted: bool


def find_coco(path: Path) -> Path:
    """The annotation file of a dataset given by its folder or by that file.

    Raises DatasetNotFoundError unless the folder holds exactly one of FILES.
    """
    if path.is_file():
        return path
    candidates = [path / name for name in FILES if (path / name).is_file()]
    if len(candidates) != 1:
        raise DatasetNotFoundError(
            f"{path} must hold exactly one of {', '.join(FILES)}: give the file itself (one of"
            " annotations/*.json in AP-10K)"
        )
    return candidates[0]


def read_coco(
    path: Path, images: Path | None = None, vocabulary: Vocabulary | None = None
) -> RecordSet:
    """The animals of a COCO keypoints file, or of AnimalPose's json.

    Args:
        path: the file, or the folder it lies in.
        images: the folder that file_name is relative to; None: the first of the usual ones that has
            the first image.
        vocabulary: what the keypoints are, by their names; None: the known vocabulary that fits
            the categories' names.

    Returns:
        The records, those of an image together, in the order of "images", and a fault for each that
        is unusable.

    Raises:
        DatasetNotFoundError: no such file, or no such folder of images.
        DatasetFormatError: not JSON, or not COCO's.
        ConfigError: no category has keypoints that are known.

    """
    annotations = find_coco(path)
    file = read_coco_file(annotations)
    species, parts = species_by_id(file, vocabulary), take_apart(file)
    root = images or _images_root(annotations, parts.images)
    if not root.is_dir():
        raise DatasetNotFoundError(f"there is no folder of images {root}")
    animals: list[_Animal] = []
    faults = list(parts.faults)
    for image in parts.images:
        for k, (i, raw) in enumerate(image.annotations):
            try:
                sample_id = image.name if k == 0 else f"{image.name}#{k}"
                animals.append(
                    _animal(
                        decoded(raw, CocoEntry, sample_id),
                        sample_id,
                        image,
                        root,
                        species=species,
                        has_corners=parts.is_animalpose,
                    )
                )
            except SampleError as error:
                faults.append(
                    SampleError(error.sample_id, error.field, f"{error.problem} (annotation {i})")
                )
    graded = any(bool((animal.record.keypoints_2d[:, 2] > 1).any()) for animal in animals)
    records = tuple(_with_confidence(animal.record, graded) for animal in animals)
    return RecordSet(
        name=FORMAT,
        records=records,
        faults=tuple(faults),
        notes=_notes(animals, parts, species, graded),
        categories=tuple(kind.name for kind in species.values()),
    )


def _images_root(annotations: Path, images: Sequence[CocoImage]) -> Path:
    """The folder of images: the first of the usual ones that holds the first image.

    Without such a folder it is images/ beside the annotations, or else their own folder.
    """
    home = annotations.parent
    folders = (home / "images", home, home.parent / "images", home.parent / "data", home.parent)
    with_image = (folder for folder in folders if images and is_file(folder / images[0].name))
    return next(with_image, folders[0] if folders[0].is_dir() else home)


def _animal(
    entry: CocoEntry,
    sample_id: str,
    image: CocoImage,
    root: Path,
    *,
    species: dict[str, Species],
    has_corners: bool,
) -> _Animal:
    """The record of one annotation, checked; raises SampleError.

    Args:
        entry: the annotation.
        sample_id: named in every error.
        image: the annotation's image.
        root: the folder of images.
        species: category id -> species.
        has_corners: whether bbox holds two corners, as AnimalPose's do.

    """
    kind = species.get(str(entry.category_id))
    if kind is None:
        raise SampleError(sample_id, "category_id", f"no category has the id {entry.category_id}")
    if kind.match is None:
        raise SampleError(sample_id, "keypoints", kind.problem)
    path = resolve_inside(root, image.name, sample_id, "file_name")
    height, width = image.image_hw
    image_hw = (
        stored_size(path, sample_id)
        if height is None or width is None
        else image_size(height, width, sample_id, "width, height of the image")
    )
    marked = _keypoints(entry, kind.keypoints, sample_id)
    keypoints = kind.match.rows(marked)
    form = "xmin, ymin, xmax, ymax" if has_corners else "x, y, w, h"
    box = None if entry.bbox is None else read_box(entry.bbox, sample_id, "bbox", form)
    if box is not None:
        _check_box_in_image(box, image_hw, sample_id)
    record = AnimalRecord(
        sample_id=sample_id,
        image_id=image.name,
        image_path=path,
        image_hw=image_hw,
        vocabulary=kind.match.vocabulary,
        keypoints_2d=keypoints,
        mask_runs=read_segmentation(entry.segmentation, image_hw, sample_id),
        category=kind.name,
        box=box,
    )
    return _Animal(record, entry.num_keypoints not in (None, int((marked[:, 2] > 0).sum())))


def _keypoints(entry: CocoEntry, count: int, sample_id: str) -> NDArray[np.float64]:
    """The keypoints (N, 3) of an annotation: x, y and COCO's visibility, in the category's order.

    They are zeros if there are none, and where they are not marked (visibility 0).
    AnimalPose nests them, three numbers a list.
    """
    items = entry.keypoints or [0.0] * (3 * count)
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
    if not np.isin(rows[:, 2], (0, 1, 2)).all():
        raise SampleError(
            sample_id,
            "keypoints",
            f"visibility must be 0, 1 or 2, got {sorted(set(rows[:, 2].tolist()))}: are these"
            " scores?",
        )
    rows[rows[:, 2] == 0] = 0.0
    return rows


def _check_box_in_image(
    box: NDArray[np.float64], image_hw: tuple[int, int], sample_id: str
) -> None:
    """Raise a SampleError for a box (4,) that lies outside its image."""
    height, width = image_hw
    if not (box[0] < width and box[1] < height and box[2] > 0 and box[3] > 0):
        raise SampleError(
            sample_id,
            "bbox",
            f"lies outside the image of {width} x {height}: are these pixels of this image?",
        )


def _with_confidence(record: AnimalRecord, graded: bool) -> AnimalRecord:
    """The record with confidences in the place of COCO's visibility.

    Visible keypoints get 1, hidden ones less. In a file that is not graded, which never says 2,
    a visibility of 1 means visible.
    """
    rows = record.keypoints_2d
    hidden = HIDDEN_CONFIDENCE if graded else 1.0
    confidence = np.select([rows[:, 2] >= 2, rows[:, 2] >= 1], [1.0, hidden], 0.0)
    return replace(record, keypoints_2d=np.concatenate((rows[:, :2], confidence[:, None]), axis=1))


def _notes(
    animals: Sequence[_Animal], parts: CocoParts, species: dict[str, Species], graded: bool
) -> tuple[str, ...]:
    """Notes for the report on what a careful person should know, in whole sentences."""
    notes = []
    bare = sum(not image.annotations for image in parts.images)
    empty = sum(not animal.record.keypoints_2d.any() for animal in animals)
    miscounted = sum(animal.miscounted for animal in animals)
    if parts.crowds:
        notes.append(
            f"{parts.crowds} annotations are crowds (iscrowd 1), no single animals, and were"
            " left out"
        )
    if bare:
        notes.append(f"{bare} of {len(parts.images)} images have no annotation of an animal")
    if empty:
        notes.append(f"{empty} of {len(animals)} animals have no marked keypoint")
    if miscounted:
        notes.append(
            f"num_keypoints is not the number of marked keypoints in {miscounted} of {len(animals)}"
            " animals; the marks count"
        )
    if not graded and any(animal.record.keypoints_2d.any() for animal in animals):
        notes.append(
            "no keypoint has the visibility 2: 1 is taken to mean visible, not labelled but hidden"
        )
    for match in dict.fromkeys(
        kind.match for kind in species.values() if kind.match is not None and kind.match.unused
    ):
        notes.append(
            f"the keypoints {', '.join(match.unused)} are not in the vocabulary"
            f" {match.vocabulary.name} and not used"
        )
    return tuple(notes)

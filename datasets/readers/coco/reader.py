"""The reader of COCO keypoints: images of animals with named keypoints, boxes and masks.

AP-10K, AnimalPose and what is converted to them are read alike.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.named_files import portable_name, resolve_inside
from animal3dbox.datasets.images.photos import is_file, stored_size
from animal3dbox.datasets.images.segmentation import read_segmentation
from animal3dbox.datasets.readers.coco.file import (
    CocoImage,
    CocoParts,
    Species,
    read_coco_file,
    species_by_id,
    take_apart,
    wanted_species,
)
from animal3dbox.datasets.readers.distinct_animals import distinct_animals, elsewhere_notes
from animal3dbox.datasets.readers.elements import (
    decoded,
    image_size,
    read_box,
    read_rows,
)
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.sightings import SightingKeys, sighting_of
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


class CocoEntry(SightingKeys):
    """One element of "annotations", by the keys that we use; others are left alone."""

    category_id: int | str
    keypoints: list[float | list[float | None] | None] | None = None
    num_keypoints: int | None = None
    bbox: Any = None
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
    path: Path,
    images: Path | None = None,
    vocabulary: Vocabulary | None = None,
    *,
    tolerance: Tolerance | None = None,
    categories: Sequence[str] = (),
) -> RecordSet:
    """The animals of a COCO keypoints file, or of AnimalPose's json.

    Args:
        path: the file, or the folder it lies in.
        images: the folder that file_name is relative to; None: the first of the usual ones that has
            the first image.
        vocabulary: what the keypoints are, by their names; None: the known vocabulary that fits
            the categories' names.
        tolerance: how bad masks and boxes, and scores, are taken; None: not at all.
        categories: names of those that are read; none: all whose keypoints are an animal's.

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
    tolerance = tolerance or Tolerance()
    root = images or _images_root(annotations, parts.images)
    if not root.is_dir():
        raise DatasetNotFoundError(f"there is no folder of images {root}")
    read = wanted_species(species, categories)
    found = _animals(parts, root, species=species, read=read, tolerance=tolerance)
    has_flags = tolerance.visibility == "flags"
    graded = any(bool((animal.record.keypoints_2d[:, 2] > 1).any()) for animal in found.animals)
    animals = [
        _with_confidence(animal.record, graded) if has_flags else animal.record
        for animal in found.animals
    ]
    records, copies = distinct_animals(animals, tolerance)
    used = {key: kind for key, kind in species.items() if kind.name in read}
    return RecordSet(
        name=FORMAT,
        records=records,
        faults=(*parts.faults, *found.faults, *copies),
        notes=(
            *_notes(found.animals, parts, used, is_ungraded=has_flags and not graded),
            *_category_notes(found.left_out),
            *elsewhere_notes(records),
            *tolerance.notes(),
        ),
        categories=tuple(kind.name for kind in used.values()),
    )


@dataclass(frozen=True)
class _Found:
    """The animals of a file.

    Attributes:
        animals: the sound ones, those of an image together.
        faults: an error for each other one.
        left_out: category -> how many of its annotations are not read.
    """

    animals: list[_Animal]
    faults: list[SampleError]
    left_out: Counter[str]


def _animals(
    parts: CocoParts,
    root: Path,
    *,
    species: dict[str, Species],
    read: frozenset[str],
    tolerance: Tolerance,
) -> _Found:
    """The animals of a file's images; arguments as read_coco has them."""
    found = _Found([], [], Counter())
    for listed in parts.images:
        name = portable_name(root, listed.name)
        image = listed if name == listed.name else replace(listed, name=name)
        for k, (i, raw) in enumerate(image.annotations):
            try:
                sample_id = image.name if k == 0 else f"{image.name}#{k}"
                entry = decoded(raw, CocoEntry, sample_id)
                kind = species.get(str(entry.category_id))
                if kind is not None and kind.name not in read:
                    found.left_out[kind.name] += 1
                    continue
                animal = _animal(
                    entry,
                    sample_id,
                    image,
                    root,
                    species=species,
                    has_corners=parts.is_animalpose,
                    tolerance=tolerance,
                )
                found.animals.append(animal)
            except SampleError as error:
                problem = f"{error.problem} (annotation {i})"
                found.faults.append(SampleError(error.sample_id, error.field, problem))
    return found


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
    tolerance: Tolerance,
) -> _Animal:
    """The record of one annotation, checked; raises SampleError.

    Args:
        entry: the annotation.
        sample_id: named in every error.
        image: the annotation's image.
        root: the folder of images.
        species: category id -> species.
        has_corners: whether bbox holds two corners, as AnimalPose's do.
        tolerance: how bad parts are taken.

    """
    kind = species.get(str(entry.category_id))
    if kind is None:
        raise SampleError(sample_id, "category_id", f"no category has the id {entry.category_id}")
    if kind.match is None:
        raise SampleError(sample_id, "keypoints", kind.problem)
    path = resolve_inside(root, image.name, sample_id, "file_name")
    height, width = image.image_hw
    image_hw = (
        stored_size(path, sample_id, upright=tolerance.upright)
        if height is None or width is None
        else image_size(height, width, sample_id, "width, height of the image")
    )
    marked = _keypoints(entry, kind.keypoints, sample_id, tolerance)
    keypoints = kind.match.rows(marked)
    form = "xmin, ymin, xmax, ymax" if has_corners else "x, y, w, h"
    runs = tolerance.part(partial(read_segmentation, entry.segmentation, image_hw, sample_id))
    record = AnimalRecord(
        sample_id=sample_id,
        image_id=image.name,
        image_path=path,
        image_hw=image_hw,
        vocabulary=kind.match.vocabulary,
        keypoints_2d=keypoints,
        mask_runs=runs,
        category=kind.name,
        box=tolerance.part(lambda: _box(entry.bbox, image_hw, sample_id, form)),
        sighting=sighting_of(entry, image.sighting),
        upright=tolerance.upright,
    )
    return _Animal(record, entry.num_keypoints not in (None, int((marked[:, 2] > 0).sum())))


def _keypoints(
    entry: CocoEntry, count: int, sample_id: str, tolerance: Tolerance
) -> NDArray[np.float64]:
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


def _with_confidence(record: AnimalRecord, graded: bool) -> AnimalRecord:
    """The record with confidences in the place of COCO's visibility.

    Visible keypoints get 1, hidden ones less. In a file that is not graded, which never says 2,
    a visibility of 1 means visible.
    """
    rows = record.keypoints_2d
    hidden = HIDDEN_CONFIDENCE if graded else 1.0
    confidence = np.select([rows[:, 2] >= 2, rows[:, 2] >= 1], [1.0, hidden], 0.0)
    return replace(record, keypoints_2d=np.concatenate((rows[:, :2], confidence[:, None]), axis=1))


def _category_notes(left_out: Counter[str]) -> tuple[str, ...]:
    """A sentence on the annotations of categories that are not read."""
    if not left_out:
        return ()
    counts = ", ".join(f"{count} of {name!r}" for name, count in left_out.most_common())
    return (f"annotations of other categories are left out: {counts} (--categories says which)",)


def _notes(
    animals: Sequence[_Animal], parts: CocoParts, species: dict[str, Species], *, is_ungraded: bool
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
    if is_ungraded and any(animal.record.keypoints_2d.any() for animal in animals):
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

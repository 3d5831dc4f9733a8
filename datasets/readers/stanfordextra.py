"""The reader of StanfordExtra: photographs of dogs with 24 keypoints and run-length masks."""

from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from animal3dbox.datasets.images.named_files import portable_name, resolve_inside
from animal3dbox.datasets.images.segmentation import read_runs
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
from animal3dbox.datasets.storage.json_files import read_json_list
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError, SampleError
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES

FORMAT = "stanfordextra"
"""The format's name in reports and for --format."""
CATEGORY = "dog"
"""The category of every animal."""
VOCABULARY = VOCABULARIES["stanfordextra24"]
"""The keypoints of every animal."""


class _ImageName(SightingKeys):
    """The part of an entry that names its sample, readable even where the rest is not."""

    img_path: str


class StanfordExtraEntry(_ImageName):
    """One element of the json's list, by the keys that we use; others are left alone."""

    img_width: int
    img_height: int
    joints: list[list[float | None]]
    img_bbox: Any = None
    seg: Any = None
    is_multiple_dogs: Any = False


def find_annotations(path: Path) -> Path:
    """The annotation file of a dataset given by its root or by that file.

    Raises:
        DatasetNotFoundError: there is none, or more than one.

    """
    if path.is_file():
        return path
    if not path.is_dir():
        raise DatasetNotFoundError(f"there is no file or folder {path}")
    candidates = annotation_files(path)
    if len(candidates) != 1:
        names = ", ".join(p.name for p in candidates) or "none"
        raise DatasetNotFoundError(
            f"{path} must hold one annotations.json or StanfordExtra*.json, found {names}: give the"
            " file itself"
        )
    return candidates[0]


def annotation_files(folder: Path) -> list[Path]:
    """The files of a folder that are named as StanfordExtra's annotations are, in order."""
    return sorted(
        path
        for path in folder.glob("*.json")
        if path.stem == "annotations" or path.stem.lower().startswith("stanfordextra")
    )


def read_stanfordextra(
    path: Path, images: Path | None = None, tolerance: Tolerance | None = None
) -> RecordSet:
    """The dogs of a StanfordExtra json.

    Args:
        path: the json, or the folder it lies in.
        images: the folder that img_path is relative to; None: "images" beside the json if there is
            one, else the json's folder.
        tolerance: how bad masks and boxes, and scores, are taken; None: not at all.

    Returns:
        The records in the file's order, and a fault for each that is unusable.

    Raises:
        DatasetNotFoundError: no such file, or no such folder of images.
        DatasetFormatError: not JSON, or not a list.

    """
    annotations = find_annotations(path)
    root = images or (
        annotations.parent / "images"
        if (annotations.parent / "images").is_dir()
        else annotations.parent
    )
    if not root.is_dir():
        raise DatasetNotFoundError(f"there is no folder of images {root}")
    tolerance, home = tolerance or Tolerance(), root.resolve()
    records: list[AnimalRecord] = []
    faults: list[SampleError] = []
    counts: dict[str, int] = {}
    copies: dict[bytes, int] = {}
    entries = read_json_list(annotations)
    if not entries:
        raise DatasetFormatError(f"{annotations} is a list without an entry")
    for i, raw in enumerate(entries):
        try:
            record = _record(raw, i, root, counts, home=home, tolerance=tolerance)
            if (first := copies.setdefault(bytes(raw), i)) != i:
                raise SampleError(
                    record.sample_id,
                    f"entry {i}",
                    f"is entry {first} once more; remove one, or it counts twice",
                )
            records.append(record)
        except SampleError as error:
            faults.append(error)
    kept, same_files = distinct_animals(records, tolerance)
    return RecordSet(
        FORMAT,
        kept,
        (*faults, *same_files),
        notes=(*elsewhere_notes(kept), *tolerance.notes()),
        categories=(CATEGORY,),
    )


def _record(
    raw: msgspec.Raw,
    index: int,
    root: Path,
    counts: dict[str, int],
    *,
    home: Path,
    tolerance: Tolerance,
) -> AnimalRecord:
    """The record of one entry, checked; raises SampleError.

    Args:
        raw: the entry.
        index: its place in the file.
        root: the folder that img_path is relative to.
        counts: image -> entries so far, to which this one is added.
        home: the same folder, resolved.
        tolerance: how bad parts are taken.

    """
    stated = decoded(raw, _ImageName, f"entry {index}").img_path
    if not stated.strip():
        raise SampleError(f"entry {index}", "img_path", f"is {stated!r}, which names no file")
    image = portable_name(root, stated)
    count = counts.get(image, 0)
    counts[image] = count + 1
    sample_id = image if count == 0 else f"{image}#{count}"
    entry = decoded(raw, StanfordExtraEntry, sample_id)
    image_hw = image_size(entry.img_height, entry.img_width, sample_id, "img_width, img_height")
    rows = read_rows(entry.joints, len(VOCABULARY), sample_id, "joints")
    seg, bbox = entry.seg, entry.img_bbox
    runs = None
    if seg is not None:
        runs = tolerance.part(partial(read_runs, seg, image_hw, sample_id, "seg"))
    return AnimalRecord(
        sample_id=sample_id,
        image_id=image,
        image_path=resolve_inside(root, image, sample_id, "img_path", home=home),
        image_hw=image_hw,
        vocabulary=VOCABULARY,
        keypoints_2d=tolerance.without_minus_ones(rows, sample_id),
        mask_runs=runs,
        category=CATEGORY,
        box=tolerance.part(lambda: read_box(bbox, sample_id, "img_bbox")),
        sighting=sighting_of(entry),
        upright=tolerance.upright,
    )

"""The checks that every writer of cuboids makes first, and the summary that it returns.

Lengths must have a unit that the format allows, and the boxes of an image its one K.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import Convention
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError, SampleError

SUPERCATEGORY = "object"
"""Supercategory of every category that is written, since a box does not know the kind of a dog."""


@dataclass(frozen=True)
class ExportSummary:
    """A summary of the files that a writer of cuboids wrote, for the person who asked for them.

    Attributes:
        files: the files in the order of writing; of many alike only their folder.
        images: number of images, with or without boxes.
        boxes: number of boxes.
        faults: one error a box that the format cannot hold.
        notes: what a careful person should know, in whole sentences.
        iou: intersection over union of each box with what the format keeps of it; None where the
            format keeps everything.
        next_id: the first number that no image and no box has, for an export that is to be joined
            with this one.
    """

    files: tuple[Path, ...]
    images: int
    boxes: int
    faults: tuple[SampleError, ...]
    notes: tuple[str, ...]
    iou: tuple[float, ...] | None = None
    next_id: int = 1


def category_ids(used: set[str], listed: Sequence[str], first_id: int) -> dict[str, int]:
    """The number of each category by name, in the order listed, else of the alphabet.

    Args:
        used: names of the boxes' categories.
        listed: names in the order of their numbers; none: those that are used.
        first_id: number of the first.

    Raises:
        ConfigError: a category of the boxes is not listed, or one is listed twice.

    """
    names = list(listed) or sorted(used)
    if len(set(names)) != len(names):
        raise ConfigError(f"categories must differ, got {', '.join(names)}")
    if missing := sorted(used.difference(names)):
        raise ConfigError(
            f"categories must list every category of the boxes, and lacks {', '.join(missing)}"
        )
    return {name: first_id + number for number, name in enumerate(names)}


def checked_first_id(first_id: int, least: int = 1) -> int:
    """A number to begin with, checked.

    Args:
        first_id: the user's.
        least: 1 where evaluators take 0 for "none".

    Raises:
        ConfigError: it is smaller.

    """
    if first_id < least:
        raise ConfigError(
            f"the first id must be {least} or greater, got {first_id}"
            + (": evaluators take 0 for no box" if least else "")
        )
    return first_id


def in_metres(cuboids: CuboidSet, metres_per_unit: float) -> CuboidSet:
    """The same boxes, those of unknown scale brought to metres.

    Args:
        cuboids: boxes, some of them of unknown scale.
        metres_per_unit: metres in a unit of these.

    Raises:
        ConfigError: the factor is not positive, or all boxes are in metres already.

    """
    if not (metres_per_unit > 0 and np.isfinite(metres_per_unit)):
        raise ConfigError(f"metres per unit must be positive, got {metres_per_unit}")
    if cuboids.records and all(record.metric for record in cuboids.records):
        raise ConfigError("all boxes are in metres already: leave out --metres-per-unit")
    return replace(
        cuboids, records=tuple(_metric(record, metres_per_unit) for record in cuboids.records)
    )


def _metric(record: CuboidRecord, metres_per_unit: float) -> CuboidRecord:
    """The record in metres."""
    if record.metric:
        return record
    return replace(
        record,
        center=record.center * metres_per_unit,
        size=record.size * metres_per_unit,
        metric=True,
    )


def checked_units(cuboids: CuboidSet, convention: Convention, *, scale_free: bool) -> str:
    """The unit of the lengths that will be written: "m", "unknown" or "mixed".

    Args:
        cuboids: the boxes.
        convention: of the format.
        scale_free: whether boxes of unknown scale may be written as they are.

    Raises:
        ConfigError: the format is in metres, the scale of a box is not known, and scale_free is
            false.

    """
    unknown = [record for record in cuboids.records if not record.metric]
    if not unknown:
        return "m"
    if convention.unit == "metres" and not scale_free:
        raise ConfigError(
            f"{convention.name} is in metres, and the scale of {len(unknown)} of"
            f" {len(cuboids.records)} boxes is not known (first: {unknown[0].sample_id}); give"
            " --metres-per-unit, or --scale-free to write the lengths as they are, or --metric yes"
            " if a file's are metres"
        )
    return "unknown" if len(unknown) == len(cuboids.records) else "mixed"


def images_with_boxes(
    cuboids: CuboidSet,
) -> tuple[list[tuple[CuboidImage, list[CuboidRecord]]], list[SampleError]]:
    """Every image with its boxes, and an error for each box that is not for the image as it is.

    Formats hold one K and one size an image, so a box of another K or size cannot be written.
    """
    members: dict[str, tuple[CuboidImage, list[CuboidRecord]]] = {
        image.image_id: (image, []) for image in cuboids.listed_images()
    }
    faults = []
    for record in cuboids.records:
        image, boxes = members[record.image_id]
        if record.image_hw != image.image_hw:
            faults.append(
                SampleError(
                    record.sample_id,
                    "image_hw",
                    f"is {record.image_hw}, but that of its image is {image.image_hw}",
                )
            )
        elif np.abs(record.K - image.K).max() > 1e-9 * image.K[0, 0]:
            focal = f"{record.K[0, 0]:.6g} and {image.K[0, 0]:.6g}"
            faults.append(
                SampleError(
                    record.sample_id,
                    "K",
                    f"differs from that of other boxes in its image (fx {focal}); label with one"
                    " known K an image",
                )
            )
        else:
            boxes.append(record)
    return list(members.values()), faults


def heading_note(records: Sequence[CuboidRecord]) -> tuple[str, ...]:
    """A sentence on boxes whose forward and left mean nothing, if there are any."""
    unknown = sum(not record.heading_known for record in records)
    if not unknown:
        return ()
    return (
        f"the heading of {unknown} of {len(records)} boxes is not known: which of their sides is"
        " called front means nothing",
    )


def upright_note(cuboids: CuboidSet) -> tuple[str, ...]:
    """A sentence on images whose boxes are for the pixels as turned, if there are any.

    It is for formats that name pictures and hold none of them.
    """
    turned = [image.image_id for image in cuboids.listed_images() if image.upright]
    if not turned:
        return ()
    return (
        f"the boxes of {len(turned)} images are for their pixels turned as the EXIF headers say,"
        f" not as stored: read the pictures so; the first is {turned[0]}",
    )

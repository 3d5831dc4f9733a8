"""What every writer of cuboids asks before it writes.

Units, one K an image, boxes that have a name.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import Convention
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError, SampleError

SUPERCATEGORY = "object"
"""Of every category that is written: a box does not know what kind of thing a dog is."""


@dataclass(frozen=True)
class Exported:
    """What a writer wrote.

    Attributes:
        files: in the order of writing; of many alike only their folder.
        images: how many, with or without boxes.
        boxes: how many.
        faults: the boxes that the format cannot hold, one each.
        notes: what a careful person should know, in whole sentences.
        iou: of what the format keeps of each box with the whole box; None where it keeps all.
    """

    files: tuple[Path, ...]
    images: int
    boxes: int
    faults: tuple[SampleError, ...]
    notes: tuple[str, ...]
    iou: tuple[float, ...] | None = None


def in_metres(cuboids: CuboidSet, metres_per_unit: float) -> CuboidSet:
    """The same boxes with those of unknown scale in metres.

    Raises:
        ConfigError: the factor is not positive, or all boxes are in metres already.

    """
    if not (metres_per_unit > 0 and np.isfinite(metres_per_unit)):
        raise ConfigError(f"metres per unit must be positive, got {metres_per_unit}")
    if cuboids.records and all(record.metric for record in cuboids.records):
        raise ConfigError("all boxes are in metres already: leave out --metres-per-unit")
    records = tuple(
        (
            record
            if record.metric
            else replace(
                record,
                center=record.center * metres_per_unit,
                size=record.size * metres_per_unit,
                metric=True,
            )
        )
        for record in cuboids.records
    )
    return replace(cuboids, records=records)


def checked_units(cuboids: CuboidSet, convention: Convention, *, scale_free: bool) -> str:
    """The unit of the lengths that will be written: "m", "unknown" or "mixed".

    Raises:
        ConfigError: a format of metres is asked for boxes of unknown scale, and nobody said that
            this is meant.

    """
    unknown = [record for record in cuboids.records if not record.metric]
    if not unknown:
        return "m"
    if convention.unit == "metres" and not scale_free:
        raise ConfigError(
            f"{convention.name} is in metres, and the scale of {len(unknown)} of"
            f" {len(cuboids.records)} boxes is not known (first: {unknown[0].sample_id}); give"
            " --metres-per-unit, or --scale-free to write the lengths as they are"
        )
    return "unknown" if len(unknown) == len(cuboids.records) else "mixed"


def images_with_boxes(
    cuboids: CuboidSet,
) -> tuple[list[tuple[CuboidImage, list[CuboidRecord]]], list[SampleError]]:
    """Every image with its boxes.

    Those whose K is not that of their image are faults, since formats hold one K an image.
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
    """A sentence if what is called forward and left has no meaning for some boxes."""
    unknown = sum(not record.heading_known for record in records)
    return (
        (
            (
                f"the heading of {unknown} of {len(records)} boxes is not known: which of their"
                " sides is called front means nothing"
            ),
        )
        if unknown
        else ()
    )

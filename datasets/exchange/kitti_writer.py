"""Cuboids written as KITTI's text files.

A KITTI box stands on the ground plane: what that costs is measured and said.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from animal3dbox.datasets.exchange.export import (
    Exported,
    checked_units,
    heading_note,
    images_with_boxes,
)
from animal3dbox.datasets.readers.cuboid_conventions import KITTI, Floats, yaw_of, yaw_rotation
from animal3dbox.datasets.readers.kitti.files import (
    OCCLUSION_UNKNOWN,
    KittiLine,
    calibration_text,
    image_line,
)
from animal3dbox.datasets.readers.visible_boxes import (
    VisibleBoxes,
    stacked_boxes,
    stated_truncation,
    visible_boxes,
)
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import write_whole
from animal3dbox.geometry.box_overlap import box_iou
from animal3dbox.geometry.cuboid import Cuboid


def write_kitti(cuboids: CuboidSet, folder: Path, *, scale_free: bool = False) -> Exported:
    """Write FOLDER/label_2/000000.txt and so on, FOLDER/calib/000000.txt, and FOLDER/images.txt, which says whose they are.

    A box keeps its centre, its dimensions and the yaw of its forward axis; pitch and roll are lost.
    The intersection over union of each box with what is left of it is returned, and its median and
    worst are noted.

    Args:
        cuboids: boxes in metres.
        folder: new, or without label files: those of another export would stay among these.
        scale_free: write boxes of unknown scale as they are.

    Returns:
        What was written; its faults are the boxes that were left out, those outside the frame among
        them.

    Raises:
        ConfigError: the scale of a box is not known, and scale_free is false; or the folder holds
            label files.

    """
    if any((folder / "label_2").glob("*.txt")):
        raise ConfigError(
            f"{folder} holds label files already: give a new folder, or remove them first"
        )
    units = checked_units(cuboids, KITTI, scale_free=scale_free)
    members, faults = images_with_boxes(cuboids)
    written: list[CuboidRecord] = []
    for number, (image, records) in enumerate(members):
        seen = visible_boxes(records)
        lines = []
        for index, record in enumerate(records):
            box = seen.in_frame[index] if record.box is None else record.box
            if np.isnan(box).any():
                faults.append(
                    SampleError(
                        record.sample_id,
                        "box",
                        "nothing of it lies in the frame, so that there is no 2D box",
                    )
                )
                continue
            lines.append(_line(record, seen, index, box).text() + "\n")
            written.append(record)
        write_whole(folder / "label_2" / f"{number:06d}.txt", "".join(lines).encode())
        write_whole(
            folder / "calib" / f"{number:06d}.txt", calibration_text(KITTI.K_out(image.K)).encode()
        )
    write_whole(
        folder / "images.txt",
        "".join(image_line(number, image) for number, (image, _) in enumerate(members)).encode(),
    )
    iou = yaw_only_iou(written)
    notes = (
        heading_note(written)
        + _loss_note(iou)
        + (() if units == "m" else (f"lengths are not all in metres ({units})",))
    )
    files = (folder / "label_2", folder / "calib", folder / "images.txt")
    return Exported(files, len(members), len(written), tuple(faults), notes, iou)


def levelled(rotation: Floats) -> Floats:
    """Rotations (..., 3, 3) R_cam_box without pitch and roll.

    The camera's y axis points down the box.
    """
    center = size = np.ones((*rotation.shape[:-2], 3))
    location, turned, dimensions = KITTI.boxes_out(center, rotation, size)
    return KITTI.boxes_in(location, yaw_rotation(yaw_of(turned)), dimensions)[1]


def yaw_only_iou(records: Sequence[CuboidRecord]) -> tuple[float, ...]:
    """What KITTI keeps of boxes.

    Their exact intersection over union with the yaw-only boxes that are written.
    """
    if not records:
        return ()
    center, whole, size = stacked_boxes(records)
    c, R, flat, s = (
        torch.from_numpy(np.ascontiguousarray(part))
        for part in (center, whole, levelled(whole), size)
    )
    return tuple(box_iou(Cuboid(c, R, s), Cuboid(c, flat, s)).tolist())


def _line(record: CuboidRecord, seen: VisibleBoxes, index: int, box: Floats) -> KittiLine:
    location, turned, dimensions = KITTI.boxes_out(
        record.center, levelled(record.rotation), record.size
    )
    yaw = float(yaw_of(turned))
    alpha = yaw - float(np.arctan2(location[0], location[2]))
    return KittiLine(
        kind="_".join(record.category.split()) or "unknown",
        truncated=stated_truncation(record, seen, index),
        occluded=OCCLUSION_UNKNOWN,
        alpha=(alpha + np.pi) % (2 * np.pi) - np.pi,
        box=KITTI.boxes_2d_out(box),
        dimensions=dimensions,
        location=location,
        rotation_y=yaw,
    )


def _loss_note(iou: tuple[float, ...]) -> tuple[str, ...]:
    if not iou:
        return ()
    median, worst = float(np.median(iou)), min(iou)
    return (
        (
            f"KITTI boxes keep only yaw: IoU with the whole boxes is {median:.3f} in the median and"
            f" {worst:.3f} at worst ({len(iou)} boxes)"
        ),
    )

"""The writer of cuboids as KITTI's text files.

A KITTI box stands on the ground plane; the loss is measured and noted.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from animal3dbox.datasets.exchange.export import (
    ExportSummary,
    checked_units,
    heading_note,
    images_with_boxes,
)
from animal3dbox.datasets.readers.cuboid_conventions import KITTI, Floats, yaw_of, yaw_rotation
from animal3dbox.datasets.readers.kitti.files import (
    OCCLUSION_UNKNOWN,
    UNITS,
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


def write_kitti(cuboids: CuboidSet, folder: Path, *, scale_free: bool = False) -> ExportSummary:
    """Write cuboids as a folder of KITTI's text files.

    FOLDER/label_2/000000.txt and FOLDER/calib/000000.txt are the first image's, and so on;
    FOLDER/images.txt says which image each number is.

    A box keeps its centre, its dimensions and the yaw of its forward axis; pitch and roll are lost.
    The intersection over union of each box with what is left of it is returned, and its median and
    worst are noted.

    Args:
        cuboids: boxes in metres.
        folder: new, or without label files: those of another export would stay among these.
        scale_free: write boxes of unknown scale as they are.

    Returns:
        The summary; its faults are the boxes that were left out, those outside the frame among
        them.

    Raises:
        ConfigError: the scale of a box is not known, and scale_free is false; or the folder holds
            label files.

    Example:
        >>> import tempfile
        >>> from animal3dbox.datasets import CuboidRecord, CuboidSet
        >>> K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
        >>> dog = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="dog",
        ...     K=K,
        ...     center=np.array([0.0, 0.0, 4.0]),
        ...     rotation=np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
        ...     size=np.array([0.9, 0.3, 0.6]),
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     summary = write_kitti(CuboidSet("dogs", (dog,), ()), Path(folder))
        ...     (Path(folder) / "label_2" / "000000.txt").read_text().split()[:3]
        ['dog', '0.000000', '3']
        >>> [round(iou, 6) for iou in summary.iou]
        [1.0]

    """
    if any((folder / "label_2").glob("*.txt")):
        raise ConfigError(
            f"{folder} holds label files already: give a new folder, or remove them first"
        )
    units = checked_units(cuboids, KITTI, scale_free=scale_free)
    members, faults = images_with_boxes(cuboids)
    records: list[CuboidRecord] = []
    for number, (image, boxes) in enumerate(members):
        lines, with_box, outside = _lines(boxes)
        records += with_box
        faults += outside
        calibration = calibration_text(KITTI.K_out(image.K))
        write_whole(folder / "label_2" / f"{number:06d}.txt", "".join(lines).encode())
        write_whole(folder / "calib" / f"{number:06d}.txt", calibration.encode())
    index = [image_line(number, image) for number, (image, _) in enumerate(members)]
    index = index if units == "m" else [f"{UNITS}{units}\n", *index]
    write_whole(folder / "images.txt", "".join(index).encode())
    iou = yaw_only_iou(records)
    unit_note = () if units == "m" else (f"lengths are not all in metres ({units})",)
    return ExportSummary(
        files=(folder / "label_2", folder / "calib", folder / "images.txt"),
        images=len(members),
        boxes=len(records),
        faults=tuple(faults),
        notes=(*heading_note(records), *_loss_note(iou), *unit_note),
        iou=iou,
    )


def _lines(
    records: Sequence[CuboidRecord],
) -> tuple[list[str], list[CuboidRecord], list[SampleError]]:
    """The lines of an image's boxes, the boxes that have one, and an error for each other box."""
    visible = visible_boxes(records)
    lines, with_box, faults = [], [], []
    for index, record in enumerate(records):
        box = visible.in_frame[index] if record.box is None else record.box
        if np.isnan(box).any():
            faults.append(
                SampleError(
                    record.sample_id,
                    "box",
                    "nothing of it lies in the frame, so that there is no 2D box",
                )
            )
            continue
        if record.center[2] <= 0:
            faults.append(
                SampleError(
                    record.sample_id,
                    "center",
                    f"has z = {record.center[2]:.4g}: KITTI's boxes stand in front of the camera",
                )
            )
            continue
        lines.append(_line(record, visible, index, box).text() + "\n")
        with_box.append(record)
    return lines, with_box, faults


def levelled(rotation: Floats) -> Floats:
    """The rotations (..., 3, 3) R_cam_box without pitch and roll.

    The camera's y axis then points down the box, and the yaw of its forward axis is kept.
    """
    center = size = np.ones((*rotation.shape[:-2], 3))
    location, rotation_out, dimensions = KITTI.boxes_out(center, rotation, size)
    return KITTI.boxes_in(location, yaw_rotation(yaw_of(rotation_out)), dimensions)[1]


def yaw_only_iou(records: Sequence[CuboidRecord]) -> tuple[float, ...]:
    """Exact intersection over union of each box with the yaw-only box that KITTI keeps of it."""
    if not records:
        return ()
    boxes = stacked_boxes(records)
    center, rotation, size = (torch.from_numpy(np.ascontiguousarray(part)) for part in boxes)
    yaw_only = torch.from_numpy(np.ascontiguousarray(levelled(boxes[1])))
    iou = box_iou(Cuboid(center, rotation, size), Cuboid(center, yaw_only, size))
    return tuple(iou.tolist())


def _line(record: CuboidRecord, visible: VisibleBoxes, index: int, box: Floats) -> KittiLine:
    """The line of one box.

    Args:
        record: the box.
        visible: of the image's boxes.
        index: the record's place among them.
        box: (4,) xyxy in our px.

    """
    location, rotation, dimensions = KITTI.boxes_out(
        record.center, levelled(record.rotation), record.size
    )
    yaw = float(yaw_of(rotation))
    alpha = yaw - float(np.arctan2(location[0], location[2]))
    return KittiLine(
        kind="_".join(record.category.split()) or "unknown",
        truncated=stated_truncation(record, visible, index),
        occluded=OCCLUSION_UNKNOWN,
        alpha=(alpha + np.pi) % (2 * np.pi) - np.pi,
        box=KITTI.boxes_2d_out(box),
        dimensions=dimensions,
        location=location,
        rotation_y=yaw,
    )


def _loss_note(iou: tuple[float, ...]) -> tuple[str, ...]:
    """A sentence on the pitch and roll that are lost, if there is a box."""
    if not iou:
        return ()
    median, worst = float(np.median(iou)), min(iou)
    return (
        f"KITTI boxes keep only yaw: IoU with the whole boxes is {median:.3f} in the median and"
        f" {worst:.3f} at worst ({len(iou)} boxes)",
    )

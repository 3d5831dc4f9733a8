"""The writer of cuboids as KITTI's text files.

A KITTI box stands on the ground plane; the loss is measured and noted.
"""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from animal3dbox.datasets.exchange.export import (
    ExportSummary,
    checked_first_id,
    checked_units,
    heading_note,
    images_with_boxes,
)
from animal3dbox.datasets.exchange.occlusion import visible_parts
from animal3dbox.datasets.images.photos import is_file, read_photo
from animal3dbox.datasets.readers.cuboid_conventions import KITTI, Floats, yaw_of, yaw_rotation
from animal3dbox.datasets.readers.kitti.files import (
    HEADING_UNKNOWN,
    OCCLUSION_UNKNOWN,
    UNITS,
    VISIBILITY,
    KittiLine,
    calibration_text,
    image_line,
)
from animal3dbox.datasets.readers.visible_boxes import (
    stacked_boxes,
    stated_truncation,
    visible_boxes,
)
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import write_whole
from animal3dbox.geometry.box_overlap import box_iou
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.progress import watched

FILES = ("label_2", "calib", "image_2", "ImageSets", "images.txt")
"""What a folder holds, but for image_2/ if no picture was found."""


def write_kitti(
    cuboids: CuboidSet,
    folder: Path,
    *,
    scale_free: bool = False,
    split: str = "train",
    first_id: int = 0,
) -> ExportSummary:
    """Write cuboids as a folder of KITTI's text files.

    FOLDER/label_2/000000.txt, FOLDER/calib/000000.txt and FOLDER/image_2/000000.png are the first
    image's, and so on; FOLDER/ImageSets/train.txt lists the numbers, FOLDER/images.txt says which
    image each is. Pictures are written anew and without any header: as their pixels are stored, or
    turned as their headers say where the boxes are for the turned ones.

    `occluded` is 0, 1 or 2 by the part that is visible, as the dataset says, else as the nearer
    boxes of the image leave it: with 3, unknown, a common family of loaders skips every box.

    A box keeps its centre, its dimensions and the yaw of its forward axis; pitch and roll are lost.
    The intersection over union of each box with what is left of it is returned, and its median and
    worst are noted.

    Args:
        cuboids: boxes in metres.
        folder: new, or without label files: those of another export would stay among these.
        scale_free: write boxes of unknown scale as they are.
        split: name of the list in ImageSets/.
        first_id: number of the first image.

    Returns:
        The summary; its faults are the boxes that were left out, those outside the frame among
        them, and pictures that are there and cannot be read.

    Raises:
        ConfigError: the scale of a box is not known, and scale_free is false; the folder holds
            label files; first_id is negative; or split is no name of a file.

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
        ['dog', '0.000000', '0']
        >>> [round(iou, 6) for iou in summary.iou]
        [1.0]

    """
    if any((folder / "label_2").glob("*.txt")):
        raise ConfigError(
            f"{folder} holds label files already: give a new folder, or remove them first"
        )
    units = checked_units(cuboids, KITTI, scale_free=scale_free)
    start = checked_first_id(first_id, least=0)
    _check_split(split)
    members, faults = images_with_boxes(cuboids)
    records: list[CuboidRecord] = []
    missing: list[str] = []
    images = dict(enumerate((image for image, _ in members), start))
    for number, image in watched(images.items(), "writing", unit="image"):
        lines, with_box, outside = _lines(members[number - start][1])
        records += with_box
        faults += outside
        write_whole(folder / "label_2" / f"{number:06d}.txt", "".join(lines).encode())
        calibration = calibration_text(KITTI.K_out(image.K)).encode()
        write_whole(folder / "calib" / f"{number:06d}.txt", calibration)
        try:
            missing += _write_picture(image, folder / "image_2" / f"{number:06d}.png")
        except SampleError as error:
            faults.append(error)
    _write_lists(folder, images, split=split, remarks=_remarks(records, units))
    iou = yaw_only_iou(records)
    return ExportSummary(
        files=tuple(folder / name for name in FILES if (folder / name).exists()),
        images=len(members),
        boxes=len(records),
        faults=tuple(faults),
        notes=(
            *heading_note(records),
            *_picture_note(missing, len(members)),
            *_occlusion_note(records),
            *_loss_note(iou),
            *(() if units == "m" else (f"lengths are not all in metres ({units})",)),
        ),
        iou=iou,
        next_id=start + len(members),
    )


def _remarks(records: Sequence[CuboidRecord], units: str) -> list[str]:
    """The lines of images.txt on what KITTI's format takes for granted and these boxes are not."""
    remarks = [] if units == "m" else [f"{UNITS}{units}"]
    return remarks + ([] if all(record.heading_known for record in records) else [HEADING_UNKNOWN])


def _write_lists(
    folder: Path, images: dict[int, CuboidImage], *, split: str, remarks: Sequence[str]
) -> None:
    """Write images.txt, with remarks on all boxes, and the list of a split, of images by number."""
    index = [f"{remark}\n" for remark in remarks]
    index += [image_line(number, image) for number, image in images.items()]
    numbers = "".join(f"{number:06d}\n" for number in images)
    write_whole(folder / "images.txt", "".join(index).encode())
    write_whole(folder / "ImageSets" / f"{split}.txt", numbers.encode())


def _check_split(split: str) -> None:
    """Raise a ConfigError for a split that is no plain name of a file."""
    if not split or Path(split).name != split or split.startswith("."):
        raise ConfigError(f"split must be a name such as train or val, got {split!r}")


def _write_picture(image: CuboidImage, path: Path) -> list[str]:
    """Write an image's pixels, and nothing else of its file, as a PNG.

    Returns:
        The image's name, if there is no file of it; else nothing.

    Raises:
        SampleError: the file cannot be decoded, or is of another size than the boxes are for.

    """
    path_or_url = image.image_path
    if path_or_url is None or (isinstance(path_or_url, Path) and not is_file(path_or_url)):
        return [image.image_id]
    photo = read_photo(path_or_url, image.image_id, image.image_hw, upright=image.upright)
    content = BytesIO()
    Image.fromarray(photo.pixels).save(content, "PNG")
    write_whole(path, content.getvalue())
    return []


def _picture_note(missing: Sequence[str], images: int) -> tuple[str, ...]:
    """A sentence on images of which there is no file, if there are any."""
    if not missing:
        return ()
    return (
        f"{len(missing)} of {images} pictures were not found and are not in image_2/ (the first is"
        f" {missing[0]}): give their folder (--images)",
    )


def _occlusion_note(records: Sequence[CuboidRecord]) -> tuple[str, ...]:
    """A sentence on boxes of which the dataset does not say what hides them, if there are any."""
    count = sum(record.visibility is None for record in records)
    if not count:
        return ()
    return (
        f"occluded of {count} of {len(records)} boxes is what nearer boxes hide of them: things"
        " that are no boxes are not known",
    )


def _lines(
    records: Sequence[CuboidRecord],
) -> tuple[list[str], list[CuboidRecord], list[SampleError]]:
    """The lines of an image's boxes, the boxes that have one, and an error for each other box."""
    visible = visible_boxes(records)
    parts = visible_parts(records, visible)
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
        truncated = stated_truncation(record, visible, index)
        occluded = occlusion_level(float(parts[index]))
        line = _line(record, box, truncated=truncated, occluded=occluded)
        lines.append(line.text() + "\n")
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


def occlusion_level(part: float) -> int:
    """KITTI's level of occlusion of a thing of which a part, 0 to 1, is visible; 3 of NaN."""
    if np.isnan(part):
        return OCCLUSION_UNKNOWN
    return min(VISIBILITY, key=lambda level: abs(VISIBILITY[level] - part))


def _line(record: CuboidRecord, box: Floats, *, truncated: float, occluded: int) -> KittiLine:
    """The line of one box.

    Args:
        record: the box.
        box: (4,) xyxy in our px.
        truncated: the part outside the frame.
        occluded: KITTI's level.

    """
    location, rotation, dimensions = KITTI.boxes_out(
        record.center, levelled(record.rotation), record.size
    )
    yaw = float(yaw_of(rotation))
    alpha = yaw - float(np.arctan2(location[0], location[2]))
    return KittiLine(
        kind="_".join(record.category.split()) or "unknown",
        truncated=truncated,
        occluded=occluded,
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

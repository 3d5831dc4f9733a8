"""The pictures of a comparison: labels solid and detections dashed, as in the paper's Fig. 2."""

import io
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.datasets.images.photos import is_file, read_image
from animal3dbox.datasets.images.remote_files import PicturePath
from animal3dbox.datasets.records import CuboidRecord
from animal3dbox.errors import SampleError
from animal3dbox.evaluate.comparison import ComparedBox, cuboids_of
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.report.overlay import DrawnCuboid, cuboids_in_picture, with_words

BLANK = 70
"""Grey of a picture that is not there."""


def comparison_pictures(
    boxes: Sequence[ComparedBox], files: dict[str, PicturePath | None], faults: list[SampleError]
) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Each image's name and its picture (H, W, 3) uint8 RGB, the worst match first.

    Args:
        boxes: of all images.
        files: image -> its file.
        faults: to which an error is added of each file that cannot be read, whose picture is grey.

    """
    of_image: dict[str, list[ComparedBox]] = defaultdict(list)
    for box in boxes:
        of_image[box.image_id].append(box)
    for image_id in sorted(of_image, key=lambda name: _worst(of_image[name])):
        members = of_image[image_id]
        try:
            pixels = _pixels(members[0], files.get(image_id))
        except SampleError as error:
            faults.append(error)
            pixels = np.full((*members[0].record.image_hw, 3), BLANK, dtype=np.uint8)
        yield image_id, drawn_boxes(pixels, members)


def _worst(boxes: Sequence[ComparedBox]) -> float:
    """The least overlap of an image's boxes; one that is alone has none."""
    return min(box.iou_3d if box.iou_3d is not None else (box.iou_2d or 0.0) for box in boxes)


def _pixels(box: ComparedBox, file: PicturePath | None) -> NDArray[np.uint8]:
    """The pixels (H, W, 3) of a box's image; raises SampleError."""
    if file is None or (isinstance(file, Path) and not is_file(file)):
        problem = "there is no such picture: give the folder that names are relative to (--images)"
        raise SampleError(box.image_id, "file_path", problem)
    return read_image(file, box.image_id, box.record.image_hw)


def drawn_boxes(pixels: NDArray[np.uint8], boxes: Sequence[ComparedBox]) -> NDArray[np.uint8]:
    """The picture (H', W', 3) with labels solid, detections dashed, and a line of words each.

    Small animals are shown enlarged in a corner too, the worst match first.

    Args:
        pixels: (H, W, 3) uint8 RGB.
        boxes: of this image.

    """
    worst_first = sorted(boxes, key=lambda box: _worst([box]))
    labels = [_drawn(box.label, dashed=False) for box in worst_first if box.label is not None]
    detections = [
        _drawn(box.detection, dashed=True) for box in worst_first if box.detection is not None
    ]
    canvas = cuboids_in_picture(pixels, labels + detections)
    return with_words(canvas, [_words(box) for box in boxes])


def _drawn(record: CuboidRecord, *, dashed: bool) -> DrawnCuboid:
    """The box of a record in the camera frame, as it is drawn."""
    return DrawnCuboid(
        _cuboid(record), torch.from_numpy(record.K), dashed, heading_known=record.heading_known
    )


def _cuboid(record: CuboidRecord) -> Cuboid:
    """The box of a record in the camera frame."""
    boxes = cuboids_of([record])
    return Cuboid(boxes.center[0], boxes.rotation[0], boxes.size[0])


def _words(box: ComparedBox) -> str:
    """The caption of one animal: its status, category, overlaps and score."""
    words = [box.status, box.record.category]
    words += [] if box.iou_3d is None else [f"IoU {box.iou_3d:.2f}"]
    words += [] if box.iou_2d is None else [f"2D {box.iou_2d:.2f}"]
    if box.detection is not None and box.detection.score is not None:
        words.append(f"score {box.detection.score:.2f}")
    return "  ".join(words)


def png_of(picture: NDArray[np.uint8]) -> bytes:
    """A picture (H, W, 3) uint8 RGB as the bytes of a PNG."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    return buffer.getvalue()

"""Cuboids written as COCO keypoints.

The eight projected corners and the projected centre of each box.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from animal3dbox.datasets.exchange.export import (
    SUPERCATEGORY,
    Exported,
    heading_note,
    images_with_boxes,
)
from animal3dbox.datasets.readers.cuboid_conventions import COCO, Floats
from animal3dbox.datasets.readers.visible_boxes import VisibleBoxes, visible_boxes
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import SampleError
from animal3dbox.files import write_whole
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import CORNER_SIGNS, EDGES, MIRRORED_CORNERS

KEYPOINT_NAMES = (
    *(
        "_".join((("back", "front")[x > 0], ("right", "left")[y > 0], ("bottom", "top")[z > 0]))
        for x, y, z in CORNER_SIGNS
    ),
    "center",
)
FLIP_PAIRS = tuple(
    (KEYPOINT_NAMES[a], KEYPOINT_NAMES[b]) for a, b in enumerate(MIRRORED_CORNERS) if a < b
)
SKELETON = [[a + 1, b + 1] for a, b in EDGES]
"""COCO counts keypoints from 1 here."""

NOT_LABELLED, OUTSIDE, SEEN = 0, 1, 2


def write_coco(cuboids: CuboidSet, path: Path) -> Exported:
    """Write cuboids as a COCO keypoint file.

    A keypoint has v = 2 if it lies in the frame and in front of the camera, 1 if in front but
    outside the frame (its coordinates are right, and out of bounds), 0 with x = y = 0 if it is not
    in front. Corners of a box are no points of a surface: none is hidden. bbox is the dataset's
    box, else the one round what the frame shows of the cuboid.

    Args:
        cuboids: boxes of any unit; their scale is not written.
        path: the JSON file; one that is there is replaced.

    Returns:
        What was written; its faults are the boxes that were left out, those outside the frame among
        them.

    """
    members, faults = images_with_boxes(cuboids)
    kept = [record for _, records in members for record in records]
    names = sorted({record.category.strip() or "unknown" for record in kept})
    ids = {name: number for number, name in enumerate(names, start=1)}
    numbers = {image.image_id: number for number, (image, _) in enumerate(members, start=1)}
    annotations, outside = _annotations(kept, numbers, ids)
    file = {
        "info": {"description": "projected cuboids, written by animal3dbox", "version": "1"},
        "licenses": [],
        "images": [
            {
                "id": numbers[image.image_id],
                "file_name": image.image_id,
                "width": image.image_hw[1],
                "height": image.image_hw[0],
            }
            | {"K": COCO.K_out(image.K).tolist()}
            for image, _ in members
        ],
        "categories": [
            {
                "id": number,
                "name": name,
                "supercategory": SUPERCATEGORY,
                "keypoints": KEYPOINT_NAMES,
                "skeleton": SKELETON,
            }
            | {"flip_pairs": FLIP_PAIRS}
            for name, number in ids.items()
        ],
        "annotations": annotations,
    }
    write_whole(path, msgspec.json.encode(file))
    return Exported(
        (path,), len(members), len(annotations), (*faults, *outside), heading_note(kept)
    )


def _annotations(
    records: Sequence[CuboidRecord], numbers: dict[str, int], ids: dict[str, int]
) -> tuple[list[dict[str, Any]], list[SampleError]]:
    seen = visible_boxes(records)
    annotations: list[dict[str, Any]] = []
    faults = []
    for index, record in enumerate(records):
        box = seen.in_frame[index] if record.box is None else record.box
        if np.isnan(box).any():
            faults.append(
                SampleError(
                    record.sample_id,
                    "box",
                    "nothing of it lies in the frame, so that there is no bbox",
                )
            )
            continue
        x1, y1, x2, y2 = COCO.boxes_2d_out(box).tolist()
        keypoints = corner_keypoints(record, seen, index)
        annotation = {
            "id": len(annotations) + 1,
            "image_id": numbers[record.image_id],
            "category_id": ids[record.category.strip() or "unknown"],
            "bbox": [x1, y1, x2 - x1, y2 - y1],
            "area": (x2 - x1) * (y2 - y1),
            "iscrowd": 0,
            "keypoints": keypoints.ravel().tolist(),
            "num_keypoints": int((keypoints[:, 2] > NOT_LABELLED).sum()),
            "heading_known": record.heading_known,
        }
        annotations.append(annotation)
    return annotations, faults


def corner_keypoints(record: CuboidRecord, seen: VisibleBoxes, index: int) -> Floats:
    """The keypoints (9, 3) x, y, v of one box in COCO's pixels."""
    height, width = record.image_hw
    near = seen.corners_3d[index]
    middle = project(record.K, record.center[None])[0]
    middle_in_front = record.center[2] > 1e-2 * np.linalg.norm(near[6] - near[0])
    px = np.concatenate((seen.corners_2d[index], middle))
    in_front = np.append(seen.corner_in_front[index], middle_in_front)
    in_frame = ((px >= -0.5) & (px <= [width - 0.5, height - 0.5])).all(-1)
    v = np.where(in_front, np.where(in_frame, SEEN, OUTSIDE), NOT_LABELLED)
    return np.concatenate(
        (np.where(in_front[:, None], COCO.keypoints_out(px), 0.0), v[:, None]), axis=-1
    )

"""The writer of cuboids as COCO keypoints: the projected corners and centre of each box."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from animal3dbox.datasets.exchange.export import (
    SUPERCATEGORY,
    ExportSummary,
    category_ids,
    checked_first_id,
    heading_note,
    images_with_boxes,
    upright_note,
)
from animal3dbox.datasets.readers.cuboid_conventions import COCO, Floats
from animal3dbox.datasets.readers.visible_boxes import VisibleBoxes, visible_boxes
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import SampleError
from animal3dbox.files import write_whole
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import CORNER_SIGNS, EDGES, MIRRORED_CORNERS
from animal3dbox.progress import watched

KEYPOINT_NAMES = (
    *(
        "_".join((("back", "front")[x > 0], ("right", "left")[y > 0], ("bottom", "top")[z > 0]))
        for x, y, z in CORNER_SIGNS
    ),
    "center",
)
"""Names of a box's nine keypoints: its corners in our order, then its centre."""
FLIP_PAIRS = tuple(
    (KEYPOINT_NAMES[a], KEYPOINT_NAMES[b]) for a, b in enumerate(MIRRORED_CORNERS) if a < b
)
"""Pairs of corners that a mirrored picture exchanges, by name."""
SKELETON = [[a + 1, b + 1] for a, b in EDGES]
"""Edges of the box as pairs of keypoints, which COCO counts from 1 here."""

NOT_LABELLED, OUTSIDE, IN_FRAME = 0, 1, 2
"""COCO's visibility of a keypoint, as write_coco uses it."""


def write_coco(
    cuboids: CuboidSet, path: Path, *, first_id: int = 1, categories: Sequence[str] = ()
) -> ExportSummary:
    """Write cuboids as a COCO keypoint file.

    A keypoint has v = 2 if it lies in the frame and in front of the camera, 1 if in front but
    outside the frame (its coordinates are right, and out of bounds), 0 with x = y = 0 if it is not
    in front. Corners of a box are no points of a surface: none is hidden. bbox is the dataset's
    box, else the one round what the frame shows of the cuboid.

    Args:
        cuboids: boxes of any unit; their scale is not written.
        path: the JSON file; one that is there is replaced.
        first_id: id of the first image and of the first annotation; see write_omni3d.
        categories: names in the order of their ids, from 1; none: those of the boxes.

    Returns:
        The summary; its faults are the boxes that were left out, those outside the frame among
        them.

    Raises:
        ConfigError: first_id is below 1, or categories lacks one of a box.

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
        ...     summary = write_coco(CuboidSet("dogs", (dog,), ()), Path(folder) / "dogs.json")
        >>> summary.images, summary.boxes, summary.faults
        (1, 1, ())

    """
    members, faults = images_with_boxes(cuboids)
    records = [record for _, boxes in members for record in boxes]
    used = {record.category.strip() or "unknown" for record in records}
    ids = category_ids(used, categories, first_id=1)
    start = checked_first_id(first_id)
    numbers = {image.image_id: number for number, (image, _) in enumerate(members, start)}
    annotations, outside = _annotations(records, numbers, ids, first_id=start)
    file = {
        "info": {"description": "projected cuboids, written by animal3dbox", "version": "1"},
        "licenses": [],
        "images": [
            {
                "id": numbers[image.image_id],
                "file_name": image.image_id,
                "width": image.image_hw[1],
                "height": image.image_hw[0],
                "K": COCO.K_out(image.K).tolist(),
            }
            for image, _ in members
        ],
        "categories": [_category(name, number) for name, number in ids.items()],
        "annotations": annotations,
    }
    write_whole(path, msgspec.json.encode(file))
    return ExportSummary(
        files=(path,),
        images=len(members),
        boxes=len(annotations),
        faults=(*faults, *outside),
        notes=(*heading_note(records), *upright_note(cuboids)),
        next_id=start + max(len(members), len(annotations)),
    )


def _category(name: str, number: int) -> dict[str, Any]:
    """One element of "categories", all of which have the keypoints of a box."""
    return {
        "id": number,
        "name": name,
        "supercategory": SUPERCATEGORY,
        "keypoints": KEYPOINT_NAMES,
        "skeleton": SKELETON,
        "flip_pairs": FLIP_PAIRS,
    }


def _annotations(
    records: Sequence[CuboidRecord],
    numbers: dict[str, int],
    ids: dict[str, int],
    *,
    first_id: int,
) -> tuple[list[dict[str, Any]], list[SampleError]]:
    """The annotations of the boxes that have a bbox, and an error for each other box.

    Args:
        records: the boxes.
        numbers: image id -> number.
        ids: category -> number.
        first_id: of the annotations.

    """
    visible = visible_boxes(records)
    annotations: list[dict[str, Any]] = []
    faults = []
    for index, record in enumerate(watched(records, "writing", unit="box")):
        box = visible.in_frame[index] if record.box is None else record.box
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
        keypoints = corner_keypoints(record, visible, index)
        annotation = {
            "id": first_id + len(annotations),
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


def corner_keypoints(record: CuboidRecord, visible: VisibleBoxes, index: int) -> Floats:
    """The keypoints (9, 3) x, y, v of one box in COCO's pixels.

    Args:
        record: the box.
        visible: of several boxes.
        index: the record's place among them.

    """
    height, width = record.image_hw
    corners = visible.corners_3d[index]
    near_depth = 1e-2 * np.linalg.norm(corners[6] - corners[0])
    px = np.concatenate((visible.corners_2d[index], project(record.K, record.center[None])[0]))
    in_front = np.append(visible.corner_in_front[index], record.center[2] > near_depth)
    in_frame = ((px >= -0.5) & (px <= [width - 0.5, height - 0.5])).all(-1)
    v = np.where(in_front, np.where(in_frame, IN_FRAME, OUTSIDE), NOT_LABELLED)
    xy = np.where(in_front[:, None], COCO.keypoints_out(px), 0.0)
    return np.concatenate((xy, v[:, None]), axis=-1)

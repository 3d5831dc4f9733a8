"""The writer of 2D boxes as open-vocabulary 3D detectors take them for prompts (oracle 2D)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from animal3dbox.datasets.exchange.export import (
    ExportSummary,
    category_ids,
    checked_first_id,
    images_with_boxes,
)
from animal3dbox.datasets.exchange.omni3d_writer import category_name
from animal3dbox.datasets.readers.cuboid_conventions import OMNI3D, Floats
from animal3dbox.datasets.readers.visible_boxes import visible_boxes
from animal3dbox.datasets.records import CuboidRecord, CuboidSet
from animal3dbox.errors import SampleError
from animal3dbox.files import write_whole


def write_oracle2d(
    cuboids: CuboidSet, path: Path, *, first_id: int = 1, categories: Sequence[str] = ()
) -> ExportSummary:
    """Write the 2D boxes of cuboids as OVMono3D and DetAny3D take them: a list, an image each.

    An element is {image_id, K, file_path, height, width, instances}, an instance {bbox, score,
    category_id, category_name}. Numbers join with write_omni3d's of the same set: image_id is that
    of its "images", category_id the category's contiguous id (its place from 0 on), bbox is
    x, y, w, h in Omni3D's pixels. Images without an animal have no instances.

    Args:
        cuboids: boxes in any unit.
        path: the JSON file; one that is there is replaced.
        first_id: id of the first image.
        categories: names in the order of their ids; none: those of the boxes, by the alphabet.

    Returns:
        The summary; its faults are the boxes that were left out, such as those out of the frame.

    Raises:
        ConfigError: first_id is below 1; or categories lacks one of a box.

    Example:
        >>> import json, tempfile
        >>> from animal3dbox.datasets import CuboidRecord, CuboidSet
        >>> dog = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="Dog",
        ...     K=np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]),
        ...     center=np.array([0.0, 0.0, 4.0]),
        ...     rotation=np.eye(3),
        ...     size=np.array([0.9, 0.3, 0.6]),
        ...     box=np.array([249.5, 199.5, 389.5, 279.5]),
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     summary = write_oracle2d(CuboidSet("dogs", (dog,), ()), Path(folder) / "o.json")
        ...     image = json.loads((Path(folder) / "o.json").read_text())[0]
        >>> image["instances"][0]["bbox"], image["instances"][0]["category_name"]
        ([250.0, 200.0, 140.0, 80.0], 'dog')

    """
    members, faults = images_with_boxes(cuboids)
    records = [record for _, boxes in members for record in boxes]
    used = {category_name(record.category) for record in records}
    ids = category_ids(used, [category_name(name) for name in categories], 0)
    start = checked_first_id(first_id)
    content, written, projected = [], 0, 0
    for number, (image, boxes) in enumerate(members, start):
        instances = _instances(boxes, ids, faults)
        written += len(instances)
        projected += sum(record.box is None for record in boxes)
        element = {
            "image_id": number,
            "K": OMNI3D.K_out(image.K).tolist(),
            "file_path": image.image_id,
            "height": image.image_hw[0],
            "width": image.image_hw[1],
            "instances": instances,
        }
        content.append(element)
    write_whole(path, msgspec.json.encode(content))
    note = f"the dataset gives no 2D box of {projected} boxes: those round their cuboids are meant"
    return ExportSummary(
        files=(path,),
        images=len(members),
        boxes=written,
        faults=tuple(faults),
        notes=(note,) if projected else (),
        next_id=start + len(members),
    )


def _instances(
    records: Sequence[CuboidRecord], ids: dict[str, int], faults: list[SampleError]
) -> list[dict[str, Any]]:
    """The prompts of one image's boxes; those that are not in the frame become faults."""
    in_frame = visible_boxes(records).in_frame
    instances = []
    for record, projection in zip(records, in_frame, strict=True):
        box = _in_frame(projection if record.box is None else record.box, record.image_hw)
        if box is None:
            problem = "nothing of it is in the frame, so that there is no 2D box to ask for"
            faults.append(SampleError(record.sample_id, "box", problem))
            continue
        x1, y1, x2, y2 = OMNI3D.boxes_2d_out(box).tolist()
        name = category_name(record.category)
        instance = {
            "bbox": [x1, y1, x2 - x1, y2 - y1],
            "score": 1.0 if record.score is None else record.score,
            "category_id": ids[name],
            "category_name": name,
        }
        instances.append(instance)
    return instances


def _in_frame(box: Floats, image_hw: tuple[int, int]) -> Floats | None:
    """The part of a box (4,) xyxy that is in the frame; None if there is none."""
    height, width = image_hw
    inside = np.clip(box, -0.5, [width - 0.5, height - 0.5] * 2)
    return inside if not np.isnan(box).any() and (inside[2:] > inside[:2]).all() else None

"""The writer of detections in the layout of Cube R-CNN's predictions: an element an image.

It is the one layout in which an image without a box differs from an image that was left out.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from animal3dbox.datasets.readers.cuboid_conventions import OMNI3D
from animal3dbox.datasets.readers.omni3d.schema import Key
from animal3dbox.datasets.readers.predictions.truth import Truth, read_truth
from animal3dbox.datasets.records import CuboidImage, CuboidRecord
from animal3dbox.errors import SampleError
from animal3dbox.files import write_whole


def write_detections(records: Sequence[CuboidRecord], truth: Path, path: Path) -> None:
    """Write boxes as detections in a truth's images, for read_predictions and for Omni3D's tools.

    Every image of the truth gets its element, whether it has a box or not, and a file or not.

    Args:
        records: boxes in the truth's images, by their image_id; a score that is None is 1.
        truth: the Omni3D JSON that was detected on.
        path: the JSON file; one that is there is replaced.

    Raises:
        SampleError: a box is of an image or of a category that the truth does not have.
        DatasetNotFoundError: there is no truth.
        DatasetFormatError: the truth is not of the format.

    Example:
        >>> import tempfile
        >>> import numpy as np
        >>> from animal3dbox.datasets import CuboidSet, read_predictions, write_omni3d
        >>> K = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
        >>> dog = CuboidRecord(
        ...     sample_id="a.jpg",
        ...     image_id="a.jpg",
        ...     image_path=None,
        ...     image_hw=(480, 640),
        ...     category="dog",
        ...     K=K,
        ...     center=np.array([0.0, 0.0, 4.0]),
        ...     rotation=np.eye(3),
        ...     size=np.array([0.9, 0.3, 0.6]),
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     truth, found = Path(folder) / "dogs.json", Path(folder) / "found.json"
        ...     _ = write_omni3d(CuboidSet("dogs", (dog,), ()), truth)
        ...     write_detections([dog], truth, found)
        ...     boxes = read_predictions(found, truth)
        >>> boxes.name, boxes.records[0].size.round(6).tolist()
        ('cubercnn', [0.9, 0.3, 0.6])
    """
    known = read_truth(truth, look_for_images=False)
    instances: dict[str, list[dict[str, Any]]] = {image.image_id: [] for image in known.usable}
    for record in records:
        if record.image_id not in instances:
            raise SampleError(
                record.sample_id, "image_id", f"{record.image_id} is no image of {truth}"
            )
        instances[record.image_id].append(_instance(record, known, truth))
    elements = [
        _element(key, image, instances[image.image_id])
        for key, image in known.images.items()
        if image is not None
    ]
    write_whole(path, msgspec.json.encode(elements))


def _element(key: Key, image: CuboidImage, instances: list[dict[str, Any]]) -> dict[str, Any]:
    """One image of the file."""
    return {
        "image_id": key,
        "K": OMNI3D.K_out(image.K).tolist(),
        "width": image.image_hw[1],
        "height": image.image_hw[0],
        "instances": [{"image_id": key, **instance} for instance in instances],
    }


def _instance(record: CuboidRecord, known: Truth, truth: Path) -> dict[str, Any]:
    """One detection, but for its image's id."""
    name = record.category.strip().lower()
    if name not in known.contiguous:
        raise SampleError(record.sample_id, "category", f"{name!r} is no category of {truth}")
    center, rotation, dimensions = OMNI3D.boxes_out(record.center, record.rotation, record.size)
    instance = {
        "category_id": known.contiguous.index(name),
        "score": 1.0 if record.score is None else record.score,
        "bbox3D": OMNI3D.corners_out(record.center, record.rotation, record.size).tolist(),
        "center_cam": center.tolist(),
        "dimensions": dimensions.tolist(),
        "pose": rotation.tolist(),
    }
    if record.box is not None:
        x1, y1, x2, y2 = OMNI3D.boxes_2d_out(record.box).tolist()
        instance["bbox"] = [x1, y1, x2 - x1, y2 - y1]
    return instance

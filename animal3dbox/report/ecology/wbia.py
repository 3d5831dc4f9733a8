"""Labels as COCO with the words of WBIA (the Wildbook image analysis): viewpoint and theta."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from animal3dbox.datasets.exchange.export import ExportSummary
from animal3dbox.files import write_whole
from animal3dbox.report.ecology.edge_boxes import rows_with_boxes, turned_notes
from animal3dbox.report.label_files import AnimalRow

FROM_ABOVE_DEG = 67.5
"""Elevation of the camera over the animal from which on it is seen from above, and the negative one
from below: the middle of the eighth of a turn that ends overhead."""
UPRIGHT_THETA = 0.0
"""Our 2D boxes are not turned in the picture."""


def write_wbia(animals: Sequence[AnimalRow], path: Path) -> ExportSummary:
    """Write labels as a COCO file whose annotations have WBIA's `viewpoint` and `theta`.

    `viewpoint` is one of front, frontleft, left, backleft, back, backright, right, frontright, up
    and down: the side of the animal that faces the camera. `theta` is the angle in radians by which
    an annotation's box is turned about its centre, 0. `name` is the individual's, where the dataset
    knows it.

    Args:
        animals: the rows of labels.json.
        path: the JSON file; one that is there is replaced.

    Returns:
        The summary; its faults are the animals without a box in the frame, which are left out.

    Example:
        >>> import json, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     summary = write_wbia([], Path(folder) / "wbia.json")
        ...     sorted(json.loads((Path(folder) / "wbia.json").read_text()))
        ['annotations', 'categories', 'images', 'info']
    """
    images: dict[str, dict[str, Any]] = {}
    annotations: list[dict[str, Any]] = []
    categories = {name: id_ for id_, name in enumerate(sorted({a.category for a in animals}), 1)}
    pairs, faults = rows_with_boxes(animals)
    for row, box in pairs:
        height, width = row.image_hw
        image = images.setdefault(
            row.image,
            {"id": len(images) + 1, "file_name": row.image, "height": height, "width": width},
        )
        name = {"name": row.sighting.individual} if row.sighting.individual else {}
        annotations.append(
            {
                "id": len(annotations) + 1,
                "image_id": image["id"],
                "category_id": categories[row.category],
                "bbox": list(box),
                "area": box[2] * box[3],
                "iscrowd": 0,
                "theta": UPRIGHT_THETA,
                "viewpoint": viewpoint_word(row),
                **name,
            }
        )
    content = {
        "info": {"description": "made by animal3dbox from labels.json"},
        "images": list(images.values()),
        "annotations": annotations,
        "categories": [{"id": number, "name": name} for name, number in categories.items()],
    }
    write_whole(path, msgspec.json.encode(content))
    return ExportSummary(
        (path,), len(images), len(annotations), faults, turned_notes([row for row, _ in pairs])
    )


def viewpoint_word(row: AnimalRow) -> str:
    """WBIA's word for the side of an animal that faces the camera.

    Example:
        >>> from types import SimpleNamespace
        >>> viewpoint_word(SimpleNamespace(viewpoint="front-left", elevation_deg=20.0))
        'frontleft'
        >>> viewpoint_word(SimpleNamespace(viewpoint="front-left", elevation_deg=80.0))
        'up'
    """
    if abs(row.elevation_deg) >= FROM_ABOVE_DEG:
        return "up" if row.elevation_deg > 0 else "down"
    return row.viewpoint.replace("-", "")

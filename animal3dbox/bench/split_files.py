"""The files of a split beside its images: the truth, the keypoints, and the digests.

All are written from the same rows, whole or not at all.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from animal3dbox.bench.image_rows import ImageRow
from animal3dbox.bench.plan import BenchPlan, SplitPlan
from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.readers.cuboid_conventions import COCO
from animal3dbox.datasets.records import CuboidSet
from animal3dbox.files import write_whole
from animal3dbox.smal.quadruped.preset_bodies import quadruped_names

VISIBLE = 2
"""COCO's visibility of a keypoint that is seen."""


class ImageDigests(msgspec.Struct, kw_only=True, frozen=True):
    """What is in one image, as digests.

    Attributes:
        pixels: of the decoded pixels.
        scene: of the scene.
        bodies: of each animal's body.

    Example:
        >>> ImageDigests(pixels="0", scene="1", bodies=[]).bodies
        []
    """

    pixels: str
    scene: str
    bodies: list[str]


def split_paths(split: str) -> tuple[str, ...]:
    """The files of a split below the benchmark's folder, beside its images.

    Example:
        >>> split_paths("val")[0]
        'truth/val.json'
    """
    parts = (".json", "_category_meta.json", "_stats.json")
    return (
        *(f"truth/{split}{part}" for part in parts),
        f"keypoints/{split}.json",
        f"digests/{split}.json",
    )


def write_split(root: Path, plan: BenchPlan, split: SplitPlan, rows: Sequence[ImageRow]) -> None:
    """Write the files of split_paths from the rows of its images, or of the first of them.

    Args:
        root: the benchmark's folder.
        plan: of the edition.
        split: of the plan.
        rows: of the images, in their order.

    """
    truth, *_, keypoints, digests = (root / path for path in split_paths(split.name))
    write_omni3d(
        CuboidSet(
            name=plan.version,
            records=tuple(record for row in rows for record in row.records()),
            faults=(),
            images=tuple(row.image() for row in rows),
        ),
        truth,
        scale_free=True,
        split=split.name,
        dataset_id=[one.name for one in plan.splits].index(split.name),
        categories=quadruped_names().presets,
        faces=True,
    )
    write_whole(keypoints, msgspec.json.encode(_keypoint_file(split, rows)))
    digests_of_image = {
        row.name: ImageDigests(
            pixels=row.pixels, scene=row.scene, bodies=[animal.body for animal in row.animals]
        )
        for row in rows
    }
    write_whole(digests, msgspec.json.format(msgspec.json.encode(digests_of_image)))


def _keypoint_file(split: SplitPlan, rows: Sequence[ImageRow]) -> dict[str, Any]:
    """A COCO keypoints file, whose ids of images and animals are the truth's."""
    names, ids = split.world.vocabulary.keypoints, quadruped_names().presets
    annotations: list[dict[str, Any]] = []
    for image_id, row in enumerate(rows, 1):
        for animal in row.animals:
            x1, y1, x2, y2 = COCO.boxes_2d_out(np.array(animal.box)).tolist()
            keypoints = [[x, y, VISIBLE * v] for x, y, v in animal.keypoints]
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": image_id,
                    "category_id": ids.index(animal.category) + 1,
                    "bbox": [x1, y1, x2 - x1, y2 - y1],
                    "keypoints": [number for point in keypoints for number in point],
                    "num_keypoints": sum(v > 0 for *_, v in keypoints),
                }
            )
    return {
        "info": {"description": f"keypoints of {split.name} with a detector's errors"},
        "images": [
            {
                "id": image_id,
                "file_name": row.name,
                "height": row.image_hw[0],
                "width": row.image_hw[1],
                "K": COCO.K_out(row.image().K).tolist(),
            }
            for image_id, row in enumerate(rows, 1)
        ],
        "categories": [
            {"id": number, "name": name, "keypoints": names} for number, name in enumerate(ids, 1)
        ],
        "annotations": annotations,
    }

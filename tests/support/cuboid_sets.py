"""Sets of cuboids to write and read back.

In front of the camera, cut by the frame, behind it, several an image, and none.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from animal3dbox.datasets.readers.visible_boxes import visible_boxes
from animal3dbox.datasets.records import CuboidImage, CuboidRecord, CuboidSet
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle

HW = (120, 160)


def simple_record(**changes: object) -> CuboidRecord:
    """A box 2 long, 1 wide, 1.5 high, 10 m ahead, that looks to the right of the picture, upright.

    Numbers a person can check.
    """
    R = np.array(
        [[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]
    )  # forward = x right, left = z away from us, up = -y
    fields: dict[str, object] = {
        "sample_id": "images/a.jpg", "image_id": "images/a.jpg", "image_path": Path("images/a.jpg"),
        "image_hw": HW, "category": "dog",
        "K": np.array([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]]),
        "center": np.array([1.0, 0.5, 10]), "rotation": R,
        "size": np.array([2.0, 1, 1.5]), "metric": True, "heading_known": True,
        "box": np.array([79.5, 55.5, 99.5, 71.5]), "truncation": 0.0,
    }  # fmt: skip
    return CuboidRecord(**{**fields, **changes})  # type: ignore[arg-type]


def random_set(seed: int = 0, *, upright: bool = False, in_view: bool = False) -> CuboidSet:
    """Five images with four, one, no, two and three boxes.

    Unless in_view, some are cut by the frame and some behind the camera.
    """
    rng = np.random.default_rng(seed)
    records, images = [], []
    for number, count in enumerate((4, 1, 0, 2, 3)):
        name, hw = f"images/{number}.jpg", (100 + 10 * number, 200 - 7 * number)
        K = np.array(
            [
                [150 + 10 * number, 0.0, rng.uniform(60, 110)],
                [0, 140 + number, rng.uniform(40, 70)],
                [0, 0, 1],
            ]
        )
        images.append(CuboidImage(name, Path(name), hw, K))
        for k in range(count):
            center = rng.uniform((-1, -1, 7), (1, 1, 9))
            if not in_view and k == 1:
                center = np.array([3.6, 0.3, 7.0])  # cut by the right border
            if not in_view and k == 2:
                center = rng.uniform(-0.3, 0.3, 3)  # round the camera
            angles = np.array([0, rng.uniform(-3, 3), 0]) if upright else rng.normal(size=3)
            rotation = np.asarray(rotation_from_axis_angle(torch.from_numpy(angles)).numpy())
            if upright:
                rotation = rotation @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
            record = (
                simple_record(
                    sample_id=f"{name}#{k}" if k else name, image_id=name,
                    image_path=Path(name), image_hw=hw, K=K,
                    center=center, rotation=rotation, size=rng.uniform(0.3, 2.5, 3),
                    category=("dog", "brown bear")[k % 2], box=None,
                    truncation=None if k == 2 else k / 4, heading_known=k != 1,
                )
            )  # fmt: skip
            records.append(record if k == 3 else replace(record, box=visible_part(record)))
    return CuboidSet("labels", tuple(records), (), (), tuple(images))


def standing_set() -> CuboidSet:
    """Two images with three and one upright boxes whose sides differ, seen whole."""
    places = ((0, 8.0, 0.4), (-2.0, 10.0, 2.0), (2.0, 9.0, -1.1), (0.5, 7.0, 2.8))
    records = []
    for number, (x, z, yaw) in enumerate(places):
        forward, up = np.array([np.cos(yaw), 0, -np.sin(yaw)]), np.array([0.0, -1, 0])
        image_id = f"{number // 3}.jpg"
        record = simple_record(
            sample_id=f"{image_id}#{number % 3}" if number % 3 else image_id,
            image_id=image_id,
            center=np.array([x, 0.3, z]),
            rotation=np.stack((forward, np.cross(up, forward), up), axis=1),
            size=np.array([1.6, 0.5, 1.1]),
            box=None,
        )
        records.append(replace(record, box=visible_part(record, 0.03)))
    return CuboidSet("labels", tuple(records), ())


def visible_part(record: CuboidRecord, margin: float = 0.1) -> np.ndarray | None:
    """The 2D box of a thing that fills its cuboid in the frame, but for a margin on each side."""
    box = visible_boxes([record]).in_frame[0]
    if np.isnan(box).any():
        return None
    px = margin * (box[2:] - box[:2])
    return np.concatenate((box[:2] + px, box[2:] - px))

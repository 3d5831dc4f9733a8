"""Cuboids that are no animals, for the golden record: an Omni3D file and bare arrays."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from golden_names import named
from PIL import Image

HW = (120, 160)
OMNI3D_ORDER = [4, 5, 1, 0, 7, 6, 2, 3]
"""Corner k of Omni3D is ours of this number."""


def picture(rng: np.random.Generator) -> np.ndarray:
    """A smooth picture (H, W, 3) with some noise."""
    y, x = np.mgrid[: HW[0], : HW[1]]
    smooth = np.stack((x * 1.4, y * 1.9, 128 + 60 * np.sin(x / 9) * np.cos(y / 7)), axis=-1)
    noisy = smooth + rng.normal(0, 6, smooth.shape)
    return np.asarray(np.clip(noisy, 0, 255), dtype=np.uint8)


def cuboids(rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    """Boxes in front of a camera: K, center, rotation, size and corners, in our order."""
    K = np.array([[210.0, 0, 84.0], [0, 190.0, 57.0], [0, 0, 1]])
    center = rng.uniform((-1.2, -0.8, 6.0), (1.2, 0.8, 9.0), (count, 3))
    turned, upper = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    rotation = turned * np.sign(np.einsum("nii->ni", upper))[:, None]
    rotation[:, :, 2] *= np.linalg.det(rotation)[:, None]
    size = rng.uniform(0.4, 1.8, (count, 3))
    signs = np.array(named("animal3dbox.geometry.cuboid.CORNER_SIGNS"), dtype=np.float64)
    corners = center[:, None] + (signs * size[:, None] / 2) @ rotation.transpose(0, 2, 1)
    arrays = {"K": K, "center": center, "rotation": rotation, "size": size}
    return {**arrays, "corners_3d": corners}


def write_bare_cuboids(path: Path) -> None:
    """Write pictures and targets of three scenes, with all that other people's targets may have."""
    rng = np.random.default_rng(31)
    arrays: dict[str, np.ndarray] = {}
    for number, count in enumerate((1, 3, 2)):
        boxes = cuboids(rng, count)
        seen = boxes["corners_3d"] @ boxes["K"].T
        pixels = seen[..., :2] / seen[..., 2:]
        frame = np.array([HW[1], HW[0]]) - 0.5
        flat = np.concatenate((pixels.min(1), pixels.max(1)), axis=-1)
        flat = np.clip(flat, -0.5, np.tile(frame, 2))
        y, x = np.mgrid[: HW[0], : HW[1]]
        inside = [(x >= a) & (x <= c) & (y >= b) & (y <= d) for a, b, c, d in flat]
        marked = np.concatenate((pixels[:, :5], np.ones((count, 5, 1))), axis=-1)
        scene = {
            **boxes, "corners_2d": pixels, "boxes": flat, "labels": np.arange(count),
            "masks": np.stack(inside).astype(np.uint8), "keypoints": marked,
            "keypoint_mirror": np.array([1, 0, 2, 4, 3]), "image": picture(rng),
            "depth": 5 + 0.01 * (x + y).astype(np.float32),
        }  # fmt: skip
        arrays |= {f"{number}/{name}": array for name, array in scene.items()}
    np.savez(path, allow_pickle=False, **arrays)


def write_things(root: Path) -> None:
    """Write things.json in Omni3D's format: whole boxes, boxes told in part, and an empty image."""
    rng = np.random.default_rng(32)
    root.mkdir()
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number, count in enumerate((2, 0, 3)):
        boxes = cuboids(rng, count)
        file = f"{number}.png"
        Image.fromarray(picture(rng)).save(root / file)
        size = {"width": HW[1], "height": HW[0], "K": boxes["K"].tolist()}
        images.append({"id": number, "dataset_id": 0, "file_path": file, **size})
        for k in range(count):
            told = {
                "id": len(annotations),
                "image_id": number,
                "category_id": k % 2,
                "dataset_id": 0,
            }
            annotations.append({**told, **_omni3d_box(boxes, k, len(annotations))})
    kinds = [{"id": 0, "name": "car"}, {"id": 1, "name": "chair", "supercategory": "furniture"}]
    info = {"id": 0, "source": "golden", "name": "things", "split": "train", "version": "1"}
    content = {"info": info, "images": images, "categories": kinds, "annotations": annotations}
    (root / "things.json").write_text(json.dumps(content))


def _omni3d_box(boxes: dict[str, np.ndarray], k: int, number: int) -> dict[str, Any]:
    """One box in Omni3D's keys; every third has no rotation, every fourth no corners."""
    forward, left, up = boxes["rotation"][k].T
    length, width, height = boxes["size"][k].tolist()
    rotation: Any = np.stack((forward, -up, left), axis=1).tolist()
    corners: Any = boxes["corners_3d"][k][OMNI3D_ORDER].tolist()
    return {
        "valid3D": True, "center_cam": boxes["center"][k].tolist(),
        "dimensions": [width, height, length], "R_cam": -1 if number % 3 == 2 else rotation,
        "bbox3D_cam": -1 if number % 4 == 3 else corners, "behind_camera": False,
        "bbox2D_tight": [20.5, 30.0, 90.25, 100.0], "truncation": 0.1 * k, "visibility": -1,
    }  # fmt: skip

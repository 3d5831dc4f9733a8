"""Augment boxes that are not animals: a car as in KITTI, and a chair as in Omni3D.

Each has its own camera.

Run: python examples/augment_your_own_cuboids.py [--out FILE.png]
"""

import argparse
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from animal3dbox.geometry.cuboid import EDGES, corners_of
from animal3dbox.transforms import (
    ColorJitter,
    Compose,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomVirtualCamera,
)


def from_kitti(
    location: list[float], dimensions: list[float], rotation_y: float
) -> dict[str, np.ndarray]:
    """A box of KITTI's conventions in ours.

    KITTI's location is the middle of the bottom, its dimensions are height, width, length, and
    rotation_y turns about the camera's y. Our box axes are forward, left, up; KITTI's car looks
    along its own x axis, and y points down.
    """
    height, width, length = dimensions
    cos, sin = math.cos(rotation_y), math.sin(rotation_y)
    forward, up = [cos, 0.0, -sin], [0.0, -1.0, 0.0]
    left = np.cross(up, forward)
    center = np.array(location) - np.array([0.0, height / 2, 0.0])
    return {
        "center": center,
        "rotation": np.stack((forward, left, up), axis=1),
        "size": np.array([length, width, height]),
    }


def from_omni3d(
    center_cam: list[float], dimensions: list[float], R_cam: np.ndarray
) -> dict[str, np.ndarray]:
    """A box of Omni3D's conventions in ours.

    Omni3D's dimensions are width, height, length; R_cam's columns are forward, down and left.
    """
    width, height, length = dimensions
    forward, down, left = R_cam.T
    return {
        "center": np.array(center_cam),
        "rotation": np.stack((forward, left, -down), axis=1),
        "size": np.array([length, width, height]),
    }


def target_of(box: dict[str, np.ndarray], K: np.ndarray, name: str) -> dict[str, Any]:
    """All that the transforms need: K and boxes.

    Corners are optional; here they are drawn later.
    """
    corners = corners_of(box["center"], box["rotation"], box["size"])
    batched = {key: value[None] for key, value in (*box.items(), ("corners_3d", corners))}
    return {"K": K, **batched, "labels": np.zeros(1, dtype=np.int64), "image_id": name}


def picture_of(target: dict[str, Any], image_hw: tuple[int, int]) -> np.ndarray:
    """A picture (H, W, 3) uint8 of a box, its edges drawn thick before a grid."""
    image = np.full((*image_hw, 3), 90, dtype=np.uint8)
    image[::16] = image[:, ::16] = 110
    return with_edges(image, target, (240, 240, 240), 7)


def with_edges(
    image: np.ndarray, target: dict[str, Any], colour: tuple[int, int, int], thick: int
) -> np.ndarray:
    """The picture with the edges of the target's boxes, the front in green."""
    image = np.ascontiguousarray(image)
    for corners in target["corners_3d"]:
        px = corners @ target["K"].T
        px = np.round(px[:, :2] / px[:, 2:]).astype(int)
        for start, end in EDGES:
            front = {start, end} <= {1, 2, 6, 5}
            cv2.line(
                image,
                px[start].tolist(),
                px[end].tolist(),
                (80, 200, 80) if front and thick < 6 else colour,
                thick,
                cv2.LINE_AA,
            )
    return image


def scenes() -> list[tuple[dict[str, Any], tuple[int, int]]]:
    """A car and a chair, as targets, and the sizes of their pictures."""
    kitti_K = np.array([[721.5, 0, 609.6], [0, 721.5, 172.9], [0, 0, 1]])
    omni_K = np.array([[520.0, 0, 330.0], [0, 525.0, 250.0], [0, 0, 1]])
    tilt = np.array([[0.8, 0, -0.6], [0, 1, 0], [-0.6, 0, -0.8]])  # columns: forward, down, left
    return [
        (
            target_of(from_kitti([-2.0, 1.6, 11.0], [1.5, 1.7, 4.2], 0.6), kitti_K, "kitti-like"),
            (375, 1242),
        ),
        (
            target_of(from_omni3d([0.2, 0.3, 3.0], [0.6, 1.0, 0.7], tilt), omni_K, "omni3d-like"),
            (480, 640),
        ),
    ]


def main() -> None:
    """Augment both, and write a sheet on which the boxes stay on their pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("augment_your_own_cuboids.png"))
    out = parser.parse_args().out
    compose = Compose(
        [
            RandomHorizontalFlip(),
            RandomVirtualCamera(4, 4, 8),
            RandomResizedCrop((300, 400), (0.6, 1.0)),
            ColorJitter(0.2, 0.2),
        ],
        seed=1,
    )
    rows = []
    for target, image_hw in scenes():
        image = picture_of(target, image_hw)
        row = [cv2.resize(with_edges(image, target, (220, 120, 40), 2), (400, 300))]
        for index in range(3):
            augmented, after = compose(image, target, key=(0, index))
            row.append(with_edges(augmented, after, (220, 120, 40), 2))
            forward = after["rotation"][0, :, 0]
            print(
                f"{target['image_id']} {index}: mirrored {after['mirrored']}, fx"
                f" {after['K'][0, 0]:.1f}, heading {np.round(forward, 2).tolist()}"
            )
        rows.append(np.concatenate(row, axis=1))
    cv2.imwrite(str(out), np.concatenate(rows)[..., ::-1])
    print(f"wrote {out}")


if __name__ == "__main__":
    main()

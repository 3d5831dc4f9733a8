"""Masks as another tool makes them: a renderer of its own, an outline that wanders, holes."""

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.camera import project

SUPERSAMPLING = 4
"""Samples along each side of a pixel; a pixel is the animal's if half of them are."""
SHIFT = 6
"""Binary digits of OpenCV's fractions of a pixel."""
WANDER_PX = 4.0
"""Length over which the jitter of an outline changes."""
HOLE_RADIUS = (0.03, 0.1)
"""Radii of holes, as parts of the root of the mask's area."""
THING_WIDTH = (0.1, 0.3)
"""Widths of things before an animal, as parts of the longer side of the mask's box."""
MOST_SLANT = 0.5
"""Most that the middle of such a thing moves sideways, by the way downwards."""


def supersampled_mask(
    vertices_cam: Tensor, faces: Tensor, K: Tensor, image_hw: tuple[int, int]
) -> NDArray[np.bool_]:
    """The silhouette (H, W) of a closed mesh before the camera, by OpenCV's polygon filling.

    The labeller draws by winding numbers of signed areas; this one fills triangle by triangle on a
    grid SUPERSAMPLING times as fine.
    """
    px, _ = project(K, vertices_cam)
    fine = ((px + 0.5) * SUPERSAMPLING - 0.5).numpy()
    corners = fine[faces.numpy()]  # (F, 3, 2)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    height, width = image_hw
    canvas = np.zeros((height * SUPERSAMPLING, width * SUPERSAMPLING), dtype=np.uint8)
    for triangle in np.rint(corners[area < 0] * (1 << SHIFT)).astype(np.int32):
        cv2.fillConvexPoly(canvas, triangle, 1, cv2.LINE_8, SHIFT)
    blocks = canvas.reshape(height, SUPERSAMPLING, width, SUPERSAMPLING)
    return np.asarray(blocks.sum((1, 3)) * 2 >= SUPERSAMPLING**2)


def occluding_thing(mask: NDArray[np.bool_], rng: np.random.Generator) -> NDArray[np.bool_]:
    """The pixels (H, W) of a thing that stands before an animal: a slanting trunk of a tree.

    Args:
        mask: (H, W) of the animal; its middle is somewhere on it.
        rng: the random numbers.

    """
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return np.zeros_like(mask)
    place = int(rng.integers(len(rows)))
    extent = max(np.ptp(rows), np.ptp(columns)) + 1
    half, slant = rng.uniform(*THING_WIDTH) * extent / 2, rng.uniform(-MOST_SLANT, MOST_SLANT)
    y, x = np.mgrid[: mask.shape[0], : mask.shape[1]]
    thing: NDArray[np.bool_] = np.abs(x - columns[place] - slant * (y - rows[place])) <= half
    return thing


def worn_mask(
    mask: NDArray[np.bool_], rng: np.random.Generator, *, jitter_px: float, holes: bool
) -> Tensor:
    """A mask (H, W) whose outline wanders, with holes in it; never empty unless it was before.

    Args:
        mask: (H, W).
        rng: the random numbers.
        jitter_px: standard deviation of the outline's way from the true one.
        holes: whether it gets some.

    """
    worn = mask.copy()
    if jitter_px:
        inside, outside = (
            cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            for part in (mask, ~mask)
        )
        noise = cv2.GaussianBlur(rng.standard_normal(mask.shape), (0, 0), WANDER_PX)
        worn = (inside - outside) + jitter_px * noise / max(noise.std(), 1e-9) > 0
        # The picture's border cuts a mask where it cuts it, whatever the outline does.
        worn &= cv2.dilate(mask.astype(np.uint8), np.ones((3, 3)), iterations=4).astype(bool)
    if holes and mask.any():
        rows, columns = np.nonzero(mask)
        for _ in range(int(rng.integers(1, 5))):
            place = int(rng.integers(len(rows)))
            radius = rng.uniform(*HOLE_RADIUS) * np.sqrt(len(rows))
            hole = np.zeros(mask.shape, dtype=np.uint8)
            center = int(columns[place]), int(rows[place])
            cv2.circle(hole, center, max(1, round(radius)), 1, -1)
            worn &= hole == 0
    return torch.from_numpy(worn if worn.any() else mask)

"""A small animal shown a second time, enlarged, in a corner of its picture."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Drawing = Callable[[Picture, tuple[int, int], float], None]
"""Draws into a part of a picture: the enlarged part, its first pixel (x, y), the factor."""

SMALL_PART = 1 / 6
"""An animal is small if its longer side is a smaller part of the picture's width."""
INSET_WIDTH, INSET_HEIGHT = 0.33, 0.45
"""The most that an inset takes of a picture."""
AROUND = 0.25
"""What an inset shows on each side of the animal, in parts of its longer side."""
LEAST_CROP_PX = 12
"""An inset shows no less than this of the picture, px: more would only show its grain."""
LEAST_GAIN = 1.2
"""There is no inset that would not be so many times larger than the animal itself."""
FRAME, FRAME_RIM = (255, 255, 255), (20, 20, 20)


@dataclass(frozen=True)
class Region:
    """A rectangle of a picture, px.

    Attributes:
        x1: left side.
        y1: upper side.
        x2: right side.
        y2: lower side.
    """

    x1: float
    y1: float
    x2: float
    y2: float

    @property
    def width(self) -> float:
        """Width of the rectangle, px."""
        return self.x2 - self.x1

    @property
    def height(self) -> float:
        """Height of the rectangle, px."""
        return self.y2 - self.y1

    @property
    def longer(self) -> float:
        """The longer of the rectangle's two sides, px."""
        return max(self.width, self.height)

    def scaled(self, factor: float) -> "Region":
        """The same rectangle in a picture that was enlarged by a factor."""
        return Region(
            *((side + 0.5) * factor - 0.5 for side in (self.x1, self.y1, self.x2, self.y2))
        )

    def overlaps(self, other: "Region") -> bool:
        """Whether it has a point in common with another."""
        return (
            self.x1 <= other.x2
            and other.x1 <= self.x2
            and self.y1 <= other.y2
            and other.y1 <= self.y2
        )


def is_small(region: Region | None, image_hw: tuple[int, int]) -> bool:
    """Whether an animal is so small in its picture that it is shown enlarged too."""
    return region is not None and region.longer < SMALL_PART * image_hw[1]


def with_inset(
    image: Picture,
    canvas: Picture,
    region: Region | None,
    *,
    factor: float,
    draw: Drawing,
    points_px: Sequence[Sequence[float]] = (),
) -> Picture:
    """Draw an animal into its picture, and a small one enlarged in a corner too.

    The corner is one that hides neither the animal nor its keypoints, if there is such a one, and
    of several the plainest: sky rather than other animals.

    Args:
        image: (H, W, 3) uint8 RGB, which stays as it is.
        canvas: the same enlarged, which is drawn into.
        region: where the animal is in the image; None: outside.
        factor: by which the canvas was enlarged.
        draw: draws the animal.
        points_px: (x, y, ...) of its keypoints in the image.

    Returns:
        The canvas.

    Example:
        >>> image = np.zeros((300, 600, 3), dtype=np.uint8)
        >>> def draw(canvas, origin_px, factor):
        ...     canvas[:, :, 0] = 200
        >>> canvas = with_inset(
        ...     image, image.copy(), Region(20, 20, 60, 50), factor=1, draw=draw
        ... )
        >>> int(canvas[290, 590, 0]), int(image.max())
        (200, 0)
    """
    draw(canvas, (0, 0), factor)
    crop = None if region is None else _crop_of(region, (image.shape[0], image.shape[1]))
    if region is None or crop is None:
        return canvas
    x1, y1, x2, y2 = crop
    zoom = min(
        INSET_WIDTH * canvas.shape[1] / (x2 - x1), INSET_HEIGHT * canvas.shape[0] / (y2 - y1)
    )
    if zoom < LEAST_GAIN * factor:
        return canvas
    size = (round(zoom * (x2 - x1)), round(zoom * (y2 - y1)))
    enlarged = cv2.resize(image[y1:y2, x1:x2], size, interpolation=cv2.INTER_CUBIC)
    inset = np.asarray(enlarged, dtype=np.uint8)
    draw(inset, (x1, y1), zoom)
    around = Region(x1 - 0.5, y1 - 0.5, x2 - 0.5, y2 - 0.5).scaled(factor)
    points = [[(value + 0.5) * factor - 0.5 for value in point[:2]] for point in points_px]
    _paste(canvas, inset, _plainest_corner(canvas, inset, around, points))
    _frame(canvas, around)
    return canvas


def _crop_of(region: Region, image_hw: tuple[int, int]) -> tuple[int, int, int, int] | None:
    """What the inset shows of the picture, whole pixels x1, y1, x2, y2; None of a large animal."""
    if not is_small(region, image_hw):
        return None
    margin = max(AROUND * region.longer, (LEAST_CROP_PX - region.longer) / 2)
    height, width = image_hw
    return (
        max(0, int(np.floor(region.x1 - margin))),
        max(0, int(np.floor(region.y1 - margin))),
        min(width, int(np.ceil(region.x2 + margin)) + 1),
        min(height, int(np.ceil(region.y2 + margin)) + 1),
    )


def _plainest_corner(
    canvas: Picture, inset: Picture, animal: Region, points: Sequence[Sequence[float]]
) -> tuple[int, int]:
    """Where the inset's first pixel (x, y) goes: the corner that hides least."""
    gap = _gap(canvas)
    free_x, free_y = (max(0, canvas.shape[i] - inset.shape[i] - gap) for i in (1, 0))
    grey = cv2.cvtColor(canvas, cv2.COLOR_RGB2GRAY)

    def hidden(place: tuple[int, int]) -> tuple[bool, int, float]:
        x, y = place
        covered = Region(x - gap, y - gap, x + inset.shape[1] + gap, y + inset.shape[0] + gap)
        n_points = sum(covered.overlaps(Region(u, v, u, v)) for u, v in points)
        below = grey[y : y + inset.shape[0], x : x + inset.shape[1]]
        return covered.overlaps(animal), n_points, round(float(below.std()), 3)

    return min(product((free_x, min(gap, free_x)), (free_y, min(gap, free_y))), key=hidden)


def _paste(canvas: Picture, inset: Picture, place: tuple[int, int]) -> None:
    x, y = place
    height, width = inset.shape[:2]
    canvas[y : y + height, x : x + width] = inset
    _frame(canvas, Region(x, y, x + width - 1, y + height - 1))


def _frame(canvas: Picture, region: Region) -> None:
    """A white frame within a dark one about a region of the canvas."""
    line = max(1, _gap(canvas) // 4)
    first = (round(region.x1) - line, round(region.y1) - line)
    last = (round(region.x2) + line, round(region.y2) + line)
    cv2.rectangle(canvas, first, last, FRAME_RIM, 3 * line)
    cv2.rectangle(canvas, first, last, FRAME, line)


def _gap(canvas: Picture) -> int:
    """The room between an inset and the picture's border, px."""
    return max(4, round(float(canvas.shape[1]) / 120))

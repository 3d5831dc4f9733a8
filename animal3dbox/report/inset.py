"""Small animals shown a second time, enlarged, in corners of their picture."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Drawing = Callable[[Picture, tuple[int, int], float], None]
"""Draws into a part of a picture: the enlarged part, its first pixel (x, y), the factor."""
Crop = tuple[int, int, int, int]
"""A part of a picture in whole pixels: x1, y1, x2, y2, the last two beyond it."""

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
MOST_INSETS = 2
"""A picture has no more insets, lest they take more of it than the animals' surroundings."""
FRAME, FRAME_RIM = (255, 255, 255), (20, 20, 20)
NUMBER_HEIGHT = 16
"""Height of the dark ground of an inset's number, px of a picture 600 px wide."""


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

    def joined(self, other: "Region") -> "Region":
        """The least rectangle that holds both."""
        return Region(
            min(self.x1, other.x1),
            min(self.y1, other.y1),
            max(self.x2, other.x2),
            max(self.y2, other.y2),
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


def with_insets(
    image: Picture,
    canvas: Picture,
    regions: Sequence[Region | None],
    *,
    factor: float,
    draw: Drawing,
    points_px: Sequence[Sequence[float]] = (),
) -> Picture:
    """Draw boxes into a picture, and small ones enlarged in its corners too.

    Boxes beside each other, as a label and a detection of the same animal, share an inset if they
    are small together. Of more than MOST_INSETS the first ones are shown; two have numbers, at the
    boxes and in the insets. The corner is one that hides no box, and few of the keypoints; of
    several it is the plainest: sky rather than other animals. Without it there is no inset.

    Args:
        image: (H, W, 3) uint8 RGB, which stays as it is.
        canvas: the same enlarged, which is drawn into.
        regions: where each box is in the image; None: outside.
        factor: by which the canvas was enlarged.
        draw: draws the boxes, all of them.
        points_px: (x, y, ...) of keypoints in the image.

    Returns:
        The canvas.

    Example:
        >>> image = np.zeros((300, 600, 3), dtype=np.uint8)
        >>> def draw(canvas, origin_px, factor):
        ...     canvas[:, :, 0] = 200
        >>> canvas = with_insets(
        ...     image, image.copy(), [Region(20, 20, 60, 50)], factor=1, draw=draw
        ... )
        >>> int(canvas[290, 590, 0]), int(image.max())
        (200, 0)
    """
    draw(canvas, (0, 0), factor)
    image_hw = (image.shape[0], image.shape[1])
    in_picture = [region for region in regions if region is not None]
    small = [crop for group in _groups(in_picture, image_hw) if (crop := _crop_of(group, image_hw))]
    crops = _apart([crop for crop in small if _zoom(crop, canvas) >= LEAST_GAIN * factor])
    frames = [_frame_of(crop).scaled(factor) for crop in crops]
    obstacles = _Obstacles(
        boxes=[region.scaled(factor) for region in in_picture] + frames,
        points=[[(value + 0.5) * factor - 0.5 for value in point[:2]] for point in points_px],
    )
    for number, (crop, frame) in enumerate(zip(crops, frames, strict=True), start=1):
        inset = _enlarged_part(image, crop, _zoom(crop, canvas), draw)
        place = _plainest_corner(canvas, inset, obstacles)
        if place is None:
            continue
        covered = _paste(canvas, inset, place)
        _frame(canvas, frame)
        obstacles.boxes.append(covered)
        if len(crops) > 1:
            _write_number(canvas, number, covered.x1, covered.y1)
            _write_number(canvas, number, frame.x1, frame.y1 - NUMBER_HEIGHT * _unit(canvas))
    return canvas


def _groups(regions: Sequence[Region], image_hw: tuple[int, int]) -> list[Region]:
    """Regions joined with those beside them, as long as what comes of it is small."""
    groups: list[Region] = []
    for region in regions:
        together = next(
            (
                place
                for place, group in enumerate(groups)
                if is_small(group.joined(region), image_hw)
                and _surroundings(group).overlaps(_surroundings(region))
            ),
            None,
        )
        if together is None:
            groups.append(region)
        else:
            groups[together] = groups[together].joined(region)
    return groups


def _surroundings(region: Region) -> Region:
    """What an inset of a region would show of an unbounded picture."""
    margin = max(AROUND * region.longer, (LEAST_CROP_PX - region.longer) / 2)
    return Region(region.x1 - margin, region.y1 - margin, region.x2 + margin, region.y2 + margin)


def _crop_of(region: Region, image_hw: tuple[int, int]) -> Crop | None:
    """What the inset shows of the picture; None of a large animal."""
    if not is_small(region, image_hw):
        return None
    around = _surroundings(region)
    height, width = image_hw
    return (
        max(0, int(np.floor(around.x1))),
        max(0, int(np.floor(around.y1))),
        min(width, int(np.ceil(around.x2)) + 1),
        min(height, int(np.ceil(around.y2)) + 1),
    )


def _apart(crops: Sequence[Crop]) -> list[Crop]:
    """The first MOST_INSETS of the crops whose frames do not cross."""
    chosen: list[Crop] = []
    for crop in crops:
        if not any(_frame_of(crop).overlaps(_frame_of(other)) for other in chosen):
            chosen.append(crop)
    return chosen[:MOST_INSETS]


def _zoom(crop: Crop, canvas: Picture) -> float:
    """By how much an inset enlarges its part of the picture."""
    x1, y1, x2, y2 = crop
    height, width = (float(side) for side in canvas.shape[:2])
    return min(INSET_WIDTH * width / (x2 - x1), INSET_HEIGHT * height / (y2 - y1))


def _frame_of(crop: Crop) -> Region:
    """The borders of an inset's part of the picture."""
    x1, y1, x2, y2 = crop
    return Region(x1 - 0.5, y1 - 0.5, x2 - 0.5, y2 - 0.5)


def _enlarged_part(image: Picture, crop: Crop, zoom: float, draw: Drawing) -> Picture:
    """A part of the picture, enlarged and drawn into."""
    x1, y1, x2, y2 = crop
    size = (round(zoom * (x2 - x1)), round(zoom * (y2 - y1)))
    enlarged = cv2.resize(image[y1:y2, x1:x2], size, interpolation=cv2.INTER_CUBIC)
    inset = np.asarray(enlarged, dtype=np.uint8)
    draw(inset, (x1, y1), zoom)
    return inset


@dataclass(frozen=True)
class _Obstacles:
    """What insets are not to hide, in px of the enlarged picture.

    Attributes:
        boxes: never, the other insets among them.
        points: rather not, (x, y) each.
    """

    boxes: list[Region]
    points: list[list[float]]


def _plainest_corner(
    canvas: Picture, inset: Picture, obstacles: _Obstacles
) -> tuple[int, int] | None:
    """Where the inset's first pixel (x, y) goes; None if each corner would hide a box."""
    gap = _gap(canvas)
    free_x, free_y = (max(0, canvas.shape[i] - inset.shape[i] - gap) for i in (1, 0))
    grey = cv2.cvtColor(canvas, cv2.COLOR_RGB2GRAY)

    def around(place: tuple[int, int]) -> Region:
        x, y = place
        return Region(x - gap, y - gap, x + inset.shape[1] + gap, y + inset.shape[0] + gap)

    def liveliness(place: tuple[int, int]) -> tuple[int, float]:
        x, y = place
        n_points = sum(around(place).overlaps(Region(u, v, u, v)) for u, v in obstacles.points)
        below = grey[y : y + inset.shape[0], x : x + inset.shape[1]]
        return n_points, round(float(below.std()), 3)

    corners = product((free_x, min(gap, free_x)), (free_y, min(gap, free_y)))
    free = [
        corner
        for corner in corners
        if not any(around(corner).overlaps(region) for region in obstacles.boxes)
    ]
    return min(free, key=liveliness, default=None)


def _paste(canvas: Picture, inset: Picture, place: tuple[int, int]) -> Region:
    """Put an inset into the canvas; returns what it covers."""
    x, y = place
    height, width = inset.shape[:2]
    canvas[y : y + height, x : x + width] = inset
    covered = Region(x, y, x + width - 1, y + height - 1)
    _frame(canvas, covered)
    return covered


def _write_number(canvas: Picture, number: int, x: float, y: float) -> None:
    """A number on a dark ground, whose first pixel is at (x, y) or as near as the canvas admits."""
    unit = _unit(canvas)
    left, upper = max(0, round(x)), max(0, round(y))
    last = (left + NUMBER_HEIGHT * unit * 3 // 4, upper + NUMBER_HEIGHT * unit)
    cv2.rectangle(canvas, (left, upper), last, FRAME_RIM, -1)
    foot = (left + 2 * unit, upper + (NUMBER_HEIGHT - 4) * unit)
    face, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.4 * unit
    cv2.putText(canvas, str(number), foot, face, scale, FRAME, unit, cv2.LINE_AA)


def _unit(canvas: Picture) -> int:
    """How many times larger than in a picture of 600 px an inset's number is."""
    return max(1, _gap(canvas) // 5)


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

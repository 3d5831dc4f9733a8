"""Random crops that know where the animals are."""

import math
from collections.abc import Sequence

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.augmentations.resizing import keep_visible
from animal3dbox.transforms.camera_law.maps import Size, check_size, cropping
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import check_probability, check_range
from animal3dbox.transforms.steps import Step, Warp
from animal3dbox.transforms.transform import Transform

Box = tuple[float, float, float, float]
"""x least, y least, x greatest, y greatest, px."""
TRIALS = 10
"""Crops that are drawn at once, of which the first that shows enough of an animal is taken."""


class RandomResizedCrop(Transform):
    """Cut out a random part and resize it.

    K: x' = (x - left) s - 1/2 with one s for x and y, unless ratio is given.

    Args:
        size: (height, width) after, or one number for both.
        scale: range of the part's area over the greatest area of its aspect that fits into the
            picture.
        ratio: range by which the part's aspect is changed against that of size, e.g. (3 / 4, 4 /
            3); None keeps the aspect, so that an animal is not stretched.
        keep_part: at least this part of what is visible of some animal stays; of the crops drawn
            the first that keeps it is taken, and if none does (TRIALS), the one that keeps most.
        min_visible: animals of which less than this part of what was visible remains are dropped;
            None keeps all.
        p: probability of a random crop; otherwise the greatest part of the right aspect is taken
            from the middle, so that the size is always the same.

    Example:
        >>> image, target = np.zeros((60, 80, 3), np.uint8), {}
        >>> image, target = RandomResizedCrop((30, 30), scale=(1, 1), p=0)(image, target)
        >>> image.shape, target["H_out_in"][0].tolist()  # the middle 60 columns, halved
        ((30, 30, 3), [0.5, 0.0, -5.25])
    """

    geometric = True

    def __init__(
        self,
        size: Size,
        scale: tuple[float, float] = (0.3, 1.0),
        ratio: tuple[float, float] | None = None,
        *,
        keep_part: float = 0.5,
        min_visible: float | None = 0.1,
        p: float = 1.0,
    ) -> None:
        super().__init__(1.0)
        self.random_p = check_probability("p", p)
        self.size = check_size("size", size)
        self.scale = check_range("scale", scale, about=None, least=0)
        if self.scale[0] <= 0 or self.scale[1] > 1:
            raise ConfigError(f"scale must lie in (0, 1], got {scale!r}")
        self.ratio = None if ratio is None else check_range("ratio", ratio, about=None, least=1e-3)
        self.keep_part = check_probability("keep_part", keep_part)
        self.min_visible = (
            None if min_visible is None else check_probability("min_visible", min_visible)
        )

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw TRIALS crops, take one by what it shows, and say which animals stay."""
        random = rng.random() < self.random_p
        draws = rng.random((4, TRIALS)).T.tolist()
        greatest = _placed(self.size[1] / self.size[0], 1.0, (0.5, 0.5), context.image_hw)
        boxes = [self._box(draw, context.image_hw) for draw in draws] if random else [greatest]
        box, parts = self._choice(boxes, context)
        warp = Warp(cropping(box, self.size), self.size)
        return (warp, *keep_visible(context, parts, self.min_visible))

    def _choice(self, boxes: list[Box], context: DrawContext) -> tuple[Box, np.ndarray | None]:
        """The crop that is taken, and the part that it shows of each animal.

        The part is None where nothing depends on it. The first crop is looked at alone, since it
        mostly shows enough.
        """
        if not context.alive or (self.keep_part == 0 and self.min_visible is None):
            return boxes[0], None
        best, shown = 0, None
        for candidates in (boxes[:1], boxes):
            parts = context.visible_parts(np.array(candidates))
            if parts is None:
                break
            most = np.where(np.isnan(parts), 0, parts).max(axis=1)
            enough = np.flatnonzero(most >= self.keep_part)
            best = int(enough[0]) if len(enough) else int(most.argmax())
            shown = parts[best]
            if len(enough):
                break
        return boxes[best], shown

    def _box(self, draw: Sequence[float], image_hw: tuple[int, int]) -> Box:
        """A crop from four draws in [0, 1): its area, its place across and down, its stretch."""
        area, across, down, stretch = draw
        low, high = self.scale
        aspect = self.size[1] / self.size[0]
        if self.ratio is not None:
            aspect *= self.ratio[0] * (self.ratio[1] / self.ratio[0]) ** stretch
        return _placed(aspect, low + (high - low) * area, (across, down), image_hw)


def _placed(
    aspect: float, area: float, place: tuple[float, float], image_hw: tuple[int, int]
) -> Box:
    """A crop inside a picture, from edge to edge.

    Args:
        aspect: its width over its height.
        area: its part of the greatest area of its aspect that fits into the picture.
        place: across and down, 0 at the picture's first pixels and 1 at its last.
        image_hw: of the picture.
    """
    height, width = image_hw
    crop_width = min(width, height * aspect) * math.sqrt(area)
    crop_height = min(height, width / aspect) * math.sqrt(area)
    left = (width - crop_width) * place[0] - 0.5
    top = (height - crop_height) * place[1] - 0.5
    return left, top, left + crop_width, top + crop_height

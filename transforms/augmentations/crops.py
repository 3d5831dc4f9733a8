"""Random crops that know where the animals are."""

import math

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.augmentations.resizing import keep_visible
from animal3dbox.transforms.camera_law.maps import Size, check_size, cropping
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import check_probability, check_range
from animal3dbox.transforms.steps import Step, Warp
from animal3dbox.transforms.transform import Transform

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
        boxes = self._draw(rng, context.image_hw, random=rng.random() < self.random_p)
        depends = context.alive and (self.keep_part > 0 or self.min_visible is not None)
        parts = context.visible_parts(boxes) if depends else None
        best = 0
        if parts is not None:
            most = np.where(np.isnan(parts), 0, parts).max(axis=1)
            enough = np.flatnonzero(most >= self.keep_part)
            best = int(enough[0]) if len(enough) else int(most.argmax())
        box = boxes[best]
        warp = Warp(cropping((box[0], box[1], box[2], box[3]), self.size), self.size)
        return (
            warp,
            *keep_visible(context, None if parts is None else parts[best], self.min_visible),
        )

    def _draw(
        self, rng: np.random.Generator, image_hw: tuple[int, int], *, random: bool
    ) -> np.ndarray:
        """Boxes (TRIALS, 4) inside the picture, from edge to edge."""
        area, across, down, stretch = rng.random((4, TRIALS))
        low, high = self.scale
        area = low + (high - low) * area if random else np.ones(1)
        aspect = np.full(TRIALS, self.size[1] / self.size[0])
        if self.ratio is not None and random:
            aspect = aspect * np.exp(
                math.log(self.ratio[0]) + math.log(self.ratio[1] / self.ratio[0]) * stretch
            )
        height, width = image_hw
        crop_width = np.minimum(width, height * aspect) * np.sqrt(area)
        crop_height = np.minimum(height, width / aspect) * np.sqrt(area)
        left = (width - crop_width) * (across if random else 0.5) - 0.5
        top = (height - crop_height) * (down if random else 0.5) - 0.5
        return np.stack((left, top, left + crop_width, top + crop_height), axis=1)

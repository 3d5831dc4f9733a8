"""Random erasing that says what it hid."""

import math

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import SEEDS, check_range
from animal3dbox.transforms.steps import Erase, Step
from animal3dbox.transforms.transform import Transform


class RandomErasing(Transform):
    """Paint a rectangle over, and mark what it hides.

    Masks lose its pixels, depth becomes unknown (0), keypoints below it get visibility 0, and
    occlusion (N,) grows: the part of the animal (its mask, else its cuboid's silhouette in the
    picture) that is hidden. The cuboid, its faces and its 2D box stay.

    Args:
        p: probability.
        scale: range of the rectangle's area over the picture's.
        ratio: range of its aspect, width over height.
        value: colour in [0, 1], one or one a channel; "random" for noise.

    Example:
        >>> target = {"masks": np.ones((1, 40, 40), np.uint8)}
        >>> erase = RandomErasing(p=1, scale=(0.25, 0.25), ratio=(1, 1))
        >>> image, target = erase(np.full((40, 40, 3), 9, np.uint8), target)
        >>> target["occlusion"].tolist(), int((image == 0).sum()) // 3
        ([0.25], 400)
    """

    def __init__(
        self,
        p: float = 0.5,
        scale: tuple[float, float] = (0.02, 0.2),
        ratio: tuple[float, float] = (0.3, 3.3),
        value: float | tuple[float, ...] | str = 0.0,
    ) -> None:
        super().__init__(p)
        self.scale = check_range("scale", scale, about=None, least=0)
        self.ratio = check_range("ratio", ratio, about=None, least=1e-3)
        if self.scale[1] > 1:
            raise ConfigError(f"scale must lie in [0, 1], got {scale!r}")
        if isinstance(value, str) and value != "random":
            raise ConfigError(f"value must be colours in [0, 1] or 'random', got {value!r}")
        self.value = value

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw the rectangle, whole pixels inside the picture, and the seed of its noise."""
        height, width = context.image_hw
        area = rng.uniform(*self.scale) * height * width
        aspect = math.exp(rng.uniform(math.log(self.ratio[0]), math.log(self.ratio[1])))
        box_width = min(width, round(math.sqrt(area * aspect)))
        box_height = min(height, round(math.sqrt(area / aspect)))
        left = int(rng.integers(width - box_width + 1))
        top = int(rng.integers(height - box_height + 1))
        seed = int(rng.integers(SEEDS))
        if box_width == 0 or box_height == 0:
            return ()
        return (Erase(((left, top, left + box_width, top + box_height),), self._colour(), seed),)

    def _colour(self) -> tuple[float, ...] | None:
        """The colour of the paint; None for noise."""
        if isinstance(self.value, str):
            return None
        return self.value if isinstance(self.value, tuple) else (float(self.value),)

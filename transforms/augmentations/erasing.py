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
        """The rectangle."""
        height, width = context.image_hw
        area = rng.uniform(*self.scale) * height * width
        aspect = math.exp(rng.uniform(math.log(self.ratio[0]), math.log(self.ratio[1])))
        wide, high = (
            min(width, round(math.sqrt(area * aspect))),
            min(height, round(math.sqrt(area / aspect))),
        )
        left, top, seed = (
            int(rng.integers(width - wide + 1)),
            int(rng.integers(height - high + 1)),
            int(rng.integers(SEEDS)),
        )
        if wide == 0 or high == 0:
            return ()
        value = (
            None
            if isinstance(self.value, str)
            else self.value
            if isinstance(self.value, tuple)
            else (float(self.value),)
        )
        return (Erase(((left, top, left + wide, top + high),), value, seed),)

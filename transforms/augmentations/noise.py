"""Blur and noise.

They act where they stand in the pipeline, since they do not commute with maps of pixels.
"""

import numpy as np

from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import SEEDS, check_range
from animal3dbox.transforms.steps import Blur, Noise, Step
from animal3dbox.transforms.transform import Transform


class RandomGaussianBlur(Transform):
    """Blur with a Gaussian.

    Args:
        sigma: range of its standard deviation in px of the picture by then.
        p: probability.

    """

    def __init__(self, sigma: tuple[float, float] = (0.1, 2.0), p: float = 0.5) -> None:
        super().__init__(p)
        self.sigma = check_range("sigma", sigma, about=None, least=0)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """The one blur; none below a twentieth of a pixel, which changes no grey level."""
        sigma = rng.uniform(*self.sigma)
        return (Blur(sigma),) if sigma > 0.05 else ()


class RandomGaussianNoise(Transform):
    """Add Gaussian noise, independent in every pixel and channel.

    Args:
        sigma: range of its standard deviation, of colours in [0, 1].
        p: probability.

    """

    def __init__(self, sigma: tuple[float, float] = (0.0, 0.05), p: float = 0.5) -> None:
        super().__init__(p)
        self.sigma = check_range("sigma", sigma, about=None, least=0)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """The strength and the seed of the noise."""
        return (Noise(rng.uniform(*self.sigma), int(rng.integers(SEEDS))),)

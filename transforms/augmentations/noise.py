"""Blur and noise.

They act where they stand in the pipeline, since they do not commute with maps of pixels.
"""

import numpy as np

from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import SEEDS, check_range
from animal3dbox.transforms.steps import Blur, Noise, Step
from animal3dbox.transforms.transform import Transform


class RandomGaussianBlur(Transform):
    """Blur the picture with a Gaussian.

    Args:
        sigma: range of its standard deviation in px of the picture by then.
        p: probability.

    Example:
        >>> edge = np.repeat(np.array([0, 0, 0, 200, 200, 200], np.uint8)[None], 6, axis=0)
        >>> RandomGaussianBlur((1, 1), p=1)(edge, {})[0][3].tolist()
        [2, 12, 60, 140, 188, 198]
    """

    def __init__(self, sigma: tuple[float, float] = (0.1, 2.0), p: float = 0.5) -> None:
        super().__init__(p)
        self.sigma = check_range("sigma", sigma, about=None, least=0)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw the blur; none below a twentieth of a pixel, which changes no grey level."""
        sigma = rng.uniform(*self.sigma)
        return (Blur(sigma),) if sigma > 0.05 else ()


class RandomGaussianNoise(Transform):
    """Add Gaussian noise, independent in every pixel and channel.

    Args:
        sigma: range of its standard deviation, of colours in [0, 1].
        p: probability.

    Example:
        >>> grey = np.full((50, 50, 3), 128, np.uint8)
        >>> noisy, _ = RandomGaussianNoise((0.05, 0.05), p=1)(grey, {}, key=(0, 0))
        >>> round(float(noisy.std()))  # 0.05 of 255
        13
    """

    def __init__(self, sigma: tuple[float, float] = (0.0, 0.05), p: float = 0.5) -> None:
        super().__init__(p)
        self.sigma = check_range("sigma", sigma, about=None, least=0)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw the strength and the seed of the noise."""
        return (Noise(rng.uniform(*self.sigma), int(rng.integers(SEEDS))),)

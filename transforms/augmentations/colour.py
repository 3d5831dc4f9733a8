"""Colours: affine maps of RGB, fused into one matrix, and the final standardisation.

All act on colours in [0, 1]; they are clipped once, after the last of them.
"""

import math

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import check_range
from animal3dbox.transforms.steps import Colour, Standardise, Step, compose_colours
from animal3dbox.transforms.transform import Transform

LUMA = np.array([0.299, 0.587, 0.114])
"""Weights of red, green and blue in brightness (Rec. 601)."""
CHROMA = np.array([LUMA, [0.595716, -0.274453, -0.321263], [0.211456, -0.522591, 0.311135]])
"""From RGB to brightness and the two chroma axes of YIQ."""
RGB_OF_CHROMA = np.linalg.inv(CHROMA)
"""From there back to RGB."""

Range = float | tuple[float, float]


class ColorJitter(Transform):
    """Change brightness, contrast, saturation and hue, in this order, by one matrix.

    Contrast is about mid grey and hue is a turn of the chroma plane (YIQ), so that all four are
    affine; kornia's and torchvision's contrast is about the mean of the picture, and their hue goes
    through HSV, which costs most of their time.

    Args:
        brightness: factor; a number x means [max(0, 1 - x), 1 + x].
        contrast: likewise.
        saturation: likewise; 0 is grey.
        hue: turn as part of the circle; a number x means [-x, x].
        p: probability.

    Example:
        >>> image = np.full((2, 2, 3), 100, np.uint8)
        >>> ColorJitter(brightness=(1.5, 1.5))(image, {})[0][0, 0].tolist()
        [150, 150, 150]
    """

    def __init__(
        self,
        brightness: Range = 0.0,
        contrast: Range = 0.0,
        saturation: Range = 0.0,
        hue: Range = 0.0,
        *,
        p: float = 1.0,
    ) -> None:
        super().__init__(p)
        self.brightness = check_range("brightness", brightness, about=1, least=0)
        self.contrast = check_range("contrast", contrast, about=1, least=0)
        self.saturation = check_range("saturation", saturation, about=1, least=0)
        self.hue = check_range("hue", hue)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw the four factors, and make one matrix of them."""
        brightness, contrast, saturation, hue = (
            rng.uniform(*span)
            for span in (self.brightness, self.contrast, self.saturation, self.hue)
        )
        matrix = colour_matrix(saturation_and_hue(saturation, hue) * contrast, 0.5 * (1 - contrast))
        return (Colour(compose_colours(matrix, colour_matrix(np.eye(3) * brightness, 0.0))),)


class RandomGrayscale(Transform):
    """Take the colour out: all channels become the brightness.

    Args:
        p: probability.

    Example:
        >>> image = np.zeros((2, 2, 3), np.uint8) + np.array([200, 0, 0], np.uint8)
        >>> RandomGrayscale(p=1)(image, {})[0][0, 0].tolist()  # 0.299 of the red
        [60, 60, 60]
    """

    def __init__(self, p: float = 0.1) -> None:
        super().__init__(p)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """The matrix whose rows are all the weights of brightness."""
        return (Colour(colour_matrix(saturation_and_hue(0.0, 0.0), 0.0)),)


class Normalize(Transform):
    """Standardise colours in [0, 1]: (x - mean) / std.

    The image leaves as float32 (float64 if it came so). Put it last: after it there is no [0, 1]
    any more in which another transform could change colours.

    Args:
        mean: per channel, of colours in [0, 1].
        std: per channel, > 0.

    Example:
        >>> image = np.full((2, 2, 3), 255, np.uint8)
        >>> image, _ = Normalize(mean=(0.5,) * 3, std=(0.25,) * 3)(image, {})
        >>> image[0, 0].tolist(), image.dtype.name
        ([2.0, 2.0, 2.0], 'float32')
    """

    def __init__(
        self,
        mean: tuple[float, ...] = (0.485, 0.456, 0.406),
        std: tuple[float, ...] = (0.229, 0.224, 0.225),
    ) -> None:
        super().__init__()
        if (
            len(mean) != len(std)
            or any(not math.isfinite(m) for m in mean)
            or any(not s > 0 for s in std)
        ):
            raise ConfigError(
                f"mean and std must have one finite value a channel, std > 0, got {mean!r} and"
                f" {std!r}"
            )
        self.mean, self.std = tuple(float(m) for m in mean), tuple(float(s) for s in std)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """The standardisation; nothing of it is random."""
        return (Standardise(self.mean, self.std),)


def colour_matrix(linear: np.ndarray, offset: float) -> np.ndarray:
    """The (3, 4) map x' = linear x + offset."""
    return np.concatenate((linear, np.full((3, 1), offset)), axis=1)


def saturation_and_hue(saturation: float, hue: float) -> np.ndarray:
    """The (3, 3) matrix that keeps brightness, scales chroma, and turns it by a part of the circle.

    YIQ^-1 diag(1, s R(2 pi hue)) YIQ, with R the turn of the chroma plane by the hue.
    """
    angle = 2 * math.pi * hue
    turn = np.array(
        [[1, 0, 0], [0, math.cos(angle), -math.sin(angle)], [0, math.sin(angle), math.cos(angle)]]
    )
    matrix: np.ndarray = (
        RGB_OF_CHROMA @ (turn * np.array([[1.0], [saturation], [saturation]])) @ CHROMA
    )
    return matrix

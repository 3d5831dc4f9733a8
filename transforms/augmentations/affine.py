"""Affine maps: rolls of the camera, zooms and shifts; shear on request."""

import math

import numpy as np

from animal3dbox.transforms.camera_law.maps import about, center_of, rolling, shifting
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import check_range
from animal3dbox.transforms.steps import Step, Warp
from animal3dbox.transforms.transform import Transform

Range = float | tuple[float, float]


class RandomAffine(Transform):
    """Turn, zoom, shift and, on request, shear the picture about its middle.

    Turning is an exact roll of the camera, for fx != fy too. K: one more scale and a shift; no skew
    without shear.

    Args:
        degrees: range of the turn, clockwise; a number x means [-x, x].
        translate: greatest shift as parts of the (width, height), e.g. (0.1, 0.1); None for none.
        scale: range of the zoom, e.g. (0.8, 1.2); None for none.
        shear: range of the shear along x in degrees; None for none. It gives K a skew, so the
            pipeline must allow it (Compose(allow_skew=True)).
        p: probability.

    Example:
        >>> image, target = RandomAffine(0, scale=(2, 2))(np.zeros((60, 80, 3), np.uint8), {})
        >>> target["H_out_in"].tolist()  # a zoom about the middle, (39.5, 29.5)
        [[2.0, 0.0, -39.5], [0.0, 2.0, -29.5], [0.0, 0.0, 1.0]]
    """

    geometric = True

    def __init__(
        self,
        degrees: Range,
        translate: tuple[float, float] | None = None,
        scale: tuple[float, float] | None = None,
        shear: Range | None = None,
        *,
        p: float = 1.0,
    ) -> None:
        super().__init__(p)
        self.degrees = check_range("degrees", degrees)
        self.translate = (0.0, 0.0) if translate is None else translate
        for part in self.translate:
            check_range("translate", (0.0, part))
        self.scale = (
            (1.0, 1.0) if scale is None else check_range("scale", scale, about=None, least=1e-3)
        )
        self.shear = (0.0, 0.0) if shear is None else check_range("shear", shear)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw the turn, zoom, shift and shear, and make one map of them."""
        turn = rng.uniform(*self.degrees)
        zoom = math.exp(rng.uniform(math.log(self.scale[0]), math.log(self.scale[1])))
        shift = rng.uniform(-1, 1, 2) * self.translate
        lean = math.tan(math.radians(rng.uniform(*self.shear)))
        linear = rolling(context.K, turn) @ np.array([[1.0, lean], [0, 1]]) * zoom
        linear[np.abs(linear) < 1e-15 * np.abs(linear).max()] = 0  # a quarter turn keeps the axes
        H = shifting(shift[0] * context.image_hw[1], shift[1] * context.image_hw[0]) @ about(
            linear, center_of(context.image_hw)
        )
        return (Warp(H, context.image_hw),)


class RandomRotation(RandomAffine):
    """Turn the picture about its middle by rolling the camera.

    Exact, without skew, for fx != fy too.

    Args:
        degrees: range of the turn, clockwise; a number x means [-x, x].
        p: probability.

    Example:
        >>> image, target = RandomRotation((90, 90))(np.zeros((60, 60, 3), np.uint8), {})
        >>> (target["H_out_in"].round() + 0).tolist()  # x' = 59 - y, y' = x
        [[0.0, -1.0, 59.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """

    def __init__(self, degrees: Range, p: float = 1.0) -> None:
        super().__init__(degrees, p=p)

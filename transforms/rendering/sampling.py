"""The rules by which both executors read pixels: shrinking first, horizons, ties, kernels."""

import math
from dataclasses import dataclass

import numpy as np

from animal3dbox.errors import ConfigError, ShapeError
from animal3dbox.transforms.camera_law.maps import inverse_map, scaling, shifting
from animal3dbox.transforms.steps import Erase

INTERPOLATIONS = ("nearest", "bilinear", "bicubic")
TIE_PX = 1e-3
"""Nearest neighbours are read this much to the left and above, so that a tie goes to the same pixel
everywhere."""
REACH_PX = 3
"""Interpolations read pixels nearer than this, on either side."""


@dataclass(frozen=True)
class Reading:
    """How to read a picture for a warp.

    Attributes:
        shrink_xy: whole numbers of pixels to average first, so that strong shrinking does not
            alias.
        H_in_out: (3, 3) from pixels of the result to pixels of the shrunken picture; the third
            coordinate of its result is positive where something can be read, since H_out_in is
            oriented.
        image_hw: height and width of the result.
        horizon: whether parts of the result lie beyond the map's horizon, where there is nothing to
            read.
    """

    shrink_xy: tuple[int, int]
    H_in_out: np.ndarray
    image_hw: tuple[int, int]
    horizon: bool

    @property
    def affine(self) -> bool:
        """Whether the map has no perspective."""
        return bool((self.H_in_out[2, :2] == 0).all())

    def beyond(self) -> np.ndarray:
        """Which pixels of the result lie beyond the horizon, (H, W) bool."""
        height, width = self.image_hw
        a, b, c = self.H_in_out[2]
        over: np.ndarray = a * np.arange(width)[None] + b * np.arange(height)[:, None] + c <= 0
        return over

    def part_read(self, source_hw: tuple[int, int]) -> tuple[slice, slice]:
        """The rows and columns of the source that some pixel of the result is read from.

        A map without a horizon in the result makes a convex quadrilateral of it, round which lies
        the box of its four mapped corners.

        Args:
            source_hw: height and width of the picture that is read, shrunken if it is.

        Returns:
            Slices of at least one row and one column.
        """
        height, width = source_hw
        if self.horizon:
            return slice(0, height), slice(0, width)
        px = [(u / w, v / w) for u, v, w in _mapped_corners(self.H_in_out, self.image_hw)]
        columns, rows = (
            _covering(min(line), max(line), length)
            for line, length in zip(zip(*px, strict=True), (width, height), strict=True)
        )
        return rows, columns


def _covering(least: float, greatest: float, length: int) -> slice:
    """The whole pixels within reach of an interpolation from least to greatest, in [0, length)."""
    first, last = (min(max(edge, 0), length - 1) for edge in (least, greatest))
    return slice(
        max(math.floor(first) - REACH_PX, 0), min(math.ceil(last) + REACH_PX, length - 1) + 1
    )


def plan_reading(
    H_out_in: np.ndarray,
    image_hw_in: tuple[int, int],
    image_hw_out: tuple[int, int],
    interpolation: str,
) -> Reading:
    """How to read a picture for a warp by a map.

    Args:
        H_out_in: (3, 3), w > 0 on the part that stays in the picture.
        image_hw_in: height and width before.
        image_hw_out: height and width after.
        interpolation: one of INTERPOLATIONS; "nearest" is never shrunk first.

    """
    H_in_out = inverse_map(H_out_in)
    affine = not H_in_out[2, :2].any()
    horizon, shrink = False, (1, 1)
    if not affine:
        horizon = any(w <= 0 for _, _, w in _mapped_corners(H_in_out, image_hw_out))
    if interpolation == "nearest":
        H_in_out = shifting(-TIE_PX, -TIE_PX) @ H_in_out
    else:
        shrink = _shrink(H_in_out, image_hw_in, image_hw_out, affine=affine)
        if shrink != (1, 1):
            H_in_out = scaling((1 / shrink[0], 1 / shrink[1])) @ H_in_out
    return Reading(shrink, H_in_out, image_hw_out, horizon)


def _mapped_corners(
    H_in_out: np.ndarray, image_hw: tuple[int, int]
) -> list[tuple[float, float, float]]:
    """The corners and the middle of a result, mapped to where they are read: (u, v, w) each.

    In plain numbers: NumPy's calls take several times as long for five points
    (benchmarks/augment.py, keypoints only).
    """
    right, bottom = image_hw[1] - 0.5, image_hw[0] - 0.5
    corners = ((-0.5, -0.5), (right, -0.5), (-0.5, bottom), (right, bottom))
    (a, b, c), (d, e, f), (g, h, i) = H_in_out.tolist()
    return [
        (a * x + b * y + c, d * x + e * y + f, g * x + h * y + i)
        for x, y in (*corners, ((right - 0.5) / 2, (bottom - 0.5) / 2))
    ]


def _shrink(
    H_in_out: np.ndarray,
    image_hw_in: tuple[int, int],
    image_hw_out: tuple[int, int],
    *,
    affine: bool,
) -> tuple[int, int]:
    """Whole numbers of pixels (x, y) to average: how many go into one pixel of the result.

    Where the fewest do, so that no part of the picture becomes blurred. By the quotient rule a
    step of one pixel in the result goes (a - u g, b - u h) / w pixels across in the picture, and
    (d - v g, e - v h) / w pixels down, at the pixel (u, v).
    """
    (a, b, _), (d, e, _), (g, h, i) = H_in_out.tolist()
    if affine:
        steps = [(math.hypot(a, b) / abs(i), math.hypot(d, e) / abs(i))]
    else:
        px = [(x / w, y / w, w) for x, y, w in _mapped_corners(H_in_out, image_hw_out) if w > 0]
        steps = [
            (math.hypot(a - u * g, b - u * h) / w, math.hypot(d - v * g, e - v * h) / w)
            for u, v, w in px
        ]
    if not steps:
        return 1, 1
    across, down = (
        max(1, int(min(*fewest, side) + 1e-6))
        for fewest, side in zip(zip(*steps, strict=True), image_hw_in[::-1], strict=True)
    )
    return across, down


def check_interpolation(interpolation: str) -> str:
    """The name, or a ConfigError that lists the known ones."""
    if interpolation not in INTERPOLATIONS:
        raise ConfigError(
            f"interpolation must be one of {', '.join(INTERPOLATIONS)}, got {interpolation!r}"
        )
    return interpolation


def gaussian_kernel(sigma_px: float, image_hw: tuple[int, int]) -> np.ndarray:
    """Weights (2 r + 1,) of a Gaussian out to three sigma, not beyond the picture."""
    radius = min(int(np.ceil(3 * sigma_px)), min(image_hw) - 1)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma_px) ** 2)
    kernel: np.ndarray = (weights / weights.sum()).astype(np.float32)
    return kernel


def check_erase(step: Erase, channels: int) -> None:
    """Raise a ShapeError unless the erasing colour has one value, or one a channel."""
    if step.value is not None and len(step.value) not in (1, channels):
        raise ShapeError(
            f"image has {channels} channels, but RandomErasing's value has {len(step.value)}: give"
            " one number, or one a channel"
        )

"""What both executors share about reading pixels: how much to shrink first, where there is nothing to read, ties."""

from dataclasses import dataclass

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.maps import scaling, shifting

INTERPOLATIONS = ("nearest", "bilinear", "bicubic")
TIE_PX = 1e-3
"""Nearest neighbours are read this much to the left and above, so that a tie goes to the same pixel everywhere."""


@dataclass(frozen=True)
class Reading:
    """How to read a picture for a warp.

    Attributes:
        shrink_xy: whole numbers of pixels to average first, so that strong shrinking does not alias.
        H_in_out: (3, 3) from pixels of the result to pixels of the shrunken picture; the third coordinate of its result is
            positive where something can be read, since H_out_in is oriented.
        image_hw: height and width of the result.
        horizon: whether parts of the result lie beyond the map's horizon, where there is nothing to read.
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


def plan_reading(H_out_in: np.ndarray, image_hw_in: tuple[int, int], image_hw_out: tuple[int, int], interpolation: str) -> Reading:
    """How to read a picture.

    Args:
        H_out_in: (3, 3), w > 0 on what stays in the picture.
        image_hw_in: height and width before.
        image_hw_out: height and width after.
        interpolation: one of INTERPOLATIONS; "nearest" is never shrunk first.

    """
    H_in_out = np.linalg.inv(H_out_in)
    height, width = image_hw_out
    probes = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [-0.5, height - 0.5], [width - 0.5, height - 0.5], [(width - 1) / 2, (height - 1) / 2]])
    mapped = np.concatenate((probes, np.ones((5, 1))), axis=1) @ H_in_out.T
    w = mapped[:, 2]
    horizon = bool((w <= 0).any())
    shrink = (1, 1)
    if interpolation == "nearest":
        H_in_out = shifting(-TIE_PX, -TIE_PX) @ H_in_out
    else:
        seen = w > 0
        px = mapped[seen, :2] / w[seen, None]
        # d px_in / d px_out by the quotient rule, (M, 2, 2); its row norms are pixels read per pixel made.
        jacobian = (H_in_out[None, :2, :2] - px[:, :, None] * H_in_out[None, 2:, :2]) / w[seen, None, None]
        steps = np.linalg.norm(jacobian, axis=2)
        if len(steps):
            fewest = np.minimum(steps.min(axis=0), (image_hw_in[1], image_hw_in[0]))
            shrink = (max(1, int(fewest[0] + 1e-6)), max(1, int(fewest[1] + 1e-6)))
        if shrink != (1, 1):
            H_in_out = scaling((1 / shrink[0], 1 / shrink[1])) @ H_in_out
    return Reading(shrink, H_in_out, image_hw_out, horizon)


def check_interpolation(interpolation: str) -> str:
    """The name, or a ConfigError that lists the known ones."""
    if interpolation not in INTERPOLATIONS:
        raise ConfigError(f"interpolation must be one of {', '.join(INTERPOLATIONS)}, got {interpolation!r}")
    return interpolation


def gaussian_kernel(sigma_px: float, image_hw: tuple[int, int]) -> np.ndarray:
    """Weights (2 r + 1,) of a Gaussian out to three sigma, not beyond the picture."""
    radius = min(int(np.ceil(3 * sigma_px)), min(image_hw) - 1)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma_px) ** 2)
    kernel: np.ndarray = (weights / weights.sum()).astype(np.float32)
    return kernel

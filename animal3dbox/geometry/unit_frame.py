"""Point clouds about their mean and in units of their spread, so that solvers know no unit.

A pose of the cloud about its mean m in units s, X_cam = R (X - m) / s + t, is the pose
(R, s t - R m) of the cloud as it was, up to the scale s of the camera frame.

Arrays come and go as float64 NumPy arrays. Products and sums run in torch, whose order of summation
is the one that labels have been made with: they stay the same to the last bit.
"""

import numpy as np
import torch
from numpy.typing import NDArray

Array = NDArray[np.float64]


def unit_frame(points: Array) -> tuple[Array, float]:
    """The mean (3,) of points (N, 3) and their root mean square distance from it."""
    middle = points.mean(0)
    return middle, float(np.sqrt(((points - middle) ** 2).sum(-1).mean()))


def translation_in_unit_frame(R: Array, t: Array, *, middle: Array, unit: float) -> Array:
    """The translation (3,) in the unit frame of a pose (R, t) of the cloud as it is."""
    # t' = (t + R m) / s
    rotated_middle = torch.from_numpy(R) @ torch.from_numpy(middle)
    scaled: Array = (t + rotated_middle.numpy()) / unit
    return scaled


def translation_from_unit_frame(R: Array, t: Array, *, middle: Array, unit: float) -> Array:
    """The translation (3,) of the cloud as it is, of its pose (R, t) in the unit frame."""
    # t = s t' - R m
    rotated_middle = torch.from_numpy(R) @ torch.from_numpy(middle)
    unscaled: Array = t * unit - rotated_middle.numpy()
    return unscaled


def pixels_per_unit(points_world: Array, points_px: Array) -> float:
    """The px that a unit of length takes where a cloud is seen, by the ratio of the spreads.

    sqrt(3/2 * spread_px^2 / spread_world^2): over all directions of view, the mean square of what
    one view shows of a length is two thirds of its square.

    Args:
        points_world: (N, 3), N at least 1.
        points_px: (N, 2) where they are seen.

    """
    world, px = torch.from_numpy(points_world), torch.from_numpy(points_px)
    spread_px = (px - px.mean(0)).pow(2).sum(-1).mean()
    spread_world = (world - world.mean(0)).pow(2).sum(-1).mean().clamp_min(1e-300)
    return float((1.5 * spread_px / spread_world).sqrt())

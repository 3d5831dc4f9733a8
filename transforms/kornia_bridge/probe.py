"""Whether a kornia operation moves its pixels by its matrix.

Measured on a picture whose colours are its coordinates: what came out at a pixel says where it was.
"""

from dataclasses import dataclass
from typing import Any

import kornia.augmentation as kornia
import numpy as np
import torch

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.kornia_bridge.operations import (
    is_geometric,
    matrices,
    mirrored,
    output_hw,
    seeded,
)

FLIPS = (kornia.RandomHorizontalFlip, kornia.RandomVerticalFlip)
BLURS = (
    kornia.RandomBoxBlur,
    kornia.RandomGaussianBlur,
    kornia.RandomMedianBlur,
    kornia.RandomMotionBlur,
)
PROBE_HW = ((97, 128), (131, 90))
TOLERANCE_PX = 0.1
MARGIN_PX = 3
"""How far from the edges of the picture that goes in pixels are measured: interpolation reads up
to two pixels further."""
MARGIN_PART = 0.15
"""How far from the edges of the picture that comes out, over its side: crops that are resized
repeat their edge."""
FEWEST_PIXELS = 25
DRAWS = 4
UNMEASURABLE = (
    ArithmeticError,
    AssertionError,
    LookupError,
    NotImplementedError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""Errors of an operation that cannot work on a picture of some size."""


@dataclass(frozen=True)
class Measured:
    """One draw of an operation, measured.

    Attributes:
        off_px: the greatest distance along x or y between where a pixel came from and where the
            matrix says.
        pixels: of the interior, on which this was measured.
        image_hw: height and width that came out.
        claimed_hw: height and width that the drawn parameters announce.
        mirrored: whether the matrix mirrors.
    """

    off_px: float
    pixels: int
    image_hw: tuple[int, int]
    claimed_hw: tuple[int, int]
    mirrored: bool


def measure(op: Any, image_hw: tuple[int, int], seed: int, *, applied: bool = True) -> Measured:
    """Run an operation once on coordinates and compare with its matrix.

    Args:
        op: a GeometricAugmentationBase2D.
        image_hw: of the picture.
        seed: of the draw.
        applied: whether the operation's own coin is set to yes or to no.

    """
    height, width = image_hw
    x, y = (
        torch.arange(width, dtype=torch.float64).expand(height, width),
        torch.arange(height, dtype=torch.float64)[:, None].expand(height, width),
    )
    image = torch.stack((x, y, torch.ones_like(x)))[None]
    with seeded(seed):
        params = op.forward_parameters(image.shape)
        params["batch_prob"] = torch.full_like(params["batch_prob"], float(applied))
        came_from = op(image.clone(), params=dict(params))[0, :2].permute(1, 2, 0).detach().numpy()
        H = matrices(op, params, (1, 3, height, width))[0]
    out_hw = (came_from.shape[0], came_from.shape[1])
    columns, rows = np.meshgrid(np.arange(out_hw[1]), np.arange(out_hw[0]))
    mapped = np.stack((columns, rows, np.ones_like(rows)), axis=-1) @ np.linalg.inv(H).T
    w = np.where(mapped[..., 2:] > 1e-9, mapped[..., 2:], np.nan)
    expected = mapped[..., :2] / w
    edges = np.array([width, height]) - 1 - MARGIN_PX
    inside = np.asarray(((expected > MARGIN_PX) & (expected < edges)).all(axis=-1))
    top, left = (int(MARGIN_PART * side) + 1 for side in out_hw)
    inside[:top], inside[-top:], inside[:, :left], inside[:, -left:] = False, False, False, False
    off = np.abs(came_from - expected)[inside]
    return Measured(
        float(off.max(initial=0)),
        int(inside.sum()),
        out_hw,
        output_hw(op, params, image_hw),
        mirrored(H),
    )


def check_matrix(op: Any, sizes: tuple[tuple[int, int], ...] = PROBE_HW) -> bool:
    """Whether the operation mirrors, as far as some draws show; its matrix must be true in all.

    Args:
        op: a GeometricAugmentationBase2D.
        sizes: heights and widths of the pictures to measure on.

    Raises:
        ConfigError: its pixels are not where its matrix says, its size is not what it announces, or
            nothing could be measured.

    """
    name = type(op).__name__
    nearest = getattr(op.flags.get("resample"), "name", "") == "NEAREST"
    allowed = TOLERANCE_PX + (0.5 if nearest else 0.0)
    results = _measurements(op, sizes)
    for result in results:
        if result.image_hw != result.claimed_hw:
            raise ConfigError(
                f"{name} makes images of {result.image_hw} (height, width) but announces"
                f" {result.claimed_hw}; let its parameters hold output_size (B, 2)"
            )
        if not result.off_px <= allowed:
            raise ConfigError(
                f"{name}'s pixels are up to {result.off_px:.3g} px from where its matrix says, so"
                " it would leave the camera stale; correct it"
            )
    if sum(result.pixels for result in results) < FEWEST_PIXELS:
        raise ConfigError(
            f"{name} leaves nothing to measure on images of {sizes}; give KorniaTransform(op,"
            " probe_hw=...) that suit it"
        )
    return any(result.mirrored for result in results)


def _measurements(op: Any, sizes: tuple[tuple[int, int], ...]) -> list[Measured]:
    """Some draws on each size, and one that the operation's own coin leaves out, if it has one."""
    draws = [(seed, True) for seed in range(DRAWS)]
    draws += [(DRAWS, False)] if op.p < 1 or op.p_batch < 1 else []
    results: list[Measured] = []
    for image_hw in sizes:
        try:
            results += [measure(op, image_hw, seed, applied=applied) for seed, applied in draws]
        except UNMEASURABLE as error:
            raise ConfigError(
                f"{type(op).__name__} cannot be measured on an image of {image_hw}: {error}; give"
                " KorniaTransform(op, probe_hw=...) others"
            ) from error
    return results


def check_blur(op: Any, side_px: int = 160) -> None:
    """Raise a ConfigError if a blur also moves the picture.

    An even kernel moves it by half a pixel, a motion with a direction by more.

    Args:
        op: an operation on colours that leaves a ramp a ramp.
        side_px: of the measured picture.

    """
    ramp = torch.arange(side_px, dtype=torch.float32).expand(side_px, side_px) / side_px
    image = torch.stack((ramp, ramp.T, ramp))[None]
    middle = slice(side_px // 3, -(side_px // 3))
    for seed in range(2 * DRAWS):
        with seeded(seed):
            params = op.forward_parameters(image.shape)
            params["batch_prob"] = torch.ones_like(params["batch_prob"])
            shift_px = (op(image.clone(), params=params) - image)[0, :2, middle, middle] * side_px
        off_px = float(shift_px.detach().mean(dim=(1, 2)).abs().max())
        if off_px > TOLERANCE_PX:
            raise ConfigError(
                f"{type(op).__name__} moves the picture by {off_px:.2g} px without a matrix, which"
                " would leave the camera stale; give it odd kernel sizes, and direction=0.0 if it"
                " has one"
            )


def measured_mirror(op: Any, probe_hw: tuple[tuple[int, int], ...] | None = None) -> bool:
    """Whether a kornia augmentation may mirror; an unknown operation is measured.

    Args:
        op: of kornia, or derived from its 2D bases.
        probe_hw: heights and widths of the pictures to measure on.

    Raises:
        ConfigError: its pixels do not follow its matrix, or it moves pixels without one.

    """
    if isinstance(op, BLURS):
        check_blur(op)
    may_mirror = isinstance(op, FLIPS) and op.p > 0 and op.p_batch > 0
    if is_geometric(op) and not type(op).__module__.startswith("kornia."):
        may_mirror |= check_matrix(op, PROBE_HW if probe_hw is None else probe_hw)
    return may_mirror

"""kornia's 2D augmentations as transforms.

Its matrices and its colours, with our one warp and one key for all randomness.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import kornia.augmentation as kornia
import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.kornia_bridge.operations import (
    gates,
    is_geometric,
    matrices,
    mirrored,
    output_hw,
    seeded,
)
from animal3dbox.transforms.kornia_bridge.probe import measured_mirror
from animal3dbox.transforms.randomness import SEEDS
from animal3dbox.transforms.steps import Erase, KorniaPixels, Standardise, Step, Warp
from animal3dbox.transforms.transform import Transform

CHANNELS = 3
"""Parameters are drawn for RGB; for other images they are drawn again, from the same seed."""


@dataclass(frozen=True)
class PixelOp:
    """A kornia operation on colours that gives the same pixels whenever it is run.

    Whatever it draws while it runs, it draws from the seed.
    """

    op: Any
    seed: int

    def __call__(self, images: Tensor, params: Mapping[str, Any]) -> Tensor:
        """The changed images (1, C, H, W)."""
        with seeded(self.seed):
            suits = images.shape[1] == CHANNELS
            params = dict(params) if suits else self.op.forward_parameters(images.shape)
            result: Tensor = self.op(images, params=params)
        if result.shape != images.shape:
            raise ConfigError(
                f"{type(self.op).__name__} should change colours only, but made"
                f" {tuple(result.shape)} of {tuple(images.shape)}"
            )
        return result


class KorniaTransform(Transform):
    """A kornia 2D augmentation as one of our transforms; pipelines wrap it by themselves.

    Geometric operations give their matrix to the one warp; the interpolation and the fill are the
    pipeline's, not the operation's own. RandomErasing and Normalize become our own steps. Any other
    operation on colours runs as it is, and its result is clipped to [0, 1]; blurs are measured
    first, for some of kornia's move the picture. Whether and what it draws depends on the sample's
    key alone; torch's generator is left as it was.

    Args:
        op: from kornia.augmentation, or derived from its 2D bases. A geometric operation that is
            not kornia's own is measured: its pixels must be where its matrix says (probe.py).
        mirrors: whether it may mirror; None finds out. An operation that mirrors all the same
            raises.
        probe_hw: sizes of the images that an operation of your own is measured on.

    Raises:
        ConfigError: the operation has no matrix, or is a container, a mixture, a policy or for
            volumes.

    Example:
        >>> flip = KorniaTransform(kornia.RandomHorizontalFlip(p=1.0))
        >>> image, target = flip(np.zeros((60, 80, 3), np.uint8), {})
        >>> target["H_out_in"][0].tolist(), flip.mirrors
        ([-1.0, 0.0, 79.0], True)
    """

    def __init__(
        self,
        op: Any,
        *,
        mirrors: bool | None = None,
        probe_hw: tuple[tuple[int, int], ...] | None = None,
    ) -> None:
        super().__init__()  # the operation tosses its own coin
        self.op = op
        self.geometric = is_geometric(op)
        if op.device.type != "cpu":
            raise ConfigError(
                f"{type(op).__name__} draws on {op.device}, which no sample's key can seed; draw on"
                " the CPU: op.to('cpu')"
            )
        may_mirror = measured_mirror(op, probe_hw)
        self.mirrors = may_mirror if mirrors is None else mirrors
        if not self.geometric:
            _check_colours(op)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Let kornia draw for a batch of this one picture, and take its draws as steps."""
        seed = int(rng.integers(SEEDS))
        shape = (1, CHANNELS, *context.image_hw)
        with seeded(seed):
            params = self.op.forward_parameters(torch.Size(shape))
        if not gates(self.op, params).all():
            return ()
        if self.geometric:
            return self._warp(params, shape)
        if isinstance(self.op, kornia.RandomErasing):
            return _erased(params, context.image_hw)
        if isinstance(self.op, kornia.Normalize):
            return (_standardised(self.op.flags["mean"], self.op.flags["std"]),)
        return (KorniaPixels(PixelOp(self.op, seed), params),)

    def _warp(
        self, params: Mapping[str, Any], shape: tuple[int, int, int, int]
    ) -> tuple[Step, ...]:
        """The map of kornia's matrix."""
        H = matrices(self.op, params, shape)[0]
        self.check_mirror(H)
        return (Warp(H, output_hw(self.op, params, (shape[2], shape[3]))),)

    def check_mirror(self, H_out_in: np.ndarray) -> None:
        """Raise a ConfigError if a map mirrors although the operation was said to mirror none.

        Args:
            H_out_in: (3, 3), as it was drawn.
        """
        if mirrored(H_out_in) and not self.mirrors:
            raise ConfigError(
                f"{self.op!r} mirrored the picture unexpectedly; if it may, say so:"
                " KorniaTransform(op, mirrors=True)"
            )


def _check_colours(op: Any) -> None:
    """Raise a ConfigError for operations on colours that have no place among those in [0, 1]."""
    name = type(op).__name__
    if isinstance(op, kornia.Denormalize):
        raise ConfigError(
            "Denormalize undoes a Normalize, which comes last here; leave both out, or apply it to"
            " the result"
        )
    if isinstance(op, kornia.Normalize) and not (op.p == 1 and op.p_batch == 1):
        raise ConfigError("Normalize with p < 1 would leave pictures of two kinds; give it p=1")
    overridden = (
        isinstance(op, kornia.RandomErasing)
        and type(op).apply_transform is not kornia.RandomErasing.apply_transform
    )
    if overridden:
        raise ConfigError(
            f"{name} changes what RandomErasing paints, so what it hides is not known; use"
            " RandomErasing of animal3dbox.transforms"
        )


def _erased(params: Mapping[str, Any], image_hw: tuple[int, int]) -> tuple[Step, ...]:
    """Kornia's rectangle as our own step, which also marks what it hides."""
    left, top, wide, high = (int(params[name][0]) for name in ("xs", "ys", "widths", "heights"))
    box = (left, top, min(left + wide, image_hw[1]), min(top + high, image_hw[0]))
    return (Erase((box,), (float(params["values"][0]),)),)


def _standardised(mean: Tensor, std: Tensor) -> Standardise:
    """Kornia's mean and std (C,) or (1,) for one picture.

    One number stands for all three channels.
    """
    values = [tuple(float(x) for x in value.reshape(-1)) for value in (mean, std)]
    values = [value * CHANNELS if len(value) == 1 else value for value in values]
    return Standardise(values[0], values[1])

"""kornia's 2D augmentations as transforms.

Its matrices and its colours, with our one warp and one key for all randomness.

Tested with kornia 0.9, the first whose matrices agree with its pixels; importing this module
imports kornia.
"""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import kornia.augmentation as kornia
import numpy as np
import torch
from kornia.augmentation.auto.base import PolicyAugmentBase
from kornia.augmentation.container.base import BasicSequentialBase
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.augmentations.noise import SEEDS
from animal3dbox.transforms.steps import Erase, KorniaPixels, Standardise, Step, Warp
from animal3dbox.transforms.transform import Transform
from animal3dbox.transforms.view import View

CHANNELS = 3
"""Parameters are drawn for RGB.

An operation drawn for another number of channels draws again from the same seed.
"""
NOTHING_PX = 1e-9
"""What moves no pixel of the picture by more than this is rounding, and is set to 0.

An affine map stays affine.
"""

ONE_AT_A_TIME = threading.RLock()
"""Held while kornia draws: threads share torch's generator."""

FLIPS = (kornia.RandomHorizontalFlip, kornia.RandomVerticalFlip)
BLURS = (
    kornia.RandomBoxBlur,
    kornia.RandomGaussianBlur,
    kornia.RandomMedianBlur,
    kornia.RandomMotionBlur,
)
REFUSED: tuple[tuple[type, str], ...] = (
    (
        PolicyAugmentBase,
        (
            "is a policy whose operations have no common matrix; list the operations that you want"
            " in Compose"
        ),
    ),
    (
        BasicSequentialBase,
        (
            "is a container, which kornia leaves out of the matrix when nested; list its members in"
            " Compose"
        ),
    ),
    (
        kornia.MixAugmentationBaseV2,
        (
            "mixes the pictures of a batch, and no one camera describes a mixture; leave it out, or"
            " mix after labels are made"
        ),
    ),
    (kornia.AugmentationBase3D, "works on volumes, not on pictures; leave it out"),
)


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Let torch's CPU generator, from which kornia draws, depend on the seed alone, and leave it as
    it was afterwards."""
    with ONE_AT_A_TIME, torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(seed)
        yield


def is_geometric(op: Any) -> bool:
    """Whether a kornia augmentation moves pixels, by a matrix; False if it changes colours only.

    Raises:
        ConfigError: it is neither, with the reason and the remedy.

    """
    name = type(op).__name__
    for kinds, reason in REFUSED:
        if isinstance(op, kinds):
            raise ConfigError(f"{name} {reason}")
    if isinstance(op, kornia.GeometricAugmentationBase2D | kornia.IntensityAugmentationBase2D):
        return isinstance(op, kornia.GeometricAugmentationBase2D)
    if isinstance(op, kornia.AugmentationBase2D):
        raise ConfigError(
            f"{name} bends the picture in a way that no matrix, and so no camera, describes; leave"
            " it out, or use RandomVirtualCamera"
        )
    raise ConfigError(
        f"{name} is no kornia 2D augmentation, so nothing says what it does to the camera; derive"
        " it from kornia's IntensityAugmentationBase2D if it changes colours only, or from"
        " GeometricAugmentationBase2D if it has a matrix"
    )


def gates(op: Any, params: Mapping[str, Any]) -> np.ndarray:
    """For each picture whether kornia applies the operation, (B,) bool.

    One entry for all if it gates whole batches.
    """
    open_: np.ndarray = np.atleast_1d(params["batch_prob"].cpu().numpy() > 0.5)
    return np.ones_like(open_) if op.p == 1 and op.p_batch == 1 else open_


def output_hw(op: Any, params: Mapping[str, Any], image_hw: tuple[int, int]) -> tuple[int, int]:
    """Height and width after the operation.

    Raises:
        ConfigError: it is applied to some pictures of a batch only, and changes their size.

    """
    size = image_hw
    if isinstance(op, kornia.PadTo):
        height, width = (int(side) for side in op.flags["size"])
        grows = not op.flags.get("crop_if_exceeds", True)
        size = (max(height, image_hw[0]), max(width, image_hw[1])) if grows else (height, width)
    elif "output_size" in params:
        height, width = params["output_size"][0].tolist()
        size = (int(height), int(width))
    open_ = gates(op, params)
    if open_.all() or size == image_hw:
        return size
    if open_.any():
        raise ConfigError(
            f"{type(op).__name__} would change the size of some pictures of the batch only; give"
            " it p=1"
        )
    return image_hw


def matrices(op: Any, params: Mapping[str, Any], shape: tuple[int, int, int, int]) -> np.ndarray:
    """The maps of pixels of a geometric operation, from kornia's own formula but in float64 and without touching a pixel.

    Args:
        op: a GeometricAugmentationBase2D.
        params: drawn by its forward_parameters.
        shape: (B, C, H, W) of the pictures that go in.

    Returns:
        (B, 3, 3).

    Raises:
        ConfigError: the matrices are not invertible or not (B, 3, 3).

    """
    precise = {
        name: value.double() if isinstance(value, Tensor) and value.is_floating_point() else value
        for name, value in params.items()
    }
    without_pixels = torch.zeros((), dtype=torch.float64).expand(shape)
    H = (
        op.generate_transformation_matrix(without_pixels, precise, op.flags)
        .detach()
        .double()
        .cpu()
        .numpy()
    )
    if H.ndim != 3 or H.shape[1:] != (3, 3) or H.shape[0] not in (1, shape[0]):
        raise ConfigError(
            f"{type(op).__name__} must give matrices ({shape[0]}, 3, 3), got {H.shape}"
        )
    rows = np.sqrt((H * H).sum(axis=2)).prod(axis=1)
    if not np.isfinite(rows).all() or (np.abs(np.linalg.det(H)) <= 1e-12 * rows).any():
        raise ConfigError(
            f"{type(op).__name__} drew a map of pixels that cannot be inverted; narrow its ranges"
        )
    return oriented(np.broadcast_to(H, (shape[0], 3, 3)), (shape[2], shape[3]))


def oriented(H_out_in: np.ndarray, image_hw: tuple[int, int]) -> np.ndarray:
    """The same maps (B, 3, 3) with w = 1 in the middle of the picture, and without rounding where
    there should be zeros."""
    height, width = image_hw
    w = H_out_in[:, 2] @ np.array([(width - 1) / 2, (height - 1) / 2, 1])
    if (np.abs(w) < 1e-12 * np.abs(H_out_in[:, 2]).max(axis=1)).any():
        raise ConfigError(
            "a kornia operation drew a map that sends the middle of the picture to infinity; narrow"
            " its ranges"
        )
    H = H_out_in / w[:, None, None]
    moved_px = (
        np.abs(H) * np.array([width, height, 1]) * np.array([[1.0], [1.0], [max(height, width)]])
    )
    H = np.where(moved_px < NOTHING_PX, 0.0, H)
    if not H[:, 2, :2].any():
        H[:, 2, 2] = 1.0  # w is the same everywhere, so it was 1 but for rounding
    return H


def mirrored(H_out_in: np.ndarray) -> bool:
    """Whether an oriented map (3, 3) mirrors."""
    return bool(np.linalg.det(H_out_in) < 0)


@dataclass(frozen=True)
class PixelOp:
    """A kornia operation on colours that gives the same pixels whenever it is run.

    What it draws, it draws from the seed.
    """

    op: Any
    seed: int

    def __call__(self, images: Tensor, params: Mapping[str, Any]) -> Tensor:
        """The changed images (1, C, H, W)."""
        with seeded(self.seed):
            drawn = (
                dict(params)
                if images.shape[1] == CHANNELS
                else self.op.forward_parameters(images.shape)
            )
            result: Tensor = self.op(images, params=drawn)
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
            not kornia's own is measured: its pixels must be where its matrix says (kornia_probe).
        mirrors: whether it may mirror; None finds out. An operation that mirrors all the same
            raises.
        probe_hw: sizes of the images that an operation of your own is measured on.

    Raises:
        ConfigError: the operation has no matrix, or is a container, a mixture, a policy or for
            volumes.

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

    def steps(self, rng: np.random.Generator, view: View) -> tuple[Step, ...]:
        """What kornia draws for a batch of this one picture."""
        seed = int(rng.integers(SEEDS))
        shape = (1, CHANNELS, *view.image_hw)
        with seeded(seed):
            params = self.op.forward_parameters(torch.Size(shape))
        if not gates(self.op, params).all():
            return ()
        if self.geometric:
            return self._moved(params, shape)
        if isinstance(self.op, kornia.RandomErasing):
            return _erased(params, view.image_hw)
        if isinstance(self.op, kornia.Normalize):
            return (_standardised(self.op.flags["mean"], self.op.flags["std"]),)
        return (KorniaPixels(PixelOp(self.op, seed), params),)

    def _moved(
        self, params: Mapping[str, Any], shape: tuple[int, int, int, int]
    ) -> tuple[Step, ...]:
        H = matrices(self.op, params, shape)[0]
        self.check_mirror(H)
        return (Warp(H, output_hw(self.op, params, (shape[2], shape[3]))),)

    def check_mirror(self, H_out_in: np.ndarray) -> None:
        """Raise a ConfigError if a drawn map mirrors although the operation was taken for one that
        does not."""
        if mirrored(H_out_in) and not self.mirrors:
            raise ConfigError(
                f"{self.op!r} mirrored the picture unexpectedly; if it may, say so:"
                " KorniaTransform(op, mirrors=True)"
            )


def measured_mirror(op: Any, probe_hw: tuple[tuple[int, int], ...] | None = None) -> bool:
    """Whether a kornia augmentation may mirror; what is not known of it is measured.

    Raises:
        ConfigError: its pixels do not follow its matrix, or it moves pixels without one (see
            kornia_probe).

    """
    from animal3dbox.transforms.kornia_bridge.probe import (
        PROBE_HW,
        check_blur,
        check_matrix,
    )  # it measures with this module's matrices

    if isinstance(op, BLURS):
        check_blur(op)
    may_mirror = isinstance(op, FLIPS) and op.p > 0 and op.p_batch > 0
    if is_geometric(op) and not type(op).__module__.startswith("kornia."):
        may_mirror |= check_matrix(op, PROBE_HW if probe_hw is None else probe_hw)
    return may_mirror


def _check_colours(op: Any) -> None:
    """Raise a ConfigError for operations on colours that a pipeline of pictures in [0, 1] cannot
    hold."""
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

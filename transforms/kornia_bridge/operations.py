"""kornia's operations: their kind, their coin, the size they make, and their matrices.

Tested with kornia 0.9, the first whose matrices agree with its pixels. Importing this module
imports kornia.
"""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import kornia.augmentation as kornia
import numpy as np
import torch
from kornia.augmentation.auto.base import PolicyAugmentBase
from kornia.augmentation.container.base import BasicSequentialBase
from torch import Tensor

from animal3dbox.errors import ConfigError

NOTHING_PX = 1e-9
"""An entry of a matrix that moves no pixel of the picture by more than this is rounding, and set to
0, so that an affine map stays affine."""

ONE_AT_A_TIME = threading.RLock()
"""Held while kornia draws: threads share torch's generator."""

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
    """A context in which torch's CPU generator, from which kornia draws, depends on the seed alone.

    It is left as it was afterwards.
    """
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
    """The pictures of a batch that kornia applies the operation to, (B,) bool.

    One entry for all if it gates whole batches.
    """
    coins: np.ndarray = np.atleast_1d(params["batch_prob"].cpu().numpy() > 0.5)
    return np.ones_like(coins) if op.p == 1 and op.p_batch == 1 else coins


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
    applied = gates(op, params)
    if applied.all() or size == image_hw:
        return size
    if applied.any():
        raise ConfigError(
            f"{type(op).__name__} would change the size of some pictures of the batch only; give"
            " it p=1"
        )
    return image_hw


def matrices(op: Any, params: Mapping[str, Any], shape: tuple[int, int, int, int]) -> np.ndarray:
    """The maps of pixels of a geometric operation, without touching a pixel.

    They come from kornia's own formula, but in float64.

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
    """Maps (B, 3, 3) with w = 1 in the middle of the picture, and with zeros instead of rounding.

    Args:
        H_out_in: (B, 3, 3) of any scale and sign.
        image_hw: height and width of the pictures that go in.
    """
    height, width = image_hw
    w = H_out_in[:, 2] @ np.array([(width - 1) / 2, (height - 1) / 2, 1])
    if (np.abs(w) < 1e-12 * np.abs(H_out_in[:, 2]).max(axis=1)).any():
        raise ConfigError(
            "a kornia operation drew a map that sends the middle of the picture to infinity; narrow"
            " its ranges"
        )
    H = H_out_in / w[:, None, None]
    shift_px = (
        np.abs(H) * np.array([width, height, 1]) * np.array([[1.0], [1.0], [max(height, width)]])
    )
    H = np.where(shift_px < NOTHING_PX, 0.0, H)
    if not H[:, 2, :2].any():
        H[:, 2, 2] = 1.0  # w is the same everywhere, so it was 1 but for rounding
    return H


def mirrored(H_out_in: np.ndarray) -> bool:
    """Whether an oriented map (3, 3) mirrors."""
    return bool(np.linalg.det(H_out_in) < 0)

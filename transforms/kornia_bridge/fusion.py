"""A batch's way through a kornia pipeline, with as few readings of the pixels as possible."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import kornia.augmentation as kornia
import numpy as np
import torch
from torch import Tensor

from animal3dbox.transforms.kornia_bridge.operations import gates, is_geometric, matrices, output_hw
from animal3dbox.transforms.rendering.torch_executor import warp

LINEAR = (
    kornia.Denormalize,
    kornia.Normalize,
    kornia.RandomChannelDropout,
    kornia.RandomChannelShuffle,
    kornia.RandomGrayscale,
    kornia.RandomInvert,
)
"""Affine maps of colours without clipping.

They commute with interpolation, but for the fill, which they then colour too.
"""
WIDE = (torch.int32, torch.int64)
"""Types of masks whose numbers float32 cannot hold."""


@dataclass(frozen=True)
class BatchWarp:
    """Maps of pixels, one a picture.

    Attributes:
        H_out_in: (B, 3, 3) float64, w > 0 on the part that stays in the picture.
        image_hw: height and width after.
    """

    H_out_in: np.ndarray
    image_hw: tuple[int, int]


@dataclass(frozen=True)
class BatchColours:
    """A kornia operation on colours, with the parameters that it drew for the batch."""

    op: Any
    params: dict[str, Any]


Stage = BatchWarp | BatchColours


def drawn_stages(
    pipeline: Any, params: Sequence[Any], shape: tuple[int, int, int, int]
) -> list[Stage]:
    """The operations that a kornia pipeline will apply, in its order.

    Args:
        pipeline: an AugmentationSequential.
        params: of its forward_parameters.
        shape: (B, C, H, W) of the pictures.

    """
    stages: list[Stage] = []
    image_hw = (shape[2], shape[3])
    for item in params:
        op = pipeline.get_submodule(item.name)
        geometric = is_geometric(op)  # raises for operations without a camera, drawn or not
        if not gates(op, item.data).any():
            continue
        if not geometric:
            stages.append(BatchColours(op, item.data))
            continue
        H = matrices(op, item.data, (shape[0], shape[1], *image_hw))
        after_hw = output_hw(op, item.data, image_hw)
        if after_hw != image_hw or (np.eye(3) != H).any():
            stages.append(BatchWarp(H, after_hw))
        image_hw = after_hw
    return stages


def fused(stages: Sequence[Stage], commutes: Callable[[Any], bool]) -> list[Stage]:
    """The same stages with maps of pixels multiplied together, as far as their order allows.

    Args:
        stages: in their order.
        commutes: whether a map of pixels may change places with this operation on colours.
    """
    result: list[Stage] = []
    for stage in stages:
        place = len(result)
        while isinstance(stage, BatchWarp) and place:
            before = result[place - 1]
            if isinstance(before, BatchWarp):
                result[place - 1] = BatchWarp(stage.H_out_in @ before.H_out_in, stage.image_hw)
                break
            place = place - 1 if commutes(before.op) else 0
        else:
            result.append(stage)
    return result


def whole_map(stages: Sequence[Stage], count: int, image_hw: tuple[int, int]) -> BatchWarp:
    """All maps of pixels of a batch together; the identity if there are none."""
    for stage in fused(stages, lambda op: True):
        if isinstance(stage, BatchWarp):
            return stage
    return BatchWarp(np.broadcast_to(np.eye(3), (count, 3, 3)), image_hw)


def run_images(
    images: Tensor, stages: Sequence[Stage], interpolation: str, fill: tuple[float, ...]
) -> Tensor:
    """The pictures (B, C, H', W') of a batch (B, C, H, W) after all stages."""
    for stage in fused(stages, lambda op: isinstance(op, LINEAR)):
        if isinstance(stage, BatchWarp):
            images = warp(
                images,
                stage.H_out_in,
                stage.image_hw,
                interpolation=interpolation,
                fill=fill,
            )
        else:
            images = stage.op(images, params=dict(stage.params))
    return images


def run_masks(masks: Tensor, stages: Sequence[Stage]) -> Tensor:
    """Masks (B, C, H', W') or (B, H', W') of a batch, read at the nearest pixel.

    They lose what an erasing hides.
    """
    layers = masks[:, None] if masks.ndim == 3 else masks
    layers = layers.to(
        torch.float64 if masks.dtype in WIDE else torch.promote_types(masks.dtype, torch.float32)
    )
    for stage in fused(stages, lambda op: not isinstance(op, kornia.RandomErasing)):
        if isinstance(stage, BatchWarp):
            layers = warp(
                layers, stage.H_out_in, stage.image_hw, interpolation="nearest", fill=(0.0,)
            )
        elif isinstance(stage.op, kornia.RandomErasing):
            layers = stage.op.transform_masks(
                layers, params=dict(stage.params), flags=stage.op.flags
            )
    return (layers[:, 0] if masks.ndim == 3 else layers).to(masks.dtype)

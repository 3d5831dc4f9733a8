"""Masks and depth maps under a map of pixels."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import SampleError
from animal3dbox.geometry.arrays import as_numpy, namespace
from animal3dbox.transforms.camera_law.boxes import boxes_of_masks
from animal3dbox.transforms.camera_law.fields import Fields
from animal3dbox.transforms.camera_law.law import map_fields
from animal3dbox.transforms.camera_law.maps import inverse_map
from animal3dbox.transforms.rendering.opencv_executor import warp

SAME_BOX_PX = 1.0
"""A 2D box within this of its mask's box was made from it."""


def mapped_with_pixels(
    fields: Fields,
    H_out_in: np.ndarray,
    image_hw_out: tuple[int, int],
    *,
    keypoint_mirror: np.ndarray | None,
    allow_skew: bool,
) -> Fields:
    """The law (law.map_fields, same arguments) with masks and depth.

    A 2D box that was its mask's box becomes the mapped mask's box; any other (amodal, or of a mask
    that was painted over) is mapped.
    """
    mapped = map_fields(
        fields, H_out_in, image_hw_out, keypoint_mirror=keypoint_mirror, allow_skew=allow_skew
    )
    mapped = mapped.updated(**warp_pixel_fields(fields, H_out_in, image_hw_out))
    if "masks" in mapped.values and "boxes" in mapped.values:
        before, boxes = fields.values["boxes"], mapped.values["boxes"]
        off = abs(boxes_of_masks(fields.values["masks"], before + SAME_BOX_PX + 1) - before)
        of_mask = (off <= SAME_BOX_PX).all(-1)[:, None]
        return mapped.updated(
            boxes=namespace(boxes).where(
                of_mask, boxes_of_masks(mapped.values["masks"], boxes), boxes
            )
        )
    return mapped


def warp_pixel_fields(
    before: Fields, H_out_in: np.ndarray, image_hw_out: tuple[int, int]
) -> dict[str, Any]:
    """The masks and the depth of the mapped image, read at the nearest pixel.

    Depth changes by the law depth' = w depth / k with k the norm of row 3 of H K: the optical axis
    turns.

    Args:
        before: the target before the map.
        H_out_in: (3, 3), w > 0 on the part that stays in the picture.
        image_hw_out: of the image after.

    Returns:
        masks (N, H', W') and depth (H', W'), those that there were; 0 where nothing is known.

    """
    layers_out: dict[str, Any] = {}
    if "masks" in before.values:
        masks = as_numpy(before.values["masks"])
        readable = masks.astype(np.uint8) if masks.dtype == bool else masks
        layers = [_nearest(mask, H_out_in, image_hw_out) for mask in readable]
        stacked = np.stack(layers) if layers else np.zeros((0, *image_hw_out))
        layers_out["masks"] = _as_came(
            stacked.astype(masks.dtype, copy=False), before.values["masks"]
        )
    if "depth" in before.values:
        if "K" not in before.values:
            raise SampleError(
                before.sample_id,
                "depth",
                "needs the intrinsics K (3, 3): a turn of the camera changes depth",
            )
        depth = _nearest(as_numpy(before.values["depth"]), H_out_in, image_hw_out)
        factor = depth_factor(H_out_in, as_numpy(before.values["K"]), image_hw_out)
        layers_out["depth"] = _as_came(depth * factor.astype(depth.dtype), before.values["depth"])
    return layers_out


def _nearest(layer: np.ndarray, H_out_in: np.ndarray, image_hw: tuple[int, int]) -> np.ndarray:
    """A layer (H, W) of numbers read at the nearest pixel, 0 where there is nothing to read."""
    return warp(layer[..., None], H_out_in, image_hw, interpolation="nearest", fill=(0.0,))[..., 0]


def _as_came(array: np.ndarray, before: Tensor | np.ndarray) -> Tensor | np.ndarray:
    return torch.from_numpy(array).to(before.device) if isinstance(before, Tensor) else array


def depth_factor(H_out_in: np.ndarray, K: np.ndarray, image_hw: tuple[int, int]) -> np.ndarray:
    """The factor w / k of depth at every pixel of the mapped image, (H', W').

    (1, 1) for an affine map, which has one factor for all pixels. k is the norm of row 3 of H K.
    """
    k = np.linalg.norm(H_out_in[2] @ K)
    a, b, c = inverse_map(H_out_in)[2]
    if a == 0 and b == 0:
        return np.full((1, 1), 1 / (c * k))
    height, width = image_hw
    inverse_w = a * np.arange(width)[None] + b * np.arange(height)[:, None] + c
    factor: np.ndarray = np.where(inverse_w > 0, 1 / (np.where(inverse_w > 0, inverse_w, 1) * k), 0)
    return factor

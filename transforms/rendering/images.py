"""The forms of images: as they come in, and as the executors take them.

Tensors or arrays, CHW or HWC, uint8 or float.
"""

from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.transforms.rendering.scratch import SCRATCH
from animal3dbox.transforms.steps import Standardise

Image = Tensor | np.ndarray
AnyImage = TypeVar("AnyImage", Tensor, np.ndarray)
CHANNELS = (1, 3, 4)
LEVELS = np.arange(256, dtype=np.float32)
"""The grey levels of uint8, as numbers to calculate with."""
DTYPES = (
    torch.uint8,
    torch.float32,
    torch.float64,
    np.dtype(np.uint8),
    np.dtype(np.float32),
    np.dtype(np.float64),
)


@dataclass(frozen=True)
class ImageForm:
    """How an image came, so that the result can leave the same way.

    Attributes:
        tensor: a torch tensor, not an array.
        layout: "chw", "hwc" or "hw".
        dtype: of the array that came.
        image_hw: height and width.
        channels: 1, 3 or 4.
        channels_last: whether a (C, H, W) tensor leaves with the colours of a pixel side by side in
            memory; else colour after colour.
    """

    tensor: bool
    layout: str
    dtype: torch.dtype | np.dtype[np.generic]
    image_hw: tuple[int, int]
    channels: int
    channels_last: bool = False

    @property
    def is_permuted(self) -> bool:
        """Whether the result is a view of (H, W, C) as (C, H, W)."""
        return self.channels_last and self.tensor and self.layout == "chw"

    @property
    def is_uint8(self) -> bool:
        """Whether grey levels run from 0 to 255; floats run from 0 to 1."""
        return self.dtype in (torch.uint8, np.dtype(np.uint8))


def image_form(image: Image) -> ImageForm:
    """The form of an image, by its type and shape.

    Args:
        image: tensor, (C, H, W) unless only the last size is 1, 3 or 4; or array, (H, W, C) unless
            only the first is; or (H, W).

    Raises:
        ShapeError: the shape or the dtype is none that is supported.

    Example:
        >>> form = image_form(np.zeros((60, 80, 3), np.uint8))
        >>> form.layout, form.image_hw, form.channels
        ('hwc', (60, 80), 3)
    """
    if not isinstance(image, Tensor | np.ndarray):
        raise ShapeError(
            f"image must be a torch tensor or a numpy array, got {type(image).__name__}"
        )
    shape = tuple(image.shape)
    tensor = isinstance(image, Tensor)
    layout = _layout(shape, tensor=tensor)
    height, width = shape[-2:] if layout != "hwc" else shape[:2]
    if height == 0 or width == 0:
        raise ShapeError(f"image must not be empty, got shape {shape}")
    dtype: torch.dtype | np.dtype[np.generic] = image.dtype
    if dtype not in DTYPES:
        raise ShapeError(
            f"image must be uint8 (0 to 255), float32 or float64 (0 to 1), got {dtype}; convert it"
            " first"
        )
    channels = {"hw": 1, "chw": shape[0], "hwc": shape[-1]}[layout]
    return ImageForm(tensor, layout, dtype, (int(height), int(width)), channels)


def _layout(shape: tuple[int, ...], *, tensor: bool) -> str:
    """The order of an image's dimensions: "hw", "chw" or "hwc", of its shape and its library."""
    first, last = (len(shape) == 3 and shape[side] in CHANNELS for side in (0, -1))
    if len(shape) == 2:
        return "hw"
    if first and (tensor or not last):
        return "chw"
    if last:
        return "hwc"
    raise ShapeError(
        f"image must have shape (C, H, W), (H, W, C) or (H, W) with C = 1, 3 or 4, got {shape}"
    )


def image_to_hwc(image: Image, form: ImageForm) -> np.ndarray:
    """The image as (H, W, C) for OpenCV; shares memory with the image where it can.

    Args:
        image: of any supported kind.
        form: of the image.

    """
    array = image.detach().numpy() if isinstance(image, Tensor) else image
    if array.dtype == np.float64:  # OpenCV reads these at 1/32 px
        array = array.astype(np.float32)
    if form.layout == "chw":
        channels_last = array.transpose(1, 2, 0)
        if channels_last.flags.c_contiguous:
            return channels_last
        array = cv2.merge([np.ascontiguousarray(plane) for plane in array])
    return array[..., None] if array.ndim == 2 else array


def image_from_hwc(
    array: np.ndarray, form: ImageForm, standardise: Standardise | None = None
) -> Any:
    """The result in the form in which the image came.

    Args:
        array: (H, W, C), or with a fourth channel to spare behind the form's three.
        form: of the image.
        standardise: the standardisation of the colours, if any; the result is float32 then.
    """
    is_planar = form.layout == "chw" and not form.is_permuted
    if standardise is not None:
        planes = SCRATCH.array("planes", (array.shape[2], *array.shape[:2]), array.dtype)
        planes = _standardised(_split(array, planes)[: form.channels], standardise)
        array = planes if is_planar else cv2.merge(list(planes))
    elif is_planar:
        array = _split(array, np.empty((form.channels, *array.shape[:2]), array.dtype))
    elif array.shape[2] > form.channels:
        array = cv2.cvtColor(array, cv2.COLOR_RGBA2RGB)
    if form.layout == "hw":
        array = array.reshape(array.shape[:2])
    elif not is_planar:
        array = array.reshape(*array.shape[:2], form.channels)
    if array.dtype == np.float32 and form.dtype in (torch.float64, np.dtype(np.float64)):
        array = array.astype(np.float64)
    array = np.ascontiguousarray(array)
    if form.is_permuted:
        return torch.from_numpy(array).permute(2, 0, 1)
    return torch.from_numpy(array) if form.tensor else array


def _split(array: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """The channels of a picture (H, W, C), one after the other in given memory (C, H, W).

    Or its first C of four, if the memory has no room for them all.
    """
    # Split where they shall lie: a fifth of the time of splitting and stacking
    # (benchmarks/augment.py, all pipelines).
    parts = list(planes)
    if len(parts) < array.shape[2]:
        parts.append(SCRATCH.array("spare channel", array.shape[:2], array.dtype))
    cv2.split(array, parts)
    return planes


def _standardised(planes: np.ndarray, standardise: Standardise) -> np.ndarray:
    """Colours (x - mean) / std in float32, of planes (C, H, W) of grey levels or of [0, 1]."""
    unit = 255.0 if planes.dtype == np.uint8 else 1.0
    standardised = np.empty(planes.shape, dtype=np.float32)
    for plane, mean, std, out in zip(
        planes, standardise.mean, standardise.std, standardised, strict=True
    ):
        factor, offset = np.float32(1 / (unit * std)), np.float32(mean / std)
        if planes.dtype == np.uint8:
            # The 256 levels are standardised and the pixels looked up: the same numbers in less
            # time (benchmarks/augment.py, with normalise).
            cv2.LUT(plane, LEVELS * factor - offset, dst=out)
        else:
            np.multiply(plane, factor, out=out)
            out -= offset
    return standardised


def owned(result: Any, image: Image) -> Any:
    """The result, copied if it is still the caller's memory.

    Writing to it must not change the image that came.
    """
    if isinstance(result, Tensor) and isinstance(image, Tensor):
        return (
            result.clone()
            if result.untyped_storage().data_ptr() == image.untyped_storage().data_ptr()
            else result
        )
    if isinstance(result, np.ndarray) and isinstance(image, np.ndarray):
        return result.copy() if np.may_share_memory(result, image) else result
    return result


def image_to_bchw(image: Image, form: ImageForm) -> Tensor:
    """The image as a floating-point batch of one, (1, C, H, W), in its own grey levels.

    Differentiable.
    """
    tensor = image if isinstance(image, Tensor) else torch.from_numpy(np.ascontiguousarray(image))
    if form.layout == "hwc":
        tensor = tensor.permute(2, 0, 1)
    elif form.layout == "hw":
        tensor = tensor[None]
    return (tensor if tensor.is_floating_point() else tensor.float())[None]


def image_from_bchw(batch: Tensor, form: ImageForm, *, normalised: bool) -> Any:
    """The (1, C, H, W) result in the form in which the image came.

    Uint8 is rounded, unless a Normalize has made it float.
    """
    tensor = batch[0]
    if form.is_uint8 and not normalised:
        tensor = tensor.round().clamp(0, 255).to(torch.uint8)
    if form.layout == "hwc":
        tensor = tensor.permute(1, 2, 0).contiguous()
    elif form.layout == "hw":
        tensor = tensor[0]
    elif form.is_permuted:
        tensor = tensor[None].contiguous(memory_format=torch.channels_last)[0]
    return tensor if form.tensor else tensor.detach().cpu().numpy()

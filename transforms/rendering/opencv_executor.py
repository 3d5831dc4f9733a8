"""The executor of DataLoader workers: OpenCV on (H, W, C) arrays, uint8 as long as the image is."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import torch

from animal3dbox.errors import ShapeError
from animal3dbox.transforms.rendering.images import Image, ImageForm, image_from_hwc, image_to_hwc
from animal3dbox.transforms.rendering.sampling import (
    Reading,
    check_erase,
    gaussian_kernel,
    plan_reading,
)
from animal3dbox.transforms.rendering.scratch import SCRATCH
from animal3dbox.transforms.steps import Blur, Erase, KorniaPixels, Local, Noise, Pass

FLAGS = {"nearest": cv2.INTER_NEAREST, "bilinear": cv2.INTER_LINEAR, "bicubic": cv2.INTER_CUBIC}


def run_stages(
    image: Image,
    form: ImageForm,
    stages: Sequence[Pass | Local],
    *,
    interpolation: str,
    fill: tuple[float, ...],
) -> Any:
    """The image after all stages of a plan.

    Args:
        image: of any supported kind.
        form: of the image.
        stages: of a plan.
        interpolation: see sampling.INTERPOLATIONS.
        fill: grey levels 0 to 255, one or one a channel.

    Returns:
        The image in the form in which it came; float after a standardisation.

    """
    array = image_to_hwc(image, form)
    last = stages[-1] if stages else None  # a standardisation is always the last thing done
    for stage in stages:
        array = run_stage(
            array, stage, interpolation=interpolation, fill=fill, spare_channel=stage is last
        )
    standardise = last.standardise if isinstance(last, Pass) else None
    if standardise is not None and len(standardise.mean) != form.channels:
        raise ShapeError(
            f"Normalize has {len(standardise.mean)} channels, the image {form.channels}"
        )
    return image_from_hwc(array, form, standardise)


def run_stage(
    image: np.ndarray,
    stage: Pass | Local,
    *,
    interpolation: str,
    fill: tuple[float, ...],
    spare_channel: bool = False,
) -> np.ndarray:
    """The image after one stage of a plan, but for its standardisation.

    Args:
        image: (H, W, C) uint8, or float in [0, 1].
        stage: of a plan.
        interpolation: see sampling.INTERPOLATIONS.
        fill: grey levels 0 to 255, one or one a channel.
        spare_channel: whether the result may have one, see warp.
    """
    if isinstance(stage, Pass):
        if stage.H_out_in is not None:
            unit = 1.0 if image.dtype == np.uint8 else 1 / 255
            image = warp(
                image,
                stage.H_out_in,
                stage.image_hw,
                interpolation=interpolation,
                fill=tuple(level * unit for level in fill),
                spare_channel=spare_channel and stage.colour is None,
            )
        return image if stage.colour is None else recolour(image, stage.colour)
    if isinstance(stage, Blur):
        kernel = gaussian_kernel(stage.sigma_px, (image.shape[0], image.shape[1]))
        return _with_channels(
            cv2.sepFilter2D(image, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT_101)
        )
    if isinstance(stage, Noise):
        noise = np.random.default_rng(stage.seed).standard_normal(image.shape, dtype=np.float32)
        return _in_levels(_levels(image) + noise * np.float32(255 * stage.sigma), image)
    if isinstance(stage, Erase):
        return erased(image, stage)
    return _kornia(image, stage)


def warp(
    image: np.ndarray,
    H_out_in: np.ndarray,
    image_hw: tuple[int, int],
    *,
    interpolation: str,
    fill: tuple[float, ...],
    spare_channel: bool = False,
) -> np.ndarray:
    """The mapped image (H', W', C).

    Args:
        image: (H, W, C).
        H_out_in: (3, 3), w > 0 on the part that stays in the picture.
        image_hw: height and width after.
        interpolation: see sampling.INTERPOLATIONS.
        fill: in the image's own grey levels, where there is nothing to read.
        spare_channel: whether the result of three channels may be left as it is read: with a fourth
            that means nothing, in scratch memory.
    """
    # Flips and shifts by whole pixels copy them, so that they are lossless whatever interpolates.
    if H_out_in[2, 2] > 0 and (H_out_in[2, :2] == 0).all():
        copy = _whole_pixels(image, H_out_in / H_out_in[2, 2], image_hw, fill)
        if copy is not None:
            return copy
    reading = plan_reading(H_out_in, (image.shape[0], image.shape[1]), image_hw, interpolation)
    source = _shrunken(image, reading.shrink_xy, fill)
    border = _four(fill)
    if source.shape[2:] != (3,):
        return _blank_beyond(
            _with_channels(_warped(source, reading, interpolation, border)), reading, border
        )
    rgba = _blank_beyond(_warped_rgba(source, reading, interpolation, border), reading, border)
    return rgba if spare_channel else cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB)


def _warped(
    source: np.ndarray,
    reading: Reading,
    interpolation: str,
    border: tuple[float, ...],
    *,
    result: np.ndarray | None = None,
) -> np.ndarray:
    """A picture of one or four channels as it is read, into a given result or a new one."""
    options: dict[str, Any] = {
        "dsize": (reading.image_hw[1], reading.image_hw[0]),
        "dst": result,
        "flags": FLAGS[interpolation] | cv2.WARP_INVERSE_MAP,
        "borderMode": cv2.BORDER_CONSTANT,
        "borderValue": border,
    }
    if reading.affine:
        matrix = reading.H_in_out[:2] / reading.H_in_out[2, 2]
        return cv2.warpAffine(source, matrix, **options)
    return cv2.warpPerspective(source, reading.H_in_out, **options)


def _warped_rgba(
    source: np.ndarray, reading: Reading, interpolation: str, border: tuple[float, ...]
) -> np.ndarray:
    """A picture (H, W, 3) as it is read, with a fourth channel, in scratch memory.

    OpenCV reads four channels in less than half the time that it takes for three. Only the part
    that the result shows is copied to four channels, which also brings it into the processor's
    cache (benchmarks/augment.py, flip + affine + crop).
    """
    height, width = source.shape[:2]
    rgba = SCRATCH.array("source", (height, width, 4), source.dtype)
    part = reading.part_read((height, width))
    cv2.cvtColor(source[part], cv2.COLOR_RGB2RGBA, dst=rgba[part])
    result = SCRATCH.array("result", (*reading.image_hw, 4), source.dtype)
    return _warped(rgba, reading, interpolation, border, result=result)


def _blank_beyond(image: np.ndarray, reading: Reading, border: tuple[float, ...]) -> np.ndarray:
    """The image with the border's grey level beyond the map's horizon, where OpenCV reads on."""
    if reading.horizon:
        image[reading.beyond()] = border[: image.shape[2]]
    return image


def _whole_pixels(
    image: np.ndarray, H: np.ndarray, image_hw: tuple[int, int], fill: tuple[float, ...]
) -> np.ndarray | None:
    """The mapped image if the map only flips and shifts by whole pixels; None otherwise."""
    if H[0, 1] or H[1, 0] or abs(H[0, 0]) != 1 or abs(H[1, 1]) != 1 or H[0, 2] % 1 or H[1, 2] % 1:
        return None
    source = image[:: int(H[1, 1]), :: int(H[0, 0])]
    # After a flip the picture's first pixel is the one that was last.
    left = int(H[0, 2]) - (image.shape[1] - 1 if H[0, 0] < 0 else 0)
    top = int(H[1, 2]) - (image.shape[0] - 1 if H[1, 1] < 0 else 0)
    rows, columns = (
        _overlap(top, image.shape[0], image_hw[0]),
        _overlap(left, image.shape[1], image_hw[1]),
    )
    part = source[rows[0] - top : rows[1] - top, columns[0] - left : columns[1] - left]
    if part.shape[:2] == tuple(image_hw):
        return np.ascontiguousarray(part)
    result = np.empty((*image_hw, image.shape[2]), dtype=image.dtype)
    result[:] = np.array(_four(fill)[: image.shape[2]]).astype(image.dtype)
    result[rows[0] : rows[1], columns[0] : columns[1]] = part
    return result


def _overlap(start: int, length: int, room: int) -> tuple[int, int]:
    """Where [start, start + length) lies in [0, room)."""
    low = min(max(start, 0), room)
    return low, max(low, min(start + length, room))


def _shrunken(image: np.ndarray, shrink_xy: tuple[int, int], fill: tuple[float, ...]) -> np.ndarray:
    """The averages of whole blocks of pixels, the last ones filled up."""
    across, down = shrink_xy
    if (across, down) == (1, 1):
        return image
    height, width = image.shape[:2]
    more_down, more_across = -height % down, -width % across
    if more_down or more_across:
        image = cv2.copyMakeBorder(
            image, 0, more_down, 0, more_across, cv2.BORDER_CONSTANT, value=_four(fill)
        )
    size = ((width + more_across) // across, (height + more_down) // down)
    return _with_channels(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def recolour(image: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Colours under a (3, 4) map, clipped."""
    if image.shape[2] != 3:
        raise ShapeError(
            f"image must have 3 channels (RGB) for colour transforms, got {image.shape[2]}"
        )
    if image.dtype == np.uint8:
        return cv2.transform(image, matrix * np.array([1, 1, 1, 255.0]))
    return np.clip(cv2.transform(image, matrix), 0, 1)


def erased(image: np.ndarray, step: Erase) -> np.ndarray:
    """The image with rectangles painted over."""
    check_erase(step, image.shape[2])
    result = image.copy()
    unit = 255 if image.dtype == np.uint8 else 1
    rng = np.random.default_rng(step.seed)
    for x_least, y_least, x_past, y_past in step.boxes:
        shape = (y_past - y_least, x_past - x_least, image.shape[2])
        colours = (
            rng.random(shape, dtype=np.float32)
            if step.value is None
            else np.broadcast_to(np.array(step.value), shape)
        )
        result[y_least:y_past, x_least:x_past] = (
            np.round(colours * unit) if unit == 255 else colours
        )
    return result


def _kornia(image: np.ndarray, step: KorniaPixels) -> np.ndarray:
    """The image after one of kornia's operations on colours."""
    batch = torch.from_numpy(np.ascontiguousarray(_levels(image).transpose(2, 0, 1)))[None] / 255
    changed = step.op(batch, params=step.params)[0].permute(1, 2, 0).numpy()
    return _in_levels(changed * 255, image)


def _levels(image: np.ndarray) -> np.ndarray:
    """The image as float32 grey levels 0 to 255."""
    levels: np.ndarray = image.astype(np.float32) * np.float32(
        1 if image.dtype == np.uint8 else 255
    )
    return levels


def _in_levels(levels: np.ndarray, like: np.ndarray) -> np.ndarray:
    """Grey levels 0 to 255, clipped, as an image like another."""
    if like.dtype == np.uint8:
        rounded: np.ndarray = np.clip(np.round(levels), 0, 255).astype(np.uint8)
        return rounded
    clipped: np.ndarray = np.clip(levels / 255, 0, 1).astype(like.dtype)
    return clipped


def _with_channels(image: np.ndarray) -> np.ndarray:
    return image[..., None] if image.ndim == 2 else image


def _four(fill: tuple[float, ...]) -> tuple[float, ...]:
    """A border value for OpenCV, which always wants four numbers."""
    return (fill * 4)[:4] if len(fill) == 1 else (*fill, 0.0)[:4]

"""The executor of batches on a device: torch on (B, C, H, W) floats, with their gradients."""

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.transforms.rendering.sampling import (
    Reading,
    check_erase,
    gaussian_kernel,
    plan_reading,
)
from animal3dbox.transforms.steps import Blur, KorniaPixels, Local, Noise, Pass, Standardise


def run_stage(
    images: Tensor,
    stages: list[Pass | Local],
    interpolation: str,
    fill: tuple[float, ...],
    *,
    uint8: bool,
) -> Tensor:
    """The images of a batch after one stage of their plans.

    Args:
        images: (B, C, H, W) float: grey levels 0 to 255 if uint8, else colours in [0, 1].
        stages: one an image, of one kind; passes agree on the size after, and on what they do to
            colours or not.
        interpolation: see sampling.INTERPOLATIONS.
        fill: grey levels 0 to 255, one or one a channel.
        uint8: whether the images came as uint8; results are then rounded where the other executor
            rounds.

    Returns:
        (B, C, H', W').

    """
    unit = 255.0 if uint8 else 1.0
    first = stages[0]
    if not isinstance(first, Pass):
        results = [
            _local(image[None], stage, unit)
            for image, stage in zip(images, stages, strict=True)
            if not isinstance(stage, Pass)
        ]
        return torch.cat(results)
    passes = [stage for stage in stages if isinstance(stage, Pass)]
    maps = [stage.H_out_in for stage in passes]
    if any(H is not None for H in maps):
        H = np.stack([np.eye(3) if H is None else H for H in maps])
        images = warp(
            images,
            H,
            first.image_hw,
            interpolation=interpolation,
            fill=tuple(level * unit / 255 for level in fill),
            rounded=uint8,
        )
    if any(stage.colour is not None for stage in passes):
        images = _recoloured(images, passes, unit)
        images = images.round() if uint8 else images
    if first.standardise is not None:
        steps = [stage.standardise for stage in passes if stage.standardise is not None]
        images = torch.cat(
            [
                _standardised(image[None] / unit, step)
                for image, step in zip(images, steps, strict=True)
            ]
        )
    return images


def warp(
    images: Tensor,
    H_out_in: np.ndarray,
    image_hw: tuple[int, int],
    *,
    interpolation: str,
    fill: tuple[float, ...],
    rounded: bool = False,
) -> Tensor:
    """The images after one map of pixels each.

    Args:
        images: (B, C, H, W) float.
        H_out_in: (B, 3, 3) float64, w > 0 on the part that stays in the picture.
        image_hw: height and width after.
        interpolation: see sampling.INTERPOLATIONS.
        fill: in the images' own grey levels, where there is nothing to read.
        rounded: round to whole grey levels, as the other executor does for uint8.

    Returns:
        (B, C, H', W').

    """
    readings = [
        plan_reading(H, (images.shape[-2], images.shape[-1]), image_hw, interpolation)
        for H in H_out_in
    ]
    shrinks = sorted({reading.shrink_xy for reading in readings})
    if len(shrinks) == 1:
        return _read(images, readings, interpolation, fill, rounded=rounded)
    result = images.new_empty((*images.shape[:2], *image_hw))
    for shrink in shrinks:
        rows = [row for row, reading in enumerate(readings) if reading.shrink_xy == shrink]
        warped = _read(
            images[rows], [readings[row] for row in rows], interpolation, fill, rounded=rounded
        )
        result = result.index_copy(0, torch.tensor(rows, device=images.device), warped)
    return result


def _read(
    images: Tensor,
    readings: list[Reading],
    interpolation: str,
    fill: tuple[float, ...],
    *,
    rounded: bool,
) -> Tensor:
    """Read pictures that are all shrunken alike."""
    channels = images.shape[1]
    background = images.new_tensor(
        (*fill, *[0.0] * channels)[:channels] if len(fill) > 1 else fill * channels
    )[:, None, None]
    # A constant border is a border of zeros round the picture less the constant.
    filled = any(fill)
    source = images - background if filled else images
    across, down = readings[0].shrink_xy
    if (across, down) != (1, 1):
        padded = torch.nn.functional.pad(
            source, (0, -images.shape[-1] % across, 0, -images.shape[-2] % down)
        )
        source = torch.nn.functional.avg_pool2d(padded, (down, across))
        if rounded:  # OpenCV rounds blocks of 2 x 2 half up, others half to even
            levels = source + background
            source = (
                (levels + 0.5).floor() if (across, down) == (2, 2) else levels.round()
            ) - background
    grid = sampling_grid(
        np.stack([reading.H_in_out for reading in readings]), readings[0].image_hw, source
    )
    warped = torch.nn.functional.grid_sample(
        source, grid, mode=interpolation, padding_mode="zeros", align_corners=False
    )
    if any(reading.horizon for reading in readings):
        beyond = torch.from_numpy(np.stack([reading.beyond() for reading in readings])).to(
            images.device
        )
        warped = torch.where(beyond[:, None], torch.zeros_like(warped), warped)
    warped = warped + background if filled else warped
    return warped.round().clamp(0, 255) if rounded else warped


def sampling_grid(H_in_out: np.ndarray, image_hw: tuple[int, int], source: Tensor) -> Tensor:
    """Where to read, for grid_sample with align_corners=False: pixel x is (2 x + 1) / W - 1.

    The matrices are put into those units in float64, so that float32 grids stay true to 1e-3 px.

    Args:
        H_in_out: (B, 3, 3).
        image_hw: height and width of the result.
        source: (B, C, H, W) what will be read; gives the units, the dtype and the device.

    Returns:
        (B, H', W', 2).

    """
    height, width = source.shape[-2:]
    units = np.array([[2 / width, 0, 1 / width - 1], [0, 2 / height, 1 / height - 1], [0, 0, 1.0]])
    affine = bool((H_in_out[:, 2, :2] == 0).all())
    matrices = torch.from_numpy(
        units @ (H_in_out / H_in_out[:, 2:, 2:] if affine else H_in_out)
    ).to(source)
    x = torch.arange(image_hw[1], dtype=source.dtype, device=source.device)
    y = torch.arange(image_hw[0], dtype=source.dtype, device=source.device)
    across = [matrices[:, row, 0, None] * x for row in (0, 1)]
    down = [matrices[:, row, 1, None] * y + matrices[:, row, 2, None] for row in (0, 1)]
    if affine:
        grid = source.new_empty((len(matrices), *image_hw, 2))
        for axis in (0, 1):
            torch.add(across[axis][:, None], down[axis][:, :, None], out=grid[..., axis])
        return grid
    lines = [across[axis][:, None] + down[axis][:, :, None] for axis in (0, 1)]
    w = (
        matrices[:, 2, 0, None, None] * x
        + (matrices[:, 2, 1, None] * y + matrices[:, 2, 2, None])[:, :, None]
    )
    safe = torch.where(w.abs() < 1e-12, torch.full_like(w, 1e-12), w)
    return torch.stack(lines, dim=-1) / safe[..., None]


def _recoloured(images: Tensor, passes: list[Pass], unit: float) -> Tensor:
    """Colours under each image's (3, 4) map, clipped."""
    if images.shape[1] != 3:
        raise ShapeError(
            f"image must have 3 channels (RGB) for colour transforms, got {images.shape[1]}"
        )
    same = np.eye(3, 4)
    matrices = images.new_tensor(
        np.stack([same if stage.colour is None else stage.colour for stage in passes])
    )
    mixed = (
        torch.einsum("bij,bjhw->bihw", matrices[:, :, :3], images)
        + unit * matrices[:, :, 3, None, None]
    )
    return mixed.clamp(0, unit)


def _standardised(image: Tensor, step: Standardise) -> Tensor:
    """(x - mean) / std of an image (1, C, H, W) in [0, 1]."""
    if len(step.mean) != image.shape[1]:
        raise ShapeError(f"Normalize has {len(step.mean)} channels, the image {image.shape[1]}")
    mean, std = (image.new_tensor(x)[:, None, None] for x in (step.mean, step.std))
    return (image - mean) / std


def _local(image: Tensor, step: Local, unit: float) -> Tensor:
    """Blur, noise, erasing or kornia's pixels on one image (1, C, H, W)."""
    height, width = image.shape[-2:]
    if isinstance(step, KorniaPixels):
        return _clipped(step.op(image / unit, params=step.params) * unit, unit)
    if isinstance(step, Blur):
        kernel = torch.from_numpy(gaussian_kernel(step.sigma_px, (height, width))).to(image)
        reach, channels = len(kernel) // 2, image.shape[1]
        padded = torch.nn.functional.pad(image, (reach, reach, reach, reach), mode="reflect")
        rows = torch.nn.functional.conv2d(
            padded, kernel.reshape(1, 1, 1, -1).expand(channels, 1, 1, -1), groups=channels
        )
        blurred = torch.nn.functional.conv2d(
            rows, kernel.reshape(1, 1, -1, 1).expand(channels, 1, -1, 1), groups=channels
        )
        return _clipped(blurred, unit) if unit == 255 else blurred
    rng = np.random.default_rng(step.seed)
    if isinstance(step, Noise):
        noise = rng.standard_normal((height, width, image.shape[1]), dtype=np.float32)
        return _clipped(
            image + torch.from_numpy(noise).permute(2, 0, 1).to(image) * (step.sigma * unit), unit
        )
    check_erase(step, image.shape[1])
    result = image.clone()
    for x_least, y_least, x_past, y_past in step.boxes:
        shape = (y_past - y_least, x_past - x_least, image.shape[1])
        colours = (
            rng.random(shape, dtype=np.float32)
            if step.value is None
            else np.broadcast_to(np.array(step.value), shape)
        )
        result[..., y_least:y_past, x_least:x_past] = (
            torch.from_numpy(np.ascontiguousarray(colours)).permute(2, 0, 1).to(image) * unit
        )
    return _clipped(result, unit) if unit == 255 else result


def _clipped(image: Tensor, unit: float) -> Tensor:
    """The image held in [0, unit], and rounded where grey levels are whole."""
    return image.clamp(0, unit).round() if unit == 255 else image.clamp(0, unit)

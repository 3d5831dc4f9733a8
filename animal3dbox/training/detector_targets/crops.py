"""Pictures of single animals, cut out and resized, with the cameras that would have taken them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.checks import check_image_hw
from animal3dbox.geometry.homography import apply_homography, update_camera

MOST_SAMPLES = 8
"""A pixel of a crop is the mean of at most so many samples along each side."""


@dataclass(frozen=True, kw_only=True)
class BoxCrops:
    """The crops of N animals; each has its own K, and keeps the camera frame of its image.

    A crop that only cuts and resizes leaves centre, rotation and size in the camera frame as they
    are: what is projected by `K` lies where the animal is in the crop.

    Attributes:
        pixels: (N, C, h, w) in the images' type and range; 0 beyond the image.
        K: (N, 3, 3) intrinsics of the crops.
        boxes: (N, 4) xyxy px of the crops.
        H_out_in: (N, 3, 3) the map of pixels from image to crop.
        image: (N,) which image of the batch.
        animal: (N,) which animal of its target.

    Example:
        >>> target = {"boxes": torch.tensor([[2.0, 2, 6, 6]]), "K": torch.eye(3)}
        >>> crop_boxes([torch.zeros(3, 9, 9)], [target], (8, 8)).pixels.shape
        torch.Size([1, 3, 8, 8])
    """

    pixels: Tensor
    K: Tensor
    boxes: Tensor
    H_out_in: Tensor
    image: Tensor
    animal: Tensor


def crop_boxes(
    images: Sequence[Tensor] | Tensor,
    targets: Sequence[Mapping[str, Any]],
    size: tuple[int, int],
    *,
    margin: float = 0.1,
) -> BoxCrops:
    """Cut the animals of a batch out of their pictures, each as large as fits.

    The shape of an animal is kept: one scale for both sides. Where pixels shrink, several samples
    are averaged, so that nothing aliases; differentiable in the images.

    Args:
        images: (B, C, H, W), or B images (C, H, W) of any sizes; uint8 or floating point.
        targets: with `boxes` (N, 4) xyxy px and `K` (3, 3), one an image.
        size: height and width of the crops.
        margin: empty part on each side of the box, as a part of the box.

    Returns:
        The crops of all animals, those of the first image first.

    Raises:
        SampleError: a target has no boxes or K, or a box has no area.
        ConfigError: there are not as many images as targets, or an option cannot be.

    Example:
        >>> target = {
        ...     "boxes": torch.tensor([[9.5, 9.5, 29.5, 19.5]]),  # 20 by 10 px
        ...     "K": torch.tensor([[50.0, 0, 19.5], [0, 50, 19.5], [0, 0, 1]]),
        ... }
        >>> crops = crop_boxes(torch.zeros(1, 3, 40, 40), [target], (40, 40), margin=0.0)
        >>> crops.K[0].tolist(), crops.boxes.tolist()
        ([[100.0, 0.0, 19.5], [0.0, 100.0, 29.5], [0.0, 0.0, 1.0]], [[-0.5, 9.5, 39.5, 29.5]])
    """
    check_image_hw("size", size)
    if not margin >= 0:
        raise ConfigError(f"margin must not be negative, got {margin}")
    if len(images) != len(targets):
        raise ConfigError(f"{len(images)} images for {len(targets)} targets")
    parts = [
        _crops_of(image, target, number, size=size, margin=margin)
        for number, (image, target) in enumerate(zip(images, targets, strict=True))
    ]
    if not parts:
        raise ConfigError("there is no image to cut crops out of")
    return BoxCrops(
        **{
            name: torch.cat([getattr(part, name) for part in parts])
            for name in BoxCrops.__dataclass_fields__
        }
    )


def _crops_of(
    image: Tensor,
    target: Mapping[str, Any],
    number: int,
    *,
    size: tuple[int, int],
    margin: float,
) -> BoxCrops:
    """The crops of one image's boxes, one a box, with the intrinsics that belong to each."""
    name = str(target.get("image_id", f"image {number} of the batch"))
    for field in ("boxes", "K"):
        if field not in target:
            raise SampleError(name, field, "is missing, and crops need it")
    boxes = target["boxes"].reshape(-1, 4)
    for animal in (~(boxes[:, 2:] > boxes[:, :2]).all(1)).nonzero().flatten().tolist():
        raise SampleError(
            f"{name}#{animal}", "boxes", f"has no area to cut out: {boxes[animal].tolist()}"
        )
    H = crop_maps(boxes, size, margin)
    corners = apply_homography(H, boxes.reshape(-1, 2, 2))
    device = boxes.device
    return BoxCrops(
        pixels=_sampled(image, H, size),
        K=update_camera(H, target["K"].to(H)).K,
        boxes=corners.reshape(-1, 4),
        H_out_in=H,
        image=torch.full((len(boxes),), number, device=device),
        animal=torch.arange(len(boxes), device=device),
    )


def crop_maps(boxes: Tensor, size: tuple[int, int], margin: float) -> Tensor:
    """The maps H_out_in (N, 3, 3) that bring boxes (N, 4) xyxy px to the middle of crops.

    px_out = s (px_in - middle) + ((w - 1) / 2, (h - 1) / 2), with s the greatest scale at which the
    box and its margin fit.
    """
    height, width = size
    room = boxes.new_tensor([width, height])
    scale = (room / ((boxes[:, 2:] - boxes[:, :2]) * (1 + 2 * margin))).amin(1)
    shift = (room - 1) / 2 - scale[:, None] * (boxes[:, :2] + boxes[:, 2:]) / 2
    H = torch.eye(3, dtype=boxes.dtype, device=boxes.device).repeat(len(boxes), 1, 1)
    H[:, 0, 0], H[:, 1, 1] = scale, scale
    H[:, :2, 2] = shift
    return H


def _sampled(image: Tensor, H: Tensor, size: tuple[int, int]) -> Tensor:
    """The pixels (N, C, h, w) of crops by maps (N, 3, 3) that scale and shift."""
    height, width = size
    channels, image_height, image_width = image.shape
    if len(H) == 0:
        return image.new_zeros(0, channels, height, width)
    floating = image if image.is_floating_point() else image.float()
    scale, shift = H[:, 0, 0].to(floating), H[:, :2, 2].to(floating)
    samples = min(MOST_SAMPLES, max(1, int(torch.ceil(1 / scale.detach().min() - 1e-6))))
    place = [
        (torch.arange(side * samples, device=image.device, dtype=floating.dtype) + 0.5) / samples
        - 0.5
        for side in (width, height)
    ]
    # px_in = (px_out - shift) / s; grid_sample counts from -1 to 1 over the outer edges of pixels
    x, y = (
        ((place[axis] - shift[:, axis, None]) / scale[:, None] * 2 + 1) / side - 1
        for axis, side in enumerate((image_width, image_height))
    )
    shape = (len(H), height * samples, width * samples)
    grid = torch.stack((x[:, None].expand(shape), y[:, :, None].expand(shape)), dim=-1)
    fine = grid_sample(floating.expand(len(H), -1, -1, -1), grid, align_corners=False)
    pixels = avg_pool2d(fine, samples)
    return pixels if image.is_floating_point() else pixels.round().clamp(0, 255).to(image.dtype)

"""Upright 2D boxes (x least, y least, x greatest, y greatest) under maps of pixels."""

import torch
from torch import Tensor

from animal3dbox.geometry.homography import apply_homography


def mapped_boxes(boxes: Tensor, H_out_in: Tensor, image_hw: tuple[int, int], outline: tuple[Tensor, Tensor] | None) -> Tensor:
    """Upright boxes round mapped boxes, inside the new frame.

    Exact where the map keeps the axes (flip, crop, resize, quarter turns). Any other map turns the box, and what lies round it
    bounds the animal less tightly; it is cut to the outline of the projected cuboid where that has any overlap with it.

    Args:
        boxes: (N, 4).
        H_out_in: (3, 3).
        image_hw: of the image after.
        outline: (N, 4) boxes round the projected cuboids and (N,) whether each means something; None if the map keeps the axes, or
            without cuboids.

    Returns:
        (N, 4); without area where nothing of the box lies in the frame.

    """
    x_least, y_least, x_most, y_most = boxes.unbind(-1)
    around = torch.stack((x_least, y_least, x_most, y_least, x_most, y_most, x_least, y_most), dim=-1).reshape(-1, 4, 2)
    w = around @ H_out_in[2, :2] + H_out_in[2, 2]
    height, width = image_hw
    frame = boxes.new_tensor([-0.5, -0.5, width - 0.5, height - 0.5])
    px = apply_homography(H_out_in, around)
    mapped = torch.cat((px.amin(-2), px.amax(-2)), dim=-1)
    mapped = torch.where((w > 0).all(-1, keepdim=True), mapped, frame)  # across the horizon nothing bounds the box
    if outline is not None:
        cut = torch.cat((torch.maximum(mapped[:, :2], outline[0][:, :2]), torch.minimum(mapped[:, 2:], outline[0][:, 2:])), dim=-1)
        mapped = torch.where((outline[1] & (cut[:, 2:] > cut[:, :2]).all(-1))[:, None], cut, mapped)
    return torch.cat((mapped[:, :2].clamp(frame[:2], frame[2:]), mapped[:, 2:].clamp(frame[:2], frame[2:])), dim=-1)


def keeps_axes(H: Tensor) -> bool:
    """Whether upright boxes stay upright boxes."""
    straight = bool((H[[0, 1], [1, 0]] == 0).all()) or bool((H[[0, 1], [0, 1]] == 0).all())
    return straight and bool((H[2, :2] == 0).all())


def boxes_of_masks(masks: Tensor, otherwise: Tensor) -> Tensor:
    """Upright boxes round masks, from the outer edges of their pixels.

    Args:
        masks: (N, H, W), 0 or 1.
        otherwise: (N, 4) what an empty mask gets.

    Returns:
        (N, 4) float64.

    """
    found = otherwise.clone()
    for index, mask in enumerate(masks):
        rows, columns = mask.any(dim=1).nonzero()[:, 0], mask.any(dim=0).nonzero()[:, 0]
        if len(rows):
            found[index] = torch.stack((columns[0] - 0.5, rows[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5)).to(found)
    return found

"""Shares of a box's faces, counted ray by ray instead of computed.

Each pixel's ray enters the box by one face; the counts check face_visibility.
"""

import torch
from torch import Tensor

from animal3dbox.geometry.box_visibility import near_depth
from animal3dbox.geometry.cuboid import Cuboid


def face_shares_by_rays(
    cuboid_cam: Cuboid, K: Tensor, image_hw: tuple[int, int], rays_per_pixel: int = 1
) -> Tensor:
    """The parts of the rays through the frame that enter a box by each of its faces.

    Rays that enter nearer than the near plane are left out, as face_visibility clips there. From
    inside the box no ray enters.

    Args:
        cuboid_cam: one box in the camera frame.
        K: (3, 3) in px.
        image_hw: height and width.
        rays_per_pixel: number of rays along each side of a pixel, evenly spread; 1: one ray through
            its centre.

    Returns:
        (6,) in FACES' order, summing to 1; all 0 if no ray meets the box.

    """
    height, width = image_hw
    v, u = (
        ((torch.arange(n * rays_per_pixel, dtype=torch.float64) + 0.5) / rays_per_pixel - 0.5)
        for n in (height, width)
    )
    pixels = torch.stack(
        (*torch.meshgrid(u, v, indexing="xy"), torch.ones(len(v), len(u), dtype=torch.float64)),
        dim=-1,
    ).reshape(-1, 3)
    rays = pixels @ torch.linalg.inv(K).mT @ cuboid_cam.rotation  # in the box's frame, of depth 1
    eye = -cuboid_cam.center @ cuboid_cam.rotation
    to_low, to_high = ((sign * cuboid_cam.size / 2 - eye) / rays for sign in (-1, 1))
    to_low, to_high = (torch.where(depth.isnan(), -torch.inf, depth) for depth in (to_low, to_high))
    enter, axis = torch.minimum(to_low, to_high).max(dim=1)
    leave = torch.maximum(to_low, to_high).amin(dim=1)
    enters = (enter < leave) & (enter > near_depth(cuboid_cam))
    by_low_side = rays.gather(1, axis[:, None])[:, 0] > 0
    counts = torch.bincount((2 * axis + by_low_side)[enters], minlength=6).double()
    return counts / counts.sum().clamp_min(1)

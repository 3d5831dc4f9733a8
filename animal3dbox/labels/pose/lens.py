"""The picture without its lens.

Where a pinhole would show keypoints and mask, for the camera pose.
"""

import torch
from torch import Tensor

from animal3dbox.geometry.distortion import distortion_slope, undistort


def straightened(pixels: Tensor, K: Tensor, distortion: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Where a pinhole of the same K would show what a lens shows.

    Args:
        pixels: (N, 2) px of the distorted picture.
        K: (3, 3).
        distortion: coefficients of OpenCV's lens.

    Returns:
        pixels: (N, 2) px of the straight picture.
        stretch: (N,) by how much a small length there is longer than in the distorted picture, over
            all directions.
        found: (N,) bool; False where the lens shows nothing.

    """
    bent = torch.linalg.solve(K[:2, :2], (pixels - K[:2, 2]).mT).mT
    points, found = undistort(bent, distortion)
    stretch = torch.linalg.det(distortion_slope(points, distortion)).abs().clamp_min(1e-12).rsqrt()
    return points @ K[:2, :2].mT + K[:2, 2], stretch, found


def straightened_box(mask: Tensor, K: Tensor, distortion: Tensor) -> Tensor | None:
    """The box (4,) xyxy px around a mask (H, W) in the straight picture.

    None if the mask touches the border, so that its outline is not the animal's, or reaches to
    where the lens shows nothing.
    """
    if bool(mask[0].any() | mask[-1].any() | mask[:, 0].any() | mask[:, -1].any()):
        return None
    inner = mask[1:-1, 1:-1] & mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
    rows, columns = (
        (mask & ~torch.nn.functional.pad(inner, (1, 1, 1, 1))).nonzero().double().unbind(-1)
    )
    sides = [
        torch.stack((columns + du, rows + dv), dim=-1)
        for du, dv in ((-0.5, 0.0), (0.5, 0.0), (0.0, -0.5), (0.0, 0.5))
    ]
    pixels, _, found = straightened(torch.cat(sides), K, distortion)
    return torch.cat((pixels.amin(0), pixels.amax(0))) if bool(found.all()) else None

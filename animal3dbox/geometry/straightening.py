"""The picture without its lens: where a pinhole would show keypoints and the outline of a mask.

Arrays come and go as NumPy; the sums run in torch, whose order of summation is the one that labels
have been made with: they stay the same to the last bit.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.distortion import distortion_slope, undistort

Array = NDArray[np.float64]


def straightened_pixels(
    pixels: Array, K: Array, distortion: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """The pixels at which a pinhole of the same K would show what a lens shows.

    Args:
        pixels: (N, 2) px of the distorted picture.
        K: (3, 3).
        distortion: coefficients of OpenCV's lens.

    Returns:
        pixels: (N, 2) px of the straight picture.
        stretch: (N,) by how much a small length there is longer than in the distorted picture, over
            all directions.
        in_lens: (N,) False where the lens shows nothing.

    """
    tensors = (torch.from_numpy(values) for values in (pixels, K, distortion))
    return tuple(part.numpy() for part in _straightened(*tensors))  # type: ignore[return-value]


def _straightened(pixels: Tensor, K: Tensor, distortion: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The values of straightened_pixels as tensors."""
    bent = torch.linalg.solve(K[:2, :2], (pixels - K[:2, 2]).mT).mT
    points, in_lens = undistort(bent, distortion)
    stretch = torch.linalg.det(distortion_slope(points, distortion)).abs().clamp_min(1e-12).rsqrt()
    return points @ K[:2, :2].mT + K[:2, 2], stretch, in_lens


def straightened_box(mask: NDArray[np.bool_], K: Array, distortion: Array) -> Array | None:
    """The box (4,) xyxy px around a mask (H, W) in the straight picture.

    None if the mask touches the border, so that its outline is not the animal's, or reaches to
    where the lens shows nothing.
    """
    if mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any():
        return None
    inner = mask[1:-1, 1:-1] & mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
    rows, columns = (mask & ~np.pad(inner, 1)).nonzero()
    sides = [
        np.stack((columns + du, rows + dv), axis=-1)
        for du, dv in ((-0.5, 0.0), (0.5, 0.0), (0.0, -0.5), (0.0, 0.5))
    ]
    pixels, _, in_lens = straightened_pixels(np.concatenate(sides), K, distortion)
    if not in_lens.all():
        return None
    box: Array = np.concatenate((pixels.min(0), pixels.max(0)))
    return box

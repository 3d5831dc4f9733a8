"""The frame of an image, and the one rule for what lies inside it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import AnyArray, like


def frame_box(image_hw: tuple[int, int]) -> NDArray[np.float64]:
    """The frame of an image as a box (4,) xyxy px, from the outer edges of its border pixels.

    Example:
        >>> frame_box((3, 4)).tolist()
        [-0.5, -0.5, 3.5, 2.5]
    """
    return np.array([-0.5, -0.5, image_hw[1] - 0.5, image_hw[0] - 0.5])


def in_frame(px: AnyArray, image_hw: tuple[int, int]) -> AnyArray:
    """Which points an image holds: the one rule of the package for "inside the frame".

    Pixel centres lie at whole numbers, so the frame is [-0.5, W - 0.5] x [-0.5, H - 0.5]; its
    border belongs to it. A point that is NaN lies outside.

    Args:
        px: (..., 2) x, y in px; an array or a tensor.
        image_hw: height and width of the image.

    Returns:
        (...) booleans.

    Example:
        >>> import numpy as np
        >>> in_frame(np.array([[-0.5, 0.0], [4.0, 2.6]]), (3, 4)).tolist()
        [True, False]
    """
    far_corner = like(px, [image_hw[1] - 0.5, image_hw[0] - 0.5])
    comparison: Any = (px >= -0.5) & (px <= far_corner)
    inside: AnyArray = comparison.all(-1)
    return inside

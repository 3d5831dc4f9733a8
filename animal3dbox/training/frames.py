"""The frames of a batch's images, which may be of many sizes."""

import numpy as np
from numpy.typing import NDArray

from animal3dbox.training.packed import Floats


def outside_frame(px: Floats, far_corner: Floats, tolerance_px: float = 0.0) -> NDArray[np.bool_]:
    """Points that lie outside the frames of their images.

    The rule of geometry.frame.in_frame, which knows one size: a frame is [-0.5, W - 0.5] x
    [-0.5, H - 0.5], and its border belongs to it.

    Args:
        px: (..., 2) x, y in px, finite.
        far_corner: broadcast to px: W - 0.5, H - 0.5 of each point's image.
        tolerance_px: by how much a point may be off, for what float32 has rounded.

    Returns:
        (...) booleans.

    Example:
        >>> outside_frame(np.array([[-0.5, 2.5], [4.0, 0.0]]), np.array([3.5, 2.5])).tolist()
        [False, True]
    """
    beyond = (px < -0.5 - tolerance_px) | (px > far_corner + tolerance_px)
    return np.asarray(beyond[..., 0] | beyond[..., 1])

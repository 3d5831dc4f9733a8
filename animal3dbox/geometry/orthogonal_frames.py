"""Right-handed frames out of directions, point clouds and reference layouts.

Arrays come and go as float64 NumPy arrays. The sums run in torch, whose order of summation is the
one that labels have been made with: they stay the same to the last bit.
"""

import numpy as np
import torch
from numpy.typing import NDArray

Array = NDArray[np.float64]
PARALLEL = 1e-6
"""Sine of the angle between two directions below which they count as parallel."""


def frame_from_directions(forward: Array, leftward: Array) -> Array | None:
    """The frame whose x is one direction and whose y is another made square to it.

    x = f / |f|,  y = (l - (l . x) x) / |...|,  z = x × y.

    Args:
        forward: (3,) of any length.
        leftward: (3,) of any length.

    Returns:
        (3, 3), columns x, y, z, det +1; None if the directions are parallel or have no length.

    Example:
        >>> frame_from_directions(np.array([2.0, 0, 0]), np.array([1.0, 3, 0])).tolist()
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    f, l = torch.from_numpy(forward), torch.from_numpy(leftward)  # noqa: E741
    x = torch.nn.functional.normalize(f, dim=-1)
    y = l - (l @ x) * x
    limit = PARALLEL * float(torch.linalg.vector_norm(l))
    if float(torch.linalg.vector_norm(y)) <= limit or not forward.any():
        return None
    y = torch.nn.functional.normalize(y, dim=-1)
    frame: Array = torch.stack((x, y, torch.linalg.cross(x, y)), dim=-1).numpy()
    return frame


def principal_axes(points: Array) -> Array:
    """The directions of greatest spread of points, as a right-handed frame.

    The sign of an eigenvector means nothing: which way each axis points is accidental.

    Args:
        points: (N, 3).

    Returns:
        (3, 3), columns by falling spread; the third is turned so that det is +1.

    Example:
        >>> int(abs(principal_axes(np.diag([3.0, 2.0, 1.0]))[:, 0]).argmax())
        0
    """
    cloud = torch.from_numpy(points)
    about_mean = cloud - cloud.mean(0)
    _, vectors = torch.linalg.eigh(about_mean.mT @ about_mean)
    frame = vectors.flip(-1)
    third = frame[:, 2:] * torch.sign(torch.linalg.det(frame))
    axes: Array = torch.cat((frame[:, :2], third), dim=1).numpy()
    return axes

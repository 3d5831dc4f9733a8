"""The baseline that the paper compares with: axes by principal components."""

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.orthogonal_frames import principal_axes


def pca_axes(vertices_world: Tensor | NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes along the directions of greatest spread (section 3.1, PCA).

    The sign of an eigenvector means nothing, so the front of the animal comes out at random: that
    is the baseline's known fault and kept as it is. The third axis is turned to make the frame
    right-handed.

    Args:
        vertices_world: (V, 3).

    Returns:
        R_box (3, 3), columns by falling spread; det +1.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import pca_axes
        >>> ellipsoid = np.random.default_rng(0).normal(size=(1000, 3)) * [3.0, 1.0, 2.0]
        >>> abs(pca_axes(ellipsoid)).round()
        array([[1., 0., 0.],
               [0., 0., 1.],
               [0., 1., 0.]])
    """
    vertices = as_numpy(vertices_world)
    check_shape("vertices_world", vertices, "V 3")
    return principal_axes(vertices)

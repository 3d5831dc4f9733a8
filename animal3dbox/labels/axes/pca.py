"""The baseline that the paper compares with: axes by principal components."""

import torch
from torch import Tensor

from animal3dbox.geometry.checks import check_shape


def pca_axes(vertices_world: Tensor) -> Tensor:
    """Axes along the directions of greatest spread (section 3.1, PCA).

    The sign of an eigenvector means nothing, so the front of the animal comes out at random: that
    is the baseline's known fault and kept as it is. The third axis is turned to make the frame
    right-handed.

    Args:
        vertices_world: (V, 3).

    Returns:
        R_box (3, 3), columns by falling spread; det +1.

    """
    check_shape("vertices_world", vertices_world, "V 3")
    about = vertices_world - vertices_world.mean(0)
    _, vectors = torch.linalg.eigh(about.mT @ about)
    R_box = vectors.flip(-1)
    return torch.cat((R_box[:, :2], R_box[:, 2:] * torch.sign(torch.linalg.det(R_box))), dim=1)

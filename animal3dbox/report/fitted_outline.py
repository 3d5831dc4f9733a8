"""The outline of a fitted body over its picture: what the cuboid was made of, thin beneath it."""

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.labels.fit_parameters import fitted_vertices
from animal3dbox.labels.types import CuboidLabel
from animal3dbox.smal.model import SmalModel

Picture = NDArray[np.uint8]
OUTLINE = (255, 255, 255)
OUTLINE_EDGE = (30, 30, 30)
"""Colours of the line, and of the darker one about it that keeps it legible on bright fur."""


def draw_fitted_outline(
    canvas: Picture, label: CuboidLabel, model: SmalModel, *, factor: float = 1.0, width: int = 1
) -> None:
    """Draw the outline of a label's fitted body into a picture that was enlarged by a factor.

    The picture itself is drawn into. A label without a fit draws nothing.

    Args:
        canvas: (H, W, 3) uint8 RGB.
        label: what was fitted.
        model: whose parameters the fit's are.
        factor: by which the picture was enlarged.
        width: of the line, px.

    Raises:
        ConfigError: the fit is of another model.

    Example:
        >>> from animal3dbox import label_animal
        >>> from animal3dbox.datasets.synthetic import synthetic_animal
        >>> animal = synthetic_animal(seed=0, index=2)
        >>> label = label_animal(animal.image_hw, animal.keypoints_2d, K=animal.K, body="fit")
        >>> canvas = np.zeros((*animal.image_hw, 3), dtype=np.uint8)
        >>> draw_fitted_outline(canvas, label, animal.model)
        >>> bool((canvas > 200).all(-1).any())
        True
    """
    if label.fit is None:
        return
    scale = label.scale_m_per_unit or 1.0
    vertices = scale * fitted_vertices(label.fit, model) @ label.R.numpy().T + label.t.numpy()
    middle = (factor - 1) / 2  # px of the enlarged picture are (px + 0.5) factor - 0.5
    enlarging = torch.tensor(
        [[factor, 0, middle], [0, factor, middle], [0, 0, 1]], dtype=torch.float64
    )
    image_hw = (canvas.shape[0], canvas.shape[1])
    mask = silhouette(torch.from_numpy(vertices), model.faces, enlarging @ label.K, image_hw)
    rings, _ = cv2.findContours(
        mask.numpy().astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    cv2.polylines(canvas, rings, True, OUTLINE_EDGE, width + 2, cv2.LINE_AA)
    cv2.polylines(canvas, rings, True, OUTLINE, width, cv2.LINE_AA)

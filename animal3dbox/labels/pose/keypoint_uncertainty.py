"""How far each keypoint is to be trusted, in px."""

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import clip
from animal3dbox.geometry.unit_frame import pixels_per_unit
from animal3dbox.labels.config import LabelConfig

Array = NDArray[np.float64]


def misfit_sigma(points_world: Array, points_px: Array, landmark_sigma: Array) -> Array:
    """The uncertain places of landmarks on the body, as standard deviations in the picture.

    Args:
        points_world: (N, 3) landmarks on the body.
        points_px: (N, 2) where they are seen.
        landmark_sigma: (N,) how far each may be from where the body has it, in the body's unit.

    Returns:
        (N,) in px.

    """
    if not len(points_world):
        return np.zeros_like(landmark_sigma)
    return landmark_sigma * pixels_per_unit(points_world, points_px)


def keypoint_sigma(keypoints_2d: Array, image_hw: tuple[int, int], config: LabelConfig) -> Array:
    """Standard deviation of each keypoint in pixels.

    Sigma_i is its square times the identity (section 2.2.1, Sigma_i).

    sigma_i^2 = sigma_base^2 * edge_factor * conf_factor (section 2.2.1, sigma_i): sigma_base by
    whether the point may be occluded, edge_factor growing linearly towards the border of the image,
    conf_factor = 1 / confidence. The paper names the factors without their formulas; these are
    ours, with their numbers in the config.

    Args:
        keypoints_2d: (J, 3) x, y in px and a confidence in (0, 1].
        image_hw: height and width.
        config: the factors' numbers.

    Returns:
        (J,) in px.

    """
    x, y, confidence = keypoints_2d.T
    height, width = image_hw
    to_border = np.minimum(
        np.minimum(x + 0.5, width - 0.5 - x), np.minimum(y + 0.5, height - 0.5 - y)
    )
    band = max(config.edge_band * min(height, width), 1e-9)
    edge_factor = 1 + (config.edge_gain - 1) * clip(1 - to_border / band, 0.0, 1.0)
    conf_factor = 1 / clip(confidence, config.confidence_floor, 1.0)
    occluded = confidence < config.occluded_below
    sigma_base = np.where(occluded, config.sigma_occluded_px, config.sigma_visible_px)
    sigma: Array = np.sqrt(sigma_base**2 * edge_factor * conf_factor)
    return sigma

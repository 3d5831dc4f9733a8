"""How far each keypoint is to be trusted."""

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy, clip
from animal3dbox.labels.config import LabelConfig


def misfit_sigma(points_world: Tensor, points_px: Tensor, landmark_sigma: Tensor) -> Tensor:
    """What an uncertain place on the body is worth in pixels.

    Args:
        points_world: (N, 3) landmarks on the body.
        points_px: (N, 2) where they are seen.
        landmark_sigma: (N,) how far each may be from where the body has it, in the body's unit.

    Returns:
        (N,) in px, by the ratio of the spreads in the image and in space; the mean of all
        directions is 3 / 2 of what one view shows of a squared length.

    """
    if not len(points_world):
        return torch.zeros_like(landmark_sigma)
    spread_px = (points_px - points_px.mean(0)).pow(2).sum(-1).mean()
    spread_world = (points_world - points_world.mean(0)).pow(2).sum(-1).mean().clamp_min(1e-300)
    return landmark_sigma * (1.5 * spread_px / spread_world).sqrt()


def keypoint_sigma(keypoints_2d: Tensor, image_hw: tuple[int, int], config: LabelConfig) -> Tensor:
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
    x, y, confidence = as_numpy(keypoints_2d).T
    height, width = image_hw
    to_border = np.minimum(
        np.minimum(x + 0.5, width - 0.5 - x), np.minimum(y + 0.5, height - 0.5 - y)
    )
    band = max(config.edge_band * min(height, width), 1e-9)
    edge_factor = 1 + (config.edge_gain - 1) * clip(1 - to_border / band, 0.0, 1.0)
    conf_factor = 1 / clip(confidence, config.confidence_floor, 1.0)
    occluded = confidence < config.occluded_below
    sigma_base = np.where(occluded, config.sigma_occluded_px, config.sigma_visible_px).astype(
        x.dtype
    )
    return torch.from_numpy(np.sqrt(sigma_base**2 * edge_factor * conf_factor))

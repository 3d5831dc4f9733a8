"""Cameras all round a body, its back up in the picture."""

import math

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.camera import look_at

Array = NDArray[np.float64]


def orbit_rotations(azimuths: int, elevations_deg: tuple[float, ...]) -> Array:
    """Rotations of cameras that look at a body from a grid of directions.

    Args:
        azimuths: how many directions round the body, evenly spaced, the first ahead of it.
        elevations_deg: the heights over its horizontal plane, for each azimuth.

    Returns:
        R_cam_box (azimuths x elevations, 3, 3), elevations running fastest.

    Example:
        >>> orbit_rotations(4, (0.0,))[0].round(6)[2].tolist()  # it looks back along the body's x
        [-1.0, 0.0, 0.0]
    """
    azimuth, elevation = torch.meshgrid(
        torch.arange(azimuths, dtype=torch.float64) * (2 * math.pi / azimuths),
        torch.deg2rad(torch.tensor(elevations_deg, dtype=torch.float64)),
        indexing="ij",
    )
    azimuth, elevation = azimuth.flatten(), elevation.flatten()
    eyes = torch.stack(
        (
            torch.cos(elevation) * torch.cos(azimuth),
            torch.cos(elevation) * torch.sin(azimuth),
            torch.sin(elevation),
        ),
        dim=-1,
    )
    up = torch.tensor([0.0, 0, 1], dtype=torch.float64)
    rotations: Array = look_at(eyes, torch.zeros_like(eyes), up)[:, :3, :3].numpy()
    return rotations

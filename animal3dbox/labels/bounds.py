"""Tight bounds of a body along given axes."""

import torch
from torch import Tensor

from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.cuboid import Cuboid, cuboid_from_bounds

PAPER_MARGIN = 1e-5
RELATIVE_MARGIN = 1e-6
"""Of the box diagonal, so that a scaled body gets the scaled box."""
ROUNDING = 32 * torch.finfo(torch.float64).eps
"""Of the greatest coordinate: what the way into the box frame and back may lose, for a body far from its origin or without extent."""


def box_bounds(vertices_world: Tensor, R_box: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Tight bounds of points along the box axes, about their mean c (section 2.1.2, V_local).

    Args:
        vertices_world: (V, 3).
        R_box: (3, 3), R_world_box.

    Returns:
        The least and the greatest corner in the box frame and the mean in world, (3,) each.

    """
    check_shape("vertices_world", vertices_world, "V 3")
    centroid_world = vertices_world.mean(dim=0)
    vertices_box = (vertices_world - centroid_world) @ R_box  # rows: R_boxᵀ (v - c)
    return vertices_box.amin(dim=0), vertices_box.amax(dim=0), centroid_world


def tight_cuboid(vertices_world: Tensor, R_box: Tensor, margin: float | None = None) -> Cuboid:
    """The smallest box with given axes around points, grown by a margin (section 2.1.2, V_min and V_max).

    Args:
        vertices_world: (V, 3).
        R_box: (3, 3), R_world_box.
        margin: added on every side, so that a vertex on a face counts as inside, in the points' unit; None: a
            millionth of the box diagonal, and what float64 loses to rounding.

    Returns:
        The box in world, in float64.

    """
    R_box = R_box.double()
    least, greatest, centroid_world = box_bounds(vertices_world.double(), R_box)
    rounding = ROUNDING * float(vertices_world.abs().amax())
    grown = RELATIVE_MARGIN * float(torch.linalg.vector_norm(greatest - least)) + rounding if margin is None else margin
    return cuboid_from_bounds(least - grown, greatest + grown, R_box, centroid_world)

"""Tight bounds of a body along given axes."""

from collections.abc import Sequence
from math import dist

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.checks import check_rotation, check_shape
from animal3dbox.geometry.cuboid import Cuboid

Array = NDArray[np.float64]
PAPER_MARGIN = 1e-5
RELATIVE_MARGIN = 1e-6
"""Of the box diagonal, so that a scaled body gets the scaled box."""
ROUNDING = 32 * np.finfo(np.float64).eps
"""Of the greatest coordinate: what the way into the box frame and back may lose, for a body far
from its origin or without extent."""


def box_bounds(vertices_world: Array, R_box: Array) -> tuple[Array, Array, Array]:
    """Tight bounds of points along the box axes, about one of them (section 2.1.2, V_local).

    The paper takes off their mean, which gives the same box.

    Args:
        vertices_world: (V, 3).
        R_box: (3, 3), R_world_box; about a point of the body, what it lacks of a rotation counts by
            the body's size alone.

    Returns:
        The least and the greatest corner in the box frame and the point in world, (3,) each.

    """
    check_shape("vertices_world", vertices_world, "V 3")
    point_world = vertices_world[0]
    # The difference of the two is R_boxᵀ (v - c).
    vertices_box, point_box = R_box.T @ vertices_world.T, R_box.T @ point_world
    return vertices_box.min(1) - point_box, vertices_box.max(1) - point_box, point_world


def tight_boxes(
    bodies: Sequence[Array], R_box: Array, margin: float | None = None
) -> tuple[Array, Array, Array]:
    """The smallest boxes with given axes around many bodies, see tight_cuboid.

    Args:
        bodies: (B,) of (V, 3) float64.
        R_box: (B, 3, 3), R_world_box of each, float64.
        margin: as for one.

    Returns:
        center: (B, 3) in world.
        rotation: (B, 3, 3), R_world_box.
        size: (B, 3).

    """
    check_rotation("R_box", R_box)
    # Coordinate by coordinate in memory, where sums and bounds along the vertices are five times
    # faster: `pays` in benchmarks/label_stages.py, "label of a posed body".
    ordered = (np.asfortranarray(vertices) for vertices in bodies)
    bounds = [box_bounds(vertices, axes) for vertices, axes in zip(ordered, R_box, strict=True)]
    margins = [
        _relative_margin(*(bound.tolist() for bound in one)) if margin is None else margin
        for one in bounds
    ]
    least, greatest, point_world = (
        np.array(part).reshape(-1, 3) for part in zip(*bounds, strict=True)
    )
    center = point_world + (R_box @ ((least + greatest) / 2)[..., None])[..., 0]
    return center, R_box, greatest - least + 2 * np.array(margins)[:, None]


def tight_cuboid(
    vertices_world: Tensor | Array, R_box: Tensor | Array, margin: float | None = None
) -> Cuboid:
    """The smallest box with given axes around points (section 2.1.2, V_min and V_max).

    Grown by a margin, ε in the paper.

    Args:
        vertices_world: (V, 3), a tensor or an array.
        R_box: (3, 3), R_world_box, likewise.
        margin: added on every side, so that a vertex on a face counts as inside, in the points'
            unit; None: a millionth of the box diagonal, and what float64 loses to rounding.

    Returns:
        The box in world, in float64.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import tight_cuboid
        >>> points = np.array([[0.0, 0, 0], [4, 2, 1]])
        >>> tight_cuboid(points, np.eye(3), margin=0.5).size
        tensor([5., 3., 2.], dtype=torch.float64)
    """
    vertices, axes = (
        as_numpy(values).astype(np.float64, copy=False) for values in (vertices_world, R_box)
    )
    boxes = tight_boxes([vertices], axes[None], margin)
    return Cuboid.from_arrays(*(part[0] for part in boxes))


def _relative_margin(least: list[float], greatest: list[float], point_world: list[float]) -> float:
    """The margin that grows with the box; of plain numbers, since three are not worth the calls."""
    farthest = max(map(abs, point_world)) + max(max(greatest), -min(least))
    return RELATIVE_MARGIN * dist(least, greatest) + ROUNDING * farthest

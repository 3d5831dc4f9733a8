"""The same mesh on another animal: vertices keep their places along and around the bones."""

from collections.abc import Sequence

import numpy as np

from animal3dbox.smal.quadruped.modelling.implicit import (
    Array,
    Primitive,
    all_distances,
    from_local,
    local_coordinates,
)
from animal3dbox.smal.quadruped.modelling.meshing import (
    HalfMesh,
    neighbour_average,
    project,
    relax,
    untangled,
)

_REACH = 0.010  # how far, in trunk lengths, a primitive that is not the nearest still has a say
_MIRROR = np.array([1.0, -1.0, 1.0])


def transferred(
    source: Sequence[Primitive], target: Sequence[Primitive], half: HalfMesh, relax_rounds: int
) -> Array:
    """Vertices (H, 3) on the target animal.

    Args:
        source: primitives of the animal on whose surface half.vertices lie.
        target: primitives of the other animal, same names in the same order.
        half: the mesh.
        relax_rounds: rounds of evening out along the target's surface.
    """
    say = shares(source, half.vertices)
    vertices = np.zeros_like(half.vertices)
    for k, (before, after) in enumerate(zip(source, target, strict=True)):
        for row, flip in ((k, np.ones(3)), (k + len(source), _MIRROR)):
            near = np.flatnonzero(say[row] > 1e-6)
            if len(near):
                along, scaled = local_coordinates(before, half.vertices[near] * flip)
                vertices[near] += say[row, near, None] * from_local(after, along, scaled) * flip
    average = neighbour_average(half)
    shift = vertices - half.vertices
    for _ in range(2):
        shift = 0.5 * shift + 0.5 * average(shift)
    placed = project(target, half.vertices + shift, half.seam, rounds=2)
    placed = (
        relax(target, placed, half, relax_rounds)
        if relax_rounds
        else project(target, placed, half.seam, rounds=1)
    )
    return untangled(target, placed, half) if relax_rounds else placed


def shares(primitives: Sequence[Primitive], points: Array) -> Array:
    """How much each primitive, then each mirrored one, shapes the skin at points (N, 3).

    Returns:
        (2P, N), columns summing to 1.

    """
    distances = all_distances(primitives, points)
    say = np.exp(-(distances - distances.min(axis=0)) / _REACH)
    return np.asarray(say / say.sum(axis=0), dtype=np.float64)

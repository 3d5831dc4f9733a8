"""The surface of an animal as a function's zero set: a smooth union of elliptic capsules."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MIRROR = np.array([1.0, -1.0, 1.0])
_FLOOR_BLEND = 0.008
_FAR = 0.10  # beyond every blend: there the exact distance does not matter


@dataclass(frozen=True)
class Primitive:
    """A segment from start to end, swept by an ellipse whose radii change linearly.

    Attributes:
        name: chain and number, such as `fore.3`; the same for all species.
        group: primitives of a group melt into each other first, the groups then (see `GROUPS`).
        ends: (2, 3) start and end, in the template frame.
        frame: (3, 3) rows across, through, along: orthonormal.
        radii: (2, 3) along the rows of frame, at the start and at the end.
        cup: bends the across axis to a parabola, as an ear is cupped.
        paired: there is a mirror image on the right.
    """

    name: str
    group: str
    ends: Array
    frame: Array
    radii: Array
    cup: float
    paired: bool


GROUPS = {  # name: (blend inside the group, blend with what came before); lengths in trunk lengths
    "trunk": (0.022, 0.0),
    "muscle": (0.012, 0.05),
    "fore": (0.010, 0.045),
    "hind": (0.010, 0.055),
    "tail": (0.006, 0.045),
    "head": (0.008, 0.04),
    "foot": (0.004, 0.012),
    "detail": (0.002, 0.006),
    "horn": (0.003, 0.010),
    "ear": (0.004, 0.014),
}


def local_coordinates(primitive: Primitive, points: Array) -> tuple[Array, Array]:
    """Where the points are in a primitive's own measures.

    Args:
        primitive: the primitive.
        points: (N, 3).

    Returns:
        along: (N,) in [0, 1], start to end.
        scaled: (N, 3) offset from the axis in units of the radii there, along the frame's rows.
    """
    start, axis = primitive.ends[0], primitive.ends[1] - primitive.ends[0]
    offset = points - start
    along = np.clip(offset @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
    across = (offset - along[:, None] * axis) @ primitive.frame.T
    radii = _radii_at(primitive, along)
    across[:, 1] -= primitive.cup * across[:, 0] ** 2 / radii[:, 0]
    return along, across / radii


def from_local(primitive: Primitive, along: Array, scaled: Array) -> Array:
    """The inverse of local_coordinates, of the same or of another animal's primitive: (N, 3)."""
    radii = _radii_at(primitive, along)
    across = scaled * radii
    across[:, 1] += primitive.cup * across[:, 0] ** 2 / radii[:, 0]
    places: Array = (
        primitive.ends[0]
        + along[:, None] * (primitive.ends[1] - primitive.ends[0])
        + across @ primitive.frame
    )
    return places


def primitive_distance(primitive: Primitive, points: Array) -> Array:
    """About the signed distance (N,) of points (N, 3) to one primitive, negative inside.

    Far away a lower bound of it.
    """
    reach = (
        primitive.radii.max() * (1.0 + abs(primitive.cup))
        + np.linalg.norm(primitive.ends[1] - primitive.ends[0]) / 2
    )
    out: Array = np.linalg.norm(points - primitive.ends.mean(axis=0), axis=1) - reach
    near = np.flatnonzero(out < _FAR)
    along, scaled = local_coordinates(primitive, points[near])
    radii = _radii_at(primitive, along)
    k0 = np.sqrt((scaled**2).sum(axis=1))
    k1 = np.sqrt(((scaled / radii) ** 2).sum(axis=1))
    out[near] = np.where(k1 > 1e-9, k0 * (k0 - 1.0) / np.maximum(k1, 1e-9), -radii.min(axis=1))
    return out


def all_distances(primitives: Sequence[Primitive], points: Array) -> Array:
    """Distances (P, N) to the primitives, and after them (P, N) to their mirror images: (2P, N)."""
    direct = [primitive_distance(p, points) for p in primitives]
    mirrored = [
        primitive_distance(p, points * _MIRROR) if p.paired else np.full(len(points), np.inf)
        for p in primitives
    ]
    return np.stack(direct + mirrored)


def surface_value(primitives: Sequence[Primitive], points: Array) -> Array:
    """The function (N,) at points (N, 3) whose zero set is the skin; about a distance outwards."""
    chains, groups = _chain_distances(primitives, points)
    value: Array | None = None
    for group, (inner, outer) in GROUPS.items():
        rows = chains[[i for i, name in enumerate(groups) if name == group]]
        lowest = rows.min(axis=0)
        joined = lowest - inner * np.log(np.exp((lowest - rows) / inner).sum(axis=0))
        value = joined if value is None else _smooth_min(value, joined, outer)
    if value is None:
        raise ValueError("an animal needs primitives")
    return -_smooth_min(-value, points[:, 2], _FLOOR_BLEND)  # the soles are flat, on z = 0


def surface_gradient(primitives: Sequence[Primitive], points: Array, step: float = 1e-4) -> Array:
    """The gradient (N, 3) of surface_value by central differences."""
    shifted = np.concatenate([points + s * step * axis for axis in np.eye(3) for s in (1.0, -1.0)])
    values = surface_value(primitives, shifted).reshape(3, 2, len(points))
    return np.ascontiguousarray(((values[:, 0] - values[:, 1]) / (2 * step)).T)


def _chain_distances(primitives: Sequence[Primitive], points: Array) -> tuple[Array, list[str]]:
    """The distances (C, N) to whole chains on both sides, and the group of each.

    Blending segments instead would ring a limb with bumps.
    """
    distances = all_distances(primitives, points)
    rows: dict[tuple[str, int], list[int]] = {}
    for i, primitive in enumerate(primitives):
        for side in (0, 1) if primitive.paired else (0,):
            rows.setdefault((primitive.name.split(".")[0], side), []).append(
                i + side * len(primitives)
            )
    return np.stack([distances[index].min(axis=0) for index in rows.values()]), [
        primitives[i[0] % len(primitives)].group for i in rows.values()
    ]


def _radii_at(primitive: Primitive, along: Array) -> Array:
    radii: Array = primitive.radii[0] + along[:, None] * (primitive.radii[1] - primitive.radii[0])
    return radii


def _smooth_min(a: Array, b: Array, blend: float) -> Array:
    mix = np.maximum(blend - np.abs(a - b), 0.0)
    return np.minimum(a, b) - mix**2 / (4.0 * blend)

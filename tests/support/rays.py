"""A slow, plain reference for which faces are seen; shares no code with the package."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def face_hit_by_rays(
    center: Array, rotation: Array, size: Array, directions: Array
) -> NDArray[np.int64]:
    """The face (order front back left right top bottom) that each ray from the origin enters the
    box by, -1 for none."""
    origin, d = -rotation.T @ center, directions @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        to_low, to_high = (-size / 2 - origin) / d, (size / 2 - origin) / d
    enter, leave = np.minimum(to_low, to_high), np.maximum(to_low, to_high)
    hit = (enter.max(1) < leave.min(1)) & (enter.max(1) > 0)
    axis = enter.argmax(1)
    side = (
        np.take_along_axis(d, axis[:, None], 1)[:, 0] > 0
    )  # going up an axis, a ray enters by its low face
    return np.where(hit, 2 * axis + side, -1)


def faces_entered(center: Array, rotation: Array, size: Array) -> list[int]:
    """The faces that any ray from the origin to a grid of points on the box enters by, in order."""
    targets = []
    for axis in range(3):
        for side in (1, -1):
            u, v = np.meshgrid(np.linspace(-0.45, 0.45, 5), np.linspace(-0.45, 0.45, 5))
            grid = np.zeros((25, 3))
            grid[:, axis] = side * 0.5
            grid[:, (axis + 1) % 3], grid[:, (axis + 2) % 3] = u.ravel(), v.ravel()
            targets.append((grid * size) @ rotation.T + center)
    entered = face_hit_by_rays(center, rotation, size, np.concatenate(targets))
    return sorted({int(face) for face in entered if face >= 0})


def nearest_triangles(
    vertices: Array, faces: NDArray[np.int64], directions: Array
) -> tuple[NDArray[np.int64], Array]:
    """What each ray (N, 3) from the origin meets first.

    Returns:
        The triangle (N,), -1 for none, and how many directions away (N,), inf for none.

    """
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    volume, edges = (
        (np.cross(a, b) * c).sum(1),
        [np.cross(p, q) for p, q in ((a, b), (b, c), (c, a))],
    )
    first, away = np.full(len(directions), -1), np.full(len(directions), np.inf)
    for i, d in enumerate(directions):
        sides = [normals @ d for normals in edges]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = volume / (sides[0] + sides[1] + sides[2])
        same = ((sides[0] >= 0) & (sides[1] >= 0) & (sides[2] >= 0)) | (
            (sides[0] <= 0) & (sides[1] <= 0) & (sides[2] <= 0)
        )
        hit = same & (t > 0)
        if hit.any():
            first[i] = np.flatnonzero(hit)[t[hit].argmin()]
            away[i] = t[hit].min()
    return first, away

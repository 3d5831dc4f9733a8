"""Sections across an animal's trunk: where planes meet its surface, whatever its keypoints are.

A body's mesh knows its trunk without any convention of names. Planes across the trunk cut the
surface in closed outlines; from the middle of each, rays run to the first surface they meet. The
middle column of the trunk bears no legs, so up and down the rays end at the back and at the belly.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PARTS = np.linspace(0.15, 0.85, 8)
"""Where the planes cross the way from the trunk's rear end to its front end."""
RAYS = 16
"""Rays of a section, evenly spaced: the first upwards, the fifth to the left."""
ANGLES = np.arange(RAYS) * 2 * np.pi / RAYS
DIRECTIONS = np.stack((np.sin(ANGLES), np.cos(ANGLES)), axis=1)
"""The rays' directions (RAYS, 2): left and up."""
BACK, LEFT, BELLY, RIGHT = 0, RAYS // 4, RAYS // 2, 3 * RAYS // 4
LIKELY_BELOW, LIKELY_ABOVE = 0.75, 0.25
"""The trunk lies about within so much of its length below and above the line of its landmarks."""

Segments = tuple[Array, Array]
"""Both ends (S, 2) of the pieces of an outline, left and up in their plane."""


@dataclass(frozen=True)
class Sections:
    """The outlines of a trunk in planes across it.

    Attributes:
        positions: (T,) of the planes along the trunk, in the body's unit.
        centers: (T, 2) left and up of each section's middle.
        radii: (T, RAYS) from there to the surface; NaN in sections that do not close around it.
    """

    positions: Array
    centers: Array
    radii: Array

    @property
    def is_complete(self) -> NDArray[np.bool_]:
        """Which sections have a surface in every direction, (T,)."""
        return np.asarray(np.isfinite(self.radii).all(1))


def trunk_sections(
    vertices: Array, faces: NDArray[np.int64], *, R_box: Array, rear: Array, length: float
) -> Sections:
    """Cut a mesh by planes square to x, from the trunk's rear end forward.

    Args:
        vertices: (V, 3) in world.
        faces: (F, 3).
        R_box: (3, 3) R_world_box, columns forward, left, up.
        rear: (3,) the trunk's rear end in world, from which positions are counted.
        length: of the trunk along x, in the same unit.

    """
    places = (vertices - rear) @ R_box
    x = places[:, 0][faces]
    is_near = (x.max(1) > PARTS[0] * length) & (x.min(1) < PARTS[-1] * length)
    triangles = places[faces[is_near]]
    positions = PARTS * length
    centers = np.full((len(PARTS), 2), np.nan)
    radii = np.full((len(PARTS), RAYS), np.nan)
    for i, position in enumerate(positions):
        outline = _outline(triangles, position)
        center = _center(outline, length)
        if center is not None:
            centers[i], radii[i] = center, _first_distances(outline, center)
    return Sections(positions, centers, radii)


def _outline(triangles: Array, position: float) -> Segments:
    """Where triangles (F, 3, 3) meet the plane at a position: a segment for each that crosses."""
    depth = triangles[:, :, 0] - position
    is_ahead = depth > 0
    crosses = is_ahead.any(1) & ~is_ahead.all(1)
    corners, depth, is_ahead = triangles[crosses], depth[crosses], is_ahead[crosses]
    # One corner of a crossing triangle lies alone on its side: the segment joins its two edges.
    is_alone = is_ahead == (is_ahead.sum(1) == 1)[:, None]
    alone = is_alone.argmax(1)
    rows = np.arange(len(corners))
    ends = []
    for step in (1, 2):
        other = (alone + step) % 3
        a, b = depth[rows, alone], depth[rows, other]
        part = (a / (a - b))[:, None]
        start, stop = corners[rows, alone, 1:], corners[rows, other, 1:]
        ends.append(start + part * (stop - start))
    return ends[0], ends[1]


def _center(outline: Segments, length: float) -> Array | None:
    """The middle (2,) of the trunk in a section; None if the outline does not close around one."""
    center = np.zeros(2)
    for _ in range(2):
        heights = np.sort(_distances(outline, center, np.array([0.0, 1.0]))) + center[1]
        spans = [(heights[i], heights[i + 1]) for i in range(0, len(heights) - 1, 2)]
        if not spans:
            return None
        low, high = max(
            spans,
            key=lambda s: min(s[1], LIKELY_ABOVE * length) - max(s[0], -LIKELY_BELOW * length),
        )
        center = np.array([center[0], (low + high) / 2])
        sideways = _distances(outline, center, np.array([1.0, 0.0]))
        left, right = sideways[sideways > 0], sideways[sideways < 0]
        if not (len(left) and len(right)):
            return None
        center = center + np.array([(left.min() + right.max()) / 2, 0.0])
    return center


def _distances(outline: Segments, origin: Array, direction: Array) -> Array:
    """Signed distances (N,) from an origin to where a line through it meets an outline."""
    across = np.array([-direction[1], direction[0]])
    starts, stops = outline[0] - origin, outline[1] - origin
    a, b = starts @ across, stops @ across
    meets = (a > 0) != (b > 0)
    part = (a[meets] / (a[meets] - b[meets]))[:, None]
    distances: Array = (starts[meets] + part * (stops[meets] - starts[meets])) @ direction
    return distances


def _first_distances(outline: Segments, center: Array) -> Array:
    """The distance (RAYS,) along each ray from a centre to the outline; NaN where it meets none."""
    starts, stops = outline[0] - center, outline[1] - center
    across = np.stack((-DIRECTIONS[:, 1], DIRECTIONS[:, 0]))  # (2, RAYS)
    a, b = starts @ across, stops @ across  # (S, RAYS)
    along_a, along_b = starts @ DIRECTIONS.T, stops @ DIRECTIONS.T
    meets = (a > 0) != (b > 0)
    part = a / np.where(meets, a - b, 1.0)
    distance = along_a + part * (along_b - along_a)
    first: Array = np.where(meets & (distance > 0), distance, np.inf).min(0, initial=np.inf)
    return np.where(np.isinf(first), np.nan, first)

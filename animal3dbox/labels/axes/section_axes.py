"""Axes of a body from sections across its trunk, improved step by step from the landmarks' axes.

In the trunk's own frame sections are mirror images left and right, their middles lie on a straight
line, and back and belly run as animals' backs and bellies do. What is missing to each is a small
turn about x, z and y.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.orthogonal_frames import frame_from_directions
from animal3dbox.labels.axes.trunk_line import learned_facts
from animal3dbox.labels.axes.trunk_sections import (
    ANGLES,
    BACK,
    BELLY,
    PARTS,
    RAYS,
    Sections,
    trunk_sections,
)

Array = NDArray[np.float64]

STEPS = 4
"""Times that the sections are cut anew with the improved axes."""
LEAST_SECTIONS = 4
"""Of len(PARTS), which must close around the trunk."""
MOST_TURN = 0.5
"""Radians that one step turns about an axis at most."""
YAW_SHARE = 0.7
"""The part of the middles' slope that one step turns, so that steps do not swing."""
FRONT_SHARE = 0.25
"""How much the slope of the front half counts beside that of all: the hips swing with the tail."""
MIRROR_PAIRS = np.arange(1, RAYS // 2)
"""Rays on the left, each with its mirror image on the right."""
TOLERANCE = 0.05
"""Difference of mirrored radii, as a part of their mean, from which one counts less (Huber)."""


@dataclass(frozen=True)
class PitchWeights:
    """How the pitch of a frame follows from the heights of back and belly in it.

    Learned by `benchmarks/learn_trunk.py`.

    Attributes:
        weights: (2 len(PARTS),) radians for each height, back then belly, as parts of the length.
        constant: radians.
        sd_deg: standard deviation of the pitch that section_axes makes of it from the truth.
    """

    weights: Array
    constant: float
    sd_deg: float = 3.0

    def pitch(self, heights: Array) -> float:
        """Radians by which a frame's x points above the trunk's."""
        return float(self.weights @ heights + self.constant)


@cache
def shipped_weights() -> PitchWeights:
    """The weights that come with the package."""
    content = learned_facts()["sections"]
    return PitchWeights(
        np.array(content["weights"]), float(content["constant"]), float(content["sd_deg"])
    )


def section_axes(
    vertices: Array,
    faces: NDArray[np.int64],
    *,
    start: Array,
    ends: tuple[Array, Array],
    weights: PitchWeights | None = None,
) -> Array | None:
    """The axes of a body's trunk by its surface alone, from a rough guess.

    Args:
        vertices: (V, 3) in world.
        faces: (F, 3).
        start: (3, 3) R_world_box to begin with, within about 30 degrees.
        ends: (3,) each, the trunk's rear and front end in world; only how far they lie apart along
            x and where the rear one is counts, roughly.
        weights: of back and belly; None: those that come with the package.

    Returns:
        R_world_box (3, 3); None if too few sections close around a trunk.

    """
    weights = weights or shipped_weights()
    R_box = start
    for _ in range(STEPS):
        length = float((ends[1] - ends[0]) @ R_box[:, 0])
        if length <= 0:
            return None
        sections = trunk_sections(vertices, faces, R_box=R_box, rear=ends[0], length=length)
        if sections.is_complete.sum() < LEAST_SECTIONS:
            return None
        R_box = _turned(
            R_box,
            roll=mirror_roll(sections),
            pitch=weights.pitch(outline_heights(sections, length)),
            yaw=YAW_SHARE * _middles_angle(sections),
        )
    return R_box


def outline_heights(sections: Sections, length: float) -> Array:
    """Heights of back and belly (2 len(PARTS),) about their mean, as parts of the trunk's length.

    Sections that are missing get what their neighbours have.
    """
    ok = sections.is_complete
    up = sections.centers[:, 1]
    rows = [up + sections.radii[:, BACK], up - sections.radii[:, BELLY]]
    heights = np.concatenate([np.interp(PARTS, PARTS[ok], row[ok]) for row in rows]) / length
    return np.asarray(heights - heights.mean())


def mirror_roll(sections: Sections) -> float:
    """The turn about x, in radians, after which sections are most nearly symmetric.

    With S the mean of an outline r and its mirror image, an outline that is turned by a roll p and
    shifted by d to the left differs from its mirror image by

        r(a) - r(-a) = 2 p S'(a) + 2 d sin(a)

    to first order. p is common to all sections, d is each one's own; robust least squares (Huber).
    """
    radii = sections.radii[sections.is_complete]
    mirrored = radii[:, -np.arange(RAYS) % RAYS]
    mean = (radii + mirrored) / 2
    slope = (np.roll(mean, -1, 1) - np.roll(mean, 1, 1)) / (2 * ANGLES[1])
    count, size = len(radii), mean.mean()
    design = np.zeros((count, len(MIRROR_PAIRS), 1 + count))
    design[:, :, 0] = 2 * slope[:, MIRROR_PAIRS] / size
    for i in range(count):
        design[i, :, 1 + i] = 2 * np.sin(ANGLES[MIRROR_PAIRS]) / size
    rows = design.reshape(-1, 1 + count)
    values = ((radii - mirrored)[:, MIRROR_PAIRS] / size).ravel()
    weights = np.ones(len(values))
    solution = np.zeros(1 + count)
    for _ in range(8):
        normal = rows.T @ (rows * weights[:, None]) + 1e-6 * np.eye(1 + count)
        solution = np.linalg.solve(normal, rows.T @ (weights * values))
        weights = 1 / np.maximum(1, abs(values - rows @ solution) / TOLERANCE)
    return float(solution[0])


def _middles_angle(sections: Sections) -> float:
    """The angle to the left, in radians, at which the sections' middles run."""
    front = sections.is_complete.copy()
    front[: len(PARTS) // 2] = False
    whole = _median_slope(sections, sections.is_complete)
    half = _median_slope(sections, front) if front.sum() > 1 else whole
    return float(np.arctan((1 - FRONT_SHARE) * whole + FRONT_SHARE * half))


def _median_slope(sections: Sections, chosen: NDArray[np.bool_]) -> float:
    """The median of the slopes between the middles of each two of the chosen sections."""
    x, y = sections.positions[chosen], sections.centers[chosen, 0]
    i, j = np.triu_indices(len(x), 1)
    return float(np.median((y[j] - y[i]) / (x[j] - x[i])))


def _turned(R_box: Array, *, roll: float, pitch: float, yaw: float) -> Array:
    """Axes after small turns: y towards z by roll, x down by pitch, x to the left by yaw."""
    axes = np.clip(np.array([roll, pitch, yaw]), -MOST_TURN, MOST_TURN)
    forward = R_box[:, 0] - np.tan(axes[1]) * R_box[:, 2] + np.tan(axes[2]) * R_box[:, 1]
    leftward = R_box[:, 1] + np.tan(axes[0]) * R_box[:, 2]
    turned = frame_from_directions(forward, leftward)
    return R_box if turned is None else turned

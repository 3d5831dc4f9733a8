"""Batched robust Levenberg-Marquardt on camera poses.

Many starts at once, with their derivatives by hand.

A step is (w, d): R becomes small_turns(w) R, t becomes t + d. Depths are held above LEAST_DEPTH by
not taking steps beyond it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.checks import IDENTITY
from animal3dbox.geometry.rigid_transforms import CROSS

Array = NDArray[np.float64]
LEAST_DEPTH = 0.05
"""Of the landmarks' spread, which is 1: no landmark may come nearer to the camera's plane."""
FIRST_DAMPING = 1e-3
DAMPING_DOWN, DAMPING_UP = 0.1, 8
"""Factors of the damping after a step that helps, and after one that does not."""
LEAST_DAMPING, MOST_DAMPING = 1e-12, 1e8
RIDGE = 1e-12
"""Of the greatest curvature: added to every direction, so that one without can be solved for."""
SETTLED = 1e-10
"""Relative gain in cost below which a pose counts as found."""

ROUNDING, RESIDUAL_ROUNDING = 1e-13, 1e-12
"""Of the cost, and of its root, since residuals of exact keypoints are differences of pixels.

A cost that rises by less has not risen.
"""
ONES = np.eye(6)
HALF_CROSS = np.array(CROSS) / 2
"""(3, 9): a vector times this is half its cross_matrix, row by row."""
NOTHING = 1e-16
"""A cost that is none."""


@dataclass(frozen=True)
class LocalModel:
    """A cost near poses: cost + b · step + step · A step / 2.

    Attributes:
        cost: (B,); infinite where a pose is not allowed.
        A: (B, 6, 6) its Gauss-Newton matrix, positive semidefinite.
        b: (B, 6) its gradient.
    """

    cost: Array
    A: Array
    b: Array


def project_with_slopes(
    points: Array, linear: Array, R: Array, t: Array
) -> tuple[Array, Array, Array]:
    """Where points stand in the picture, about its principal point, and how that moves with a step.

    Args:
        points: (N, 3), or (B, N, 3) of each pose's own.
        linear: (2, 2) K's upper left.
        R: (B, 3, 3).
        t: (B, 3).

    Returns:
        px: (B, 2, N) about the principal point.
        slopes: (B, 6, 2, N).
        depth: (B, N).

    """
    turned = R @ points.mT
    cam = turned + t[..., None]
    x0, y0, z0 = turned[:, 0], turned[:, 1], turned[:, 2]
    depth = cam[:, 2]
    inverse = 1 / np.maximum(depth, 1e-9)
    plane = cam[:, :2] * inverse[:, None]
    x, y = plane[:, 0], plane[:, 1]
    slopes = np.zeros((len(R), 6, 2, points.shape[-2]))
    by_x, by_y = slopes[:, :, 0], slopes[:, :, 1]
    by_x[:, 0], by_x[:, 1], by_x[:, 2] = -x * y0, z0 + x * x0, -y0
    by_y[:, 0], by_y[:, 1], by_y[:, 2] = -z0 - y * y0, y * x0, x0
    by_x[:, 3] = by_y[:, 4] = 1.0
    by_x[:, 5], by_y[:, 5] = -x, -y
    if linear[0, 1] == 0:
        focal = linear.diagonal()[:, None]
        slopes *= (focal * inverse[:, None])[:, None]
        plane *= focal
        return plane, slopes, depth
    slopes *= inverse[:, None, None]
    return linear @ plane, linear @ slopes, depth


def small_turns(w: Array) -> Array:
    """Rotations (B, 3, 3) about w (B, 3), by its length to first order.

    Cayley's map, whose angle is 2 atan(|w| / 2).
    """
    half = (w @ HALF_CROSS).reshape(-1, 3, 3)
    turn: Array = half @ half
    turn += half
    turn *= (8 / (4 + (w * w).sum(-1)))[:, None, None]
    turn += IDENTITY
    return turn


def descend(
    local: Callable[[Array, Array], LocalModel],
    R: Array,
    t: Array,
    rounds: int,
    *,
    gain: float = SETTLED,
) -> tuple[Array, Array, Array, bool]:
    """Poses that cost less, by at most so many damped steps, each kept only if it helps.

    Args:
        local: the cost of poses.
        R: (B, 3, 3) where to start.
        t: (B, 3).
        rounds: most steps.
        gain: relative, in cost: a pose that gains less on an undamped step has settled.

    Returns:
        R, t, their costs (B,), and whether all of them have settled.

    """
    here, damping = local(R, t), np.full(len(R), FIRST_DAMPING)
    for _ in range(rounds):
        diagonal = here.A.diagonal(axis1=-2, axis2=-1)
        ridge = damping[:, None] * diagonal + RIDGE * diagonal.max(-1)[:, None] + 1e-300
        step = -np.linalg.solve(here.A + ridge[..., None] * ONES, here.b[..., None])[..., 0]
        R_new, t_new = small_turns(step[:, :3]) @ R, t + step[:, 3:]
        there = local(R_new, t_new)
        better = (
            there.cost <= here.cost * (1 + ROUNDING) + RESIDUAL_ROUNDING * np.sqrt(here.cost)
        ) & np.isfinite(there.cost)
        settled = (better & (there.cost >= here.cost * (1 - gain)) & (damping <= FIRST_DAMPING)) | (
            here.cost < NOTHING
        )
        R, t, here = (
            (R_new, t_new, there)
            if better.all()
            else _where(better, (R_new, t_new, there), (R, t, here))
        )
        damping = np.where(better, damping * DAMPING_DOWN, damping * DAMPING_UP)
        damping = np.minimum(np.maximum(damping, LEAST_DAMPING), MOST_DAMPING)
        if settled.all():
            return R, t, here.cost, True
    return R, t, here.cost, False


def _where(
    better: NDArray[np.bool_],
    there: tuple[Array, Array, LocalModel],
    here: tuple[Array, Array, LocalModel],
) -> tuple[Array, Array, LocalModel]:
    """For each pose what is there if that is better (B,), else what is here."""
    vectors, matrices = better[:, None], better[:, None, None]
    local = LocalModel(
        np.where(better, there[2].cost, here[2].cost),
        np.where(matrices, there[2].A, here[2].A),
        np.where(vectors, there[2].b, here[2].b),
    )
    return np.where(matrices, there[0], here[0]), np.where(vectors, there[1], here[1]), local

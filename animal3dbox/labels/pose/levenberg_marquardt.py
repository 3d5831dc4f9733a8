"""Batched robust Levenberg-Marquardt on camera poses.

Many starts at once, with their derivatives by hand.

A step is (w, d): R becomes small_turns(w) R, t becomes t + d; where the focal length is not known,
(w, d, s): it is multiplied by exp(s), too. Depths are held above LEAST_DEPTH by not taking steps
beyond it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

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
HALF_CROSS = np.array(CROSS) / 2
"""(3, 9): a vector times this is half its cross_matrix, row by row."""
NOTHING = 1e-16
"""A cost that is none."""


@dataclass(frozen=True)
class CameraPoses:
    """Poses of a camera, X_cam = R X + t.

    Attributes:
        R: (B, 3, 3) R_cam_world.
        t: (B, 3) t_cam_world.
        log_zoom: (B,) natural logarithm of the focal length by that of the problem's K; None: K is
            known, and P = 6 numbers are sought instead of 7.
    """

    R: Array
    t: Array
    log_zoom: Array | None = None

    def __len__(self) -> int:
        return len(self.R)

    def __getitem__(self, ids: Any) -> "CameraPoses":
        """Those of some indices, or of a mask (B,)."""
        zoom = None if self.log_zoom is None else self.log_zoom[ids]
        return CameraPoses(self.R[ids], self.t[ids], zoom)

    def moved(self, step: Array) -> "CameraPoses":
        """The poses after a step (B, P)."""
        zoom = None if self.log_zoom is None else self.log_zoom + step[:, 6]
        return CameraPoses(small_turns(step[:, :3]) @ self.R, self.t + step[:, 3:6], zoom)


@dataclass(frozen=True)
class LocalModel:
    """A cost near poses: cost + b · step + step · A step / 2.

    Attributes:
        cost: (B,); infinite where a pose is not allowed.
        A: (B, P, P) its Gauss-Newton matrix, positive semidefinite.
        b: (B, P) its gradient.
    """

    cost: Array
    A: Array
    b: Array

    def __getitem__(self, ids: Any) -> "LocalModel":
        """Those of some indices, or of a mask (B,)."""
        return LocalModel(self.cost[ids], self.A[ids], self.b[ids])


def project_with_slopes(
    points: Array, linear: Array, poses: CameraPoses
) -> tuple[Array, Array, Array]:
    """Where points stand in the picture, about its principal point, and how that moves with a step.

    Args:
        points: (N, 3), or (B, N, 3) of each pose's own.
        linear: (2, 2) K's upper left.
        poses: B of them.

    Returns:
        px: (B, 2, N) about the principal point.
        slopes: (B, P, 2, N).
        depth: (B, N).

    """
    turned = poses.R @ points.mT
    cam = turned + poses.t[..., None]
    x0, y0, z0 = turned[:, 0], turned[:, 1], turned[:, 2]
    depth = cam[:, 2]
    inverse = 1 / np.maximum(depth, 1e-9)
    plane = cam[:, :2] * inverse[:, None]
    x, y = plane[:, 0], plane[:, 1]
    slopes = np.zeros((len(poses), 6 if poses.log_zoom is None else 7, 2, points.shape[-2]))
    by_x, by_y = slopes[:, :, 0], slopes[:, :, 1]
    by_x[:, 0], by_x[:, 1], by_x[:, 2] = -x * y0, z0 + x * x0, -y0
    by_y[:, 0], by_y[:, 1], by_y[:, 2] = -z0 - y * y0, y * x0, x0
    by_x[:, 3] = by_y[:, 4] = 1.0
    by_x[:, 5], by_y[:, 5] = -x, -y
    slopes *= inverse[:, None, None]
    if poses.log_zoom is not None:
        slopes[:, 6] = plane
        zoom = np.exp(poses.log_zoom)[:, None, None]
        plane, slopes = plane * zoom, slopes * zoom[..., None]
    if linear[0, 1] == 0:
        focal = linear.diagonal()[:, None]
        return focal * plane, focal * slopes, depth
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
    local: Callable[[CameraPoses], LocalModel],
    poses: CameraPoses,
    rounds: int,
    *,
    gain: float = SETTLED,
) -> tuple[CameraPoses, LocalModel, bool]:
    """Poses that cost less, by at most so many damped steps, each kept only if it helps.

    Args:
        local: the cost of poses.
        poses: where to start.
        rounds: most steps.
        gain: relative, in cost: a pose that gains less on an undamped step has settled.

    Returns:
        The poses, their cost there, and whether all of them have settled.

    """
    here, damping = local(poses), np.full(len(poses), FIRST_DAMPING)
    ones = np.eye(here.b.shape[-1])
    for _ in range(rounds):
        diagonal = here.A.diagonal(axis1=-2, axis2=-1)
        ridge = damping[:, None] * diagonal + RIDGE * diagonal.max(-1)[:, None] + 1e-300
        step = -np.linalg.solve(here.A + ridge[..., None] * ones, here.b[..., None])[..., 0]
        moved = poses.moved(step)
        there = local(moved)
        better = (
            there.cost <= here.cost * (1 + ROUNDING) + RESIDUAL_ROUNDING * np.sqrt(here.cost)
        ) & np.isfinite(there.cost)
        settled = (better & (there.cost >= here.cost * (1 - gain)) & (damping <= FIRST_DAMPING)) | (
            here.cost < NOTHING
        )
        poses, here = (
            (moved, there) if better.all() else _where(better, (moved, there), (poses, here))
        )
        damping = np.where(better, damping * DAMPING_DOWN, damping * DAMPING_UP)
        damping = np.minimum(np.maximum(damping, LEAST_DAMPING), MOST_DAMPING)
        if settled.all():
            return poses, here, True
    return poses, here, False


def _where(
    better: NDArray[np.bool_],
    there: tuple[CameraPoses, LocalModel],
    here: tuple[CameraPoses, LocalModel],
) -> tuple[CameraPoses, LocalModel]:
    """For each pose what is there if that is better (B,), else what is here."""
    vectors, matrices = better[:, None], better[:, None, None]
    local = LocalModel(
        np.where(better, there[1].cost, here[1].cost),
        np.where(matrices, there[1].A, here[1].A),
        np.where(vectors, there[1].b, here[1].b),
    )
    zoom = here[0].log_zoom
    if zoom is not None and there[0].log_zoom is not None:
        zoom = np.where(better, there[0].log_zoom, zoom)
    R, t = (
        np.where(mask, of_there, of_here)
        for mask, of_there, of_here in (
            (matrices, there[0].R, here[0].R),
            (vectors, there[0].t, here[0].t),
        )
    )
    return CameraPoses(R, t, zoom), local

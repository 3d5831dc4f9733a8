"""The robust joint cost of method "default".

Keypoints and the body's bounds against the mask's, batched over poses.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.levenberg_marquardt import (
    LEAST_DEPTH,
    NOTHING,
    Array,
    Local,
    descend,
    project_with_slopes,
)
from animal3dbox.labels.pose.multi_start_search import CAUCHY_95, Candidates, median
from animal3dbox.labels.pose.problem import PoseProblem

MASK_SLACK_PX = 1.0
"""A mask's border is that of pixel centres, and tips thinner than a pixel fall between them.

Up to 0.8 px (benchmarks/masks_and_visibility.py).
"""
ROUNDS = (2, 14, 24)
BEHIND = 1.5
"""Times the least cost: what a pose may cost more and still be refined further."""
BAND = 0.06
"""Of the body's extent in the picture.

Points so near to its bounds are watched while the pose moves.
"""
LEAST_CURVATURE = 0.05
"""Of a residual's weight.

The Cauchy loss bends down beyond its width, which a descent must not follow.
"""
BOUNDS_PX = 1e-7
"""Bounds that differ by less are the same."""
SIDES = (0, 1, 0, 1)
"""Which coordinate left, top, right and bottom are."""
ONE_COORDINATE = np.eye(2)[:, SIDES]


@dataclass(frozen=True)
class Joint:
    """Keypoints and bounds; every coordinate's residual has its own Cauchy loss of width CAUCHY_95.

    With a mask, the points that bound the body to the left, top, right and bottom are four more
    points, each of which has a target and a weight in one coordinate only.

    Attributes:
        points: (N, 3) landmarks, about their mean, in units of their spread.
        target: (2, N) keypoints about the principal point; (2, N + 4) with a mask, whose box is the
            last four's.
        by: (2, N) or (2, N + 4) 1 / px: what residuals are multiplied by.
        linear: (2, 2) K's upper left.
        cloud: (3, V) the points whose bounds are compared with the mask's; V = 0 without that term.
        watched: (B, 3, M) those of them that may bound the body near each pose.
    """

    points: Array
    target: Array
    by: Array
    linear: Array
    cloud: Array
    watched: Array

    @property
    def has_bounds(self) -> bool:
        """Whether the mask's box counts."""
        return bool(self.cloud.size)

    def local(self, R: Array, t: Array) -> Local:
        """The cost of poses and its derivatives."""
        off, slopes, allowed = self.residuals(R, t)
        square = (off / CAUCHY_95) ** 2
        weight = 1 / (1 + square)
        curvature = weight * np.maximum((1 - square) * weight, LEAST_CURVATURE)
        cost = CAUCHY_95**2 / 2 * np.log1p(square).sum(-1)
        A, b = (
            (slopes * curvature[:, None]) @ slopes.mT,
            (slopes @ (weight * off)[..., None])[..., 0],
        )
        return Local(np.where(allowed, cost, np.inf), A, b)

    def residuals(self, R: Array, t: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Residuals (B, D) coordinate by coordinate, what a step does to them (B, 6, D), and
        whether the landmarks are before the camera (B,)."""
        points, count = self.points, len(self.points)
        if self.has_bounds:
            points = np.concatenate(
                (np.broadcast_to(points, (len(R), count, 3)), self._outermost(R, t)), 1
            )
        off, slopes, depth = project_with_slopes(points, self.linear, R, t)
        off -= self.target
        if self.has_bounds:  # how far they are beyond the mask's, as the paper's d_bbox
            beyond = off[..., count:]
            beyond -= np.minimum(np.maximum(beyond, -MASK_SLACK_PX), MASK_SLACK_PX)
            slopes[..., count:] *= (beyond != 0)[:, None]
        off *= self.by
        slopes *= self.by
        return (
            off.reshape(len(R), -1),
            slopes.reshape(len(R), 6, -1),
            depth[:, :count].min(-1) > LEAST_DEPTH,
        )

    def _flat(self, points: Array, R: Array, t: Array) -> Array:
        """Where points (3, M) or (B, 3, M) stand in the picture about its principal point, (B, 2,
        M)."""
        lens = np.eye(3)
        lens[:2, :2] = self.linear
        cam = lens @ R @ points
        cam += (t @ lens.T)[..., None]
        flat: Array = cam[:, :2]
        flat /= np.maximum(cam[:, 2:], 1e-9)
        return flat

    def _outermost(self, R: Array, t: Array) -> Array:
        """The watched points (B, 4, 3) that bound the body to the left, top, right and bottom."""
        flat = self._flat(self.watched, R, t)
        ids = np.concatenate((flat.argmin(-1), flat.argmax(-1)), -1)
        outermost: Array = self.watched[np.arange(len(R))[:, None], :, ids]
        return outermost

    def watching(self, R: Array, t: Array) -> "Joint":
        """The same, watching the points that bound the body near other poses."""
        if not self.has_bounds:
            return self
        flat = self._flat(self.cloud, R, t)
        least, greatest = flat.min(-1)[..., None], flat.max(-1)[..., None]
        band = BAND * (greatest - least)
        outer = ((flat < least + band) | (flat > greatest - band)).any(1)
        ids = [np.flatnonzero(row) for row in outer]
        most = max(map(len, ids))
        return replace(
            self, watched=np.stack([self.cloud[:, np.resize(one, most)] for one in ids])
        )  # shorter ones say some twice

    def watches_enough(self, R: Array, t: Array, kept: NDArray[np.int64]) -> bool:
        """Whether at poses that started from those kept of the watched ones, no other point bounds
        the body."""
        if not self.has_bounds:
            return True
        of_all, of_watched = self._flat(self.cloud, R, t), self._flat(self.watched[kept], R, t)
        apart = np.maximum(of_watched.min(-1) - of_all.min(-1), of_all.max(-1) - of_watched.max(-1))
        return bool(apart.max() <= BOUNDS_PX)


def joint_of(problem: PoseProblem, scale: float, config: LabelConfig) -> Joint:
    """The joint cost of a problem about its own mean, in units of its own spread.

    Args:
        problem: without the mask term if the mask touches the border of the image.
        scale: how badly the body fits, see Candidates.
        config: lambda, and what is compared with the mask: by default the mesh.

    """
    K, sigma, points = problem.K.numpy(), problem.sigma_px.numpy(), problem.points_world.numpy()
    target, by_keypoint = (
        problem.points_px.numpy().T - K[:2, 2:],
        np.sqrt(config.lambda_keypoints) / (scale * sigma),
    )
    by = np.stack((by_keypoint, by_keypoint))
    extent = "none" if problem.is_cut or problem.mask_box is None else config.mask_box or "mesh"
    if problem.mask_box is None or extent == "none":
        return Joint(points, target, by, K[:2, :2], np.zeros((3, 0)), np.zeros((1, 3, 0)))
    cloud = (
        points
        if extent == "keypoints" or problem.vertices_world is None
        else problem.vertices_world.numpy()
    )
    by_bound = np.sqrt(1 - config.lambda_keypoints) / (scale * median(sigma))
    target = np.concatenate((target, ONE_COORDINATE * (problem.mask_box.numpy() - K[SIDES, 2])), 1)
    by = np.concatenate((by, by_bound * ONE_COORDINATE), 1)
    return Joint(points, target, by, K[:2, :2], cloud.T, np.zeros((1, 3, 0)))


def refine_jointly(
    problem: PoseProblem, candidates: Candidates, count: int, config: LabelConfig
) -> tuple[Array, Array, Array]:
    """The first candidates refined by the joint cost.

    Those that fall far behind the best are left on the way.

    Returns:
        R (B, 3, 3), t (B, 3) and costs (B,) of what is left, cheapest first; B is at least 1.

    """
    joint = joint_of(problem, candidates.scale, config)
    R, t = candidates.R[:count], candidates.t[:count]
    for rounds in ROUNDS if len(R) > 1 else ROUNDS[1:]:
        near = joint.watching(R, t)
        R, t, cost, settled = descend(near.local, R, t, rounds)
        order = np.argsort(cost, kind="stable")
        order = order[cost[order] <= BEHIND * cost[order[0]] + NOTHING]
        R, t, cost = R[order], t[order], cost[order]
        if settled and near.watches_enough(R, t, order):
            break
    return R, t, cost

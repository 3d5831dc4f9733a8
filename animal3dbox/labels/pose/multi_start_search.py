"""Many starting poses, all refined at once on the keypoints alone.

The hopeless ones are left behind on the way.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch

from animal3dbox.geometry.arrays import norm
from animal3dbox.geometry.camera import look_at
from animal3dbox.labels.pose.levenberg_marquardt import (
    LEAST_DEPTH,
    Array,
    Local,
    descend,
    project_with_slopes,
)
from animal3dbox.labels.pose.problem import PoseEstimate, PoseProblem

AZIMUTHS = 8
ELEVATIONS_DEG = (-20.0, 15.0, 50.0, 85.0)
SURE_GAIN = 1e-4
"""Relative gain in cost below which the descent from a sure start leaves the rest to the joint
cost's."""
WIDE_ROUNDS, MIDDLE_ROUNDS, NARROW_ROUNDS, LAST_ROUNDS = 2, 3, 3, 3
KEPT = 6
"""Poses that go on once the loss has begun to narrow."""
INITIAL_SCALE = 0.25
"""Of the keypoints' extent.

The robust loss starts this wide, so that far starts feel every keypoint, and narrows.
"""
CAUCHY_95 = 2.385
"""Width of the Cauchy loss in standard deviations at which it keeps 95 % of least squares'
efficiency on clean data."""
RAYLEIGH_MEDIAN = 1.1774
SURE_KEYPOINTS, SURE_EXTENT, SURE_DISTANCE = 10, 40.0, 4.0
"""So many keypoints, over so many sigma in the picture, each explained to so many sigma.

Another view could not do that too.
"""
APART = 0.05
"""Rotations that differ by less, in the Frobenius norm, are one."""


@dataclass(frozen=True)
class Sight:
    """Keypoints as the search takes them.

    Attributes:
        points: (N, 3) landmarks, about their mean, in units of their spread.
        pixels: (2, N) about the principal point.
        sigma: (N,) px.
        linear: (2, 2) K's upper left.
        width: of the Cauchy loss, in sigma.
    """

    points: Array
    pixels: Array
    sigma: Array
    linear: Array
    width: float

    def distances(self, R: Array, t: Array) -> Array:
        """Mahalanobis distances (B, N) of poses (B, 3, 3), (B, 3)."""
        cam = R @ self.points.T + t[..., None]
        px = self.linear @ (cam[:, :2] / np.maximum(cam[:, 2:], 1e-9))
        return norm((px - self.pixels).swapaxes(-1, -2)) / self.sigma

    def local(self, R: Array, t: Array) -> Local:
        """The Cauchy loss of each keypoint's distance, summed, and its derivatives by reweighting."""
        off, slopes, depth = project_with_slopes(self.points, self.linear, R, t)
        off -= self.pixels
        off /= self.sigma
        square = (off * off).sum(1) / self.width**2
        cost = self.width**2 / 2 * np.log1p(square).sum(-1)
        root = np.sqrt(1 / (1 + square))[
            :, None
        ]  # of the weight: half of it to either factor of A and b
        off *= root
        slopes *= (root / self.sigma)[:, None]
        slopes = slopes.reshape(len(R), 6, -1)
        allowed = depth.min(-1) > LEAST_DEPTH
        return Local(
            np.where(allowed, cost, np.inf),
            slopes @ slopes.mT,
            (slopes @ off.reshape(len(R), -1, 1))[..., 0],
        )


@dataclass(frozen=True)
class Candidates:
    """Poses found, best first.

    Attributes:
        R: (B, 3, 3).
        t: (B, 3).
        names: (B,) the starts they came from.
        scale: standard deviation of the residuals over the keypoints' own, at least 1; how badly
            the body fits.
    """

    R: Array
    t: Array
    names: tuple[str, ...]
    scale: float


def median(values: Array) -> float:
    """Of values (N,): np.median, which takes five times as long for so few."""
    ordered = np.sort(values)
    return float(ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


def _views() -> Array:
    """R_cam_box (B, 3, 3) of cameras all round a body, its back up in the picture."""
    azimuth, elevation = torch.meshgrid(
        torch.arange(AZIMUTHS, dtype=torch.float64) * (2 * math.pi / AZIMUTHS),
        torch.deg2rad(torch.tensor(ELEVATIONS_DEG, dtype=torch.float64)),
        indexing="ij",
    )
    azimuth, elevation = azimuth.flatten(), elevation.flatten()
    eyes = torch.stack(
        (
            torch.cos(elevation) * torch.cos(azimuth),
            torch.cos(elevation) * torch.sin(azimuth),
            torch.sin(elevation),
        ),
        dim=-1,
    )
    return look_at(eyes, torch.zeros_like(eyes), torch.tensor([0.0, 0, 1], dtype=torch.float64))[
        :, :3, :3
    ].numpy()


VIEWS = _views()


def weak_perspective_translation(sight: Sight, R: Array) -> Array:
    """t_cam_world (B, 3) that puts rotated landmarks over the keypoints at about the right size.

    Medians and median absolute deviations, so that single wild keypoints do not decide.
    """
    turned = R @ sight.points.T  # (B, 3, N)
    rays = np.linalg.solve(sight.linear, sight.pixels)
    middle_3d, middle_2d = np.median(turned[:, :2], -1), np.median(rays, -1)
    spread_3d = np.median(norm((turned[:, :2] - middle_3d[..., None]).swapaxes(-1, -2)), -1)
    spread_2d = float(np.median(norm((rays - middle_2d[:, None]).T)))
    middle_depth = turned[:, 2].mean(-1)
    depth = np.maximum(spread_3d / max(spread_2d, 1e-9), 1e-3) - middle_depth
    depth = np.maximum(depth, 4 * LEAST_DEPTH - turned[:, 2].min(-1))
    return np.concatenate(
        (middle_2d * (depth + middle_depth)[:, None] - middle_3d, depth[:, None]), -1
    )


def _sight(problem: PoseProblem) -> tuple[Sight, float]:
    """Keypoints under the loss at its widest, and their extent in sigma."""
    K, sigma = problem.K.numpy(), problem.sigma_px.numpy()
    pixels = problem.points_px.numpy().T
    extent = float((pixels.max(1) - pixels.min(1)).max()) / median(sigma)
    widest = max(INITIAL_SCALE * extent, CAUCHY_95)
    return Sight(problem.points_world.numpy(), pixels - K[:2, 2:], sigma, K[:2, :2], widest), extent


def search_poses(problem: PoseProblem, starts: Iterable[PoseEstimate]) -> Candidates:
    """Refine the given starts and, unless one of them is beyond doubt, a grid of views.

    Robust, keypoints only.

    Args:
        problem: about its own mean, in units of its own spread.
        starts: poses worth trying, taken one by one and none after one beyond doubt.

    Returns:
        The different poses found, best first.

    """
    sight, extent = _sight(problem)
    tried = list[PoseEstimate]()
    for start in starts:
        found = _beyond_doubt(sight, extent, start)
        if found is not None:
            return found
        tried.append(start)
    return _found_among_views(sight, problem.R_box.numpy(), tried)


def _found_among_views(sight: Sight, R_box: Array, starts: list[PoseEstimate]) -> Candidates:
    """The best of the starts and of views from all round a body with these axes (3, 3), refined."""
    R_views = VIEWS @ R_box.T
    t_views = weak_perspective_translation(sight, R_views)
    names = *(start.hypothesis for start in starts), *(f"view_{i}" for i in range(len(R_views)))
    R, t = (
        np.stack([*(start.R.numpy() for start in starts), *R_views]),
        np.stack([*(start.t.numpy() for start in starts), *t_views]),
    )
    R, t, *_ = descend(sight.local, R, t, WIDE_ROUNDS)
    middle = replace(sight, width=math.sqrt(sight.width * CAUCHY_95))
    R, t, cost, _ = descend(middle.local, R, t, MIDDLE_ROUNDS)
    kept = _different(R, cost, KEPT)
    narrow = replace(sight, width=CAUCHY_95)
    R, t, *_ = descend(narrow.local, R[kept], t[kept], NARROW_ROUNDS)
    scale = max(1.0, float(np.median(narrow.distances(R, t), -1).min()) / RAYLEIGH_MEDIAN)
    R, t, cost, _ = descend(replace(sight, width=CAUCHY_95 * scale).local, R, t, LAST_ROUNDS)
    best = _different(R, cost, KEPT)
    return Candidates(R[best], t[best], tuple(names[kept[i]] for i in best), scale)


def _beyond_doubt(sight: Sight, extent: float, start: PoseEstimate) -> Candidates | None:
    """The start refined, if it explains so many keypoints so well that no other view can."""
    if len(sight.sigma) < SURE_KEYPOINTS or extent < SURE_EXTENT:
        return None
    narrow = replace(sight, width=CAUCHY_95)
    R, t = start.R.numpy()[None], start.t.numpy()[None]
    if not narrow.distances(R, t).max() < 2 * SURE_DISTANCE:
        return None
    R, t, cost, _ = descend(narrow.local, R, t, NARROW_ROUNDS, SURE_GAIN)
    off = narrow.distances(R, t)
    if not np.isfinite(cost[0]) or off.max() > SURE_DISTANCE:
        return None
    return Candidates(R, t, (start.hypothesis,), max(1.0, median(off[0]) / RAYLEIGH_MEDIAN))


def _different(R: Array, cost: Array, most: int) -> list[int]:
    """The cheapest of each group of like rotations (B, 3, 3), cheapest first, at most so many."""
    apart = ((R[:, None] - R[None]) ** 2).sum((-2, -1)) > APART**2
    kept: list[int] = []
    for i in np.argsort(cost, kind="stable").tolist():
        if len(kept) < most and apart[i, kept].all():
            kept.append(i)
    return kept

"""The search of method "default": many starting poses, refined all at once on the keypoints alone.

Hopeless ones are left behind on the way. docs/solver.md has the cost, its loss and the schedule.
"""

import math
from collections.abc import Iterable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import norm
from animal3dbox.geometry.view_sphere import orbit_rotations
from animal3dbox.labels.pose.levenberg_marquardt import (
    LEAST_DEPTH,
    CameraPoses,
    LocalModel,
    descend,
    project_with_slopes,
)
from animal3dbox.labels.pose.problem import PoseEstimate, PoseProblem

Array = NDArray[np.float64]
AZIMUTHS = 8
ELEVATIONS_DEG = (-20.0, 15.0, 50.0, 85.0)
SURE_GAIN = 1e-4
"""Relative gain in cost at which the descent of a start beyond doubt ends: refine_jointly does the
rest."""
WIDE_ROUNDS, MIDDLE_ROUNDS, NARROW_ROUNDS, LAST_ROUNDS = 2, 3, 3, 3
SURVIVORS = 6
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
"""A start is beyond doubt if SURE_KEYPOINTS keypoints or more, spread over SURE_EXTENT sigma in the
picture, all lie within SURE_DISTANCE sigma: no other view could do that too."""
APART, SETTLED_APART = 0.05, 0.35
"""Rotations that differ by less, in the Frobenius norm, are one: on the way, and at its end (14
degrees), when like starts have come together."""
NEAREST_VIEW, VIEW_CLEARANCE = 1e-3, 4
"""Least mean depth of the landmarks at a view's start, in the unit frame; each is at least
VIEW_CLEARANCE * LEAST_DEPTH deep."""
VIEWS = orbit_rotations(AZIMUTHS, ELEVATIONS_DEG)
"""R_cam_box (B, 3, 3) of cameras all round a body, its back up in the picture."""


def search_poses(
    problem: PoseProblem, starts: Iterable[PoseEstimate]
) -> tuple[list[PoseEstimate], float]:
    """Refine starting poses and, unless one of them is beyond doubt, a grid of views.

    Robust, by the keypoints only.

    Args:
        problem: about its own mean, in units of its own spread.
        starts: poses worth trying, taken one by one and none after one beyond doubt.

    Returns:
        candidates: the different poses, best first.
        misfit: the least median Mahalanobis distance of the poses over RAYLEIGH_MEDIAN, at least
            1: how many times larger the residuals are than the keypoints' own noise.

    """
    extent = _extent_in_sigma(problem)
    tried = list[PoseEstimate]()
    for start in starts:
        sure = _beyond_doubt(problem, extent, start)
        if sure is not None:
            return sure
        tried.append(start)
    return _best_of_views(problem, extent, tried)


def keypoint_distances(
    problem: PoseProblem, poses: CameraPoses, points: Array | None = None
) -> Array:
    """Mahalanobis distances (B, N) of the keypoints under B poses; points as for keypoint_cost."""
    points = problem.points_world if points is None else points
    cam = poses.R @ points.mT + poses.t[..., None]
    px = problem.linear @ (cam[:, :2] / np.maximum(cam[:, 2:], 1e-9))
    return norm((px - problem.pixels).swapaxes(-1, -2)) / problem.sigma_px


def body_misfit(problem: PoseProblem, poses: CameraPoses) -> float:
    """How many times larger the residuals are than the keypoints' own noise, at least 1.

    Unlike the misfit of search_poses it counts what the landmarks may be off on the body, too. It
    is that of the pose with the least median.
    """
    noise = problem.sigma_px if problem.noise_px is None else problem.noise_px
    in_noise = keypoint_distances(problem, poses) * (problem.sigma_px / noise)
    return max(1.0, float(np.median(in_noise, -1).min()) / RAYLEIGH_MEDIAN)


def keypoint_cost(
    problem: PoseProblem, width: float, poses: CameraPoses, points: Array | None = None
) -> LocalModel:
    """The Cauchy loss of each keypoint's distance, summed, and its derivatives by reweighting.

    rho(d) = width^2 / 2 log(1 + d^2 / width^2), d the Mahalanobis distance of a keypoint.

    Args:
        problem: about its own mean, in units of its own spread.
        width: of the loss, in sigma.
        poses: B of them.
        points: (B, N, 3) of each pose's own; None: the problem's.

    """
    points = problem.points_world if points is None else points
    residuals, slopes, depth = project_with_slopes(points, problem.linear, poses)
    residuals -= problem.pixels
    residuals /= problem.sigma_px
    square = (residuals * residuals).sum(1) / width**2
    cost = width**2 / 2 * np.log1p(square).sum(-1)
    # The square root of the weight 1 / (1 + d^2 / width^2), one for either factor of A and b.
    root = np.sqrt(1 / (1 + square))[:, None]
    residuals *= root
    slopes *= (root / problem.sigma_px)[:, None]
    slopes = slopes.reshape(len(poses), slopes.shape[1], -1)
    in_front = depth.min(-1) > LEAST_DEPTH
    gradient = (slopes @ residuals.reshape(len(poses), -1, 1))[..., 0]
    return LocalModel(np.where(in_front, cost, np.inf), slopes @ slopes.mT, gradient)


def weak_perspective_translation(problem: PoseProblem, R: Array) -> Array:
    """t_cam_world (B, 3) that puts rotated landmarks over the keypoints at about the right size.

    Medians and median absolute deviations, so that single wild keypoints do not decide.
    """
    rotated = R @ problem.points_world.T  # (B, 3, N)
    rays = np.linalg.solve(problem.linear, problem.pixels)
    middle_3d, middle_2d = np.median(rotated[:, :2], -1), np.median(rays, -1)
    spread_3d = np.median(norm((rotated[:, :2] - middle_3d[..., None]).swapaxes(-1, -2)), -1)
    spread_2d = float(np.median(norm((rays - middle_2d[:, None]).T)))
    middle_depth = rotated[:, 2].mean(-1)
    depth = np.maximum(spread_3d / max(spread_2d, 1e-9), NEAREST_VIEW) - middle_depth
    depth = np.maximum(depth, VIEW_CLEARANCE * LEAST_DEPTH - rotated[:, 2].min(-1))
    return np.concatenate(
        (middle_2d * (depth + middle_depth)[:, None] - middle_3d, depth[:, None]), -1
    )


def _extent_in_sigma(problem: PoseProblem) -> float:
    """The longer side of the keypoints' box, in units of their median sigma."""
    extent_px = (problem.points_px.max(0) - problem.points_px.min(0)).max()
    return float(extent_px) / float(np.median(problem.sigma_px))


def _best_of_views(
    problem: PoseProblem, extent: float, starts: list[PoseEstimate]
) -> tuple[list[PoseEstimate], float]:
    """The starts and views from all round the body, refined: the different poses and the misfit."""
    R_views = VIEWS @ problem.R_box.T
    t_views = weak_perspective_translation(problem, R_views)
    names = (*(start.hypothesis for start in starts), *(f"view_{i}" for i in range(len(R_views))))
    poses = CameraPoses(
        np.stack([*(start.R for start in starts), *R_views]),
        np.stack([*(start.t for start in starts), *t_views]),
    )
    widest = max(INITIAL_SCALE * extent, CAUCHY_95)
    poses, *_ = descend(partial(keypoint_cost, problem, widest), poses, WIDE_ROUNDS)
    middle = math.sqrt(widest * CAUCHY_95)
    poses, local, _ = descend(partial(keypoint_cost, problem, middle), poses, MIDDLE_ROUNDS)
    survivors = _different_rotations(poses.R, local.cost, SURVIVORS)
    poses = poses[survivors]
    poses, *_ = descend(partial(keypoint_cost, problem, CAUCHY_95), poses, NARROW_ROUNDS)
    best_median = float(np.median(keypoint_distances(problem, poses), -1).min())
    misfit = max(1.0, best_median / RAYLEIGH_MEDIAN)
    cost_of = partial(keypoint_cost, problem, CAUCHY_95 * misfit)
    poses, local, _ = descend(cost_of, poses, LAST_ROUNDS)
    order = _different_rotations(poses.R, local.cost, SURVIVORS, apart=SETTLED_APART)
    return [PoseEstimate(poses.R[i], poses.t[i], names[survivors[i]]) for i in order], misfit


def _beyond_doubt(
    problem: PoseProblem, extent: float, start: PoseEstimate
) -> tuple[list[PoseEstimate], float] | None:
    """The start refined, if it explains so many keypoints so well that no other view can."""
    if len(problem.sigma_px) < SURE_KEYPOINTS or extent < SURE_EXTENT:
        return None
    pose = CameraPoses(start.R[None], start.t[None])
    if not keypoint_distances(problem, pose).max() < 2 * SURE_DISTANCE:
        return None
    pose, local, _ = descend(
        partial(keypoint_cost, problem, CAUCHY_95), pose, NARROW_ROUNDS, gain=SURE_GAIN
    )
    distances = keypoint_distances(problem, pose)
    if not np.isfinite(local.cost[0]) or distances.max() > SURE_DISTANCE:
        return None
    misfit = max(1.0, float(np.median(distances[0])) / RAYLEIGH_MEDIAN)
    return [PoseEstimate(pose.R[0], pose.t[0], start.hypothesis)], misfit


def _different_rotations(R: Array, cost: Array, most: int, *, apart: float = APART) -> list[int]:
    """The cheapest of each group of like rotations (B, 3, 3), cheapest first, at most so many."""
    differ = ((R[:, None] - R[None]) ** 2).sum((-2, -1)) > apart**2
    chosen: list[int] = []
    for i in np.argsort(cost, kind="stable").tolist():
        if len(chosen) < most and differ[i, chosen].all():
            chosen.append(i)
    return chosen

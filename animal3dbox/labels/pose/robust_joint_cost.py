"""The robust joint cost of method "default": keypoints, and the body's bounds against the mask's.

Batched over poses; every coordinate's residual has its own Cauchy loss of width CAUCHY_95.
docs/solver.md has the formulas.
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.config import LabelConfig, MaskBox
from animal3dbox.labels.pose.levenberg_marquardt import (
    LEAST_DEPTH,
    NOTHING,
    LocalModel,
    descend,
    project_with_slopes,
)
from animal3dbox.labels.pose.multi_start_search import CAUCHY_95
from animal3dbox.labels.pose.problem import PoseEstimate, PoseProblem

Array = NDArray[np.float64]
MASK_SLACK_PX = 1.0
"""A mask's border is that of pixel centres, and tips thinner than a pixel fall between them.

Up to 0.8 px (benchmarks/masks_and_visibility.py).
"""
ROUNDS = (2, 14, 24)
BEHIND = 1.5
"""Times the least cost: what a pose may cost more and still be refined further."""
BAND = 0.06
"""Of the body's extent in the picture: vertices so near to its bounds can come to bound it while
the pose moves a little."""
LEAST_CURVATURE = 0.05
"""Of a residual's weight.

The Cauchy loss bends down beyond its width, which a descent must not follow.
"""
BOUNDS_PX = 1e-7
"""Bounds that differ by less are the same."""
SIDES = (0, 1, 0, 1)
"""Which coordinate left, top, right and bottom are."""
ONE_COORDINATE = np.eye(2)[:, SIDES]


def refine_jointly(
    problem: PoseProblem, candidates: list[PoseEstimate], misfit: float, config: LabelConfig
) -> list[PoseEstimate]:
    """Candidate poses refined by the joint cost, cheapest first.

    Those that fall far behind the best are left on the way; at least one remains.

    Args:
        problem: about its own mean, in units of its own spread.
        candidates: at least one.
        misfit: how badly the body fits, see search_poses.
        config: lambda, and what is compared with the mask: by default the mesh.

    """
    targets, weights = joint_terms(problem, misfit, config)
    body_points = bounded_points(problem, config)
    names = [pose.hypothesis for pose in candidates]
    R = np.stack([pose.R for pose in candidates])
    t = np.stack([pose.t for pose in candidates])
    for rounds in ROUNDS if len(R) > 1 else ROUNDS[1:]:
        outline = outline_candidates(problem, body_points, R, t)
        cost_of = partial(joint_cost, problem, targets=targets, weights=weights, outline=outline)
        R, t, cost, settled = descend(cost_of, R, t, rounds)
        order = np.argsort(cost, kind="stable")
        order = order[cost[order] <= BEHIND * cost[order[0]] + NOTHING]
        R, t, names = R[order], t[order], [names[i] for i in order.tolist()]
        if settled and outline_is_complete(problem, body_points, R, t, outline=outline[order]):
            break
    return [PoseEstimate(R[i].copy(), t[i].copy(), name) for i, name in enumerate(names)]


def joint_terms(problem: PoseProblem, misfit: float, config: LabelConfig) -> tuple[Array, Array]:
    """The targets and weights of the joint cost's residuals.

    With a mask, the points that bound the body to the left, top, right and bottom are four more
    points, each of which has a target and a weight in one coordinate only.

    Args:
        problem: about its own mean, in units of its own spread.
        misfit: how badly the body fits, see search_poses.
        config: lambda, and whether the mask counts.

    Returns:
        targets: (2, N) keypoints about the principal point; (2, N + 4) with a mask, whose box is
            the last four's.
        weights: (2, N) or (2, N + 4) in 1 / px, by which residuals are multiplied.

    """
    sigma = problem.sigma_px
    by_keypoint = np.sqrt(config.lambda_keypoints) / (misfit * sigma)
    weights = np.stack((by_keypoint, by_keypoint))
    if problem.mask_box is None or _extent(problem, config) == "none":
        return problem.pixels, weights
    by_bound = np.sqrt(1 - config.lambda_keypoints) / (misfit * float(np.median(sigma)))
    bounds = ONE_COORDINATE * (problem.mask_box - problem.K[SIDES, 2])
    targets = np.concatenate((problem.pixels, bounds), 1)
    return targets, np.concatenate((weights, by_bound * ONE_COORDINATE), 1)


def bounded_points(problem: PoseProblem, config: LabelConfig) -> Array:
    """The points (3, V) whose bounds are compared with the mask's; V = 0 without that term."""
    extent = _extent(problem, config)
    if extent == "none":
        return np.zeros((3, 0))
    if extent == "keypoints" or problem.vertices_world is None:
        return problem.points_world.T
    return problem.vertices_world.T


def _extent(problem: PoseProblem, config: LabelConfig) -> MaskBox:
    """What is compared with the mask: nothing, if it touches the border of the image."""
    if problem.is_cut or problem.mask_box is None:
        return "none"
    return config.mask_box or "mesh"


def joint_cost(
    problem: PoseProblem, R: Array, t: Array, *, targets: Array, weights: Array, outline: Array
) -> LocalModel:
    """The joint cost of poses and its derivatives.

    The sum over all coordinates of the Cauchy loss of residual times weight,
    rho(r) = c^2 / 2 log(1 + r^2 / c^2) with c = CAUCHY_95.

    Args:
        problem: about its own mean, in units of its own spread.
        R: (B, 3, 3).
        t: (B, 3).
        targets: see joint_terms.
        weights: see joint_terms.
        outline: (B, 3, M) see outline_candidates.

    """
    residuals, slopes, in_front = joint_residuals(
        problem, R, t, targets=targets, weights=weights, outline=outline
    )
    square = (residuals / CAUCHY_95) ** 2
    weight = 1 / (1 + square)
    curvature = weight * np.maximum((1 - square) * weight, LEAST_CURVATURE)
    cost = CAUCHY_95**2 / 2 * np.log1p(square).sum(-1)
    A = (slopes * curvature[:, None]) @ slopes.mT
    b = (slopes @ (weight * residuals)[..., None])[..., 0]
    return LocalModel(np.where(in_front, cost, np.inf), A, b)


def joint_residuals(
    problem: PoseProblem, R: Array, t: Array, *, targets: Array, weights: Array, outline: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Weighted residuals of poses, coordinate by coordinate; arguments as in joint_cost.

    Returns:
        residuals: (B, D).
        slopes: (B, 6, D) their derivatives by a step.
        in_front: (B,) whether all landmarks are before the camera.

    """
    points, count = problem.points_world, len(problem.points_world)
    has_bounds = outline.shape[-1] > 0
    if has_bounds:
        landmarks = np.broadcast_to(points, (len(R), count, 3))
        points = np.concatenate((landmarks, _outermost(problem, outline, R, t)), 1)
    residuals, slopes, depth = project_with_slopes(points, problem.linear, R, t)
    residuals -= targets
    if has_bounds:  # how far they are beyond the mask's, as the paper's d_bbox
        beyond = residuals[..., count:]
        beyond -= np.minimum(np.maximum(beyond, -MASK_SLACK_PX), MASK_SLACK_PX)
        slopes[..., count:] *= (beyond != 0)[:, None]
    residuals *= weights
    slopes *= weights
    return (
        residuals.reshape(len(R), -1),
        slopes.reshape(len(R), 6, -1),
        depth[:, :count].min(-1) > LEAST_DEPTH,
    )


def outline_candidates(problem: PoseProblem, body_points: Array, R: Array, t: Array) -> Array:
    """The few points (B, 3, M) that can bound the body near these poses.

    The bounding box of all projected points is set by four of them. While a pose moves a little,
    only points within BAND of the box's sides can take over, so the descent projects those instead
    of the whole mesh. `outline_is_complete` checks afterwards that no other point sticks out; if
    one does, the search goes on from there. Rows with fewer candidates repeat some of theirs.

    Args:
        problem: about its own mean, in units of its own spread.
        body_points: (3, V) see bounded_points.
        R: (B, 3, 3).
        t: (B, 3).

    """
    if not body_points.size:
        return np.zeros((len(R), 3, 0))
    px = _pixels(problem, body_points, R, t)
    least, greatest = px.min(-1)[..., None], px.max(-1)[..., None]
    band = BAND * (greatest - least)
    near_a_side = ((px < least + band) | (px > greatest - band)).any(1)
    ids = [np.flatnonzero(row) for row in near_a_side]
    most = max(map(len, ids))
    return np.stack([body_points[:, np.resize(row, most)] for row in ids])


def outline_is_complete(
    problem: PoseProblem, body_points: Array, R: Array, t: Array, *, outline: Array
) -> bool:
    """Whether the outline alone has the bounds of the whole body, within BOUNDS_PX."""
    if not body_points.size:
        return True
    of_body, of_outline = (_pixels(problem, points, R, t) for points in (body_points, outline))
    apart = np.maximum(of_outline.min(-1) - of_body.min(-1), of_body.max(-1) - of_outline.max(-1))
    return bool(apart.max() <= BOUNDS_PX)


def _pixels(problem: PoseProblem, points: Array, R: Array, t: Array) -> Array:
    """Where points (3, M) or (B, 3, M) are seen about the principal point, (B, 2, M)."""
    lens = np.eye(3)
    lens[:2, :2] = problem.linear
    cam = lens @ R @ points
    cam += (t @ lens.T)[..., None]
    px: Array = cam[:, :2]
    px /= np.maximum(cam[:, 2:], 1e-9)
    return px


def _outermost(problem: PoseProblem, outline: Array, R: Array, t: Array) -> Array:
    """The points (B, 4, 3) of the outline that are farthest left, up, right and down."""
    px = _pixels(problem, outline, R, t)
    ids = np.concatenate((px.argmin(-1), px.argmax(-1)), -1)
    outermost: Array = outline[np.arange(len(R))[:, None], :, ids]
    return outermost

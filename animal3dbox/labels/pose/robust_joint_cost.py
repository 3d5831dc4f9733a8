"""The robust joint cost of method "default": keypoints, and how far the body reaches in the mask.

Batched over poses; every residual has its own Cauchy loss of width CAUCHY_95. docs/solver.md has
the formulas.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.config import LabelConfig, MaskBox
from animal3dbox.labels.pose.levenberg_marquardt import (
    LEAST_DEPTH,
    CameraPoses,
    LocalModel,
    descend,
    project_with_slopes,
)
from animal3dbox.labels.pose.multi_start_search import CAUCHY_95, body_misfit
from animal3dbox.labels.pose.problem import PoseProblem

Array = NDArray[np.float64]
SUPPORT_SIGMA_PX = 0.7
"""Standard deviation of a mask's support about the true body's, of one that fits."""
MISFIT_POWER = 4
"""The power of the misfit that a support's standard deviation grows with: a body that does not fit
its keypoints fits the outline still less (the rows of misfits in benchmarks/foreign_world.py)."""
USUAL_LAMBDA = 0.8
"""The lambda_keypoints at which residuals are in standard deviations."""
ROUNDS = (2, 14, 24)
BEHIND, BEHIND_AT_MOST = 1.5, 12.0
"""What a pose may cost and still be refined further: BEHIND times the least cost and
BEHIND_AT_MOST."""
BAND = 0.02
"""Of the body's extent in the picture: vertices so near to a support can come to be it while the
pose moves a little."""
JOINT_GAIN = 1e-3
"""Relative gain in cost below which a pose has settled: a cost of ten then moves it by less than a
seventh of its standard deviation."""
LEAST_CURVATURE = 0.5
"""Of a residual's weight.

The Cauchy loss bends down beyond its width, which a descent must not follow.
"""
BOUNDS_PX = 1e-7
"""Supports that differ by less are the same."""
ZOOM_SIGMA = 0.7
"""Standard deviation of the logarithm of a focal length that is not known, about the guess."""


@dataclass(frozen=True)
class JointTerms:
    """What the joint cost compares poses with.

    Attributes:
        weights: (N,) 1 / px, by which the keypoints' residuals are multiplied.
        body: (3, V) the points whose supports are compared with the mask's; V = 0 without that
            term.
        directions: (D, 2) unit, of the supports; D = 0 without a mask.
        heights: (D,) px about the principal point.
        support_weight: 1 / px, of the supports' residuals.
        mask_share: 1 at the usual lambda, by which all residuals of masks are multiplied.
    """

    weights: Array
    body: Array
    directions: Array
    heights: Array
    support_weight: float
    mask_share: float

    @property
    def of_keypoints(self) -> "JointTerms":
        """The same without the mask's supports."""
        nothing = np.zeros((3, 0)), np.zeros((0, 2)), np.zeros(0)
        return replace(self, body=nothing[0], directions=nothing[1], heights=nothing[2])


@dataclass(frozen=True)
class RefinedPoses:
    """Poses at the least of the joint cost, cheapest first.

    Attributes:
        poses: B of them.
        ids: (B,) the candidate that each came from.
        local: their costs, and the costs' curvature.
    """

    poses: CameraPoses
    ids: NDArray[np.intp]
    local: LocalModel


def refine_jointly(
    problem: PoseProblem, candidates: CameraPoses, misfit: float, config: LabelConfig
) -> RefinedPoses:
    """Candidate poses refined by the joint cost, cheapest first.

    Those that fall far behind the best are left on the way; at least one remains.

    Args:
        problem: about its own mean, in units of its own spread.
        candidates: at least one; with a zoom if the focal length is not known.
        misfit: how badly the body fits, see search_poses.
        config: lambda, and what is compared with the mask: by default the mesh.

    """
    terms = joint_terms(problem, misfit, body_misfit(problem, candidates), config=config)
    poses, ids = candidates, np.arange(len(candidates))
    for rounds in ROUNDS if len(poses) > 1 else ROUNDS[1:]:
        outline = outline_candidates(problem, terms, poses)
        cost_of = partial(joint_cost, problem, terms=terms, outline=outline)
        poses, local, settled = descend(cost_of, poses, rounds, gain=JOINT_GAIN)
        order = np.argsort(local.cost, kind="stable")
        least = local.cost[order[0]]
        order = order[local.cost[order] <= BEHIND * least + BEHIND_AT_MOST]
        poses, ids, outline = poses[order], ids[order], outline[order]
        local = local[order]
        if settled and outline_is_complete(problem, terms, poses, outline=outline):
            break
    return RefinedPoses(poses, ids, local)


def pose_covariance(problem: PoseProblem, pose: CameraPoses, local: LocalModel) -> Array:
    """The covariance (6, 6) of a step (w, d) from one refined pose, by the cost's curvature.

    Where the focal length was estimated before, its standard deviation is propagated: with A and a
    the curvature of the pose and its product with the zoom's, the inverse of A plus s^2 g g^T,
    g = A^-1 a.
    """
    A = local.A[0]
    spread: Array = np.linalg.pinv(A, hermitian=True)
    if problem.log_focal_sd is None:
        return spread
    zoomed = CameraPoses(pose.R, pose.t, np.zeros(1))
    _, slopes, _ = project_with_slopes(problem.points_world, problem.linear, zoomed)
    slopes = (slopes / problem.sigma_px)[0].reshape(7, -1)
    by_zoom = np.linalg.lstsq(slopes[:6].T, -slopes[6], rcond=None)[0]
    return spread + problem.log_focal_sd**2 * np.outer(by_zoom, by_zoom)


def joint_terms(
    problem: PoseProblem, misfit: float, misfit_of_body: float, *, config: LabelConfig
) -> JointTerms:
    """The weights of the joint cost, and the mask's supports.

    Args:
        problem: about its own mean, in units of its own spread.
        misfit: by which the keypoints' standard deviations are multiplied, see search_poses.
        misfit_of_body: by which those of the supports grow, see body_misfit.
        config: lambda, and whether the mask counts.

    """
    by_keypoints = np.sqrt(config.lambda_keypoints / USUAL_LAMBDA)
    by_mask = np.sqrt((1 - config.lambda_keypoints) / (1 - USUAL_LAMBDA))
    supports, extent = problem.mask_supports, _extent(problem, config)
    nothing = extent == "none" or supports is None
    body = np.zeros((3, 0))
    if not nothing:
        on_mesh = extent == "mesh" and problem.vertices_world is not None
        points = problem.vertices_world if on_mesh else problem.points_world
        body = np.zeros((3, 0)) if points is None else points.T
    directions, heights = np.zeros((0, 2)), np.zeros(0)
    if supports is not None and body.size:
        directions = supports.directions
        heights = supports.heights - directions @ problem.K[:2, 2]
    return JointTerms(
        weights=by_keypoints / (misfit * problem.sigma_px),
        body=body,
        directions=directions,
        heights=heights,
        mask_share=float(by_mask),
        support_weight=float(by_mask) / (SUPPORT_SIGMA_PX * misfit_of_body**MISFIT_POWER),
    )


def cost_at(
    problem: PoseProblem,
    poses: CameraPoses,
    misfit: float,
    *,
    misfit_of_body: float,
    config: LabelConfig,
) -> Array:
    """The joint cost (B,) of poses as it is, see joint_terms."""
    terms = joint_terms(problem, misfit, misfit_of_body, config=config)
    outline = outline_candidates(problem, terms, poses)
    return joint_cost(problem, poses, terms=terms, outline=outline).cost


def _extent(problem: PoseProblem, config: LabelConfig) -> MaskBox:
    """What is compared with the mask: nothing, without one or if the frame cuts it everywhere."""
    if problem.mask_supports is None:
        return "none"
    return config.mask_box or "mesh"


def joint_cost(
    problem: PoseProblem, poses: CameraPoses, *, terms: JointTerms, outline: Array
) -> LocalModel:
    """The joint cost of poses and its derivatives.

    The sum over all residuals of the Cauchy loss rho(r) = c^2 / 2 log(1 + r^2 / c^2) with
    c = CAUCHY_95, and half the square of the zoom's, if it is sought.

    Args:
        problem: about its own mean, in units of its own spread.
        poses: B of them.
        terms: see joint_terms.
        outline: (B, 3, M) see outline_candidates.

    """
    residuals, slopes, in_front = joint_residuals(problem, poses, terms=terms, outline=outline)
    local = robust_sum(residuals, slopes)
    cost, A, b = local.cost, local.A, local.b
    if poses.log_zoom is not None:
        in_sigma = poses.log_zoom / ZOOM_SIGMA
        cost = cost + in_sigma**2 / 2
        A[:, 6, 6] += 1 / ZOOM_SIGMA**2
        b[:, 6] += in_sigma / ZOOM_SIGMA
    return LocalModel(np.where(in_front, cost, np.inf), A, b)


def robust_sum(residuals: Array, slopes: Array) -> LocalModel:
    """The sum of the Cauchy losses of residuals (B, M) with slopes (B, P, M), and derivatives."""
    square = (residuals / CAUCHY_95) ** 2
    weight = 1 / (1 + square)
    curvature = weight * np.maximum((1 - square) * weight, LEAST_CURVATURE)
    return LocalModel(
        cost=CAUCHY_95**2 / 2 * np.log1p(square).sum(-1),
        A=(slopes * curvature[:, None]) @ slopes.mT,
        b=(slopes @ (weight * residuals)[..., None])[..., 0],
    )


def joint_residuals(
    problem: PoseProblem, poses: CameraPoses, *, terms: JointTerms, outline: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Weighted residuals of poses; arguments as in joint_cost.

    Returns:
        residuals: (B, 2 N + D).
        slopes: (B, P, 2 N + D) their derivatives by a step.
        in_front: (B,) whether all landmarks are before the camera.

    """
    points, count = problem.points_world, len(problem.points_world)
    has_supports = outline.shape[-1] > 0
    if has_supports:
        landmarks = np.broadcast_to(points, (len(poses), count, 3))
        points = np.concatenate((landmarks, _supporting(problem, outline, poses, terms)), 1)
    px, slopes, depth = project_with_slopes(points, problem.linear, poses)
    of_keypoints = (px[..., :count] - problem.pixels) * terms.weights
    residuals = of_keypoints.reshape(len(poses), -1)
    turned = (slopes[..., :count] * terms.weights).reshape(len(poses), slopes.shape[1], -1)
    if has_supports:
        along = terms.directions.T  # (2, D)
        reach = (px[..., count:] * along).sum(1) - terms.heights
        residuals = np.concatenate((residuals, terms.support_weight * reach), 1)
        by_support = (slopes[..., count:] * (terms.support_weight * along)).sum(2)
        turned = np.concatenate((turned, by_support), 2)
    return residuals, turned, depth[:, :count].min(-1) > LEAST_DEPTH


def outline_candidates(problem: PoseProblem, terms: JointTerms, poses: CameraPoses) -> Array:
    """The few points (B, 3, M) of the body that can support it near these poses.

    While a pose moves a little, only points within BAND of a support can take over, so the descent
    projects those instead of the whole mesh. `outline_is_complete` checks afterwards that no other
    point reaches farther; if one does, the search goes on from there. Rows with fewer candidates
    repeat some of theirs.

    Args:
        problem: about its own mean, in units of its own spread.
        terms: see joint_terms.
        poses: B of them.

    """
    if not len(terms.directions):
        return np.zeros((len(poses), 3, 0))
    px = projected(problem, terms.body, poses)
    band = BAND * (px.max(-1) - px.min(-1)).max(-1)
    reach = terms.directions @ px  # (B, D, V)
    near = (reach > reach.max(-1, keepdims=True) - band[:, None, None]).any(1)
    ids = [np.flatnonzero(row) for row in near]
    most = max(map(len, ids))
    return np.stack([terms.body[:, np.resize(row, most)] for row in ids])


def outline_is_complete(
    problem: PoseProblem, terms: JointTerms, poses: CameraPoses, *, outline: Array
) -> bool:
    """Whether the outline alone has the supports of the whole body, within BOUNDS_PX."""
    if not len(terms.directions):
        return True
    of_body, of_outline = (
        (terms.directions @ projected(problem, points, poses)).max(-1)
        for points in (terms.body, outline)
    )
    return bool((of_body - of_outline).max() <= BOUNDS_PX)


def projected(problem: PoseProblem, points: Array, poses: CameraPoses) -> Array:
    """Where points (3, M) or (B, 3, M) are seen about the principal point, (B, 2, M)."""
    lens = np.eye(3)
    lens[:2, :2] = problem.linear
    cam = lens @ poses.R @ points
    cam += (poses.t @ lens.T)[..., None]
    px: Array = cam[:, :2]
    px /= np.maximum(cam[:, 2:], 1e-9)
    if poses.log_zoom is not None:
        px *= np.exp(poses.log_zoom)[:, None, None]
    return px


def _supporting(
    problem: PoseProblem, outline: Array, poses: CameraPoses, terms: JointTerms
) -> Array:
    """The points (B, D, 3) of the outline that reach farthest in each direction."""
    ids = (terms.directions @ projected(problem, outline, poses)).argmax(-1)
    farthest: Array = outline[np.arange(len(poses))[:, None], :, ids]
    return farthest

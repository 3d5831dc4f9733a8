"""Batched Levenberg-Marquardt on camera, pose and shape together, by a loss from wide to narrow.

docs/solver.md has the cost and the schedule. Nothing here depends on how many hypotheses or animals
share a batch: rounds are counted, and products of matrices are stacked, one a hypothesis.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.fit_body import FitBody, PosedJoints
from animal3dbox.labels.fit.ground_term import add_ground_term
from animal3dbox.labels.fit.kinematics import (
    landmark_parts,
    slopes_by_shape,
    slopes_of_parts,
)
from animal3dbox.labels.fit.local_fit import LocalFit
from animal3dbox.labels.fit.problem import CAMERA, FOCAL_KNOWN_SD, FitProblem, FitState

Array = NDArray[np.float64]
LIMIT_SD_DEG = 5.0
"""How far a joint may go beyond its limit, as a standard deviation."""
FIRST_DAMP = 1e-2
DAMP_DOWN, DAMP_UP = 0.2, 6.0
LEAST_DAMP, MOST_DAMP = 1e-9, 1e9
NEAR_DISTANCE, DISTANCE_SD = 4.0, 0.3
"""Animals are seldom photographed from nearer, in their lengths; by which standard deviation of the
logarithm a nearer camera costs, where the focal length is not known."""
NEAREST_DEPTH = 0.05
"""Least depth of a landmark, in the body's lengths."""


def descend_fit(
    local: Callable[[FitState], LocalFit], state: FitState, rounds: int, pose_count: int
) -> tuple[FitState, LocalFit]:
    """States that cost less, by so many damped steps, each kept only if it helps."""
    here, damping = local(state), np.full(len(state), FIRST_DAMP)
    for _ in range(rounds):
        matrix = here.A.copy()
        diagonal = np.einsum("bii->bi", matrix)
        diagonal *= 1 + damping[:, None]
        diagonal += 1e-9
        step = np.negative(np.linalg.solve(matrix, here.b[..., None])[..., 0], dtype=np.float64)
        moved = state.moved(step, pose_count)
        there = local(moved)
        better = there.cost <= here.cost
        state, here = moved.where(better, state), there.where(better, here)
        damping = np.where(better, damping * DAMP_DOWN, damping * DAMP_UP)
        damping = np.minimum(np.maximum(damping, LEAST_DAMP), MOST_DAMP)
    return state, here


@dataclass(frozen=True)
class KeypointResiduals:
    """How far landmarks of B states are seen from their keypoints, in standard deviations.

    Attributes:
        r: (B, 2, L); 0 where nothing is seen.
        moves: (B, Q, 2, L) how that changes with a step.
        factor: (B, L) by which the loss weighs each down.
        cost: (B,); infinite where a landmark is too near to the camera.
    """

    r: Array
    moves: Array
    factor: Array
    cost: Array

    @property
    def local(self) -> LocalFit:
        """The cost near the states."""
        flat = self.moves.reshape(*self.moves.shape[:2], -1)
        weighted = (self.moves * self.factor[:, None, None]).reshape(flat.shape)
        A = weighted @ flat.swapaxes(1, 2)
        b = (weighted @ self.r.reshape(len(self.r), -1, 1))[..., 0]
        return LocalFit(self.cost, A, b)


def keypoint_terms(
    body: FitBody,
    problem: FitProblem,
    state: FitState,
    *,
    width: Array,
    counts: tuple[int, int],
    joints: PosedJoints | None = None,
    by_kind: bool = False,
) -> LocalFit:
    """The cost of states by keypoints, priors and joint limits.

    Args:
        body: the body's tables and priors.
        problem: of all animals.
        state: B hypotheses.
        width: (B,) of the keypoints' Cauchy loss, in standard deviations.
        counts: how many pose and shape directions are free.
        joints: of the states, if they are at hand.
        by_kind: whether the shape's prior is that of the nearest species, not of all together.

    """
    joints = joints or body.joints(state.pose, state.shape, counts[0])
    local = keypoint_residuals(
        body, problem, state, width=width, shape_count=counts[1], joints=joints
    ).local
    local = with_priors(local, body, problem, state, theta=joints.theta, counts=counts)
    return with_shape_prior(local, body, state, counts=counts, by_kind=by_kind)


def keypoint_residuals(
    body: FitBody,
    problem: FitProblem,
    state: FitState,
    *,
    width: Array,
    shape_count: int,
    joints: PosedJoints,
    further: Array | None = None,
) -> KeypointResiduals:
    """How far landmarks are seen from their keypoints; arguments as keypoint_terms's.

    Args:
        body: the body's tables.
        problem: of all animals.
        state: B hypotheses.
        width: (B,).
        shape_count: how many shape directions are free.
        joints: of the states.
        further: (B, F, 3, L) by which landmarks move with F more numbers than the states have.

    """
    frames = joints.frames
    parts = landmark_parts(body.tables, frames, state.shape)
    by_pose = slopes_of_parts(
        body.skeleton, frames, parts, turns=joints.turns, beyond=body.tables.beyond
    )
    by_shape = slopes_by_shape(body.skeleton, body.tables, frames, shape_count)
    more = () if further is None else (further,)
    slopes = np.concatenate((by_pose, by_shape, *more), 1)
    pixels, weights = labeled(body, problem, state)
    linear = problem.linear[state.animal]
    px, moves, depth = projected(state, linear, parts.sum(1), slopes)
    r = (px - pixels) * weights[:, None]
    moves *= weights[:, None, None]
    square = (r * r).sum(1) / (width**2)[:, None]
    cost = (width**2) / 2 * np.log1p(square).sum(-1)
    nearest = np.where(weights > 0, depth, np.inf).min(-1)
    cost = np.where(nearest > NEAREST_DEPTH * body.length, cost, np.inf)
    return KeypointResiduals(r, moves, 1 / (1 + square), cost)


def labeled(body: FitBody, problem: FitProblem, state: FitState) -> tuple[Array, Array]:
    """The pixels (B, 2, L) and weights (B, L) of each landmark, under each state's labeling."""
    own, order = np.arange(len(body.exchanged)), np.array(body.exchanged)
    names = np.where(state.exchanged[:, None], order, own)
    weights = problem.weights[state.animal[:, None], names]
    pixels = problem.pixels[state.animal[:, None, None], np.arange(2)[:, None], names[:, None]]
    return pixels, weights


def projected(
    state: FitState, linear: Array, points: Array, slopes: Array
) -> tuple[Array, Array, Array]:
    """Where points are seen about the principal point, and how that moves with a step.

    Args:
        state: B hypotheses.
        linear: (B, 2, 2).
        points: (B, 3, L) on the body.
        slopes: (B, Q, 3, L) by the pose and shape directions that are free.

    Returns:
        px (B, 2, L), moves (B, CAMERA + Q, 2, L) and depth (B, L).

    """
    turned = state.R @ points
    cam = turned + state.t[..., None]
    depth = cam[:, 2]
    inverse = 1 / np.maximum(depth, 1e-9)
    zoom = np.exp(state.focal)[:, None]
    plane = cam[:, :2] * inverse[:, None]
    x, y = plane[:, 0], plane[:, 1]
    X, Y, Z = turned[:, 0], turned[:, 1], turned[:, 2]
    moves = np.zeros((len(state), CAMERA + slopes.shape[1], 2, points.shape[-1]))
    u, v = moves[:, :, 0], moves[:, :, 1]
    u[:, 0], u[:, 1], u[:, 2] = -x * Y, Z + x * X, -Y
    v[:, 0], v[:, 1], v[:, 2] = -Z - y * Y, y * X, X
    size = np.exp(state.scale)[:, None]
    u[:, 3] = v[:, 4] = size
    t = state.t[..., None]
    u[:, 5], v[:, 5] = t[:, 0] - x * t[:, 2], t[:, 1] - y * t[:, 2]
    u[:, 6], v[:, 6] = -x * t[:, 2], -y * t[:, 2]
    by_body = state.R[:, None] @ slopes
    u[:, CAMERA:] = by_body[:, :, 0] - x[:, None] * by_body[:, :, 2]
    v[:, CAMERA:] = by_body[:, :, 1] - y[:, None] * by_body[:, :, 2]
    moves *= (inverse * zoom)[:, None, None]
    plane = plane * zoom[:, None]
    moves[:, 6] += plane
    if not linear[:, 0, 1].any():
        focal = linear[:, range(2), range(2)]
        return focal[..., None] * plane, moves * focal[:, None, :, None], depth
    return linear @ plane, linear[:, None] @ moves, depth


def _with_distance(
    A: Array, b: Array, body: FitBody, state: FitState, *, is_known: NDArray[np.bool_]
) -> Array:
    """The cost (B,) of near cameras where the focal length is not known, added to A and b too."""
    # The logarithm of the distance, by the least that is usual
    distance = state.scale + state.focal - np.log(NEAR_DISTANCE * body.length)
    weight = np.where(is_known | (distance > 0), 0.0, 1 / DISTANCE_SD)
    off = weight * distance
    for i in (5, 6):
        b[:, i] += weight * off
        for j in (5, 6):
            A[:, i, j] += weight**2
    half: Array = off**2 / 2
    return half


def with_priors(
    local: LocalFit,
    body: FitBody,
    problem: FitProblem,
    state: FitState,
    *,
    theta: Array,
    counts: tuple[int, int],
) -> LocalFit:
    """The cost with those of the priors and the joints' limits added, in place."""
    cost, A, b = local.cost, local.A, local.b
    prior = body.pose_prior
    P, _ = counts
    focal_sd = problem.focal_sd[state.animal]
    cost = cost + (state.pose**2).sum(-1) / 2
    cost = cost + (state.focal / focal_sd) ** 2 / 2
    A[:, 6, 6] += 1 / focal_sd**2
    b[:, 6] += state.focal / focal_sd**2
    cost = cost + _with_distance(A, b, body, state, is_known=focal_sd <= FOCAL_KNOWN_SD)
    own = np.arange(CAMERA, CAMERA + P)
    A[:, own, own] += 1.0
    b[:, CAMERA : CAMERA + P] += state.pose[:, :P]
    sd = np.deg2rad(LIMIT_SD_DEG)
    excess = (np.maximum(theta - prior.high, 0.0) + np.minimum(theta - prior.low, 0.0)) / sd
    excess = excess.reshape(len(state), -1)
    cost = cost + (excess**2).sum(-1) / 2
    slopes = prior.directions.reshape(-1, prior.directions.shape[2])[:, :P] / sd
    active = (slopes.T * (excess != 0)[:, None]) @ slopes
    A[:, CAMERA : CAMERA + P, CAMERA : CAMERA + P] += active
    b[:, CAMERA : CAMERA + P] += (excess[:, None] @ slopes)[:, 0]
    cost = cost + add_ground_term(LocalFit(cost, A, b), prior, problem, state=state, pose_count=P)
    return LocalFit(cost, A, b)


def with_shape_prior(
    local: LocalFit, body: FitBody, state: FitState, *, counts: tuple[int, int], by_kind: bool
) -> LocalFit:
    """The cost with that of the shape added, in place; see keypoint_terms."""
    P, S = counts
    prior, shape = body.shape_prior, state.shape
    shapes = slice(CAMERA + P, CAMERA + P + S)
    if not by_kind:
        own = np.arange(CAMERA + P, CAMERA + P + S)
        local.A[:, own, own] += 1.0
        local.b[:, shapes] += shape[:, :S]
        return LocalFit(local.cost + (shape**2).sum(-1) / 2, local.A, local.b)
    apart = shape[:, None] - prior.kinds  # (B, C, S)
    pull = apart @ prior.precision
    costs = (pull * apart).sum(-1) / 2
    nearest = costs.argmin(1)
    rows = np.arange(len(shape))
    local.A[:, shapes, shapes] += prior.precision[:S, :S]
    local.b[:, shapes] += pull[rows, nearest][:, :S]
    return LocalFit(local.cost + costs[rows, nearest], local.A, local.b)

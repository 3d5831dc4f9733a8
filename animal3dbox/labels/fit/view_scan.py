"""The scan: every named pose seen from all round, roll, scale and shift by one complex number each.

From far away a body's landmarks are p = x + i y in the picture's plane, and turning, scaling and
shifting them there is a p + b. So a and b of each pose and view follow from weighted least squares,
a few times reweighted by the Cauchy loss, and all of SO(3) costs no more than one camera pose.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.fit_body import FitBody
from animal3dbox.labels.fit.pose_prior import ground_normals
from animal3dbox.labels.fit.problem import FitProblem, FitState

Array = NDArray[np.float64]
SCAN_DIRECTIONS = 65
SCAN_ROUNDS = 3
SCAN_WIDTH = 0.06
"""Width of the loss, by the keypoints' extent."""
SCAN_UP = 2.0
"""What a view from under the ground, or one rolled by half a turn, costs in the scan at most."""
A_VIEW = 3
"""Most starts that are taken from one direction of view, so that others get their turn."""
STARTS, EXCHANGED_STARTS = 28, 8
"""Starts of the labeling given, and of the exchanged one."""


@dataclass(frozen=True)
class ScanViews:
    """The landmarks of M poses seen from D directions.

    Attributes:
        plane: (M * D, L) complex, x + i y in the picture's plane.
        rotations: (D, 3, 3) R_cam_body without roll.
        up: (M * D, 3) the ground's normal in the camera, without roll.
        pose: (M, P) coefficients.
    """

    plane: NDArray[np.complex128]
    rotations: Array
    up: Array
    pose: Array


def even_views(count: int) -> Array:
    """Rotations (count, 3, 3) R_cam_body whose lines of sight are spread evenly over the sphere."""
    z = 1 - (2 * np.arange(count) + 1) / count
    ring, golden = np.sqrt(1 - z * z), np.pi * (3 - np.sqrt(5))
    angle = golden * np.arange(count)
    sight = np.stack((ring * np.cos(angle), ring * np.sin(angle), z), -1)
    # Down in the picture is the part of the body's down across the line of sight
    down = -np.array([0.0, 0.0, 1.0]) + sight * z[:, None]
    down /= np.sqrt((down * down).sum(-1, keepdims=True))
    return np.stack((np.cross(down, sight), down, sight), 1)


@lru_cache(maxsize=64)
def scan_views(body: FitBody) -> ScanViews:
    """The views of a body in its mean shape."""
    pose = body.pose_prior.examples
    landmarks = body.landmarks(pose, np.zeros((len(pose), body.sizes[1])))
    rotations = even_views(SCAN_DIRECTIONS)
    seen = rotations[None, :, :2] @ landmarks[:, None]  # (M, D, 2, L)
    up = rotations[None] @ ground_normals(body.pose_prior, pose)[:, None, :, None]
    plane = seen[:, :, 0] + 1j * seen[:, :, 1]
    count = len(pose) * len(rotations)
    return ScanViews(plane.reshape(count, -1), rotations, up.reshape(count, 3), pose)


def scan_starts(body: FitBody, problem: FitProblem, exchanges: bool) -> FitState:
    """The starts of all animals: as many of each, those of one after those of another."""
    starts = []
    for animal in range(len(problem.pixels)):
        starts.append(_starts(body, problem, animal, exchanged=False))
        if exchanges:
            starts.append(_starts(body, problem, animal, exchanged=True))
    return FitState(
        *(
            np.concatenate([getattr(one, name) for one in starts])
            for name in FitState.__dataclass_fields__
        )
    )


def _starts(body: FitBody, problem: FitProblem, animal: int, *, exchanged: bool) -> FitState:
    """The starts of one animal and labeling."""
    views = scan_views(body)
    used = np.flatnonzero(problem.weights[animal] > 0)
    R_look, seen, extent = _towards(problem, animal, used)
    names = np.array(body.exchanged)[used] if exchanged else used
    plane = np.ascontiguousarray(views.plane[:, names])
    weights = problem.weights[animal, used] / problem.weights[animal, used].max()
    a, b, cost = _aligned(plane, seen, weights, SCAN_WIDTH * extent)
    cost = cost + problem.up_weight[animal] * _up_costs(views, a)
    cost = cost + _gravity_costs(views, a, R_look.T @ problem.down[animal])
    count = len(views.rotations)
    ids = _best(cost.reshape(-1, count), EXCHANGED_STARTS if exchanged else STARTS)
    a, b = a[ids], b[ids]
    turn = a / np.abs(a)
    R_roll = np.zeros((len(ids), 3, 3))
    R_roll[:, 0, 0] = R_roll[:, 1, 1] = turn.real
    R_roll[:, 1, 0], R_roll[:, 0, 1], R_roll[:, 2, 2] = turn.imag, -turn.imag, 1.0
    depth = 1 / np.abs(a)
    t = np.stack((b.real, b.imag, np.ones(len(ids))), -1) * depth[:, None]
    R = R_look @ (R_roll @ views.rotations[ids % count])
    t = (R_look @ t[..., None])[..., 0]
    z = np.maximum(t[:, 2], 1e-3 * depth)
    return FitState(
        animal=np.full(len(ids), animal),
        R=R,
        aim=t[:, :2] / z[:, None],
        scale=np.log(z),
        focal=np.zeros(len(ids)),
        pose=views.pose[ids // count],
        shape=np.zeros((len(ids), body.sizes[1])),
        exchanged=np.full(len(ids), exchanged),
    )


def _towards(
    problem: FitProblem, animal: int, used: NDArray[np.intp]
) -> tuple[Array, NDArray[np.complex128], float]:
    """A camera turned towards the keypoints, in which they are seen from afar.

    Returns:
        R (3, 3) from that camera to the picture's, the keypoints (K,) in it as x + i y in focal
        lengths, and the longer side of their box.

    """
    pixels = problem.pixels[animal][:, used]
    rays = np.ones((3, len(used)))
    rays[:2] = np.linalg.solve(problem.linear[animal], pixels)
    middle = (rays.max(1) + rays.min(1)) / 2
    ahead = middle / np.sqrt(middle @ middle)
    right = np.array([ahead[2], 0.0, -ahead[0]])
    right /= np.sqrt(right @ right)
    R = np.stack((right, np.cross(ahead, right), ahead), 1)
    turned = R.T @ rays
    x, y = turned[:2] / np.maximum(turned[2], 1e-3)
    extent = max(float(np.ptp(x)), float(np.ptp(y)), 1e-9)
    return R, x + 1j * y, extent


def _aligned(
    plane: NDArray[np.complex128], seen: NDArray[np.complex128], weights: Array, width: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], Array]:
    """a, b (M,) and the cost (M,) of the best a p + b for points seen (K,).

    Args:
        plane: (M, K).
        seen: (K,).
        weights: (K,).
        width: of the loss.

    """
    w = np.broadcast_to(weights, plane.shape)
    for _ in range(SCAN_ROUNDS):
        whole = w.sum(1)
        p_mean = (w * plane).sum(1) / whole
        y_mean = (w @ seen) / whole
        p = plane - p_mean[:, None]
        y = seen - y_mean[:, None]
        a = (w * p.conj() * y).sum(1) / np.maximum((w * (p.real**2 + p.imag**2)).sum(1), 1e-12)
        a = np.where(np.abs(a) < 1e-9, 1e-9, a)
        rest = a[:, None] * p - y
        square = (rest.real**2 + rest.imag**2) / width**2
        w = weights / (1 + square)
    cost = (weights * np.log1p(square)).sum(1)
    return a, y_mean - a * p_mean, cost


def _up_costs(views: ScanViews, a: NDArray[np.complex128]) -> Array:
    """What views cost for where they put the ground, (M,): below it, or rolled."""
    turn = a / np.abs(a)
    x, y, z = views.up.T
    upright = -(turn.imag * x + turn.real * y)  # the part of the ground's normal that points up
    below = np.maximum(z, 0.0)  # it points away from the camera
    cost: Array = SCAN_UP * (np.hypot(x, y) - upright) / 2 + 2 * SCAN_UP * below**2
    return cost


def _gravity_costs(views: ScanViews, a: NDArray[np.complex128], down: Array) -> Array:
    """What views cost for a ground that is not level under gravity's direction (3,), (M,)."""
    if not np.isfinite(down).all():
        return np.zeros(len(a))
    turn = a / np.abs(a)
    x, y, z = views.up.T
    across, along = turn.real * x - turn.imag * y, turn.imag * x + turn.real * y
    level = -(across * down[0] + along * down[1] + z * down[2])
    cost: Array = SCAN_UP * (1 - level) / 2
    return cost


def _best(cost: Array, most: int) -> NDArray[np.intp]:
    """The flat indices of the least costs (M, D), most of them, at most A_VIEW a column."""
    ranks = np.argsort(cost, axis=0, kind="stable")[:A_VIEW]
    columns = np.arange(cost.shape[1])
    ids = (ranks * cost.shape[1] + columns).ravel()
    best: NDArray[np.intp] = ids[np.argsort(cost.ravel()[ids], kind="stable")[:most]]
    return best

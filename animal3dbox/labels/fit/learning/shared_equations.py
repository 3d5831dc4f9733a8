"""What fits say of the numbers that a dataset's animals share, their own numbers marginalised.

Near an animal's fit its cost is a quadratic form of its own numbers l (camera, pose, deviation from
its class's mean shape) and of the shared ones g (offsets of keypoints, the class's mean). Taking
the best l for every g leaves the Schur complement, and those of all animals add up:

    H = A_gg - A_gl A_ll^-1 A_lg,   h = b_g - A_gl A_ll^-1 b_l
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.descent import (
    KeypointResiduals,
    keypoint_residuals,
    labeled,
    with_priors,
    with_shape_prior,
)
from animal3dbox.labels.fit.fit_body import FitBody
from animal3dbox.labels.fit.kinematics import JointFrames, blended_rotations, trunk_lengths
from animal3dbox.labels.fit.learning.mirrored_offsets import offset_basis
from animal3dbox.labels.fit.local_fit import LocalFit
from animal3dbox.labels.fit.mask_target import MaskTarget
from animal3dbox.labels.fit.mask_term import MaskWeights, mask_terms
from animal3dbox.labels.fit.problem import CAMERA, FitProblem, FitState
from animal3dbox.labels.fit.schedule import HEAVY_MASK, NARROW_LOSS
from animal3dbox.labels.pose.multi_start_search import RAYLEIGH_MEDIAN

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SharedEquations:
    """The equations of A animals of one body, and what tells how their numbers scatter.

    Attributes:
        H: (A, G, G) of the shared numbers: offsets' free numbers, then the class's mean shape.
        h: (A, G) the slopes of the cost by them.
        shape_square: (A,) mean over shape directions of the squared deviation from the class's
            mean, expected over what the fit leaves open.
        apart: (A, L) px^2, mean square of a keypoint's two coordinates, expected likewise; its own
            noise included.
        factor: (A, L) by how much each counts there; 0 where it is not seen.
        misfit: (A,) the keypoints' median distance by that of noise alone.
    """

    H: Array
    h: Array
    shape_square: Array
    apart: Array
    factor: Array
    misfit: Array


def shared_equations(
    body: FitBody,
    whole: FitBody,
    problem: FitProblem,
    targets: Mapping[int, MaskTarget],
    *,
    state: FitState,
) -> SharedEquations:
    """The equations of animals at their fits.

    Args:
        body: of the animals' class.
        whole: the same with the directions of all shapes, in which the mean of the class moves; the
            body itself where there is no class, and its mean's equations say nothing.
        problem: of A animals.
        targets: animal -> its mask, of those that have one.
        state: (A,) their fits with the body.

    """
    counts = body.sizes
    own_count = CAMERA + sum(counts)
    root = np.asarray(
        np.linalg.lstsq(whole.shape_prior.directions, body.shape_prior.directions, rcond=None)[0],
        dtype=np.float64,
    )
    residuals, by_mask, theta = _residuals(body, whole, problem, targets, state=state, root=root)
    map_of_steps = _map_of_steps(root, counts, residuals.moves.shape[1] - own_count)
    local = _mapped(_joined(residuals.local, by_mask), map_of_steps)
    own = LocalFit(
        local.cost, local.A[:, :own_count, :own_count].copy(), local.b[:, :own_count].copy()
    )
    own = with_priors(own, body, problem, state, theta=theta, counts=counts)
    own = with_shape_prior(own, body, state, counts=counts, by_kind=True)
    A, b = local.A.copy(), local.b.copy()
    A[:, :own_count, :own_count], b[:, :own_count] = own.A, own.b
    H, h, spread = marginalised(A, b, own_count)
    of_shape = np.einsum("aii->ai", spread)[:, own_count - counts[1] :]
    _, weights = labeled(body, problem, state)
    by_own = map_of_steps.T[:own_count] @ residuals.moves.reshape(*residuals.moves.shape[:2], -1)
    open_square = ((spread @ by_own) * by_own).sum(1).reshape(residuals.r.shape)
    square = (residuals.r**2 + open_square).mean(1)
    return SharedEquations(
        H=H,
        h=h,
        shape_square=(state.shape**2 + of_shape).mean(1),
        apart=square / np.where(weights > 0, weights, 1.0) ** 2,
        factor=np.where(weights > 0, residuals.factor, 0.0),
        misfit=_misfits(residuals.r, weights),
    )


def marginalised(A: Array, b: Array, count: int) -> tuple[Array, Array, Array]:
    """Quadratic forms without their first numbers, which take their best values.

    Args:
        A: (B, N, N).
        b: (B, N).
        count: how many numbers are marginalised.

    Returns:
        A (B, N - count, N - count) and b (B, N - count) of the others, and the covariance (B,
        count, count) of the marginalised ones, the others held.

    Example:
        >>> H, h, _ = marginalised(np.array([[[2.0, 1.0], [1.0, 3.0]]]), np.array([[4.0, 1.0]]), 1)
        >>> H.item(), h.item()
        (2.5, -1.0)
    """
    cross = A[:, count:, :count]
    spread: Array = np.asarray(np.linalg.inv(A[:, :count, :count]), dtype=np.float64)
    pulled = cross @ spread
    H = A[:, count:, count:] - pulled @ cross.swapaxes(1, 2)
    h = b[:, count:] - (pulled @ b[:, :count, None])[..., 0]
    return H, h, spread


def _residuals(
    body: FitBody,
    whole: FitBody,
    problem: FitProblem,
    targets: Mapping[int, MaskTarget],
    *,
    state: FitState,
    root: Array,
) -> tuple[KeypointResiduals, LocalFit, Array]:
    """Residuals of keypoints by steps of the whole body and the offsets, the masks' cost, angles.

    Args:
        body: see shared_equations.
        whole: likewise.
        problem: likewise.
        targets: likewise.
        state: likewise.
        root: (S, S) from the body's shape coefficients to the whole's.

    """
    pose_count, shape_count = whole.sizes
    in_whole = replace(state, shape=(state.shape[:, None] @ root.T)[:, 0])
    joints = whole.joints(in_whole.pose, in_whole.shape, pose_count)
    residuals = keypoint_residuals(
        whole,
        problem,
        in_whole,
        width=np.full(len(state), NARROW_LOSS),
        shape_count=shape_count,
        joints=joints,
        further=offset_slopes(whole, joints.frames, in_whole.shape),
    )
    masked = np.array(sorted(targets), dtype=np.intp)
    count = CAMERA + pose_count + shape_count
    by_mask = LocalFit(
        np.zeros(len(state)), np.zeros((len(state), count, count)), np.zeros((len(state), count))
    )
    if len(masked):
        weights, counts = MaskWeights(*HEAVY_MASK), (pose_count, shape_count)
        terms = mask_terms(
            whole, problem, in_whole[masked], targets=targets, weights=weights, counts=counts
        )
        by_mask = by_mask.replaced(masked, terms)
    return residuals, by_mask, body.frames(state.pose, state.shape)[0]


def offset_slopes(body: FitBody, frames: JointFrames, shape: Array) -> Array:
    """How landmarks move with the free numbers of their offsets, (B, G, 3, L).

    A landmark l whose place in the template is moved by d moves by sum_j w_lj R_j d.
    """
    length, length_shape = trunk_lengths(body.skeleton)
    lengths = length + (shape[:, None] @ length_shape[:, None])[:, 0, 0]
    blended = blended_rotations(body.tables, frames.rotations)
    basis = offset_basis(body.vocabulary).reshape(blended.shape[-1], 3, -1)
    slopes = np.einsum("bckl,lkg->bgcl", blended, basis)
    moved: Array = lengths[:, None, None, None] * slopes
    return moved


def _joined(local: LocalFit, by_mask: LocalFit) -> LocalFit:
    """The cost by keypoints with that by masks, whose numbers are the first ones, added."""
    A, b, count = local.A.copy(), local.b.copy(), by_mask.b.shape[1]
    A[:, :count, :count] += by_mask.A
    b[:, :count] += by_mask.b
    return LocalFit(local.cost + by_mask.cost, A, b)


def _map_of_steps(root: Array, counts: tuple[int, int], offsets: int) -> Array:
    """The matrix from steps (own numbers, offsets, class's mean) to (whole body's, offsets).

    Args:
        root: see _residuals.
        counts: of pose and shape directions.
        offsets: how many free numbers they have.

    """
    moving, shape = CAMERA + counts[0], counts[1]
    own = moving + shape
    matrix = np.zeros((own + offsets, own + offsets + shape))
    matrix[:moving, :moving] = np.eye(moving)
    matrix[moving:own, moving:own] = root
    matrix[own:, own : own + offsets] = np.eye(offsets)
    matrix[moving:own, own + offsets :] = np.eye(shape)
    return matrix


def _mapped(local: LocalFit, matrix: Array) -> LocalFit:
    """The cost by other numbers, whose steps a matrix maps to those of the cost."""
    return LocalFit(local.cost, matrix.T @ local.A @ matrix, (local.b[:, None] @ matrix)[:, 0])


def _misfits(r: Array, weights: Array) -> Array:
    """The median lengths of residuals (A, 2, L) of seen keypoints by that of noise alone, (A,)."""
    distance = np.where(weights > 0, np.sqrt((r * r).sum(1)), np.nan)
    misfits: Array = np.nanmedian(distance, axis=1) / RAYLEIGH_MEDIAN
    return misfits

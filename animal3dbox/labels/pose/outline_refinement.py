"""The last refinement of method "default": the chosen pose against the whole outline of the mask.

Supports say how far a mask reaches in a few directions; a hundred points of its outline say more,
and a wandering outline averages out over them. docs/solver.md has the formulas.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from animal3dbox.geometry.mask_outline import MaskOutline
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.levenberg_marquardt import (
    CameraPoses,
    LocalModel,
    descend,
    project_with_slopes,
)
from animal3dbox.labels.pose.problem import PoseProblem
from animal3dbox.labels.pose.robust_joint_cost import (
    JOINT_GAIN,
    JointTerms,
    joint_cost,
    joint_terms,
    projected,
    robust_sum,
)

Array = NDArray[np.float64]
RIM_POINTS = 96
"""Points of the mask's outline that are compared with the body's rim."""
OUTLINE_SIGMA_PX = 1.0
"""Least standard deviation of a point of the outline from the body's rim."""
FAR_PX = 8.0
"""Points of the outline farther than this from the rim belong to something else."""
MOST_BODY_MISFIT = 1.6
"""Misfit of a body beyond which its outline tells nothing more of the pose."""
OUTLINE_ROUNDS = 2
NEIGHBOURS = 8
"""Vertices of the rim that a point of the outline can meet while the pose moves a little."""
MAD_TO_SD = 1.4826


@dataclass(frozen=True)
class RimTerms:
    """What the outline's part of the cost compares a pose with.

    Attributes:
        rim: (P, M, 3) for each point, the vertices of the body's rim that are seen nearest to it at
            the pose where the refinement begins.
        points: (P, 2) of the mask's outline, px about the principal point.
        normals: (P, 2) unit, outwards.
        weight: 1 / px.
    """

    rim: Array
    points: Array
    normals: Array
    weight: float


def refine_on_outline(
    problem: PoseProblem,
    pose: CameraPoses,
    misfit: float,
    *,
    misfit_of_body: float,
    config: LabelConfig,
) -> tuple[CameraPoses, LocalModel] | None:
    """One pose refined by the keypoints and the whole outline of the mask, and the cost there.

    None where there is no outline, or the body does not fit well enough to have its.

    Args:
        problem: about its own mean, in units of its own spread.
        pose: one, near the best.
        misfit: by which the keypoints' standard deviations are multiplied, see search_poses.
        misfit_of_body: see body_misfit.
        config: lambda, and whether the mask counts.

    """
    outline, faces = problem.mask_outline, problem.faces
    if outline is None or faces is None or not misfit_of_body <= MOST_BODY_MISFIT:
        return None
    terms = joint_terms(problem, misfit, misfit_of_body, config=config)
    if not terms.body.size or not outline.is_whole.any():
        return None
    of_rim = _rim_terms(problem, pose, outline, faces=faces, terms=terms, misfit=misfit_of_body)
    if of_rim is None:
        return None
    cost_of = partial(_outline_cost, problem, of_keypoints=terms.of_keypoints, of_rim=of_rim)
    refined, local, _ = descend(cost_of, pose, OUTLINE_ROUNDS, gain=JOINT_GAIN)
    return refined, local


def rim_vertices(vertices: Array, faces: NDArray[np.int64], pixels: Array) -> NDArray[np.intp]:
    """The indices of a closed mesh's vertices between faces seen from outside and from inside.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        pixels: (2, V) where the vertices are seen.

    """
    corners = np.ascontiguousarray(faces.T)
    x, y = pixels.astype(np.float32)
    (ax, bx, cx), (ay, by, cy) = ([row.take(corner) for corner in corners] for row in (x, y))
    is_front = (bx - ax) * (cy - ay) < (by - ay) * (cx - ax)
    of_both = np.ones(len(vertices), dtype=np.bool_)
    for side in (np.flatnonzero(is_front), np.flatnonzero(~is_front)):
        of_side = np.zeros_like(of_both)
        for corner in corners:
            of_side[corner.take(side)] = True
        of_both &= of_side
    return np.flatnonzero(of_both)


def _rim_terms(
    problem: PoseProblem,
    pose: CameraPoses,
    outline: MaskOutline,
    *,
    faces: NDArray[np.int64],
    terms: JointTerms,
    misfit: float,
) -> RimTerms | None:
    """The rim at a pose, and how much the outline's distances from it count.

    With s the robust standard deviation of the distances and m the body's misfit, the outline's
    standard deviation is OUTLINE_SIGMA_PX max(1, s / OUTLINE_SIGMA_PX)^2 m^2.
    """
    vertices = problem.vertices_world
    if vertices is None:
        return None
    pixels = projected(problem, vertices.T, pose)[0]
    ids = rim_vertices(vertices, faces, pixels)
    if len(ids) < NEIGHBOURS:
        return None
    whole, seen = outline.is_whole, pixels[:, ids]
    points, normals = outline.points[whole] - problem.K[:2, 2], outline.normals[whole]
    _, near = cKDTree(seen.T, balanced_tree=False, compact_nodes=False).query(points, NEIGHBOURS)
    rim = RimTerms(vertices[ids][near], points, normals, weight=1.0)
    _, places, _ = _nearest(problem, pose, rim)
    spread = MAD_TO_SD * float(np.median(np.abs(((places - points) * normals).sum(1))))
    sigma = OUTLINE_SIGMA_PX * max(1.0, spread / OUTLINE_SIGMA_PX) ** 2 * misfit**2
    return replace(rim, weight=terms.mask_share / sigma)


def _nearest(problem: PoseProblem, pose: CameraPoses, rim: RimTerms) -> tuple[Array, Array, Array]:
    """The rim vertex that is seen nearest to each point of the outline.

    Returns:
        vertices: (P, 3).
        places: (P, 2) where they are seen, px about the principal point.
        square: (P,) px^2, the squared distances.

    """
    count = len(rim.points)
    seen = projected(problem, rim.rim.reshape(-1, 3).T, pose)[0].T.reshape(count, -1, 2)
    square = ((seen - rim.points[:, None]) ** 2).sum(-1)
    rows, nearest = np.arange(count), square.argmin(1)
    return rim.rim[rows, nearest], seen[rows, nearest], square[rows, nearest]


def _outline_cost(
    problem: PoseProblem, pose: CameraPoses, *, of_keypoints: JointTerms, of_rim: RimTerms
) -> LocalModel:
    """The cost of one pose by keypoints and outline, and its derivatives.

    A point of the outline without a rim near it costs what one at FAR_PX costs, and pulls nowhere.
    """
    keypoints = joint_cost(problem, pose, terms=of_keypoints, outline=np.zeros((1, 3, 0)))
    vertices, _, square = _nearest(problem, pose, of_rim)
    px, slopes, _ = project_with_slopes(vertices, problem.linear, pose)
    along = of_rim.weight * of_rim.normals.T  # (2, P)
    residuals = ((px - of_rim.points.T) * along).sum(1)
    is_far = square >= FAR_PX**2
    residuals[:, is_far] = of_rim.weight * FAR_PX
    slopes = (slopes * along).sum(2)
    slopes[..., is_far] = 0.0
    rim = robust_sum(residuals, slopes)
    return LocalModel(keypoints.cost + rim.cost, keypoints.A + rim.A, keypoints.b + rim.b)

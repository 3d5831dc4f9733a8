"""The paper's refinement: keypoints and mask bounds together, by SciPy's least squares."""

import numpy as np
from scipy.optimize import least_squares

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.epnp_ransac import checked_pose
from animal3dbox.labels.pose.paper_joint_cost import Array, JointCost, joint_cost, rotate
from animal3dbox.labels.pose.problem import PoseEstimate, PoseFailure, PoseProblem

EVALUATIONS = 200
"""Most evaluations of the residuals in a solve of the vector reading."""
LITERAL_ROUNDS, LITERAL_EVALUATIONS = 50, 4
"""Most rounds of reweighting, and most evaluations in the solve of each."""
LITERAL_SETTLED = 1e-6
"""Relative change of the energy below which the rounds end."""
LITERAL_FLOOR = 1e-3
"""Distances below this weigh as if they were this far off: a distance itself has a kink at zero."""


def refined_pose(
    problem: PoseProblem, start: PoseEstimate, config: LabelConfig
) -> PoseEstimate | PoseFailure:
    """The pose that minimises the joint cost, from a starting pose (section 2.2.2, least_squares).

    Args:
        problem: about its own mean, in units of its own spread.
        start: the initial pose.
        config: lambda, the tolerances, and how E_total is read: "vector" squares all residuals, as
            SciPy does with the vector it is given; "literal" minimises lambda sum d_i + (1 -
            lambda) sum |d_bbox| with the distances unsquared, by solving reweighted squares until
            they settle.

    Returns:
        The refined pose, or why it is no answer: SciPy reports success behind the camera, too.

    """
    cost = joint_cost(problem, start.R, config.mask_box or "keypoints")
    pose = np.concatenate((np.zeros(3), start.t))
    if config.residual == "vector":
        ones = np.ones(len(cost.points))
        pose = _solve(cost, pose, config, keypoint_weights=ones, box_weights=np.ones(4))
    else:
        pose = _literal(cost, pose, config)
    R = rotate(pose[:3])[0] @ cost.R_start
    return checked_pose(problem, PoseEstimate(R, pose[3:].copy(), start.hypothesis))


def literal_energy(cost: JointCost, pose: Array, config: LabelConfig) -> float:
    """E_total as printed, distances unsquared."""
    distances = np.linalg.norm(cost.keypoints(pose)[0], axis=1)
    return float(
        config.lambda_keypoints * distances.sum()
        + (1 - config.lambda_keypoints) * np.abs(cost.box(pose)[0]).sum()
    )


def _literal(cost: JointCost, pose: Array, config: LabelConfig) -> Array:
    """Iteratively reweighted least squares; keeps the best pose seen."""
    best, least = pose, literal_energy(cost, pose, config)
    for _ in range(LITERAL_ROUNDS):
        distances = np.linalg.norm(cost.keypoints(pose)[0], axis=1)
        off = np.abs(cost.box(pose)[0])
        pose = _solve(
            cost,
            pose,
            config,
            keypoint_weights=1 / np.maximum(distances, LITERAL_FLOOR),
            box_weights=1 / np.maximum(off, LITERAL_FLOOR),
            evaluations=LITERAL_EVALUATIONS,
        )
        energy = literal_energy(cost, pose, config)
        settled = abs(least - energy) <= LITERAL_SETTLED * least
        if energy < least:
            best, least = pose, energy
        if settled:
            break
    return best


def _solve(
    cost: JointCost,
    pose: Array,
    config: LabelConfig,
    *,
    keypoint_weights: Array,
    box_weights: Array,
    evaluations: int = EVALUATIONS,
) -> Array:
    """One SciPy solve of the squared residuals under fixed weights."""
    by_keypoint = np.sqrt(config.lambda_keypoints * keypoint_weights)[:, None]
    by_bound = np.sqrt((1 - config.lambda_keypoints) * box_weights[: 4 if len(cost.extent) else 0])

    def residuals(x: Array) -> Array:
        return np.concatenate(
            ((by_keypoint * cost.keypoints(x)[0]).ravel(), by_bound * cost.box(x)[0])
        )

    def jacobian(x: Array) -> Array:
        return np.concatenate(
            (
                (by_keypoint[..., None] * cost.keypoints(x)[1]).reshape(-1, 6),
                by_bound[:, None] * cost.box(x)[1],
            )
        )

    solved = least_squares(
        residuals,
        pose,
        jac=jacobian,
        xtol=config.xtol,
        ftol=config.ftol,
        max_nfev=evaluations,
    )
    return np.asarray(solved.x, dtype=np.float64)

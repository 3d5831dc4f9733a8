"""The cost of a ground that is not level, where gravity's direction in the camera is known.

An animal's pose tells where the ground is beneath it: a sitting animal's trunk is steep. The pose
prior regresses the ground's normal on its coefficients, see `ground_normals`; here the normal is
compared with gravity while camera and pose are moved. docs/solver.md has the formulas.
"""

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.fit.local_fit import LocalFit
from animal3dbox.labels.fit.pose_prior import PosePrior
from animal3dbox.labels.fit.problem import CAMERA, FitProblem, FitState

Array = NDArray[np.float64]
GRAVITY_SD = 0.1
"""Standard deviation of the ground's normal, as a pose tells it, about gravity, in radians."""
GRAVITY_WIDTH = 3.0
"""Width of its Cauchy loss, in standard deviations: some animals climb, or lie on their sides."""


def add_ground_term(
    local: LocalFit, prior: PosePrior, problem: FitProblem, *, state: FitState, pose_count: int
) -> Array:
    """The cost (B,) of grounds that are not level; its derivatives are added to A and b in place.

    Args:
        local: the other costs near the states, (B, P, P) and (B, P).
        prior: of the poses.
        problem: of all animals; those without a direction of gravity cost nothing.
        state: B hypotheses.
        pose_count: how many pose directions are free.

    """
    down = problem.down[state.animal]
    is_known: NDArray[np.bool_] = ~np.isnan(down[:, 0])
    if not is_known.any():
        return np.zeros(len(state))
    raw = prior.up + (state.pose[:, None] @ prior.up_slopes)[:, 0]
    length = np.sqrt((raw * raw).sum(-1, keepdims=True))
    normal = raw / length
    up = (state.R @ normal[..., None])[..., 0]
    off = np.where(is_known[:, None], up + down, 0.0) / GRAVITY_SD
    along = (normal[:, None] @ prior.up_slopes[:pose_count].T)[:, 0]  # what does not turn it
    turned = prior.up_slopes[:pose_count] - along[..., None] * normal[:, None]
    slopes = np.zeros((len(state), 3 + pose_count, 3))
    slopes[:, :3] = np.cross(np.eye(3), up[:, None])
    slopes[:, 3:] = turned @ state.R.swapaxes(1, 2) / length[..., None]
    slopes *= is_known[:, None, None] / GRAVITY_SD
    square = (off * off).sum(-1) / GRAVITY_WIDTH**2
    weighted = slopes / (1 + square)[:, None, None]
    moved = np.r_[0:3, CAMERA : CAMERA + pose_count]
    local.A[:, moved[:, None], moved] += weighted @ slopes.swapaxes(1, 2)
    local.b[:, moved] += (weighted @ off[..., None])[..., 0]
    cost: Array = GRAVITY_WIDTH**2 / 2 * np.log1p(square)
    return cost

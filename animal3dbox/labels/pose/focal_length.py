"""The focal length of an image whose camera nothing tells, estimated with the poses of its animals.

Near and wide or far and long look nearly alike, so each starting pose is tried at several focal
lengths with its depth multiplied alike (a dolly), and the logarithm of the focal length is the
seventh number that the joint cost is brought low by. A weak prior holds it near the guess.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.levenberg_marquardt import CameraPoses
from animal3dbox.labels.pose.problem import PoseEstimate, PoseProblem
from animal3dbox.labels.pose.robust_joint_cost import ZOOM_SIGMA, refine_jointly

Array = NDArray[np.float64]
DOLLIES = (0.6, 1.0, 1.8, 3.5)
"""Focal lengths at which poses start, by the guess."""
WIDENED = 1.4
"""By which the standard deviation told by the cost's curvature is too small (field notes)."""


@dataclass(frozen=True)
class Zoom:
    """A focal length by the guessed one.

    Attributes:
        log: natural logarithm of the ratio.
        sd: its standard deviation.
    """

    log: float
    sd: float


def zoom_of_pose(
    problem: PoseProblem, candidates: Sequence[PoseEstimate], misfit: float, config: LabelConfig
) -> Zoom:
    """The focal length that explains one animal best.

    Args:
        problem: about its own mean, in units of its own spread, with the guessed K.
        candidates: poses found with that, at least one.
        misfit: of these, see search_poses.
        config: the method.

    """
    R = np.stack([pose.R for pose in candidates])
    t = np.stack([pose.t for pose in candidates])
    dollies = np.array(DOLLIES)
    depths = np.array([1.0, 1.0, 0.0]) + np.outer(dollies, [0.0, 0.0, 1.0])  # (4, 3)
    starts = CameraPoses(
        np.repeat(R, len(dollies), axis=0),
        (t[:, None] * depths).reshape(-1, 3),
        np.tile(np.log(dollies), len(R)),
    )
    refined = refine_jointly(problem, starts, misfit, config)
    zoom = refined.poses.log_zoom
    if zoom is None or not np.isfinite(refined.local.cost[0]):
        return Zoom(0.0, ZOOM_SIGMA)
    variance = float(np.linalg.pinv(refined.local.A[0], hermitian=True)[6, 6])
    sd = min(WIDENED * math.sqrt(max(variance, 0.0)), ZOOM_SIGMA)
    return Zoom(float(zoom[0]), max(sd, 1e-6))


def common_zoom(zooms: Sequence[Zoom]) -> Zoom:
    """The focal length of one image by all of its animals, weighted by their variances.

    Example:
        >>> common_zoom([Zoom(0.1, 0.1), Zoom(0.3, 0.1)]).log
        0.2
    """
    weights = np.array([1 / zoom.sd**2 for zoom in zooms])
    logs = np.array([zoom.log for zoom in zooms])
    return Zoom(round(float(weights @ logs / weights.sum()), 12), float(weights.sum() ** -0.5))

"""The camera-pose problem of one animal: what is known, and what an answer looks like.

All arrays are float64; world is the mesh's frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import norm
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.mask_outline import MaskOutline
from animal3dbox.geometry.mask_supports import MaskSupports
from animal3dbox.geometry.unit_frame import translation_from_unit_frame, unit_frame
from animal3dbox.plurals import counted

Array = NDArray[np.float64]
RELATIVE_FLATNESS = 1e-3
"""Points whose third principal spread is less than this part of the first count as lying in one
plane."""
COINCIDENCE = 1e-9
"""Of the points' spread: points that are nearer to each other are one."""
AS_GIVEN = "as given"
"""The labeling of keypoints whose left and right are as the file says."""
SAME_PIXEL = 1e-6
"""Keypoints that are nearer to each other than this, in px, are at the same pixel."""


@dataclass(frozen=True)
class PoseProblem:
    """What the camera pose is estimated from.

    Attributes:
        points_world: (N, 3) the visible landmarks on the body.
        points_px: (N, 2) where they are seen.
        sigma_px: (N,) their standard deviations.
        K: (3, 3).
        image_hw: height and width.
        R_box: (3, 3) the body's axes, to look at it from named sides.
        vertices_world: (V, 3) the body's surface, or None.
        mask_box: (4,) xyxy px of the mask, pixels from min - 0.5 to max + 0.5, or None.
        mask_supports: how far the mask reaches in the directions in which nothing cuts it, or None.
        exchanged: what the points would be if left and right had been exchanged in some part of the
            body: the part's name, and (N, 3).
        down_cam: (3,) unit, gravity in the camera frame, or None.
        noise_px: (N,) the keypoints' own standard deviations, without what the landmarks may be
            off on the body; None: sigma_px.
        log_focal_sd: standard deviation of the natural logarithm of K's focal length; None: it is
            known.
        faces: (F, 3) of vertices_world, or None.
        mask_outline: points on the mask's outline, or None.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import PoseProblem
        >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1]])
        >>> K = np.array([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]])
        >>> pixels = 100 * points[:, :2] / (points[:, 2:] + 5) + K[:2, 2]
        >>> problem = PoseProblem(
        ...     points, pixels, sigma_px=np.ones(6), K=K, image_hw=(120, 160), R_box=np.eye(3),
        ...     vertices_world=None, mask_box=None)
        >>> problem.points_px[1]
        array([99.5, 59.5])
    """

    points_world: Array
    points_px: Array
    sigma_px: Array
    K: Array
    image_hw: tuple[int, int]
    R_box: Array
    vertices_world: Array | None
    mask_box: Array | None
    mask_supports: MaskSupports | None = None
    exchanged: tuple[tuple[str, Array], ...] = ()
    down_cam: Array | None = None
    noise_px: Array | None = None
    log_focal_sd: float | None = None
    faces: NDArray[np.int64] | None = None
    mask_outline: MaskOutline | None = None

    @cached_property
    def linear(self) -> Array:
        """K's upper left, (2, 2)."""
        return self.K[:2, :2]

    @cached_property
    def pixels(self) -> Array:
        """Keypoints about the principal point, coordinate by coordinate: (2, N)."""
        about_center: Array = self.points_px.T - self.K[:2, 2:]
        return about_center


@dataclass(frozen=True)
class PoseEstimate:
    """A camera pose, X_cam = R X + t.

    Attributes:
        R: (3, 3) R_cam_world.
        t: (3,) t_cam_world.
        hypothesis: the start it came from.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import PoseEstimate
        >>> PoseEstimate(R=np.eye(3), t=np.array([0.0, 0.0, 5.0]), hypothesis="given").t
        array([0., 0., 5.])
    """

    R: Array
    t: Array
    hypothesis: str
    evidence: "PoseEvidence | None" = None


@dataclass(frozen=True)
class PoseEvidence:
    """How sure a pose of method "default" is.

    Attributes:
        rotation_covariance: (3, 3) rad^2, of a turn about the camera's axes.
        misfit: how many times larger the keypoints' residuals are than their noise, at least 1,
            see body_misfit.
        runner_up: what the best pose of another orientation, or the best of another labeling, costs
            more; in units of half a squared standard deviation. None if there was none.
        labeling: the part of the body whose left and right were taken to be exchanged; "as given".
        hidden: part of the marked keypoints that the body itself hides.
        log_focal_sd: standard deviation of the focal length's natural logarithm; None if it was
            known.

    Example:
        >>> from animal3dbox.labels.pose.problem import PoseEvidence
        >>> PoseEvidence(np.eye(3), 1.0, None, "as given", 0.0, None).labeling
        'as given'
    """

    rotation_covariance: Array
    misfit: float
    runner_up: float | None
    labeling: str
    hidden: float
    log_focal_sd: float | None

    @property
    def rotation_sd_deg(self) -> float:
        """Standard deviation of the rotation, in degrees, about its least certain axis."""
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(self.rotation_covariance)[-1])))


@dataclass(frozen=True)
class PoseFailure:
    """Why no pose was found.

    Attributes:
        reason: one of REASONS.
        detail: the evidence, in one sentence.

    Example:
        >>> from animal3dbox.labels import PoseFailure
        >>> PoseFailure("too_few_keypoints", "3 of 26 keypoints are visible").reason
        'too_few_keypoints'
    """

    reason: str
    detail: str


def reprojection_errors(problem: PoseProblem, R: Array, t: Array) -> tuple[Array, Array]:
    """Distances (N,) in px of the landmarks' projections from their keypoints, and depths (N,)."""
    projected, depth = project(problem.K, problem.points_world @ R.T + t)
    return norm(projected - problem.points_px), depth


def degenerate_points(problem: PoseProblem, min_keypoints: int) -> PoseFailure | None:
    """Why the points cannot fix a pose: they are too few, coincide, or lie in one plane.

    None if they can.
    """
    points, pixels = problem.points_world, problem.points_px
    count = len(points)
    if count < min_keypoints:
        return PoseFailure(
            "too_few_keypoints",
            f"{counted(count, 'visible keypoint')}, but min_keypoints is {min_keypoints}",
        )
    spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
    distinct = _distinct_points(points, COINCIDENCE * spread[0])
    if distinct < min_keypoints:
        return PoseFailure(
            "coplanar_keypoints",
            f"of {count} visible keypoints only {distinct} lie at different places on the body, but"
            f" min_keypoints is {min_keypoints}",
        )
    if spread[2] < RELATIVE_FLATNESS * spread[0]:
        return PoseFailure(
            "coplanar_keypoints", f"the {count} visible keypoints lie in one plane of the body"
        )
    if np.abs(pixels - pixels[0]).max() < SAME_PIXEL:
        return PoseFailure(
            "coplanar_keypoints",
            f"all {count} visible keypoints are at the same pixel {pixels[0].tolist()}",
        )
    return None


def _distinct_points(points: Array, tolerance: float) -> int:
    """How many of the points (N, 3) lie farther than the tolerance from every one before them."""
    offsets = points[:, None] - points[None]
    apart = (offsets * offsets).sum(-1) > tolerance**2
    count = len(points)
    if np.count_nonzero(apart) == count * (count - 1):
        return count
    return 1 + int((np.tril(apart, -1).sum(1)[1:] == np.arange(1, count)).sum())


def unit_problem(problem: PoseProblem) -> PoseProblem:
    """The problem about its landmarks' mean and in units of their spread."""
    middle, unit = unit_frame(problem.points_world)
    points = (problem.points_world - middle) / unit
    vertices = None
    if problem.vertices_world is not None:
        vertices = problem.vertices_world - middle
        vertices /= unit
    exchanged = tuple((part, (other - middle) / unit) for part, other in problem.exchanged)
    return replace(problem, points_world=points, vertices_world=vertices, exchanged=exchanged)


def in_unit_scale(
    problem: PoseProblem, solve: Callable[[PoseProblem], PoseEstimate | PoseFailure]
) -> PoseEstimate | PoseFailure:
    """Solve about the landmarks' mean and in units of their spread.

    The answer is then free of the mesh's unit.

    Args:
        problem: in the mesh's frame and unit.
        solve: finds a pose of the shifted and scaled problem.

    Returns:
        The pose of the problem as it was.

    """
    middle, unit = unit_frame(problem.points_world)
    pose = solve(unit_problem(problem))
    if isinstance(pose, PoseFailure):
        return pose
    t = translation_from_unit_frame(pose.R, pose.t, middle=middle, unit=unit)
    return replace(pose, t=t)

"""The camera pose of one animal, by the configured method."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.unit_frame import translation_in_unit_frame, unit_frame
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.pose.choice import Extras, exchange_cost, extra_costs
from animal3dbox.labels.pose.epnp_ransac import basic_pose, checked_pose, sqpnp_pose
from animal3dbox.labels.pose.exchanged_sides import likely_exchanges
from animal3dbox.labels.pose.focal_length import Zoom, zoom_of_pose
from animal3dbox.labels.pose.levenberg_marquardt import CameraPoses
from animal3dbox.labels.pose.multi_start_search import (
    body_misfit,
    keypoint_distances,
    search_poses,
)
from animal3dbox.labels.pose.outline_refinement import refine_on_outline
from animal3dbox.labels.pose.paper_refinement import refined_pose
from animal3dbox.labels.pose.problem import (
    AS_GIVEN,
    PoseEstimate,
    PoseEvidence,
    PoseFailure,
    PoseProblem,
    degenerate_points,
    in_unit_scale,
    unit_problem,
)
from animal3dbox.labels.pose.robust_joint_cost import (
    RefinedPoses,
    cost_at,
    pose_covariance,
    refine_jointly,
)

Array = NDArray[np.float64]
FINALISTS = 3
"""So many of the poses that the search finds are refined by the joint cost."""
DOUBT_SIGMA, DOUBT_MISFIT, DOUBT_HIDDEN = 4.0, 1.5, 3
"""Other labelings are tried if a keypoint is off by more than DOUBT_SIGMA, the misfit is more than
DOUBT_MISFIT, or DOUBT_HIDDEN marked keypoints lie behind the body."""
EXCHANGED = "exchanged"
"""The start of poses of another labeling."""
ANOTHER = 0.73
"""Rotations that differ by more in the Frobenius norm, by 30 degrees, are another orientation."""


def estimate_pose(
    problem: PoseProblem, config: LabelConfig, hypotheses: tuple[PoseEstimate, ...] = ()
) -> PoseEstimate | PoseFailure:
    """The camera pose of an animal (section 2.2).

    ``basic`` is EPnP + RANSAC, ``paper`` refines it by the joint cost. ``default`` starts from the
    hypotheses given, SQPnP, EPnP + RANSAC and a grid of views, in this order and only until a start
    explains every keypoint; it keeps the animal in front of the camera throughout, refines the best
    by a robust joint cost in which the mesh's supports are compared with the mask's, tries
    exchanged sides where the labeling is in doubt, and chooses by that cost, a weak prior of up and
    what the body hides. docs/solver.md has the formulas.

    Args:
        problem: keypoints, landmarks and mask.
        config: the method and its numbers.
        hypotheses: further starting poses, in the problem's own frame and unit; for ``default``
            only.

    Returns:
        The pose, or why there is none.

    Example:
        >>> import numpy as np
        >>> from animal3dbox.labels import LabelConfig, PoseProblem, estimate_pose
        >>> points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1]])
        >>> K = np.array([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]])
        >>> pixels = 100 * points[:, :2] / (points[:, 2:] + 5) + K[:2, 2]
        >>> problem = PoseProblem(
        ...     points, pixels, sigma_px=np.ones(6), K=K, image_hw=(120, 160), R_box=np.eye(3),
        ...     vertices_world=None, mask_box=None)
        >>> estimate_pose(problem, LabelConfig()).t.round(3)
        array([0., 0., 5.])
    """
    failure = degenerate_points(problem, config.min_keypoints)
    if failure is not None:
        return failure
    if config.method == "default":
        starts = _in_unit_frame(problem, hypotheses)
        return in_unit_scale(problem, lambda scaled: _default_pose(scaled, config, starts))
    return in_unit_scale(problem, lambda scaled: _published_pose(scaled, config))


def estimate_zoom(problem: PoseProblem, config: LabelConfig) -> Zoom | None:
    """The focal length that explains an animal best, by that of its K; None if it tells nothing.

    Args:
        problem: with a guessed K.
        config: the method.

    """
    if degenerate_points(problem, config.min_keypoints) is not None:
        return None
    scaled = unit_problem(problem)
    candidates, misfit = search_poses(scaled, _starting_poses(scaled, config, ()))
    return zoom_of_pose(scaled, candidates[:FINALISTS], misfit, config)


def _in_unit_frame(
    problem: PoseProblem, poses: tuple[PoseEstimate, ...]
) -> tuple[PoseEstimate, ...]:
    """Poses of the problem as poses of in_unit_scale's problem."""
    if not poses:
        return ()
    middle, unit = unit_frame(problem.points_world)
    return tuple(
        PoseEstimate(
            pose.R,
            translation_in_unit_frame(pose.R, pose.t, middle=middle, unit=unit),
            pose.hypothesis,
        )
        for pose in poses
    )


def _published_pose(problem: PoseProblem, config: LabelConfig) -> PoseEstimate | PoseFailure:
    """The pose by ``basic`` or ``paper``."""
    start = basic_pose(problem, config)
    if config.method == "basic" or isinstance(start, PoseFailure):
        return start
    return refined_pose(problem, start, config)


@dataclass(frozen=True)
class _Fit:
    """The refined poses of one labeling.

    Attributes:
        labeling: the part whose left and right are exchanged, or AS_GIVEN.
        problem: with that labeling's landmarks.
        refined: the poses, by the joint cost.
        hypotheses: (B,) the start that each came from.
        misfit: see search_poses.
        config: the method.
    """

    labeling: str
    problem: PoseProblem
    refined: RefinedPoses
    hypotheses: tuple[str, ...]
    misfit: float
    config: LabelConfig

    @cached_property
    def extras(self) -> list[Extras]:
        """What the poses cost beside the joint cost, one each."""
        poses = self.refined.poses
        return [
            extra_costs(self.problem, R, t, self.config)
            for R, t in zip(poses.R, poses.t, strict=True)
        ]

    @cached_property
    def misfit_of_body(self) -> float:
        """See body_misfit."""
        return body_misfit(self.problem, self.refined.poses)


def _default_pose(
    problem: PoseProblem, config: LabelConfig, hypotheses: tuple[PoseEstimate, ...]
) -> PoseEstimate | PoseFailure:
    """The best of several starts, and labelings if the given one is in doubt."""
    found, misfit = search_poses(problem, _starting_poses(problem, config, hypotheses))
    found = found[:FINALISTS]
    candidates = CameraPoses(
        np.stack([pose.R for pose in found]), np.stack([pose.t for pose in found])
    )
    refined = refine_jointly(problem, candidates, misfit, config)
    names = tuple(found[i].hypothesis for i in refined.ids.tolist())
    fits = [_Fit(AS_GIVEN, problem, refined, names, misfit, config)]
    if config.labelings == "mend" and problem.exchanged:
        fits += _exchanged_fits(fits[0], config)
    return _choose(fits, config)


def _exchanged_fits(given: _Fit, config: LabelConfig) -> list[_Fit]:
    """The poses of other labelings that may be cheaper; none where the one given is beyond doubt.

    It is in doubt if its best pose leaves a keypoint unexplained, or shows hidden ones.
    """
    problem, best = given.problem, given.refined.poses[:1]
    worst = keypoint_distances(problem, best).max()
    extras = given.extras[0]
    in_doubt = given.misfit > DOUBT_MISFIT or worst > DOUBT_SIGMA * given.misfit
    if not in_doubt and extras.n_hidden < DOUBT_HIDDEN:
        return []
    handicap = exchange_cost(given.misfit_of_body) - extras.total(given.misfit_of_body)
    fits = []
    for likely in likely_exchanges(problem, best, given.misfit, handicap=handicap):
        exchanged = replace(problem, points_world=likely.points_world)
        refined = refine_jointly(exchanged, likely.poses, likely.misfit, config)
        names = tuple(EXCHANGED for _ in refined.ids)
        fits.append(_Fit(likely.part, exchanged, refined, names, likely.misfit, config))
    return fits


def _choose(fits: list[_Fit], config: LabelConfig) -> PoseEstimate | PoseFailure:
    """The cheapest pose of all labelings, by the joint cost at a common misfit and the extras."""
    misfit = min(fit.misfit for fit in fits)
    of_body = min(fit.misfit_of_body for fit in fits)
    rated = sorted(
        (
            rated
            for fit in fits
            for rated in _rated(fit, misfit, of_body, is_alone=len(fits) == 1, config=config)
        ),
        key=lambda one: one.score,
    )
    for best in rated:
        pose = checked_pose(best.fit.problem, best.estimate(rated, of_body, config))
        if isinstance(pose, PoseEstimate):
            return pose
    return PoseFailure("behind_camera", "every refined pose puts the animal behind the camera")


@dataclass(frozen=True)
class _Rated:
    """One refined pose of a labeling, with all that it costs.

    Attributes:
        fit: the labeling's.
        index: of the pose in fit.refined.
        score: joint cost, extras and EXCHANGE_COST, in halves of a squared standard deviation.
        hidden: part of the marked keypoints that the body hides.
    """

    fit: _Fit
    index: int
    score: float
    hidden: float

    @property
    def R(self) -> Array:
        """The rotation (3, 3)."""
        R: Array = self.fit.refined.poses.R[self.index]
        return R

    def estimate(
        self, others: "list[_Rated]", misfit_of_body: float, config: LabelConfig
    ) -> PoseEstimate:
        """The pose with its evidence, among others, refined on the mask's whole outline."""
        refined, i = self.fit.refined, self.index
        behind = [
            other.score - self.score
            for other in others
            if other.fit is not self.fit or np.linalg.norm(other.R - self.R) > ANOTHER
        ]
        poses, local = refined.poses[i : i + 1], refined.local[i : i + 1]
        on_outline = refine_on_outline(
            self.fit.problem, poses, self.fit.misfit, misfit_of_body=misfit_of_body, config=config
        )
        if on_outline is not None:
            poses, local = on_outline
        spread = pose_covariance(self.fit.problem, poses, local)
        evidence = PoseEvidence(
            rotation_covariance=spread[:3, :3],
            misfit=misfit_of_body,
            runner_up=min(behind) if behind else None,
            labeling=self.fit.labeling,
            hidden=self.hidden,
            log_focal_sd=self.fit.problem.log_focal_sd,
        )
        return PoseEstimate(poses.R[0].copy(), poses.t[0].copy(), self.fit.hypotheses[i], evidence)


def _rated(
    fit: _Fit, misfit: float, misfit_of_body: float, *, is_alone: bool, config: LabelConfig
) -> list[_Rated]:
    """The refined poses of a labeling with all that they cost.

    Args:
        fit: of the labeling.
        misfit: the least of all labelings.
        misfit_of_body: likewise.
        is_alone: whether there is no other labeling, so that the costs are comparable as they are.
        config: the method.

    """
    poses, cost = fit.refined.poses, fit.refined.local.cost
    if not is_alone:
        cost = cost_at(fit.problem, poses, misfit, misfit_of_body=misfit_of_body, config=config)
    penalty = 0.0 if fit.labeling == AS_GIVEN else exchange_cost(misfit_of_body)
    rated = []
    for i, extras in enumerate(fit.extras):
        score = float(cost[i]) + extras.total(misfit_of_body) + penalty
        rated.append(_Rated(fit, i, score, extras.hidden))
    return rated


def _starting_poses(
    problem: PoseProblem, config: LabelConfig, hypotheses: tuple[PoseEstimate, ...]
) -> Iterator[PoseEstimate]:
    """Poses worth trying, the cheapest first, each solved for when it is asked for."""
    solvers = (
        *(partial(checked_pose, problem, hypothesis) for hypothesis in hypotheses),
        partial(sqpnp_pose, problem),
        partial(basic_pose, problem, config),
    )
    for solve in solvers:
        pose = solve()
        if isinstance(pose, PoseEstimate):
            yield pose

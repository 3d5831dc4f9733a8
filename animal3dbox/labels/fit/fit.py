"""The door of the articulated fit: one animal from arrays to a fitted body, or many at once."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.errors import ConfigError, ShapeError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.checks import check_image_hw
from animal3dbox.geometry.rigid_transforms import nearest_rotation
from animal3dbox.labels.argument_checks import ArgumentChecks
from animal3dbox.labels.body import Array, ArrayLike
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.fit_body import FitBody, fit_body
from animal3dbox.labels.fit.fitted_body import FitHypothesis, FittedBody
from animal3dbox.labels.fit.kinematics import turns_of_joints
from animal3dbox.labels.fit.mask_target import mask_target
from animal3dbox.labels.fit.pose_prior import whole_pose
from animal3dbox.labels.fit.problem import CAMERA, FitProblem, FitState, fit_problem, joined
from animal3dbox.labels.fit.schedule import Ranking, ranked_fits
from animal3dbox.labels.observation import checked_intrinsics
from animal3dbox.labels.pose.problem import AS_GIVEN, SAME_PIXEL
from animal3dbox.labels.types import Rejection
from animal3dbox.smal.keypoints.vocabularies import find_vocabulary
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SPINE_JOINTS, SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, quadruped_names

EXCHANGED_ALL = "all"
"""The labeling of keypoints whose left and right have all been exchanged, see exchanges.PARTS."""
ANOTHER_ORIENTATION = 0.73
"""Rotations that differ by more in the Frobenius norm, by 30 degrees, are another orientation."""


def fit_animal(
    image_hw: tuple[int, int],
    keypoints_2d: ArrayLike,
    *,
    mask: ArrayLike = None,
    K: ArrayLike = None,
    vocabulary: str | Vocabulary = "animal3d26",
    species: str | None = None,
    model: SmalModel | None = None,
    sample_id: str | None = None,
    config: LabelConfig | None = None,
) -> FittedBody | Rejection:
    """Fit a body to the keypoints of one animal: pose, shape, camera, and focal length if unknown.

    Arrays may be tensors, NumPy arrays or lists; all is computed in float64. Six keypoints are
    enough for an answer, but of fewer than ten a rigid body's is better.

    Args:
        image_hw: height and width of the image.
        keypoints_2d: (J, 3) x, y in px and visibility (0 hidden or missing, else a confidence in
            (0, 1]).
        mask: (H, W), above 0 on the animal; it makes the fit tighter.
        K: (3, 3) in px; None: the focal length is found with the body, about a guess.
        vocabulary: the keypoints' names: a known vocabulary or your own.
        species: one of the quadruped's presets, if it is known what the animal is.
        model: a body of SMAL's structure with landmarks and the quadruped's joint names; None: the
            embedded quadruped.
        sample_id: named in every error.
        config: the keypoints' noise, fewest keypoints, guess of the focal length, labelings.

    Returns:
        The fitted body, or a rejection with its reason.

    Raises:
        SampleError: an argument is wrong; names the sample, the argument and the remedy.
        ConfigError: the vocabulary, the species or the model cannot be used.

    Example:
        >>> from animal3dbox import fit_animal
        >>> from animal3dbox.datasets.synthetic import synthetic_animal
        >>> animal = synthetic_animal(seed=0, index=2)
        >>> fit = fit_animal(animal.image_hw, animal.keypoints_2d, K=animal.K, mask=animal.mask)
        >>> fit.vertices.shape, fit.body_name
        ((5852, 3), 'quadruped')
    """
    animal = {
        "image_hw": image_hw,
        "keypoints_2d": keypoints_2d,
        "mask": mask,
        "K": K,
        "vocabulary": vocabulary,
        "species": species,
        "model": model,
        "sample_id": sample_id,
    }
    return fit_many([animal], config)[0]


def fit_many(
    animals: Iterable[Mapping[str, Any]], config: LabelConfig | None = None
) -> list[FittedBody | Rejection]:
    """fit_animal for many animals: the same bodies to the byte, cheaper together.

    Args:
        animals: fit_animal's arguments by name, of one animal each, without config.
        config: as fit_animal's.

    Returns:
        Bodies and rejections, in order.

    Raises:
        SampleError: an argument is wrong; names the sample, the argument and the remedy.
        ConfigError: a vocabulary, a species or a model cannot be used.

    Example:
        >>> nothing_seen = {"image_hw": (48, 64), "keypoints_2d": np.zeros((26, 3))}
        >>> fit_many([nothing_seen])[0].reason
        'too_few_keypoints'
    """
    config = config or LabelConfig()
    sights = [_sight(config=config, **animal) for animal in animals]
    outcomes: list[FittedBody | Rejection | None] = [_without_points(s, config) for s in sights]
    groups: dict[int, list[int]] = {}
    for i, sight in enumerate(sights):
        if outcomes[i] is None:
            groups.setdefault(id(sight.body), []).append(i)
    for members in groups.values():
        for i, fitted in zip(members, _fitted([sights[i] for i in members], config), strict=True):
            outcomes[i] = fitted
    return [outcome for outcome in outcomes if outcome is not None]


@dataclass(frozen=True)
class FitObservation:
    """One animal, checked.

    Attributes:
        sample_id: named in every error.
        image_hw: height and width.
        keypoints_2d: (J, 3), zeros where nothing is seen.
        K: (3, 3) as given or guessed.
        K_is_given: which.
        mask: (H, W) bool, or None.
        body: what is fitted.
        body_name: see FittedBody.
    """

    sample_id: str | None
    image_hw: tuple[int, int]
    keypoints_2d: Array
    K: Array
    K_is_given: bool
    mask: NDArray[np.bool_] | None
    body: FitBody
    body_name: str

    @property
    def used(self) -> NDArray[np.bool_]:
        """Which keypoints are seen and have a landmark on the body, (J,)."""
        used: NDArray[np.bool_] = (self.keypoints_2d[:, 2] > 0) & self.body.tables.known
        return used


def _sight(
    *,
    image_hw: tuple[int, int],
    keypoints_2d: ArrayLike,
    config: LabelConfig,
    mask: ArrayLike = None,
    K: ArrayLike = None,
    vocabulary: str | Vocabulary = "animal3d26",
    species: str | None = None,
    model: SmalModel | None = None,
    sample_id: str | None = None,
) -> FitObservation:
    """The checked arguments of one animal; see fit_animal."""
    checks, words = ArgumentChecks(sample_id), find_vocabulary(vocabulary)
    try:
        check_image_hw("image_hw", image_hw)
    except (ShapeError, TypeError, ValueError) as error:
        raise checks.fail("image_hw", str(error)) from error
    size = (int(image_hw[0]), int(image_hw[1]))
    keypoints, _ = checks.keypoints(keypoints_2d, len(words), words.name, size)
    model = model or load_quadruped()
    _check_body(model, species)
    name = "quadruped" if model is load_quadruped() else "model"
    return FitObservation(
        sample_id=sample_id,
        image_hw=size,
        keypoints_2d=keypoints,
        K=checked_intrinsics(checks, K, size, config),
        K_is_given=K is not None,
        mask=None if mask is None else checks.mask(mask, size),
        body=fit_body(model, words, species),
        body_name=name if species is None else f"{name}:{species}",
    )


def _check_body(model: SmalModel, species: str | None) -> None:
    """Raise a ConfigError for a model that has no priors, or a species that is not known."""
    if not model.landmarks:
        raise ConfigError("model has no landmarks, so no keypoint has a place on it")
    known = set(load_quadruped().joint_names)
    unknown = [name for name in model.joint_names if name not in known]
    if unknown:
        raise ConfigError(
            f"model has the joint {unknown[0]!r}, of which no pose is known: its joints must have"
            " the quadruped's names, which are SMAL's"
        )
    presets = quadruped_names().presets
    if species is not None and (species not in presets or model is not load_quadruped()):
        raise ConfigError(
            f"species must be one of {', '.join(presets)}, and of the embedded quadruped, got"
            f" {species!r}"
        )


def _without_points(sight: FitObservation, config: LabelConfig) -> Rejection | None:
    """The rejection of an animal with too few keypoints, or all at one pixel."""
    seen = sight.keypoints_2d[sight.used, :2]
    if len(seen) < config.min_keypoints:
        return Rejection(
            sight.sample_id,
            "too_few_keypoints",
            f"{len(seen)} visible keypoints, but min_keypoints is {config.min_keypoints}",
        )
    if np.abs(seen - seen[0]).max() < SAME_PIXEL:
        return Rejection(
            sight.sample_id,
            "coplanar_keypoints",
            f"all {len(seen)} visible keypoints are at the same pixel {seen[0].tolist()}",
        )
    return None


def _fitted(sights: Sequence[FitObservation], config: LabelConfig) -> list[FittedBody]:
    """The fitted bodies of animals that share a body."""
    body = sights[0].body
    problem = joined([_problem(sight, config) for sight in sights])
    targets = {
        a: mask_target(sight.mask, sight.K[:2, 2])
        for a, sight in enumerate(sights)
        if sight.mask is not None
    }
    ranking = ranked_fits(body, problem, targets, exchanges=config.labelings == "mend")
    trunks = _trunks(body, ranking.state)
    covariances = _covariances(body, ranking)
    return [
        _fitted_body(sight, ranking, a, trunks=trunks, covariance=covariances[a])
        for a, sight in enumerate(sights)
    ]


def _problem(sight: FitObservation, config: LabelConfig) -> FitProblem:
    return fit_problem(
        sight.keypoints_2d,
        sight.K,
        sight.body.tables,
        image_hw=sight.image_hw,
        focal_is_known=sight.K_is_given,
        config=config,
    )


def _trunks(body: FitBody, state: FitState) -> Array:
    """The trunks' rotations (B, 3, 3) R_cam_box."""
    _, frames = body.frames(state.pose, state.shape)
    trunks: Array = state.R @ nearest_rotation(frames.rotations[:, list(SPINE_JOINTS)].mean(1))
    return trunks


def _covariances(body: FitBody, ranking: Ranking) -> Array:
    """The covariances (A, 3, 3) of turns of the best states' trunks about the camera's axes.

    The trunk turns with the camera, and by the mean turn of its joints.
    """
    state = ranking.best
    theta, frames = body.frames(state.pose, state.shape)
    turns = turns_of_joints(body.skeleton, frames, theta, body.pose_prior.directions)
    path = body.skeleton.path[list(SPINE_JOINTS)][:, body.skeleton.joints].mean(0)
    by_pose = state.R @ (path @ turns.reshape(len(state), len(path), -1)).reshape(len(state), 3, -1)
    by_step = np.zeros((len(state), 3, CAMERA + sum(body.sizes)))
    by_step[:, :, :3] = np.eye(3)
    by_step[:, :, CAMERA : CAMERA + body.sizes[0]] = by_pose
    spread = np.linalg.solve(ranking.local.A, by_step.swapaxes(1, 2))
    covariances: Array = by_step @ spread
    return covariances


def _fitted_body(
    sight: FitObservation, ranking: Ranking, a: int, *, trunks: Array, covariance: Array
) -> FittedBody:
    """The fitted body of the animal a of a ranking."""
    body, state = sight.body, ranking.best[a : a + 1]
    theta, frames = body.frames(state.pose, state.shape)
    betas = body.shape_prior.mean + body.shape_prior.directions @ state.shape[0]
    pose = whole_pose(body.model.joint_names, theta[0])
    posed = body.model.posed(
        torch.from_numpy(betas)[None], pose[None], torch.zeros(1, 3, dtype=torch.float64)
    )
    R, t = state.R[0], state.t[0] - state.R[0] @ body.skeleton.origin
    K = sight.K.copy()
    K[:2, :2] *= np.exp(state.focal[0])
    count = ranking.score.shape[1]
    own = slice(a * count, (a + 1) * count)
    hypotheses = _hypotheses(
        trunks[own], ranking.score[a], ranking.state.exchanged[own], int(ranking.chosen[a])
    )
    behind = [one.score for one in hypotheses[1:] if _is_another(one, hypotheses[0])]
    return FittedBody(
        sample_id=sight.sample_id,
        model=body.model,
        body_name=sight.body_name,
        vocabulary=body.vocabulary,
        betas=betas,
        pose=as_numpy(pose),
        vertices=as_numpy(posed.vertices[0]),
        R_world_joint=as_numpy(posed.R_world_joint[0]),
        R=R,
        t=t,
        K=sight.K if sight.K_is_given else K,
        K_source="given" if sight.K_is_given else "estimated",
        log_focal=0.0 if sight.K_is_given else float(state.focal[0]),
        R_box=nearest_rotation(frames.rotations[0, list(SPINE_JOINTS)].mean(0)),
        rotation_covariance=covariance,
        cost=float(ranking.local.cost[a]),
        margin=min(behind) - hypotheses[0].score if behind else None,
        labeling=hypotheses[0].labeling,
        hidden=float(ranking.extras.away[a]),
        hypotheses=hypotheses,
    )


def _hypotheses(
    trunks: Array, score: Array, exchanged: NDArray[np.bool_], chosen: int
) -> tuple[FitHypothesis, ...]:
    """The hypotheses of one animal, the chosen one first, then by score."""
    order = sorted(range(len(score)), key=lambda i: (i != chosen, score[i]))
    return tuple(
        FitHypothesis(trunks[i], float(score[i]), EXCHANGED_ALL if exchanged[i] else AS_GIVEN)
        for i in order
    )


def _is_another(one: FitHypothesis, other: FitHypothesis) -> bool:
    """Whether a hypothesis is of another orientation or labeling than another."""
    apart = float(np.sqrt(((one.rotation - other.rotation) ** 2).sum()))
    return one.labeling != other.labeling or apart > ANOTHER_ORIENTATION

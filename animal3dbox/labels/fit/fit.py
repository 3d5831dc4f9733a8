"""The door of the articulated fit: one animal from arrays to a fitted body, or many at once."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy, norm
from animal3dbox.geometry.rigid_transforms import nearest_rotation
from animal3dbox.labels.body import Array, ArrayLike
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.descent import projected
from animal3dbox.labels.fit.fit_body import FitBody
from animal3dbox.labels.fit.fitted_body import FitHypothesis, FittedBody
from animal3dbox.labels.fit.kinematics import turns_of_joints
from animal3dbox.labels.fit.mask_target import mask_target
from animal3dbox.labels.fit.pose_prior import whole_pose
from animal3dbox.labels.fit.problem import CAMERA, FitState, joined
from animal3dbox.labels.fit.request import FitRequest, fit_request, without_points
from animal3dbox.labels.fit.schedule import Ranking, ranked_fits
from animal3dbox.labels.pose.estimate import ANOTHER
from animal3dbox.labels.pose.multi_start_search import RAYLEIGH_MEDIAN
from animal3dbox.labels.pose.problem import AS_GIVEN
from animal3dbox.labels.types import Rejection
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SPINE_JOINTS, SmalModel

EXCHANGED_ALL = "all"
"""The labeling of keypoints whose left and right have all been exchanged, see exchanges.PARTS."""
AT_ONCE = 16
"""How many animals are fitted in one batch: more of them gain little, and need memory."""


def fit_animal(
    image_hw: tuple[int, int],
    keypoints_2d: ArrayLike,
    *,
    mask: ArrayLike = None,
    K: ArrayLike = None,
    down_cam: ArrayLike = None,
    vocabulary: str | Vocabulary = "animal3d26",
    species: str | None = None,
    category: str | None = None,
    calibration: Calibration | Path | str | None = None,
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
        down_cam: (3,) unit, gravity's direction in the camera frame, where it is known.
        vocabulary: the keypoints' names: a known vocabulary or your own.
        species: one of the quadruped's presets, if it is known what the animal is.
        category: the animal's class in its dataset, whose shape a calibration may know; its shape
            comes before that of the species.
        calibration: what the animal's dataset taught of its keypoints' places and its classes'
            shapes, or the file of it (`animal3dbox calibrate --learn places,shapes`).
        model: a body of SMAL's structure with landmarks and the quadruped's joint names; None: the
            embedded quadruped.
        sample_id: named in every error.
        config: the keypoints' noise, fewest keypoints, guess of the focal length, labelings.

    Returns:
        The fitted body, or a rejection with its reason.

    Raises:
        SampleError: an argument is wrong; names the sample, the argument and the remedy.
        ConfigError: the vocabulary, the species, the model or the calibration cannot be used.

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
        "down_cam": down_cam,
        "vocabulary": vocabulary,
        "species": species,
        "category": category,
        "calibration": calibration,
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
    requests = [fit_request(config=config, **animal) for animal in animals]
    outcomes: list[FittedBody | Rejection | None] = [
        without_points(request, config) for request in requests
    ]
    groups: dict[int, list[int]] = {}
    for i, request in enumerate(requests):
        if outcomes[i] is None:
            groups.setdefault(id(request.body), []).append(i)
    batches = [
        members[k : k + AT_ONCE]
        for members in groups.values()
        for k in range(0, len(members), AT_ONCE)
    ]
    for members in batches:
        fitted = _fitted([requests[i] for i in members], exchanges=config.labelings == "mend")
        for i, body in zip(members, fitted, strict=True):
            outcomes[i] = body
    return [outcome for outcome in outcomes if outcome is not None]


def _fitted(requests: Sequence[FitRequest], *, exchanges: bool) -> list[FittedBody]:
    """The fitted bodies of animals that share a body."""
    body = requests[0].body
    problem = joined([request.problem for request in requests])
    targets = {
        a: mask_target(request.mask, request.K[:2, 2])
        for a, request in enumerate(requests)
        if request.mask is not None
    }
    ranking = ranked_fits(body, problem, targets, exchanges=exchanges)
    trunks = _trunks(body, ranking.state)
    covariances, focal_sd = _covariances(body, ranking)
    return [
        _fitted_body(
            request, ranking, a, trunks=trunks, covariance=covariances[a], focal_sd=focal_sd[a]
        )
        for a, request in enumerate(requests)
    ]


def _trunks(body: FitBody, state: FitState) -> Array:
    """The trunks' rotations (B, 3, 3) R_cam_box."""
    _, frames = body.frames(state.pose, state.shape)
    trunks: Array = state.R @ nearest_rotation(frames.rotations[:, list(SPINE_JOINTS)].mean(1))
    return trunks


def _covariances(body: FitBody, ranking: Ranking) -> tuple[Array, Array]:
    """The covariances (A, 3, 3) of turns of the best states' trunks about the camera's axes.

    The trunk turns with the camera, and by the mean turn of its joints. Besides, the deviations
    (A,) of the focal lengths' logarithms.
    """
    state = ranking.best
    theta, frames = body.frames(state.pose, state.shape)
    turns = turns_of_joints(body.skeleton, frames, theta, body.pose_prior.directions)
    path = body.skeleton.path[list(SPINE_JOINTS)][:, body.skeleton.joints].mean(0)
    by_pose = state.R @ (path @ turns.reshape(len(state), len(path), -1)).reshape(len(state), 3, -1)
    by_step = np.zeros((len(state), 3, CAMERA + sum(body.sizes)))
    by_step[:, :, :3] = np.eye(3)
    by_step[:, :, CAMERA : CAMERA + body.sizes[0]] = by_pose
    by_focal = np.zeros((len(state), 1, by_step.shape[2]))
    by_focal[:, 0, CAMERA - 1] = 1.0
    wanted = np.concatenate((by_step, by_focal), 1)
    covariances = wanted @ np.linalg.solve(ranking.local.A, wanted.swapaxes(1, 2))
    return covariances[:, :3, :3], np.sqrt(covariances[:, 3, 3])


def _fitted_body(
    request: FitRequest,
    ranking: Ranking,
    a: int,
    *,
    trunks: Array,
    covariance: Array,
    focal_sd: float,
) -> FittedBody:
    """The fitted body of the animal a of a ranking."""
    body, state = request.body, ranking.best[a : a + 1]
    theta, frames = body.frames(state.pose, state.shape)
    betas = body.shape_prior.mean + body.shape_prior.directions @ state.shape[0]
    pose = whole_pose(body.model.joint_names, theta[0], body.skeleton.alignment)
    posed = body.model.posed(
        torch.from_numpy(betas)[None], pose[None], torch.zeros(1, 3, dtype=torch.float64)
    )
    R, t = state.R[0], state.t[0] - state.R[0] @ body.skeleton.origin
    count = ranking.score.shape[1]
    own = slice(a * count, (a + 1) * count)
    hypotheses = _hypotheses(
        trunks[own], ranking.score[a], ranking.state.exchanged[own], int(ranking.chosen[a])
    )
    behind = [one.score for one in hypotheses[1:] if _is_another(one, hypotheses[0])]
    return FittedBody(
        sample_id=request.sample_id,
        model=body.model,
        body_name=request.body_name,
        vocabulary=body.vocabulary,
        betas=betas,
        pose=as_numpy(pose),
        vertices=as_numpy(posed.vertices[0]),
        R_world_joint=as_numpy(posed.R_world_joint[0]),
        R=R,
        t=t,
        K=_intrinsics(request, float(state.focal[0])),
        K_source="given" if request.K_is_given else "estimated",
        log_focal=0.0 if request.K_is_given else float(state.focal[0]),
        log_focal_sd=None if request.K_is_given else float(focal_sd),
        R_box=nearest_rotation(frames.rotations[0, list(SPINE_JOINTS)].mean(0)),
        rotation_covariance=covariance,
        cost=float(ranking.local.cost[a]),
        margin=min(behind) - hypotheses[0].score if behind else None,
        labeling=hypotheses[0].labeling,
        misfit=_misfit(request, state),
        hidden=float(ranking.extras.away[a]),
        moved_places=body.moved_places(state.shape, as_numpy(posed.R_world_joint))[0],
        calibration=request.calibration,
        hypotheses=hypotheses,
    )


def _intrinsics(request: FitRequest, focal: float) -> Array:
    """The intrinsics as given, or with the estimated focal length, e^focal times the guess."""
    if request.K_is_given:
        return request.K
    K = request.K.copy()
    K[:2, :2] *= np.exp(focal)
    return K


def _misfit(request: FitRequest, state: FitState) -> float:
    """See FittedBody.misfit: the median Mahalanobis distance over that of noise alone."""
    body, problem = request.body, request.problem
    points = body.landmarks(state.pose, state.shape)
    px, _, _ = projected(state, problem.linear, points, np.zeros((1, 0, *points.shape[1:])))
    names = np.array(body.exchanged) if state.exchanged[0] else np.arange(len(body.exchanged))
    used = request.used[names]
    apart = (px[0] - problem.pixels[0][:, names])[:, used] / request.noise_px[names][used]
    return max(1.0, float(np.median(norm(apart.T))) / RAYLEIGH_MEDIAN)


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
    return one.labeling != other.labeling or apart > ANOTHER

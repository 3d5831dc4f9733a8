"""One animal that a body is to be fitted to: its arguments, checked."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import ConfigError
from animal3dbox.labels.argument_checks import ArgumentChecks
from animal3dbox.labels.body import Array, ArrayLike
from animal3dbox.labels.calibration import Calibration, ClassShape, KeypointPlaces, calibration_of
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.fit_body import FitBody, body_digest, fit_body
from animal3dbox.labels.fit.problem import FitProblem, fit_problem
from animal3dbox.labels.observation import checked_intrinsics
from animal3dbox.labels.pose.keypoint_uncertainty import keypoint_sigma
from animal3dbox.labels.pose.problem import SAME_PIXEL
from animal3dbox.labels.types import Rejection
from animal3dbox.plurals import counted
from animal3dbox.smal.keypoints.vocabularies import find_vocabulary
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.model import SmalModel
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped, quadruped_names


@dataclass(frozen=True)
class FitRequest:
    """One animal that a body is to be fitted to, checked.

    Attributes:
        sample_id: named in every error.
        image_hw: height and width.
        keypoints_2d: (J, 3), zeros where nothing is seen.
        K: (3, 3) as given or guessed.
        K_is_given: which.
        mask: (H, W) bool, or None.
        body: what is fitted.
        body_name: see FittedBody.
        noise_px: (J,) standard deviations of the keypoints.
        is_upright: whether cameras seldom roll or stand under the ground, and gravity counts.
        down: (3,) unit, gravity in the camera's frame; None: not known.
        calibration: digest of the calibration that has a part in the body; None without.
    """

    sample_id: str | None
    image_hw: tuple[int, int]
    keypoints_2d: Array
    K: Array
    K_is_given: bool
    mask: NDArray[np.bool_] | None
    body: FitBody
    body_name: str
    noise_px: Array
    is_upright: bool
    down: Array | None
    calibration: str | None

    @property
    def used(self) -> NDArray[np.bool_]:
        """Which keypoints are seen and have a landmark on the body, (J,)."""
        used: NDArray[np.bool_] = (self.keypoints_2d[:, 2] > 0) & self.body.tables.known
        return used

    @property
    def problem(self) -> FitProblem:
        """The problem of this animal alone."""
        return fit_problem(
            self.keypoints_2d,
            self.K,
            self.body.tables,
            image_hw=self.image_hw,
            focal_is_known=self.K_is_given,
            is_upright=self.is_upright,
            down=self.down,
            noise_px=self.noise_px,
            places_sd=self.body.places_sd,
        )


def fit_request(
    *,
    image_hw: tuple[int, int],
    keypoints_2d: ArrayLike,
    config: LabelConfig,
    mask: ArrayLike = None,
    K: ArrayLike = None,
    down_cam: ArrayLike = None,
    vocabulary: str | Vocabulary = "animal3d26",
    species: str | None = None,
    model: SmalModel | None = None,
    sample_id: str | None = None,
    calibration: Calibration | Path | str | None = None,
    category: str | None = None,
) -> FitRequest:
    """The checked arguments of one animal; see fit_animal."""
    checks, words = ArgumentChecks(sample_id), find_vocabulary(vocabulary)
    size = checks.image_hw(image_hw)
    keypoints, _ = checks.keypoints(keypoints_2d, len(words), words.name, size)
    model = model or load_quadruped()
    _check_body(model, species)
    name = "quadruped" if model is load_quadruped() else "model"
    taught = calibration_of(calibration)
    places, shape = _lessons(taught, words, model, category)
    return FitRequest(
        sample_id=sample_id,
        image_hw=size,
        keypoints_2d=keypoints,
        K=checked_intrinsics(checks, K, size, config),
        K_is_given=K is not None,
        mask=None if mask is None else checks.mask(mask, size),
        body=fit_body(model, words, None if shape else species, places=places, shape=shape),
        noise_px=keypoint_sigma(keypoints, size, config),
        is_upright=config.upright == "prior",
        down=checks.down(down_cam),
        body_name=name if species is None else f"{name}:{species}",
        calibration=taught.digest if taught is not None and (places or shape) else None,
    )


def _lessons(
    calibration: Calibration | None, words: Vocabulary, model: SmalModel, category: str | None
) -> tuple[KeypointPlaces | None, ClassShape | None]:
    """What a calibration says of an animal's body: its keypoints' places and its class's shape."""
    if calibration is None:
        return None, None
    check_lessons(calibration, words, model)
    return calibration.places_of(words.name), calibration.shape_of(words.name, category)


def check_lessons(calibration: Calibration, words: Vocabulary, model: SmalModel) -> None:
    """Raise a ConfigError unless a calibration's places and shapes are a model's.

    Args:
        calibration: of which those of one vocabulary are looked at.
        words: the vocabulary.
        model: that is to be fitted.

    """
    again = "learn anew with animal3dbox calibrate --learn places,shapes"
    shapes = [shape for shape in calibration.shapes if shape.vocabulary == words.name]
    places = [one for one in calibration.places if one.vocabulary == words.name]
    own = body_digest(model, words) if shapes or places else ""
    for body in (*(one.body for one in places), *(shape.body for shape in shapes)):
        if body != own:
            raise ConfigError(
                "the calibration's places and shapes were learned with another body than the one to"
                f" be fitted, or with {words.name}'s keypoints elsewhere on it ({body}, not {own}):"
                f" fit that body, or {again}"
            )
    if any(one.keypoints != words.keypoints for one in places):
        raise ConfigError(
            f"the calibration's places are of other keypoints than vocabulary {words.name} has now:"
            f" {again}"
        )
    for shape in shapes:
        if len(shape.betas) != model.beta_count:
            raise ConfigError(
                f"the calibration's shape of {shape.category} has {len(shape.betas)} betas, the"
                f" model {model.beta_count}: {again}"
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


def without_points(request: FitRequest, config: LabelConfig) -> Rejection | None:
    """The rejection of an animal with too few keypoints, or all at one pixel."""
    seen = request.keypoints_2d[request.used, :2]
    if len(seen) < config.min_keypoints:
        return Rejection(
            request.sample_id,
            "too_few_keypoints",
            f"{counted(len(seen), 'visible keypoint')}, but min_keypoints is"
            f" {config.min_keypoints}",
        )
    if np.abs(seen - seen[0]).max() < SAME_PIXEL:
        return Rejection(
            request.sample_id,
            "coplanar_keypoints",
            f"all {len(seen)} visible keypoints are at the same pixel {seen[0].tolist()}",
        )
    return None

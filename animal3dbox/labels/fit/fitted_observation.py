"""From a fitted body to a checked animal, which is labelled like any other."""

import math
from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

from animal3dbox.labels.argument_checks import ArgumentChecks
from animal3dbox.labels.body import Body
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.fit import fit_many
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.observation import Observation, checked_intrinsics, observe
from animal3dbox.labels.pose.focal_length import Zoom, common_zoom
from animal3dbox.labels.pose.problem import PoseEstimate, PoseEvidence
from animal3dbox.labels.types import Rejection
from animal3dbox.smal.quadruped.preset_bodies import quadruped_names

BodyChoice = Literal["given", "fit"]
"""Where a body comes from: the caller, or the articulated fit."""
FITTED = "fit"
"""The start of poses that the articulated fit found, and the word of Quality.body."""
RIGID_STAND_IN = "preset"
"""The word of Quality.body for a rigid body in the stead of a fitted one."""
FOUND_BY_THE_FIT = (
    *("vertices", "faces", "keypoints_3d", "landmark_sigma"),
    *("pose", "pose_hypotheses", "distortion"),
)
"""Arguments of label_animal that a fit finds itself, or cannot take account of."""
SHARED = (
    *("image_hw", "keypoints_2d", "mask", "K", "down_cam"),
    *("vocabulary", "sample_id", "calibration"),
)
"""Arguments of label_animal that are fit_animal's, too."""
ENOUGH_KEYPOINTS = 10
"""Of fewer keypoints a rigid body tells more than a fitted one."""


def checked_choice(arguments: dict[str, Any]) -> BodyChoice:
    """Where an animal's body comes from, taken out of label_animal's arguments.

    Raises:
        SampleError: it is no such choice, or an argument is given that a fit finds itself.

    """
    choice: BodyChoice = arguments.pop("body", "given")
    checks = ArgumentChecks(arguments.get("sample_id"))
    if choice not in get_args(BodyChoice):
        raise checks.fail("body", f"must be one of {', '.join(get_args(BodyChoice))}")
    for name in FOUND_BY_THE_FIT if choice == FITTED else ():
        value = arguments.pop(name, None)
        if value is not None and not (isinstance(value, tuple | list) and not len(value)):
            raise checks.fail(
                name, "cannot be given with body='fit', which fits a body and its camera itself"
            )
    return choice


def fitted_observations(
    animals: Sequence[dict[str, Any]],
    config: LabelConfig,
    images: Sequence[Hashable] | None = None,
) -> list[Observation | Rejection]:
    """Animals with the bodies that were fitted to them, their cameras told with how sure they are.

    Args:
        animals: label_animal's arguments, see checked_choice; and `category`, the dataset's name of
            the animal's class, where the species is a preset that stands for it.
        config: the method.
        images: what names each animal's picture: those of one share a focal length that nothing
            tells; None: each is alone in one.

    """
    if not animals:
        return []
    arguments = [_fit_arguments(animal, config) for animal in animals]
    fits = fit_many(arguments, config)
    if images is not None:
        fits = with_shared_focal_lengths(arguments, fits, images, config)
    return [
        fit if isinstance(fit, Rejection) else _observation(animal, fit, config)
        for animal, fit in zip(animals, fits, strict=True)
    ]


def with_shared_focal_lengths(
    arguments: Sequence[dict[str, Any]],
    fits: Sequence[FittedBody | Rejection],
    images: Sequence[Hashable],
    config: LabelConfig,
) -> list[FittedBody | Rejection]:
    """Fits whose animals of one image share the focal length that all of them together tell.

    Each fit found one of its own; the animals are fitted again with their mean by their variances.

    Args:
        arguments: fit_animal's, of each animal.
        fits: of each.
        images: what names each animal's picture.
        config: the method.

    """
    members: dict[Hashable, dict[int, Zoom]] = {}
    for i, fit in enumerate(fits):
        if isinstance(fit, FittedBody) and fit.log_focal_sd is not None:
            members.setdefault(images[i], {})[i] = Zoom(fit.log_focal, fit.log_focal_sd)
    zooms: dict[int, Zoom] = {}
    for own in members.values():
        if len(own) > 1:
            zooms |= dict.fromkeys(own, common_zoom(list(own.values())))
    known = []
    for i, zoom in zooms.items():
        size = arguments[i]["image_hw"]
        K = checked_intrinsics(ArgumentChecks(None), None, size, config).copy()
        K[:2, :2] *= math.exp(zoom.log)
        known.append({**arguments[i], "K": K})
    finished = list(fits)
    for (i, zoom), fit in zip(zooms.items(), fit_many(known, config), strict=True):
        finished[i] = fit
        if isinstance(fit, FittedBody):
            finished[i] = replace(
                fit, K_source="estimated", log_focal=zoom.log, log_focal_sd=zoom.sd
            )
    return finished


def rigid_stand_in(observation: Observation) -> Observation:
    """An animal that cannot be fitted, with a rigid body in its stead; its label says so."""
    count = int(observation.matched.sum())
    why = "its lens" if observation.distortion is not None else f"{count} keypoints"
    warning = f"a rigid body stands in for a fitted one, because of {why}"
    return replace(
        observation, warnings=(*observation.warnings, warning), body_source=RIGID_STAND_IN
    )


def _is_guessed(animal: dict[str, Any], config: LabelConfig) -> bool:
    """Whether an animal's focal length is to stay at the guess."""
    return animal.get("K") is None and config.focal == "guess"


def _fit_arguments(animal: dict[str, Any], config: LabelConfig) -> dict[str, Any]:
    """fit_many's arguments of label_animal's."""
    if animal.get("keypoints_2d") is None:
        checks = ArgumentChecks(animal.get("sample_id"))
        raise checks.fail("keypoints_2d", "is missing: a fit needs keypoints")
    species, model = animal.get("species"), animal.get("template")
    is_preset = species in quadruped_names().presets and model is None
    arguments = {name: animal[name] for name in SHARED if name in animal}
    if _is_guessed(animal, config):
        checks = ArgumentChecks(animal.get("sample_id"))
        size = checks.image_hw(animal["image_hw"])
        arguments["K"] = checked_intrinsics(checks, None, size, config)
    return {
        **arguments,
        "species": species if is_preset else None,
        "category": animal.get("category", species),
        "model": model,
    }


def _observation(animal: dict[str, Any], fit: FittedBody, config: LabelConfig) -> Observation:
    """An animal with its fitted body, checked."""
    arguments = {**animal, "K": fit.K}
    arguments.pop("template", None)
    arguments.pop("category", None)
    body = Body(fit.vertices, fit.model.faces, fit.landmarks, None, fit.model)
    observation = observe(body=body, config=config, **arguments)
    return replace(
        observation,
        pose=PoseEstimate(fit.R, fit.t, FITTED, _evidence(fit)),
        K_source="guessed" if _is_guessed(animal, config) else fit.K_source,
        log_focal_sd=fit.log_focal_sd,
        warnings=(*observation.warnings, *_warnings(observation)),
        body_source=FITTED,
        fit=fit.parameters,
        body_calibration=fit.calibration,
    )


def _evidence(fit: FittedBody) -> PoseEvidence:
    """How sure a fit's camera is."""
    return PoseEvidence(
        rotation_covariance=fit.rotation_covariance,
        misfit=fit.misfit,
        runner_up=fit.margin,
        labeling=fit.labeling,
        hidden=fit.hidden,
        log_focal_sd=fit.log_focal_sd,
    )


def _warnings(observation: Observation) -> tuple[str, ...]:
    """What to tell of a fit with few keypoints."""
    count = int(observation.matched.sum())
    if count >= ENOUGH_KEYPOINTS:
        return ()
    return (
        f"the body was fitted to {count} keypoints: of fewer than {ENOUGH_KEYPOINTS} a rigid"
        " preset tells more",
    )

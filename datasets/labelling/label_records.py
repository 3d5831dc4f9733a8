"""From an annotated animal to its label: the one way that every Dataset and command goes."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.sources import many_bodies
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.labelling.given_boxes import given_label
from animal3dbox.datasets.labelling.image_samples import Record
from animal3dbox.datasets.labelling.keypoint_places import Misplaced
from animal3dbox.datasets.labelling.label_requests import LabelRequest
from animal3dbox.datasets.labelling.sample_checks import (
    Outcome,
    Remarks,
    check_camera_turn,
    checked_request,
    with_remarks,
)
from animal3dbox.datasets.labelling.scale import ScaleSource, in_metres
from animal3dbox.datasets.readers.tolerance import BadParts
from animal3dbox.datasets.records import AnimalRecord, CuboidRecord
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.labels.body import Body
from animal3dbox.labels.calibration import Calibration
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.fitted_observation import fitted_observations, rigid_stand_in
from animal3dbox.labels.label import label_observations
from animal3dbox.labels.observation import Observation, observe
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

CameraPolicy = Literal["hypothesis", "exact"]
"""How the camera pose that a dataset stores for its bodies is taken: as one guess, or as known."""


def label_records(
    requests: Sequence[LabelRequest],
    config: LabelConfig,
    *,
    scale: ScaleSource | None = None,
    stored_cameras: CameraPolicy = "hypothesis",
    calibration: Calibration | None = None,
    misplaced: Misplaced = "fault",
    optional: BadParts = "fault",
) -> list[Outcome]:
    """The labels of many animals, each the same as alone; an unusable one spoils no other.

    Args:
        requests: the animals; a single one is a list of one.
        config: the method.
        scale: what makes labels metric where the dataset itself does not say; None: nothing, they
            are in the body's unit.
        stored_cameras: what a camera pose that the dataset stores is taken for.
        calibration: what the dataset taught about its keypoints' places; None: nothing.
        misplaced: what keypoints beside their animal are, see keypoints_problem.
        optional: what a mask whose file cannot be used is: a "fault", or left out with a warning.

    Returns:
        Labels, rejections and errors, in order.

    Example:
        >>> from animal3dbox import LabelConfig
        >>> from animal3dbox.datasets import SyntheticSet, preset_body, request_of_record
        >>> records = SyntheticSet(seed=0, images=1).records().records
        >>> request = request_of_record(records[0], preset_body("dog"))
        >>> [type(outcome).__name__ for outcome in label_records([request], LabelConfig())]
        ['CuboidLabel']
    """
    asked, requests = len(requests), list(_with_siblings(requests, config))
    outcomes: list[Outcome | None] = [None] * len(requests)
    by_source: dict[int, list[int]] = {}
    remarks: dict[int, Remarks] = {}
    for place, request in enumerate(requests):
        try:
            check_camera_turn(request.record, request.facts)
            if isinstance(request.record, CuboidRecord):
                outcomes[place] = given_label(request.record)
                continue
            # The mask is decoded before its batch, which an unreadable one must not spoil
            requests[place], remarks[place] = checked_request(request, misplaced, optional)
            by_source.setdefault(id(request.bodies), []).append(place)
        except SampleError as error:
            outcomes[place] = error
    for places in by_source.values():
        animals = [requests[place] for place in places]
        labels = _labels_of_source(
            animals, config, scale=scale, stored_cameras=stored_cameras, calibration=calibration
        )
        for place, outcome in zip(places, labels, strict=True):
            outcomes[place] = outcome
    for place, remark in remarks.items():
        outcomes[place] = with_remarks(outcomes[place], remark)
    return [outcome for outcome in outcomes[:asked] if outcome is not None]


def _with_siblings(requests: Sequence[LabelRequest], config: LabelConfig) -> Sequence[LabelRequest]:
    """The requests, and after them those for the other animals of images of unknown focal length.

    All animals of an image tell its focal length, whether their labels are asked for or not.
    """
    if not estimates_focal_lengths(config):
        return requests
    asked = {(id(request.sample), request.place) for request in requests}
    siblings = []
    for request in {id(one.sample): one for one in requests}.values():
        if len(request.sample.animals) < 2 or not _lacks_camera(request):
            continue
        siblings += [
            LabelRequest(request.sample, place, request.facts)
            for place in range(len(request.sample.animals))
            if (id(request.sample), place) not in asked
        ]
    return [*requests, *siblings]


def estimates_focal_lengths(config: LabelConfig) -> bool:
    """Whether a focal length that nothing tells is estimated from an image's animals."""
    return config.method == "default" and config.focal == "estimate"


def _lacks_camera(request: LabelRequest) -> bool:
    """Whether nothing tells the focal length of an animal's image."""
    record = request.record
    return isinstance(record, AnimalRecord) and camera_of(record, request.facts)[0] is None


def _labels_of_source(
    requests: Sequence[LabelRequest],
    config: LabelConfig,
    *,
    scale: ScaleSource | None,
    stored_cameras: CameraPolicy,
    calibration: Calibration | None,
) -> list[Outcome]:
    """The labels of animals whose bodies come from one source, made together where that works."""
    try:
        records = [_with_camera(request.record, stored_cameras) for request in requests]
        # Methods basic and paper estimate the camera of a body that they are given, a rigid one.
        fits = config.method == "default" and isinstance(requests[0].bodies, FittedBodies)
        observe_all = _fitted if fits else _given
        observations = observe_all(requests, records, config, calibration=calibration)
        known = [one for one in observations if isinstance(one, Observation)]
        labels = iter(label_observations(known, config))
        return [
            one
            if isinstance(one, Rejection)
            else _finished(next(labels), request, record=record, body=one.body, scale=scale)
            for one, request, record in zip(observations, requests, records, strict=True)
        ]
    except SampleError as error:
        if len(requests) == 1:
            return [error]
    label_some = partial(
        _labels_of_source,
        config=config,
        scale=scale,
        stored_cameras=stored_cameras,
        calibration=calibration,
    )
    return _one_image_at_a_time(requests, label_some)


def _one_image_at_a_time(
    requests: Sequence[LabelRequest], label_some: Callable[[Sequence[LabelRequest]], list[Outcome]]
) -> list[Outcome]:
    """The labels of animals some of which are unusable.

    The usable animals of an image are still labelled together, since they share a focal length.
    """
    images: dict[int, list[int]] = {}
    for place, request in enumerate(requests):
        images.setdefault(id(request.sample), []).append(place)
    outcomes: dict[int, Outcome] = {}
    for places in images.values():
        usable = places
        if len(images) == 1:
            alone = {place: label_some([requests[place]])[0] for place in places}
            faults = {i: one for i, one in alone.items() if isinstance(one, SampleError)}
            outcomes |= faults
            usable = [place for place in places if place not in faults]
        if usable:
            outcomes |= zip(usable, label_some([requests[i] for i in usable]), strict=True)
    return [outcomes[place] for place in range(len(requests))]


def _with_camera(record: Record, policy: CameraPolicy) -> AnimalRecord:
    """A record with its dataset's own camera taken as known, if the policy is "exact"."""
    if isinstance(record, CuboidRecord):
        raise TypeError(f"{record.sample_id} is a box: it has no body")
    if policy == "exact" and record.pose is None:
        return replace(record, pose=record.stored_pose)
    return record


def _given(
    requests: Sequence[LabelRequest],
    records: Sequence[AnimalRecord],
    config: LabelConfig,
    *,
    calibration: Calibration | None,
) -> list[Observation | Rejection]:
    """The checked animals with the bodies that their source gives."""
    bodies = many_bodies(requests[0].bodies, records)
    return [
        _observation(request, record, body, config, calibration=calibration)
        for request, record, body in zip(requests, records, bodies, strict=True)
    ]


def _fitted(
    requests: Sequence[LabelRequest],
    records: Sequence[AnimalRecord],
    config: LabelConfig,
    *,
    calibration: Calibration | None,
) -> list[Observation | Rejection]:
    """The checked animals with fitted bodies, and rigid ones of those that cannot be fitted."""
    source = requests[0].bodies
    if not isinstance(source, FittedBodies):
        raise TypeError(f"{source.name} fits no bodies")
    can_fit = [source.can_fit(record) for record in records]
    animals = [
        {**fit_arguments(request, record, source), "calibration": calibration}
        for request, record, fits in zip(requests, records, can_fit, strict=True)
        if fits
    ]
    images = [id(request.sample) for request, fits in zip(requests, can_fit, strict=True) if fits]
    shared = images if estimates_focal_lengths(config) else None
    fitted = fitted_observations(animals, config, shared)
    cameras = _estimated_cameras(fitted, images) if shared is not None else {}
    remaining = iter(fitted)
    return [
        next(remaining)
        if fits
        else _with_camera_of_fits(
            rigid_stand_in(
                _observation(request, record, source.body(record), config, calibration=calibration)
            ),
            cameras.get(id(request.sample)),
        )
        for request, record, fits in zip(requests, records, can_fit, strict=True)
    ]


def _estimated_cameras(
    fitted: Sequence[Observation | Rejection], images: Sequence[int]
) -> dict[int, Observation]:
    """An animal of each image whose focal length was estimated with fits."""
    return {
        image: one
        for image, one in zip(images, fitted, strict=True)
        if isinstance(one, Observation) and one.K_source == "estimated"
    }


def _with_camera_of_fits(observation: Observation, fitted: Observation | None) -> Observation:
    """A rigid body's animal with the focal length of the fitted ones of its image, if unknown."""
    if fitted is None or observation.K_source != "guessed" or observation.distortion is not None:
        return observation
    return replace(
        observation, K=fitted.K, K_source=fitted.K_source, log_focal_sd=fitted.log_focal_sd
    )


def fit_arguments(
    request: LabelRequest, record: AnimalRecord, source: FittedBodies
) -> dict[str, Any]:
    """label_animal's arguments by name for a fit to a record, its category beside its species.

    Raises:
        SampleError: the mask cannot be read.

    """
    return {
        "image_hw": record.image_hw,
        "keypoints_2d": record.keypoints_2d,
        "mask": request.mask,
        "K": camera_of(record, request.facts)[0],
        "vocabulary": record.vocabulary,
        "sample_id": record.sample_id,
        "species": source.species_of(record),
        "category": record.category,
        "template": None if source.model is load_quadruped() else source.model,
    }


def _observation(
    request: LabelRequest,
    record: AnimalRecord,
    body: Body,
    config: LabelConfig,
    *,
    calibration: Calibration | None,
) -> Observation:
    """A record with its picture's header, its mask and its body, checked."""
    return observe(
        image_hw=record.image_hw,
        body=body,
        keypoints_2d=record.keypoints_2d,
        K=camera_of(record, request.facts)[0],
        pose=record.pose,
        pose_hypotheses=() if record.stored_pose is None else (record.stored_pose,),
        mask=request.mask,
        vocabulary=record.vocabulary,
        distortion=record.distortion,
        image=str(id(request.sample)),
        sample_id=record.sample_id,
        species=record.category,
        calibration=calibration,
        config=config,
    )


def _finished(
    outcome: CuboidLabel | Rejection,
    request: LabelRequest,
    *,
    record: AnimalRecord,
    body: Body,
    scale: ScaleSource | None,
) -> CuboidLabel | Rejection:
    """A label with what its record and picture say of it, metric if something tells the scale."""
    if isinstance(outcome, Rejection):
        return outcome
    facts, quality = request.facts, outcome.quality
    from_dataset = quality.mask_source == "dataset"
    quality = replace(
        quality,
        mask_source=record.mask_source if from_dataset else quality.mask_source,
        warnings=(*quality.warnings, *facts.warnings),
        flags=(*quality.flags, *facts.flags),
        K_source=camera_of(record, facts)[1] or quality.K_source,
    )
    label = replace(outcome, quality=quality)
    if record.metres_per_unit is not None:
        return in_metres(label, record.metres_per_unit, "dataset")
    if scale is None:
        return label
    metres, source = scale.metres_per_unit(record, body, label)
    if metres is not None and not 0 < metres < float("inf"):
        raise SampleError(
            record.sample_id,
            "scale",
            f"metres per unit must be positive, {type(scale).__name__} gave {metres}",
        )
    return in_metres(label, metres, source)


def check_camera_policy(policy: CameraPolicy, has_cameras: bool, notes: Sequence[str] = ()) -> None:
    """Raise a ConfigError if known cameras are asked for of a dataset without trusted ones."""
    if policy == "exact" and not has_cameras:
        about_cameras = "".join(f" ({note})" for note in notes if "camera" in note)
        raise ConfigError(
            "stored_cameras 'exact' needs cameras that come with the dataset, and there are none to"
            f" be trusted{about_cameras}: take 'hypothesis'"
        )


def camera_of(
    record: AnimalRecord, facts: PhotoFacts
) -> tuple[NDArray[np.float64] | None, str | None]:
    """The intrinsics (3, 3) of a record and their source.

    Its own, its picture's EXIF header, its dataset's; None if nothing tells. A pose known exactly
    holds for the camera that it came with, and so keeps it.
    """
    own = record.K_source == "given" or record.pose is not None
    if record.K is not None and own:
        return record.K, record.K_source
    if facts.focal_px is not None:
        return as_numpy(intrinsics(facts.focal_px, record.image_hw)), "exif"
    return (None, None) if record.K is None else (record.K, record.K_source)

"""From a record to its label: the one way that every dataset and command goes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import Body, BodySource, many_bodies
from animal3dbox.datasets.images.exif import PhotoFacts, header_facts
from animal3dbox.datasets.labelling.scale import ScaleSource, in_metres
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal, label_many
from animal3dbox.labels.types import CuboidLabel, Rejection

PosePolicy = Literal["hypothesis", "exact"]
"""What a camera that a dataset stores for its bodies is taken for."""


@dataclass(frozen=True, eq=False)
class Given:
    """A record and what has been read of its picture.

    Attributes:
        record: the animal.
        facts: of its picture's header; None: read when it is labelled, if there is a file. An EXIF
            orientation, which is not applied, is among the label's warnings.
        mask: the record's (H, W), if it has been decoded; None: decoded when it is labelled, if it
            has one.
    """

    record: AnimalRecord
    facts: PhotoFacts | None = None
    mask: NDArray[np.bool_] | None = None

    def read(self) -> "Given":
        """The same with everything read; raises SampleError."""
        path = self.record.image_path
        facts = (
            self.facts
            if self.facts is not None
            else PhotoFacts()
            if path is None
            else header_facts(path)
        )
        return Given(self.record, facts, self.record.mask if self.mask is None else self.mask)


def label_record(
    record: AnimalRecord,
    bodies: BodySource,
    config: LabelConfig,
    facts: PhotoFacts | None = None,
    scale: ScaleSource | None = None,
    mask: NDArray[np.bool_] | None = None,
) -> CuboidLabel | Rejection:
    """The label of a record's animal with the body that a source gives it.

    Args:
        record: the animal.
        bodies: its body's source.
        config: the method.
        facts: see Given.
        scale: what makes the label metric where the dataset itself does not say; None: nothing, it
            is in the body's unit.
        mask: see Given.

    Raises:
        SampleError: the record is unusable; names the sample, the field and the remedy.

    """
    given = Given(record, facts, mask).read()
    body = bodies.body(record)
    return _finished(label_animal(**_arguments(given, body), config=config), given, body, scale)


def label_records(
    given: Sequence[Given],
    bodies: BodySource,
    config: LabelConfig,
    scale: ScaleSource | None = None,
) -> list[CuboidLabel | Rejection | SampleError]:
    """The labels of many records, the same as one by one, at less cost where cameras are known.

    An unusable one spoils no other.

    Args:
        given: the animals.
        bodies: the source of their bodies.
        config: the method.
        scale: see label_record.

    Returns:
        Labels, rejections and errors, in order.

    """
    found: list[CuboidLabel | Rejection | SampleError | None] = [None] * len(given)
    ready: dict[int, Given] = {}
    for place, one in enumerate(given):
        try:
            ready[place] = one.read()
        except SampleError as error:
            found[place] = error
    try:
        posed = many_bodies(bodies, [one.record for one in ready.values()])
        outcomes = label_many(
            [_arguments(one, body) for one, body in zip(ready.values(), posed, strict=True)], config
        )
        for (place, one), body, outcome in zip(ready.items(), posed, outcomes, strict=True):
            found[place] = _finished(outcome, one, body, scale)
    except SampleError:  # one of them is unusable: which, is told one by one
        for place, one in ready.items():
            try:
                found[place] = label_record(one.record, bodies, config, one.facts, scale, one.mask)
            except SampleError as error:
                found[place] = error
    return [outcome for outcome in found if outcome is not None]


def _arguments(given: Given, body: Body) -> dict[str, Any]:
    """label_animal's arguments for an animal and its body."""
    record = given.record
    return {
        "image_hw": record.image_hw,
        "keypoints_2d": record.keypoints_2d,
        "keypoints_3d": body.landmarks,
        "landmark_sigma": body.landmark_sigma,
        "vertices": body.vertices,
        "faces": body.faces,
        "template": body.template,
        "K": camera_of(record, given.facts or PhotoFacts())[0],
        "pose": record.pose,
        "pose_hypotheses": () if record.stored_pose is None else (record.stored_pose,),
        "mask": given.mask,
        "vocabulary": record.vocabulary,
        "distortion": record.distortion,
        "sample_id": record.sample_id,
    }


def _finished(
    outcome: CuboidLabel | Rejection, given: Given, body: Body, scale: ScaleSource | None
) -> CuboidLabel | Rejection:
    """A label with what the record and its picture say of it, in metres if something tells the
    scale."""
    if isinstance(outcome, Rejection):
        return outcome
    record, facts, quality = given.record, given.facts or PhotoFacts(), outcome.quality
    quality = replace(
        quality,
        mask_source=record.mask_source if quality.mask_source == "dataset" else quality.mask_source,
        warnings=(*quality.warnings, *facts.warnings),
        K_source=camera_of(record, facts)[1] or quality.K_source,
    )
    outcome = replace(outcome, quality=quality)
    if record.metres_per_unit is not None:
        return in_metres(outcome, record.metres_per_unit, "dataset")
    if scale is None:
        return outcome
    metres, source = scale.metres_per_unit(record, body, outcome)
    if metres is not None and not 0 < metres < float("inf"):
        raise SampleError(
            record.sample_id,
            "scale",
            f"metres per unit must be positive, {type(scale).__name__} gave {metres}",
        )
    return in_metres(outcome, metres, source)


def check_pose_policy(policy: PosePolicy, has_cameras: bool, notes: Sequence[str] = ()) -> None:
    """Raise ConfigError if known cameras are asked for of a dataset that has none, or none that
    agrees with its keypoints."""
    if policy == "exact" and not has_cameras:
        said = "".join(f" ({note})" for note in notes if "camera" in note)
        raise ConfigError(
            "pose 'exact' needs cameras that come with the dataset, and there are none to be"
            f" trusted{said}: take 'hypothesis'"
        )


def posed_as_stored(record: AnimalRecord, policy: PosePolicy) -> AnimalRecord:
    """The record with its dataset's own camera taken as known, if the policy is "exact" and there
    is one."""
    return (
        replace(record, pose=record.stored_pose)
        if policy == "exact" and record.pose is None
        else record
    )


def camera_of(
    record: AnimalRecord, facts: PhotoFacts
) -> tuple[NDArray[np.float64] | None, str | None]:
    """The intrinsics (3, 3) of a record and where they are from.

    Its own, its picture's EXIF header, its dataset's; None if nothing tells.

    A pose known exactly holds for the camera that it came with, and so keeps it.
    """
    if record.K is not None and (record.K_source == "given" or record.pose is not None):
        return record.K, record.K_source
    if facts.focal_px is not None:
        return intrinsics(facts.focal_px, record.image_hw).numpy(), "exif"
    return (None, None) if record.K is None else (record.K, record.K_source)

"""From a record to its label: the one way that every dataset and command goes."""

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies import BodySource
from animal3dbox.datasets.exif import PhotoFacts, header_facts
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.scale import ScaleSource, in_metres
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label import label_animal
from animal3dbox.labels.types import CuboidLabel, Rejection

PosePolicy = Literal["hypothesis", "exact"]
"""What a camera that a dataset stores for its bodies is taken for."""


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
        facts: of its picture's header, if that has been read; None: read here, if there is a file. An EXIF orientation, which is not
            applied, is among the label's warnings.
        scale: what makes the label metric where the dataset itself does not say; None: nothing, it is in the body's unit.
        mask: the record's (H, W), if it has been decoded; None: decoded here, if it has one.

    Raises:
        SampleError: the record is unusable; names the sample, the field and the remedy.

    """
    if facts is None:
        facts = PhotoFacts() if record.image_path is None else header_facts(record.image_path)
    body = bodies.body(record)
    K, K_source = camera_of(record, facts)
    outcome = label_animal(
        record.image_hw,
        keypoints_2d=record.keypoints_2d,
        keypoints_3d=body.landmarks,
        landmark_sigma=body.landmark_sigma,
        vertices=body.vertices,
        faces=body.faces,
        template=body.template,
        K=K,
        pose=record.pose,
        pose_hypotheses=() if record.stored_pose is None else (record.stored_pose,),
        mask=record.mask if mask is None else mask,
        vocabulary=record.vocabulary,
        distortion=record.distortion,
        sample_id=record.sample_id,
        config=config,
    )
    if isinstance(outcome, Rejection):
        return outcome
    quality = outcome.quality
    mask_source = record.mask_source if quality.mask_source == "dataset" else quality.mask_source
    quality = replace(quality, mask_source=mask_source, warnings=(*quality.warnings, *facts.warnings), K_source=K_source or quality.K_source)
    outcome = replace(outcome, quality=quality)
    if record.metres_per_unit is not None:
        return in_metres(outcome, record.metres_per_unit, "dataset")
    return outcome if scale is None else in_metres(outcome, *scale.metres_per_unit(record, body, outcome))


def posed_as_stored(record: AnimalRecord, policy: PosePolicy) -> AnimalRecord:
    """The record with its dataset's own camera taken as known, if the policy is "exact" and there is one."""
    return replace(record, pose=record.stored_pose) if policy == "exact" and record.pose is None else record


def camera_of(record: AnimalRecord, facts: PhotoFacts) -> tuple[NDArray[np.float64] | None, str | None]:
    """The intrinsics (3, 3) of a record and where they are from: its own, its picture's EXIF header, its dataset's; None if nothing tells.

    A pose known exactly holds for the camera that it came with, and so keeps it.
    """
    if record.K is not None and (record.K_source == "given" or record.pose is not None):
        return record.K, record.K_source
    if facts.focal_px is not None:
        return intrinsics(facts.focal_px, record.image_hw).numpy(), "exif"
    return (None, None) if record.K is None else (record.K, record.K_source)

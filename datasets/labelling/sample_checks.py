"""What is checked of a sample before its label is made, and what its label says of it."""

import math
from dataclasses import dataclass, field, replace

from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.orientation import ON_ITS_SIDE
from animal3dbox.datasets.labelling.image_samples import Record
from animal3dbox.datasets.labelling.keypoint_places import Misplaced, keypoints_problem
from animal3dbox.datasets.labelling.label_requests import LabelRequest
from animal3dbox.datasets.readers.tolerance import BadParts
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError
from animal3dbox.labels.types import CuboidLabel, Rejection

MASK_LEFT_OUT = "the mask is left out"
"""How the warning begins of a label whose mask cannot be used."""
Outcome = CuboidLabel | Rejection | SampleError
"""What becomes of an animal."""


CENTRED = 0.02
"""Part of a picture's longer side within which a principal point is taken for its middle."""


@dataclass
class Remarks:
    """What is said of an animal's label for its annotation's sake."""

    warnings: list[str] = field(default_factory=list)
    flags: list[str] = field(default_factory=list)


def with_decoded_mask(request: LabelRequest, optional: BadParts) -> LabelRequest:
    """A request whose mask has been decoded, or is left out if it cannot be and that is allowed.

    Raises:
        SampleError: the mask cannot be used, and that is an error.

    """
    try:
        _ = request.mask  # decoded once, and kept
    except SampleError as error:
        if optional == "fault":
            raise
        return replace(request, mask_problem=error)
    return request


def checked_request(
    request: LabelRequest, misplaced: Misplaced, optional: BadParts
) -> tuple[LabelRequest, Remarks]:
    """A request whose mask is decoded, or left out, and whose keypoints lie on the animal.

    Raises:
        SampleError: the mask or the keypoints' places are wrong, and that is an error.

    """
    remarks, record = Remarks(), request.record
    request = with_decoded_mask(request, optional)
    mask, problem_of_mask = request.mask, request.mask_problem
    if problem_of_mask is not None:
        words = f"{problem_of_mask.field} {problem_of_mask.problem}"
        remarks.warnings.append(f"{MASK_LEFT_OUT}: {words}")
    if isinstance(record, AnimalRecord) and (problem := keypoints_problem(record, mask)):
        if misplaced == "fault":
            raise SampleError(record.sample_id, "keypoints_2d", problem)
        remarks.warnings.append(f"the keypoints {problem}")
        remarks.flags.append("misplaced")
    return request, remarks


def check_camera_turn(record: Record, facts: PhotoFacts) -> None:
    """Raise a SampleError for a camera that is for the picture lying the other way.

    A camera says nothing of its picture's size. But if its principal point is the middle of the
    picture with width and height exchanged, and not of the picture as it is used, then it was made
    for the stored pixels of a picture that is turned, or for the turned ones of a stored one.
    """
    height, width = record.image_hw
    if record.K is None or facts.orientation not in ON_ITS_SIDE:
        return
    x, y = float(record.K[0, 2]), float(record.K[1, 2])
    near = CENTRED * max(width, height)
    is_middle = math.hypot(x - (width - 1) / 2, y - (height - 1) / 2) <= near
    is_others = math.hypot(x - (height - 1) / 2, y - (width - 1) / 2) <= near
    if is_others and not is_middle:
        used, others = ("turned upright", "stored") if facts.upright else ("stored", "turned")
        raise SampleError(
            record.sample_id,
            "K",
            f"has its principal point ({x:g}, {y:g}) in the middle of {height} x {width} pixels,"
            f" the picture as {others}, but it is used as {used}, {width} x {height} (EXIF"
            f" orientation {facts.orientation}): give the K of these pixels, or see"
            " apply_orientation (--orientation)",
        )


def with_remarks(outcome: Outcome | None, remarks: Remarks) -> Outcome | None:
    """An outcome with remarks on its annotation, if it is a label."""
    if not isinstance(outcome, CuboidLabel) or not remarks.warnings:
        return outcome
    quality = outcome.quality
    warnings, flags = (*quality.warnings, *remarks.warnings), (*quality.flags, *remarks.flags)
    return replace(outcome, quality=replace(quality, warnings=warnings, flags=flags))

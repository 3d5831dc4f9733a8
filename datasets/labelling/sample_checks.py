"""What is checked of a sample before its label is made, and what its label says of it."""

from dataclasses import dataclass, field, replace

from animal3dbox.datasets.labelling.keypoint_places import Misplaced, keypoints_problem
from animal3dbox.datasets.labelling.label_requests import LabelRequest
from animal3dbox.datasets.readers.tolerance import BadParts
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError
from animal3dbox.labels.types import CuboidLabel, Rejection

Outcome = CuboidLabel | Rejection | SampleError
"""What becomes of an animal."""


@dataclass
class Remarks:
    """What is said of an animal's label for its annotation's sake."""

    warnings: list[str] = field(default_factory=list)
    flags: list[str] = field(default_factory=list)


def checked_request(
    request: LabelRequest, misplaced: Misplaced, optional: BadParts
) -> tuple[LabelRequest, Remarks]:
    """A request whose mask is decoded, or left out, and whose keypoints lie on the animal.

    Raises:
        SampleError: the mask or the keypoints' places are wrong, and that is an error.

    """
    remarks, record = Remarks(), request.record
    try:
        mask = request.mask
    except SampleError as error:
        if optional == "fault":
            raise
        remarks.warnings.append(f"the mask is left out: {error.field} {error.problem}")
        request, mask = replace(request, has_mask=False), None
    if isinstance(record, AnimalRecord) and (problem := keypoints_problem(record, mask)):
        if misplaced == "fault":
            raise SampleError(record.sample_id, "keypoints_2d", problem)
        remarks.warnings.append(f"the keypoints {problem}")
        remarks.flags.append("misplaced")
    return request, remarks


def with_remarks(outcome: Outcome | None, remarks: Remarks) -> Outcome | None:
    """An outcome with remarks on its annotation, if it is a label."""
    if not isinstance(outcome, CuboidLabel) or not remarks.warnings:
        return outcome
    quality = outcome.quality
    warnings, flags = (*quality.warnings, *remarks.warnings), (*quality.flags, *remarks.flags)
    return replace(outcome, quality=replace(quality, warnings=warnings, flags=flags))

"""The boxes that detectors' files state, gathered one by one and then brought into our frames."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from animal3dbox.datasets.readers.cuboid_checks import size_note
from animal3dbox.datasets.readers.cuboid_conventions import OMNI3D, Floats
from animal3dbox.datasets.readers.omni3d.layout import StatedBoxes, infer_layout
from animal3dbox.datasets.readers.predictions.layouts import DetectionLayout
from animal3dbox.datasets.readers.predictions.truth import Truth
from animal3dbox.datasets.records import CuboidImage, CuboidRecord
from animal3dbox.datasets.sightings import NO_SIGHTING, Sighting
from animal3dbox.errors import SampleError


@dataclass(frozen=True)
class StatedDetection:
    """The box that one detection states, in the camera's frame.

    Attributes:
        sample_id: the image, and "#k" for the detections after its first.
        image: the detection's image in the truth.
        category: the category's name.
        score: as the detector says; None if it says nothing.
        box: (4,) xyxy in our px; None if it says nothing.
        center: (3,).
        dimensions: (3,) in the file's order.
        rotation: (3, 3), a rotation; NaN if missing.
        corners: (8, 3) in the file's order; NaN if missing.
        sighting: the track, if the file has tracks.
    """

    sample_id: str
    image: CuboidImage
    category: str
    score: float | None
    box: Floats | None
    center: Floats
    dimensions: Floats
    rotation: Floats
    corners: Floats = field(default_factory=lambda: np.full((8, 3), np.nan))
    sighting: Sighting = NO_SIGHTING


@dataclass
class DetectionReading:
    """What is read of a file of detections so far.

    Attributes:
        truth: whose images and categories it names.
        layout: what its numbers mean.
        keys: the layout's own names of Omni3D's bbox3D_cam and R_cam, for errors.
        boxes: sound by themselves.
        faults: one error a detection that is unusable.
        dummies: sample ids of the boxes that stand for none.
        notes: what a careful person should know, in whole sentences.
        numbers: how many detections of an image have a name yet.
    """

    truth: Truth
    layout: DetectionLayout
    keys: dict[str, str] = field(default_factory=dict)
    boxes: list[StatedDetection] = field(default_factory=list)
    faults: list[SampleError] = field(default_factory=list)
    dummies: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    numbers: Counter[str] = field(default_factory=Counter)

    def sample_id(self, image: CuboidImage) -> str:
        """The name of an image's next detection."""
        number = self.numbers[image.image_id]
        self.numbers[image.image_id] += 1
        return f"{image.image_id}#{number}" if number else image.image_id

    def all_notes(self, records: Sequence[CuboidRecord]) -> tuple[str, ...]:
        """The notes, those on all boxes together last.

        Args:
            records: the boxes in our frames.

        """
        notes = list(self.notes)
        if self.dummies:
            notes.append(
                f"{len(self.dummies)} dummy boxes, which stand for no 3D box, were refused (first:"
                f" {self.dummies[0]})"
            )
        known = {name.strip().lower() for name in self.truth.categories.values()}
        names = {record.category for record in records}
        unknown = sorted(name for name in names if name.strip().lower() not in known)
        if unknown:
            notes.append(f"the truth has no categories {', '.join(map(repr, unknown[:6]))}")
        return (*notes, *(size_note(records) if self.truth.metric else ()))


def is_dummy(corners: Floats | None, center: Floats | None, dimensions: Floats | None) -> bool:
    """Whether a detection is one that detectors write where they have no 3D box.

    Its eight corners are one point (all ones, all zeros), or everything is -1.

    Args:
        corners: (8, 3), or None if they are missing or all -1.
        center: (3,), likewise.
        dimensions: (3,), likewise.

    """
    if corners is not None:
        return bool(np.ptp(corners, axis=0).max() == 0)
    if dimensions is None:
        return center is None
    return not dimensions.any()


def checked_dimensions(dimensions: Floats, sample_id: str, field: str) -> Floats:
    """The dimensions (3,) of a box, which are positive; raises SampleError."""
    if dimensions.min() <= 0:
        raise SampleError(sample_id, field, f"must be positive, got {dimensions.tolist()}")
    return dimensions


def checked_score(score: float | None, sample_id: str, field: str) -> float | None:
    """A score that is finite; raises SampleError. Some detectors' exceed 1."""
    if score is not None and not np.isfinite(score):
        raise SampleError(sample_id, field, f"must be finite, got {score}")
    return score


def detection_records(
    reading: DetectionReading, *, heading_known: bool | None
) -> tuple[CuboidRecord, ...]:
    """The detections in our frames and orders; those that contradict themselves become faults.

    Args:
        reading: all that was read.
        heading_known: whether forward means something; None: as the layout says.

    """
    boxes = reading.boxes
    if not boxes:
        return ()
    problems: dict[int, tuple[str, str]] = {}
    center = np.stack([box.center for box in boxes])
    dimensions = np.stack([box.dimensions for box in boxes])
    rotation = np.stack([box.rotation for box in boxes])
    if reading.layout.convention is OMNI3D:
        corners = np.stack([box.corners for box in boxes])
        inferred = infer_layout(StatedBoxes(corners, center, dimensions, rotation))
        rotation, dimensions, problems = inferred.rotation, inferred.dimensions, inferred.problems
        reading.notes += [_in_own_words(note, reading.keys) for note in inferred.notes]
    center, rotation, size = reading.layout.convention.boxes_in(center, rotation, dimensions)
    named = reading.layout.heading_known if heading_known is None else heading_known
    records = []
    for index, box in enumerate(boxes):
        if index in problems:
            words = (_in_own_words(text, reading.keys) for text in problems[index])
            reading.faults.append(SampleError(box.sample_id, *words))
            continue
        record = CuboidRecord(
            sample_id=box.sample_id,
            image_id=box.image.image_id,
            image_path=box.image.image_path,
            image_hw=box.image.image_hw,
            category=box.category,
            K=box.image.K,
            center=center[index],
            rotation=rotation[index],
            size=size[index],
            metric=reading.truth.metric,
            heading_known=named,
            box=box.box,
            score=box.score,
            sighting=box.sighting,
        )
        records.append(record)
    return tuple(records)


def _in_own_words(text: str, keys: dict[str, str]) -> str:
    """A sentence about Omni3D's keys in those of another layout."""
    for theirs, own in keys.items():
        text = text.replace(theirs, own)
    return text.replace("annotations", "detections")

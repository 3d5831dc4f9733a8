"""Calibration of a dataset by its own animals."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.labelling.image_samples import Record, SampleSource
from animal3dbox.datasets.labelling.label_records import camera_of
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError
from animal3dbox.labels.axes.placement import (
    LEAST_ANIMALS,
    LearnedAngle,
    learned_angle,
    learned_placement,
)
from animal3dbox.labels.calibration import Calibration, calibration_of
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.fit.request import check_lessons
from animal3dbox.labels.observation import observe
from animal3dbox.smal.keypoints.vocabulary import Vocabulary

MOST_ANIMALS = 500
"""Animals that "auto" learns from at most: the first of the dataset; more tell nothing new."""
FIRST_LOOKED_AT = 100
"""Images whose vocabularies a calibration is compared with before anything is labelled."""


@dataclass(frozen=True)
class LearnedCalibration:
    """What a dataset taught, and from how many animals.

    Attributes:
        calibration: what was learned.
        animals: those looked at.
        used: those that told something.
        faulty: those that could not be read.
    """

    calibration: Calibration
    animals: int
    used: int
    faulty: int


def calibrate_animals(
    animals: Iterable[tuple[Record, BodySource | None]], config: LabelConfig | None = None
) -> LearnedCalibration:
    """Learn where a dataset's keypoints lie on its animals' bodies.

    Args:
        animals: records, each with the source of its body; those with a template and boxes that
            come as they are teach nothing.
        config: the method; its checks of what comes in are the labels'.

    Example:
        >>> from animal3dbox.datasets import SyntheticSet, preset_body
        >>> records = SyntheticSet(seed=0, images=1).records().records
        >>> calibrate_animals((record, preset_body("dog")) for record in records).used
        0
    """
    config = config or LabelConfig()
    angles: list[LearnedAngle] = []
    count = faulty = 0
    for record, bodies in animals:
        if not isinstance(record, AnimalRecord) or bodies is None:
            continue
        count += 1
        try:
            angle = _angle_of(record, bodies, config)
        except SampleError:
            faulty += 1
            continue
        if angle is not None:
            angles.append(angle)
    return LearnedCalibration(learned_placement(angles), count, len(angles), faulty)


def dataset_calibration(
    calibration: Calibration | Path | str | None, source: SampleSource, config: LabelConfig
) -> tuple[Calibration | None, tuple[str, ...]]:
    """A Dataset's calibration as its option says, and notes in whole sentences.

    Args:
        calibration: one, its file, "auto" to learn it from the source, or None.
        source: of the samples.
        config: the method.

    Raises:
        ConfigError: the option is none of these, or the file is no calibration.

    """
    if calibration != "auto":
        given = calibration_of(calibration)
        if given is None:
            return None, ()  # before anything is read, or drawn
        samples = [source.sample(place) for place in range(min(len(source), FIRST_LOOKED_AT))]
        bodies = next((sample.bodies for sample in samples if sample.bodies is not None), None)
        words = [entry.vocabulary for sample in samples for entry in sample.animals]
        return given, lesson_notes(given, bodies, (one for one in words if one is not None))
    learned = calibrate_animals(_animals_of(source, MOST_ANIMALS), config)
    if learned.used < LEAST_ANIMALS:
        note = (
            f"calibration='auto' learned nothing: {learned.used} animals tell where their"
            f" keypoints lie, and {LEAST_ANIMALS} are needed."
        )
        return None, (note,)
    return learned.calibration, (
        f"calibration='auto' learned from {learned.used} animals where keypoints lie"
        f" ({learned.calibration.digest}).",
    )


def lesson_notes(
    calibration: Calibration | None, bodies: BodySource | None, vocabularies: Iterable[Vocabulary]
) -> tuple[str, ...]:
    """A note if a calibration's places and shapes have no part in labels.

    Args:
        calibration: or None, of which there is nothing to say.
        bodies: that animals are labelled with.
        vocabularies: of the animals.

    Raises:
        ConfigError: bodies are fitted, and the places and shapes are another body's.

    """
    if calibration is None or not (calibration.places or calibration.shapes):
        return ()
    if isinstance(bodies, FittedBodies):
        for vocabulary in {one.name: one for one in vocabularies}.values():
            check_lessons(calibration, vocabulary, bodies.model)
        return ()
    return (
        "the calibration's places and shapes are for bodies that are fitted"
        f" (body='fit', --body fit): they have no part in labels of the bodies of {bodies.name}"
        if bodies is not None
        else "the calibration's places and shapes have no part in labels without bodies",
    )


def _animals_of(source: SampleSource, most: int) -> Iterator[tuple[Record, BodySource | None]]:
    """The first animals of a source, with the sources of their bodies."""
    count = 0
    for index in range(len(source)):
        sample = source.sample(index)
        for record in sample.records if sample.listed is None else ():
            if count == most:
                return
            count += 1
            yield record, sample.bodies


def _angle_of(record: AnimalRecord, bodies: BodySource, config: LabelConfig) -> LearnedAngle | None:
    """What one animal tells; raises SampleError if it cannot be read."""
    observation = observe(
        image_hw=record.image_hw,
        body=bodies.body(record),
        K=camera_of(record, PhotoFacts())[0],
        vocabulary=record.vocabulary,
        sample_id=record.sample_id,
        species=record.category,
        config=config,
    )
    return learned_angle(observation)

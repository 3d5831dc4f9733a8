"""What a dataset teaches about itself, as a file: keypoints' places, and shapes of its animals.

A calibration is given to labels, never learned on the way: the same file gives the same label,
whoever else is in the batch.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import msgspec
import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.files import user_path, write_whole

SCHEMA = "animal3dbox-calibration"
VERSION = 2
READABLE = (1, 2)
"""Versions of the file that are read: one of version 1 has a placement alone."""
KERNEL_DEG = 4.0
"""Width of the Gaussian kernel whose densest place is a placement's pitch."""
MOST_PITCH_DEG = 60.0
"""No line between landmarks of a trunk rises or falls by more."""
MOST_OFFSET, MOST_SD, MOST_SCATTER = 1.0, 1.0, 10.0
"""Greatest offsets, deviations and scatter of places and shapes that a file may have."""
Point = tuple[float, float, float]


@dataclass(frozen=True)
class PlacementPitch:
    """By how much the line between a dataset's trunk landmarks rises above its animals' trunks.

    Attributes:
        vocabulary: the keypoints' name.
        species: the animals' category; None: all animals of the vocabulary together.
        line: which line, of labels.axes.trunk_line.LINES.
        pitch_deg: degrees, positive if the line rises forward.
        animals: how many it was learned from.

    Example:
        >>> PlacementPitch("animalpose20", None, "tail_base to withers", -12.5, 40).animals
        40
    """

    vocabulary: str
    species: str | None
    line: str
    pitch_deg: float
    animals: int


@dataclass(frozen=True)
class KeypointPlaces:
    """Where a dataset's keypoints lie on the body that is fitted, and how well they keep to it.

    Attributes:
        vocabulary: the keypoints' name.
        body: digest of the body (see fit_body.body_digest).
        keypoints: (J,) their names.
        offsets: (J,) of each from the body's own place, in the template's axes, in lengths of the
            trunk along x.
        sd: (J,) standard deviation of each in the picture about where the body has it, beside its
            own noise, as a part of the keypoints' extent.
        animals: how many they were learned from.

    Example:
        >>> KeypointPlaces("own", "0123", ("nose",), ((0.1, 0.0, 0.0),), (0.01,), 50).animals
        50
    """

    vocabulary: str
    body: str
    keypoints: tuple[str, ...]
    offsets: tuple[Point, ...]
    sd: tuple[float, ...]
    animals: int


@dataclass(frozen=True)
class ClassShape:
    """The mean shape of a dataset's animals of one category, of the body that is fitted.

    Attributes:
        vocabulary: of the keypoints that it was learned from.
        body: digest of the body (see fit_body.body_digest).
        category: the dataset's name of the class.
        preset: the preset from which it was learned; None: from all of them together.
        betas: (S,) of the mean.
        scatter: standard deviation of the animals about it, by that of a known species.
        animals: how many it was learned from.

    Example:
        >>> ClassShape("ap10k17", "0123", "okapi", None, (0.0, 0.5), 0.6, 40).scatter
        0.6
    """

    vocabulary: str
    body: str
    category: str
    preset: str | None
    betas: tuple[float, ...]
    scatter: float
    animals: int


@dataclass(frozen=True)
class Calibration:
    """What a dataset teaches; made by `animal3dbox calibrate`, calibrate_animals or learn_bodies.

    Attributes:
        placement: pitches by vocabulary, species and line.
        places: of keypoints on the body that is fitted, one entry a vocabulary.
        shapes: of the dataset's classes on that body.

    Example:
        >>> line = "tail_base to shoulder_blade"
        >>> calibration = Calibration((PlacementPitch("animal3d26", None, line, 4.0, 12),))
        >>> calibration.pitch_deg("animal3d26", "horse", line), len(calibration.digest)
        (4.0, 12)
    """

    placement: tuple[PlacementPitch, ...] = ()
    places: tuple[KeypointPlaces, ...] = ()
    shapes: tuple[ClassShape, ...] = ()

    @cached_property
    def digest(self) -> str:
        """12 hexadecimal digits that name the content, as labels record it."""
        return hashlib.blake2b(_as_json(self), digest_size=6).hexdigest()

    def pitch_deg(self, vocabulary: str, species: str | None, line: str) -> float | None:
        """The pitch of a line: the species' own, else that of all animals; None if not learned."""
        pitches = {
            entry.species: entry.pitch_deg
            for entry in self.placement
            if (entry.vocabulary, entry.line) == (vocabulary, line)
        }
        return pitches.get(species, pitches.get(None))

    def places_of(self, vocabulary: str) -> KeypointPlaces | None:
        """The places of a vocabulary's keypoints; None if not learned."""
        return next((one for one in self.places if one.vocabulary == vocabulary), None)

    def shape_of(self, vocabulary: str, category: str | None) -> ClassShape | None:
        """The shape of a category by a vocabulary's keypoints; None if not learned."""
        names = (vocabulary, category)
        return next((one for one in self.shapes if (one.vocabulary, one.category) == names), None)

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all."""
        write_whole(path, _as_json(self) + b"\n")


def load_calibration(path: Path | str) -> Calibration:
    """Read a calibration's file.

    Raises:
        ConfigError: naming the file, the field and what is wrong with it.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     Calibration().save(Path(folder, "calibration.json"))
        ...     load_calibration(Path(folder, "calibration.json")).placement
        ()
    """
    try:
        content = msgspec.json.decode(user_path(path).read_bytes(), type=_CalibrationFile)
    except OSError as error:
        raise ConfigError(f"calibration {path} cannot be read: {error}") from error
    except msgspec.DecodeError as error:
        raise ConfigError(
            f"calibration {path} is no calibration file: {error}; make one with animal3dbox"
            " calibrate"
        ) from error
    if content.schema != SCHEMA or content.version not in READABLE:
        raise ConfigError(
            f"calibration {path}: schema and version must be {SCHEMA!r} and {VERSION}, got"
            f" {content.schema!r} and {content.version}: make it anew with animal3dbox calibrate"
        )
    for fault in (*_faults_of_placement(content), *_faults_of_places(content), *_faults(content)):
        raise ConfigError(f"calibration {path}: {fault}")
    return Calibration(tuple(content.placement), tuple(content.places), tuple(content.shapes))


def _faults_of_placement(content: "_CalibrationFile") -> Iterator[str]:
    """What is wrong with the numbers of a file's placement."""
    for i, entry in enumerate(content.placement):
        field, value = f"placement[{i}].pitch_deg", entry.pitch_deg
        if not abs(value) <= MOST_PITCH_DEG:
            yield f"{field} must lie within {MOST_PITCH_DEG:g} degrees of 0, got {value}"


def _faults_of_places(content: "_CalibrationFile") -> Iterator[str]:
    """What is wrong with the numbers of a file's places and shapes."""
    for i, places in enumerate(content.places):
        count = len(places.keypoints)
        for field in ("offsets", "sd"):
            if len(getattr(places, field)) != count:
                yield f"places[{i}].{field} must have one entry for each of {count} keypoints"
        if not all(0 < sd <= MOST_SD for sd in places.sd):
            yield f"places[{i}].sd must lie within 0 and {MOST_SD:g}"
        if not all(abs(value) <= MOST_OFFSET for offset in places.offsets for value in offset):
            yield f"places[{i}].offsets must lie within {MOST_OFFSET:g} trunk lengths of 0"
    for i, shape in enumerate(content.shapes):
        if not 0 < shape.scatter <= MOST_SCATTER:
            yield f"shapes[{i}].scatter must lie within 0 and {MOST_SCATTER:g}, got {shape.scatter}"


def _faults(content: "_CalibrationFile") -> Iterator[str]:
    """Entries of a file that no animal taught."""
    for section in ("placement", "places", "shapes"):
        for i, entry in enumerate(getattr(content, section)):
            if entry.animals < 1:
                yield f"{section}[{i}].animals must be at least 1, got {entry.animals}"


def calibration_of(calibration: "Calibration | Path | str | None") -> Calibration | None:
    """A calibration from what a caller gives: one, a file of one, or None.

    Raises:
        ConfigError: neither, or the file is none.

    """
    if calibration is None or isinstance(calibration, Calibration):
        return calibration
    if isinstance(calibration, Path | str):
        return load_calibration(calibration)
    raise ConfigError(
        f"calibration must be a Calibration, its file or None, got {type(calibration).__name__}"
    )


def densest(angles_deg: Sequence[float]) -> float:
    """The angle about which most angles lie: the mode of their density by a Gaussian kernel.

    Animals that lie, sit or rear leave it where those that agree have it.

    Args:
        angles_deg: at least one, within MOST_PITCH_DEG of 0.

    Example:
        >>> densest([3.0, 4.0, 5.0, 40.0])
        4.0
    """
    grid = np.arange(-MOST_PITCH_DEG, MOST_PITCH_DEG + 0.05, 0.1)
    off = (grid[:, None] - np.asarray(angles_deg)) / KERNEL_DEG
    return round(float(grid[np.exp(-(off**2) / 2).sum(1).argmax()]), 1)


class _CalibrationFile(msgspec.Struct, forbid_unknown_fields=True):
    """The JSON file."""

    schema: str
    version: int
    placement: list[PlacementPitch]
    places: list[KeypointPlaces] = []
    shapes: list[ClassShape] = []


def _as_json(calibration: Calibration) -> bytes:
    content = _CalibrationFile(
        SCHEMA,
        VERSION,
        list(calibration.placement),
        list(calibration.places),
        list(calibration.shapes),
    )
    return msgspec.json.format(msgspec.json.encode(content), indent=1)

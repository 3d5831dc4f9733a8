"""What a dataset teaches about itself, as a file: where its keypoints lie on its animals.

A calibration is given to labels, never learned on the way: the same file gives the same label,
whoever else is in the batch.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import msgspec
import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.files import write_whole

SCHEMA = "animal3dbox-calibration"
VERSION = 1
KERNEL_DEG = 4.0
"""Width of the Gaussian kernel whose densest place is a placement's pitch."""
MOST_PITCH_DEG = 60.0
"""No line between landmarks of a trunk rises or falls by more."""


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
class Calibration:
    """What a dataset teaches; made by `animal3dbox calibrate` or `calibrate_animals`.

    Attributes:
        placement: pitches by vocabulary, species and line.

    Example:
        >>> line = "tail_base to shoulder_blade"
        >>> calibration = Calibration((PlacementPitch("animal3d26", None, line, 4.0, 12),))
        >>> calibration.pitch_deg("animal3d26", "horse", line), len(calibration.digest)
        (4.0, 12)
    """

    placement: tuple[PlacementPitch, ...] = ()

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
        content = msgspec.json.decode(Path(path).read_bytes(), type=_CalibrationFile)
    except OSError as error:
        raise ConfigError(f"calibration {path} cannot be read: {error}") from error
    except msgspec.DecodeError as error:
        raise ConfigError(
            f"calibration {path} is no calibration file: {error}; make one with animal3dbox"
            " calibrate"
        ) from error
    if content.schema != SCHEMA or content.version != VERSION:
        raise ConfigError(
            f"calibration {path}: schema and version must be {SCHEMA!r} and {VERSION}, got"
            f" {content.schema!r} and {content.version}: make it anew with animal3dbox calibrate"
        )
    for i, entry in enumerate(content.placement):
        field, value = f"placement[{i}].pitch_deg", entry.pitch_deg
        if not abs(value) <= MOST_PITCH_DEG:
            raise ConfigError(
                f"calibration {path}: {field} must lie within {MOST_PITCH_DEG:g} degrees of 0, got"
                f" {value}"
            )
        if entry.animals < 1:
            raise ConfigError(
                f"calibration {path}: placement[{i}].animals must be at least 1, got"
                f" {entry.animals}"
            )
    return Calibration(tuple(content.placement))


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


def _as_json(calibration: Calibration) -> bytes:
    content = _CalibrationFile(SCHEMA, VERSION, list(calibration.placement))
    return msgspec.json.format(msgspec.json.encode(content), indent=1)

"""Any dataset by its path: which format it is in, its records, and the bodies that come with it."""

from dataclasses import dataclass
from pathlib import Path

import msgspec

from animal3dbox.datasets import animal3d, stanfordextra
from animal3dbox.datasets.bodies import BodySource
from animal3dbox.datasets.json_files import decode_json
from animal3dbox.datasets.records import RecordSet
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError

FORMATS = (animal3d.FORMAT, stanfordextra.FORMAT)


@dataclass(frozen=True)
class Dataset:
    """A dataset as it was read.

    Attributes:
        records: its animals.
        bodies: the fitted bodies that come with it; None if it has none or their model was not given.
    """

    records: RecordSet
    bodies: BodySource | None


def recognised_format(path: Path) -> str:
    """The format of a folder or annotation file.

    Raises:
        DatasetNotFoundError: nothing there is recognised.
        DatasetFormatError: the file is neither a list nor a dictionary with data.

    """
    if path.is_dir():
        if any((path / name).is_file() for name in animal3d.SPLITS):
            return animal3d.FORMAT
        return stanfordextra.FORMAT  # whose reader says what it looked for
    if not path.exists():
        raise DatasetNotFoundError(f"there is no file or folder {path}")
    content = decode_json(path, list[msgspec.Raw] | dict[str, msgspec.Raw])
    if isinstance(content, dict) and "data" not in content:
        found = ", ".join(list(content)[:8]) or "nothing"
        raise DatasetFormatError(f"{path} is no Animal3D file: it has no data, only {found}; give --format if it is another format")
    return animal3d.FORMAT if isinstance(content, dict) else stanfordextra.FORMAT


def read_dataset(path: Path, format: str = "auto", images: Path | None = None, model: Path | None = None) -> Dataset:
    """A dataset's records and bodies.

    Args:
        path: its folder or annotation file.
        format: of FORMATS, or "auto".
        images: the folder that image paths are relative to, if not the usual one.
        model: the SMAL file that the dataset's parameters belong to.

    Raises:
        ConfigError: an unknown format, or a model for a dataset without parameters.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    """
    if format not in ("auto", *FORMATS):
        raise ConfigError(f"format must be auto, {' or '.join(FORMATS)}, got {format!r}")
    kind = recognised_format(path) if format == "auto" else format
    if kind == stanfordextra.FORMAT:
        if model is not None:
            raise ConfigError(f"--model {model} is for parameters that a dataset comes with, and StanfordExtra has none: give it as --body")
        return Dataset(stanfordextra.read_stanfordextra(path, images), None)
    read = animal3d.read_animal3d(path, model, images)
    if model is not None and read.bodies is None:
        raise ConfigError(f"{path} has no parameters (pose, shape, trans) that --model {model} could pose: give a --body")
    return Dataset(read.records, read.bodies)

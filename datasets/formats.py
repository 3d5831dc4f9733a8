"""Any dataset by its path: its format, its records, and the bodies that come with it.

READERS lists the formats of annotated animals; a new one is a reader in readers/ and a line there.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import msgspec

from animal3dbox.datasets.bodies.options import DEFAULT_BODY, body_source
from animal3dbox.datasets.bodies.own_or_fitted import own_or_fitted
from animal3dbox.datasets.bodies.sources import BodySource, ParametersBody
from animal3dbox.datasets.cuboid_formats import CUBOID_READERS, cuboid_format
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.readers import stanfordextra
from animal3dbox.datasets.readers.animal3d import entries as animal3d_entries
from animal3dbox.datasets.readers.animal3d import reader as animal3d
from animal3dbox.datasets.readers.coco import reader as coco
from animal3dbox.datasets.readers.deeplabcut import h5 as deeplabcut_h5
from animal3dbox.datasets.readers.deeplabcut import project as deeplabcut_project
from animal3dbox.datasets.readers.deeplabcut import reader as deeplabcut
from animal3dbox.datasets.readers.mesh_folder import reader as mesh_folder
from animal3dbox.datasets.readers.tolerance import of_categories
from animal3dbox.datasets.record_changes import of_unicode, with_focal, without_places
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.datasets.storage.records_on_demand import RecordsOnDemand
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary


@dataclass(frozen=True)
class ReadDataset:
    """A dataset as its reader gives it.

    Attributes:
        records: the dataset's animals.
        bodies: the fitted bodies that come with it; None if it has none, or if their model is not
            known.
    """

    records: RecordSet
    bodies: BodySource | None


@dataclass(frozen=True)
class PathSummary:
    """The facts of a path by which its format is recognised, before all of it is read.

    Attributes:
        path: a folder or a file.
        keys: keys of a JSON file's dictionary; None of a list, of another file and of a folder.
        is_list: whether the path is a JSON file that holds a list.
    """

    path: Path
    keys: frozenset[str] | None
    is_list: bool


def _read_animal3d(path: Path, options: ReadOptions) -> ReadDataset:
    _refuse_vocabulary(options, animal3d_entries.VOCABULARY)
    dataset = animal3d.read_animal3d(
        path, options.model, options.images, options.tolerance(), focal_px=options.focal_px
    )
    if options.model is not None and dataset.bodies is None:
        wrong = [
            fault
            for fault in dataset.records.faults
            if re.split(r"[,.[]", fault.field)[0] in animal3d_entries.PARAMETERS
        ]
        faults = wrong or dataset.records.faults
        remedy = (
            f"{len(faults)} entries are faulty, the first: {faults[0]}"
            if faults
            else "; ".join((*dataset.zero_notes, "give a --body"))
        )
        raise ConfigError(
            f"{path} has no parameters (pose, shape, trans) that --model {options.model} could"
            f" pose: {remedy}"
        )
    return ReadDataset(dataset.records, dataset.bodies)


def _read_stanfordextra(path: Path, options: ReadOptions) -> ReadDataset:
    _refuse_model(options, "StanfordExtra")
    _refuse_vocabulary(options, stanfordextra.VOCABULARY)
    records = stanfordextra.read_stanfordextra(path, options.images, options.tolerance())
    return ReadDataset(records, None)


def _read_coco(path: Path, options: ReadOptions) -> ReadDataset:
    _refuse_model(options, "COCO")
    records = coco.read_coco(
        path,
        options.images,
        options.vocabulary,
        tolerance=options.tolerance(),
        categories=options.categories,
        check_paths=options.check_paths,
        index_folder=options.index_folder,
    )
    return ReadDataset(records, None)


def _has_index(path: Path, format: str, options: ReadOptions) -> bool:
    """Whether a file has been opened before as COCO's, so that nobody need look what it is."""
    if format not in ("auto", coco.FORMAT) or options.check_paths or options.index_folder is None:
        return False
    reading = coco.CocoReading(
        path, options.images, options.vocabulary, options.tolerance(), options.categories
    )
    return path.is_file() and reading.has_index(options.index_folder)


def _read_mesh_folder(path: Path, options: ReadOptions) -> ReadDataset:
    dataset = mesh_folder.read_mesh_folder(
        path, options.images, options.model, options.vocabulary, upright=options.apply_orientation
    )
    return ReadDataset(dataset.records, dataset.bodies)


def _read_deeplabcut(path: Path, options: ReadOptions) -> ReadDataset:
    _refuse_model(options, "DeepLabCut")
    is_project = deeplabcut_project.is_project(path)
    read = deeplabcut_project.read_project if is_project else deeplabcut.read_deeplabcut
    records = read(path, options.images, options.vocabulary, upright=options.apply_orientation)
    return ReadDataset(records, None)


def _refuse_model(options: ReadOptions, name: str) -> None:
    """Raise a ConfigError for a model that a format has no parameters for."""
    if options.model is not None:
        raise ConfigError(
            f"--model {options.model} is for parameters that a dataset comes with, and {name} has"
            " none: give it as --body, or fit it with --body fit"
        )


def _refuse_vocabulary(options: ReadOptions, own: Vocabulary) -> None:
    """Raise a ConfigError for a vocabulary if the format's own is fixed."""
    if options.vocabulary is not None:
        raise ConfigError(
            f"--vocabulary {options.vocabulary.name} is for formats whose files do not tell: these"
            f" keypoints are {own.name}"
        )


def _is_animal3d(summary: PathSummary) -> bool:
    if summary.path.is_dir():
        is_split = any((summary.path / name).is_file() for name in animal3d_entries.SPLITS)
        return is_split or any(summary.path.glob(animal3d_entries.MANY))
    return summary.keys is not None and "data" in summary.keys


def _is_mesh_folder(summary: PathSummary) -> bool:
    return mesh_folder.is_mesh_folder(summary.path)


def _is_coco(summary: PathSummary) -> bool:
    if summary.path.is_dir():
        return any(
            (file := summary.path / name).is_file() and _is_coco(path_summary(file))
            for name in coco.FILES
        )
    return summary.keys is not None and {"images", "annotations"} <= summary.keys


def _is_deeplabcut(summary: PathSummary) -> bool:
    if summary.path.is_dir():
        return deeplabcut_project.is_project(summary.path) or bool(
            deeplabcut.label_files(summary.path)
        )
    return summary.path.suffix.lower() in (".csv", *deeplabcut_h5.SUFFIXES)


def _is_stanfordextra(summary: PathSummary) -> bool:
    if summary.path.is_dir():
        return bool(stanfordextra.annotation_files(summary.path))
    return summary.is_list


@dataclass(frozen=True)
class Reader:
    """How one format is recognised and read.

    Attributes:
        signs: what it is recognised by, for people.
        recognises: whether a path is in this format.
        read: the dataset of a path.
    """

    signs: str
    recognises: Callable[[PathSummary], bool]
    read: Callable[[Path, ReadOptions], ReadDataset]


READERS: dict[str, Reader] = {
    animal3d.FORMAT: Reader("train.json or test.json", _is_animal3d, _read_animal3d),
    mesh_folder.FORMAT: Reader("images/ and meshes/", _is_mesh_folder, _read_mesh_folder),
    coco.FORMAT: Reader(" or ".join(coco.FILES), _is_coco, _read_coco),
    deeplabcut.FORMAT: Reader("a csv or h5 table, or a project", _is_deeplabcut, _read_deeplabcut),
    stanfordextra.FORMAT: Reader("StanfordExtra*.json", _is_stanfordextra, _read_stanfordextra),
}
"""Every format by name, in the order in which a path is tried."""
FORMATS = tuple(READERS)
"""The names of all formats."""


def recognised_format(path: Path) -> str:
    """The name of the format that a folder or annotation file is in.

    Raises:
        DatasetNotFoundError: nothing there is recognised.
        DatasetFormatError: the file is in no format that is known.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "keypoints.json"
        ...     _ = path.write_text('{"images": [], "annotations": []}')
        ...     recognised_format(path)
        'coco'

    """
    summary = path_summary(path)
    format = _format_of(summary)
    if format is not None:
        return format
    raise DatasetFormatError(
        f"{path} is in no format that is known: it {_contents(summary)}; give the path of a"
        " dataset, and its --format if it is named otherwise:"
        f" {', '.join(f'{name} ({reader.signs})' for name, reader in READERS.items())}"
    )


def _format_of(summary: PathSummary) -> str | None:
    return next((name for name, reader in READERS.items() if reader.recognises(summary)), None)


def _contents(summary: PathSummary) -> str:
    """The end of a sentence about a path: the files of a folder, the keys of a file."""
    if summary.path.is_dir():
        names = sorted(path.name for path in islice(summary.path.iterdir(), 1000))
        return f"holds {', '.join(names[:8])}" if names else "is an empty folder"
    if summary.is_list:
        return "is a list"
    return f"has {', '.join(sorted(summary.keys or ())[:8]) or 'nothing'}"


def path_summary(path: Path) -> PathSummary:
    """The facts of a path by which its format is recognised.

    Raises:
        DatasetNotFoundError: there is nothing.
        DatasetFormatError: a .json file that is none.

    """
    if not path.exists():
        raise DatasetNotFoundError(f"there is no file or folder {path}")
    if path.is_dir() or path.suffix.lower() not in (".json", ""):
        return PathSummary(path, None, is_list=False)
    content = decode_json(path, list[msgspec.Raw] | dict[str, msgspec.Raw])
    return PathSummary(
        path, frozenset(content) if isinstance(content, dict) else None, isinstance(content, list)
    )


def read_dataset(
    path: Path, format: str = "auto", options: ReadOptions | None = None
) -> ReadDataset:
    """The records of a dataset, and the bodies that come with it.

    Args:
        path: the dataset's folder or annotation file.
        format: of FORMATS, or "auto".
        options: the user's; None: all defaults.

    Raises:
        ConfigError: an unknown format, or an option that the format has no use for.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    Example:
        >>> import tempfile
        >>> from animal3dbox.datasets import SyntheticSet
        >>> from animal3dbox.datasets.synthetic import WorldConfig, write_stanfordextra
        >>> from animal3dbox.smal import VOCABULARIES
        >>> config = WorldConfig((120, 160), VOCABULARIES["stanfordextra24"])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = write_stanfordextra(SyntheticSet(0, 2, config), Path(folder))
        ...     dataset = read_dataset(Path(folder))
        >>> dataset.records.name, len(dataset.records.records), dataset.bodies
        ('stanfordextra', 2, None)

    """
    if format not in ("auto", *FORMATS, *CUBOID_READERS):
        raise ConfigError(f"format must be auto, {' or '.join(FORMATS)}, got {format!r}")
    if not path.exists():
        raise DatasetNotFoundError(f"there is no file or folder {path}")
    options = options or ReadOptions()
    if _has_index(path, format, options):
        kind = coco.FORMAT
    else:
        _refuse_cuboids(path, format)
        kind = recognised_format(path) if format == "auto" else format
    if options.visibility == "scores" and kind not in (coco.FORMAT, animal3d.FORMAT):
        raise ConfigError(f"visibility 'scores' is for COCO and Animal3D, and {path} is {kind}")
    dataset = _read_as(kind, path, options)
    records = of_categories(of_unicode(dataset.records), options.categories)
    if "location" not in options.keep:
        records = without_places(records)
    return replace(dataset, records=with_focal(records, options.focal_px))


def _refuse_cuboids(path: Path, format: str) -> None:
    """Raise a ConfigError for a file or folder of cuboids."""
    cuboids = cuboid_format(path, format)
    if cuboids is not None:
        raise ConfigError(
            f"{path} holds cuboids ({cuboids}), so there is nothing to label: load them with"
            f" animal3dbox.datasets.{CUBOID_READERS[cuboids].dataset}, look at them with"
            " animal3dbox check, or convert them with animal3dbox export"
        )


def _read_as(kind: str, path: Path, options: ReadOptions) -> ReadDataset:
    """The dataset in a format; an error names the other format that the path looks like."""
    try:
        return READERS[kind].read(path, options)
    except (DatasetFormatError, DatasetNotFoundError) as error:
        format = _format_of(path_summary(path))
        if format in (None, kind):
            raise
        raise type(error)(
            f"{error}; it looks like {format}: read it with --format {format}"
        ) from error


def _has_known_pose(animals: Sequence[AnimalRecord]) -> bool:
    """Whether the camera of any animal is known exactly."""
    if isinstance(animals, RecordsOnDemand):
        return False
    return any(record.pose is not None for record in animals)


def bodies_for(dataset: ReadDataset, own: BodySource | None) -> BodySource:
    """The user's body for all animals if there is one, else the dataset's own bodies, else a fit.

    Animals that have no parameters in a dataset that has some are fitted, too, with its model.

    Raises:
        ConfigError: a user's body for a dataset whose cameras are known in the frame of its own.

    """
    animals = dataset.records.records
    if own is not None and _has_known_pose(animals):
        raise ConfigError(
            f"{own.name} cannot be the body of all animals: this dataset's cameras are known only"
            " to its own meshes; leave it out"
        )
    if own is None and isinstance(dataset.bodies, ParametersBody):
        return own_or_fitted(dataset.bodies, animals)
    return own or dataset.bodies or body_source(DEFAULT_BODY)

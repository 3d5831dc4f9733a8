"""Any dataset by its path: which format it is in, its records, and the bodies that come with it."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import msgspec

from animal3dbox.datasets.bodies.options import DEFAULT_BODY, body_source
from animal3dbox.datasets.bodies.sources import BodySource
from animal3dbox.datasets.readers import stanfordextra
from animal3dbox.datasets.readers.animal3d import entries as animal3d_entries
from animal3dbox.datasets.readers.animal3d import reader as animal3d
from animal3dbox.datasets.readers.coco import reader as coco
from animal3dbox.datasets.readers.deeplabcut import h5 as deeplabcut_h5
from animal3dbox.datasets.readers.deeplabcut import reader as deeplabcut
from animal3dbox.datasets.readers.mesh_folder import reader as mesh_folder
from animal3dbox.datasets.readers.omni3d.recognition import is_omni3d
from animal3dbox.datasets.records import RecordSet
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import ConfigError, DatasetFormatError, DatasetNotFoundError, SampleError
from animal3dbox.geometry.camera import intrinsics
from animal3dbox.smal.keypoints.vocabulary import Vocabulary


@dataclass(frozen=True)
class ReadOptions:
    """What the user says of a dataset besides its path; a reader refuses what it has no use for.

    Attributes:
        images: the folder that image paths are relative to, if not the usual one.
        model: the SMAL file that the dataset's parameters or meshes belong to.
        vocabulary: what the keypoints are, of a format whose names may not tell.
        focal_px: of every image that has no camera of its own, with the principal point in the
            middle; None: what the dataset or the picture's header says, or a guess.
    """

    images: Path | None = None
    model: Path | None = None
    vocabulary: Vocabulary | None = None
    focal_px: float | None = None

    def __post_init__(self) -> None:
        if self.focal_px is not None and not 0 < self.focal_px < math.inf:
            raise ConfigError(f"focal_px must be a positive number of pixels, got {self.focal_px}")


@dataclass(frozen=True)
class Source:
    """A dataset as it was read.

    Attributes:
        records: its animals.
        bodies: the fitted bodies that come with it; None if it has none or their model was not
            given.
    """

    records: RecordSet
    bodies: BodySource | None


@dataclass(frozen=True)
class Peek:
    """What can be seen of a path without reading all of it.

    Attributes:
        path: a folder or a file.
        keys: of a JSON file's dictionary; None of a list, of another file and of a folder.
        is_list: whether it is a JSON file that holds a list.
    """

    path: Path
    keys: frozenset[str] | None
    is_list: bool


def _read_animal3d(path: Path, options: ReadOptions) -> Source:
    _refuse_vocabulary(options, animal3d_entries.VOCABULARY)
    read = animal3d.read_animal3d(path, options.model, options.images)
    if options.model is not None and read.bodies is None:
        wrong = [
            fault
            for fault in read.records.faults
            if fault.field.partition(",")[0] in animal3d_entries.PARAMETERS
        ]
        remedy = (
            f"{len(wrong)} entries have wrong ones, the first: {wrong[0]}"
            if wrong
            else "give a --body"
        )
        raise ConfigError(
            f"{path} has no parameters (pose, shape, trans) that --model {options.model} could"
            f" pose: {remedy}"
        )
    return Source(read.records, read.bodies)


def _read_stanfordextra(path: Path, options: ReadOptions) -> Source:
    _refuse_model(options, "StanfordExtra")
    _refuse_vocabulary(options, stanfordextra.VOCABULARY)
    return Source(stanfordextra.read_stanfordextra(path, options.images), None)


def _read_coco(path: Path, options: ReadOptions) -> Source:
    _refuse_model(options, "COCO")
    return Source(coco.read_coco(path, options.images, options.vocabulary), None)


def _read_mesh_folder(path: Path, options: ReadOptions) -> Source:
    read = mesh_folder.read_mesh_folder(path, options.images, options.model, options.vocabulary)
    return Source(read.records, read.bodies)


def _read_deeplabcut(path: Path, options: ReadOptions) -> Source:
    _refuse_model(options, "DeepLabCut")
    return Source(deeplabcut.read_deeplabcut(path, options.images, options.vocabulary), None)


def _refuse_model(options: ReadOptions, name: str) -> None:
    if options.model is not None:
        raise ConfigError(
            f"--model {options.model} is for parameters that a dataset comes with, and {name} has"
            " none: give it as --body"
        )


def _refuse_vocabulary(options: ReadOptions, own: Vocabulary) -> None:
    if options.vocabulary is not None:
        raise ConfigError(
            f"--vocabulary {options.vocabulary.name} is for formats whose files do not tell: these"
            f" keypoints are {own.name}"
        )


def _is_animal3d(peek: Peek) -> bool:
    if peek.path.is_dir():
        return any((peek.path / name).is_file() for name in animal3d_entries.SPLITS)
    return peek.keys is not None and "data" in peek.keys


def _is_mesh_folder(peek: Peek) -> bool:
    return mesh_folder.is_mesh_folder(peek.path)


def _is_coco(peek: Peek) -> bool:
    if peek.path.is_dir():
        return any(
            (file := peek.path / name).is_file() and _is_coco(peeked(file)) for name in coco.FILES
        )
    return peek.keys is not None and {"images", "annotations"} <= peek.keys


def _is_deeplabcut(peek: Peek) -> bool:
    if peek.path.is_dir():
        return bool(deeplabcut.label_files(peek.path))
    return peek.path.suffix.lower() in (".csv", *deeplabcut_h5.SUFFIXES)


def _is_stanfordextra(peek: Peek) -> bool:
    return bool(stanfordextra.annotation_files(peek.path)) if peek.path.is_dir() else peek.is_list


@dataclass(frozen=True)
class Reader:
    """How one format is recognised and read.

    Attributes:
        signs: what it is recognised by, for people.
        recognises: whether a path is in it.
        read: the dataset at a path.
    """

    signs: str
    recognises: Callable[[Peek], bool]
    read: Callable[[Path, ReadOptions], Source]


READERS: dict[str, Reader] = {
    animal3d.FORMAT: Reader("train.json or test.json", _is_animal3d, _read_animal3d),
    mesh_folder.FORMAT: Reader("images/ and meshes/", _is_mesh_folder, _read_mesh_folder),
    coco.FORMAT: Reader(" or ".join(coco.FILES), _is_coco, _read_coco),
    deeplabcut.FORMAT: Reader("a csv or h5 table", _is_deeplabcut, _read_deeplabcut),
    stanfordextra.FORMAT: Reader("StanfordExtra*.json", _is_stanfordextra, _read_stanfordextra),
}
"""Every format, in the order in which they are asked whether a path is theirs."""
FORMATS = tuple(READERS)


def recognised_format(path: Path) -> str:
    """The format of a folder or annotation file.

    Raises:
        DatasetNotFoundError: nothing there is recognised.
        DatasetFormatError: the file is in no format that is known.

    """
    seen = peeked(path)
    looks = _format_of(seen)
    if looks is not None:
        return looks
    raise DatasetFormatError(
        f"{path} is in no format that is known: it {_contents(seen)}; give the path of a dataset,"
        f" and its --format if it is named otherwise:"
        f" {', '.join(f'{name} ({reader.signs})' for name, reader in READERS.items())}"
    )


def _format_of(seen: Peek) -> str | None:
    return next((name for name, reader in READERS.items() if reader.recognises(seen)), None)


def _contents(seen: Peek) -> str:
    """What a path holds, for a reader of error messages: the keys of a file, a folder's files."""
    if seen.path.is_dir():
        names = sorted(path.name for path in islice(seen.path.iterdir(), 1000))
        return f"holds {', '.join(names[:8])}" if names else "is an empty folder"
    if seen.is_list:
        return "is a list"
    return f"has {', '.join(sorted(seen.keys)[:8]) or 'nothing'}" if seen.keys is not None else ""


def peeked(path: Path) -> Peek:
    """A look at a path.

    Raises DatasetNotFoundError if there is nothing, DatasetFormatError of a .json file that is
    none.
    """
    if not path.exists():
        raise DatasetNotFoundError(f"there is no file or folder {path}")
    if path.is_dir() or path.suffix.lower() not in (".json", ""):
        return Peek(path, None, is_list=False)
    content = decode_json(path, list[msgspec.Raw] | dict[str, msgspec.Raw])
    return Peek(
        path, frozenset(content) if isinstance(content, dict) else None, isinstance(content, list)
    )


def read_dataset(path: Path, format: str = "auto", options: ReadOptions | None = None) -> Source:
    """A dataset's records and bodies.

    Args:
        path: its folder or annotation file.
        format: of FORMATS, or "auto".
        options: what the user says of it.

    Raises:
        ConfigError: an unknown format, or an option that the format has no use for.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    """
    if format not in ("auto", *FORMATS):
        raise ConfigError(f"format must be auto, {' or '.join(FORMATS)}, got {format!r}")
    if not path.exists():
        raise DatasetNotFoundError(f"there is no file or folder {path}")
    kind = recognised_format(path) if format == "auto" else format
    if kind == coco.FORMAT and is_omni3d(path):
        raise ConfigError(
            f"{path} holds cuboids in Omni3D's format, so there is nothing to label: load them with"
            " animal3dbox.datasets.Omni3DDataset, look at them with animal3dbox check, or convert"
            " them with animal3dbox export"
        )
    read = _read_as(kind, path, options or ReadOptions())
    return replace(
        read,
        records=_with_focal(
            _of_unicode(read.records), None if options is None else options.focal_px
        ),
    )


def _read_as(kind: str, path: Path, options: ReadOptions) -> Source:
    """The dataset in a format; an error says which other format the path looks like."""
    try:
        return READERS[kind].read(path, options)
    except (DatasetFormatError, DatasetNotFoundError) as error:
        looks = _format_of(peeked(path))
        if looks in (None, kind):
            raise
        raise type(error)(
            f"{error}; it looks like {looks}: read it with --format {looks}"
        ) from error


def _with_focal(read: RecordSet, focal_px: float | None) -> RecordSet:
    """The records with the user's focal length where an image has no camera of its own.

    A dataset's one pose for it held for another camera.
    """
    if focal_px is None:
        return read
    own = {
        id(record)
        for record in read.records
        if record.K is not None and (record.K_source == "given" or record.pose is not None)
    }
    changed = (
        (
            record
            if id(record) in own
            else replace(
                record,
                K=intrinsics(focal_px, record.image_hw).numpy(),
                K_source="given",
                stored_pose=None,
            )
        )
        for record in read.records
    )
    told = (
        f"the focal length given, {focal_px:g} px, is that of {len(read.records) - len(own)} of"
        f" {len(read.records)} animals"
    )
    note = told if not own else f"{told}; the images of the others have cameras of their own"
    return replace(read, records=tuple(changed), notes=(*read.notes, note))


def _of_unicode(read: RecordSet) -> RecordSet:
    """The records whose names are Unicode, as reports and JSON are.

    The others, of files whose names are no UTF-8, are faults.
    """
    bad = [record.sample_id for record in read.records if not _is_unicode(record.sample_id)]
    if not bad and all(_is_unicode(str(fault)) for fault in read.faults):
        return read
    kept = tuple(record for record in read.records if _is_unicode(record.sample_id))
    told = [
        SampleError(_escaped(str(fault.sample_id)), fault.field, _escaped(str(fault.problem)))
        for fault in read.faults
    ]
    told += [
        SampleError(_escaped(name), "sample_id", "the file's name is not UTF-8: rename it")
        for name in bad
    ]
    return replace(read, records=kept, faults=tuple(told))


def _is_unicode(text: str) -> bool:
    return text.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in text)


def _escaped(text: str) -> str:
    """Text in which bytes that are no UTF-8 are spelt out."""
    return text.encode("utf-8", "backslashreplace").decode()


def bodies_for(read: Source, own: BodySource | None) -> BodySource:
    """The user's body for all animals if there is one, else the dataset's own bodies, else a dog.

    Raises:
        ConfigError: a user's body for a dataset whose cameras are known in the frame of its own.

    """
    if own is not None and any(record.pose is not None for record in read.records.records):
        raise ConfigError(
            f"{own.name} cannot be the body of all animals: this dataset's cameras are known only"
            " to its own meshes; leave it out"
        )
    return own or read.bodies or body_source(DEFAULT_BODY)

"""The reader of DeepLabCut: images with a table of the bodyparts of one animal or several.

The bodyparts are labelled by hand or found by a network, in images or in a video's frames.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.named_files import portable_name, resolve_inside
from animal3dbox.datasets.images.photos import IMAGE_SUFFIXES, is_file, stored_size
from animal3dbox.datasets.readers.deeplabcut.h5 import SUFFIXES, read_h5_table
from animal3dbox.datasets.readers.deeplabcut.table import DlcTable, is_csv_table, read_csv_table
from animal3dbox.datasets.readers.distinct_animals import distinct_animals, elsewhere_notes
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.sightings import Sighting
from animal3dbox.errors import DatasetFormatError, DatasetNotFoundError, SampleError
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.keypoints.vocabulary_match import NameMatch, match_by_name

FORMAT = "deeplabcut"
"""The format's name in reports and for --format."""
LEAST_LIKELIHOOD = 0.6
"""Likelihood under which a bodypart counts as missing.

It is DeepLabCut's own default for plots and filters.
"""
UNIQUE = "single"
"""The individual to which DeepLabCut gives bodyparts of no animal, such as a cage's corners."""
_NUMBER = re.compile(r"\d+")


def label_files(folder: Path) -> list[Path]:
    """The tables in a folder; of a csv and an h5 of one name the csv, which needs no extra."""
    tables = {path.stem: path for suffix in SUFFIXES for path in sorted(folder.glob(f"*{suffix}"))}
    tables |= {path.stem: path for path in sorted(folder.glob("*.csv")) if is_csv_table(path)}
    return sorted(tables.values())


def find_labels(path: Path) -> Path:
    """The table of a dataset given by its folder or by that file.

    Raises DatasetNotFoundError if there is none, or more than one.
    """
    if path.is_file():
        return path
    tables = label_files(path) if path.is_dir() else []
    if len(tables) != 1:
        names = ", ".join(file.name for file in tables) or "none"
        raise DatasetNotFoundError(
            f"{path} must hold one table of DeepLabCut (csv or h5), found {names}: give the file"
            " itself"
        )
    return tables[0]


def read_deeplabcut(
    path: Path,
    images: Path | None = None,
    vocabulary: Vocabulary | None = None,
    tolerance: Tolerance | None = None,
    *,
    upright: bool = False,
) -> RecordSet:
    """The animals of a table of DeepLabCut's.

    Args:
        path: the csv or h5, or the folder it lies in.
        images: the folder that the rows' paths are relative to; None: found by the first row.
        vocabulary: what the bodyparts are, if their names do not tell.
        tolerance: counts what is taken for missing, for somebody else's notes; None: for these.
        upright: without tolerance: whether pictures are turned as their headers say.

    Returns:
        The records in the order of the rows, and a fault for each that is unusable.

    Raises:
        DatasetNotFoundError: no such file, or no such folder of images.
        DatasetFormatError: not a table of DeepLabCut's.
        ConfigError: the bodyparts are in no known vocabulary, or h5py is not installed.

    """
    counts = tolerance or Tolerance(upright=upright)
    file = find_labels(path)
    table = read_h5_table(file) if file.suffix.lower() in SUFFIXES else read_csv_table(file)
    if images is not None and not images.is_dir():
        raise DatasetNotFoundError(f"there is no folder of images {images}")
    animals = tuple(
        name for name in table.individuals if name != UNIQUE or len(table.individuals) == 1
    )
    matches = {name: match_by_name(table.bodyparts(name), vocabulary) for name in animals}
    if isinstance(table.index[0], int):
        pictures = _frame_pictures(table, images or file.parent)
    else:
        pictures = _path_pictures(table, file, images)
    records: list[AnimalRecord] = []
    faults: list[SampleError] = []
    empty = 0
    for row, picture in pictures:
        for k, name in enumerate(animals):
            try:
                sample_id = f"{picture.name}#{k}" if k else picture.name
                _check_row(table, row, picture, sample_id)
                points = counts.without_minus_ones(_points(table, row, name, sample_id), sample_id)
                match, upright = matches[name], counts.upright
                record = _record(
                    points, picture, match, sample_id, individual=name, upright=upright
                )
            except SampleError as error:
                faults.append(error)
                continue
            empty += record is None
            records += [] if record is None else [record]
    kept, same_files = distinct_animals(records, counts)
    notes = (*_notes(table, len(pictures), matches, empty), *elsewhere_notes(kept))
    own_notes = counts.notes() if tolerance is None else ()
    return RecordSet(FORMAT, kept, (*faults, *same_files), (*notes, *own_notes))


@dataclass(frozen=True)
class _Picture:
    """The image of a row.

    Attributes:
        name: the image, as the table names it.
        root: the folder in which it is looked for.
        relative: its path in that folder.
        first: an earlier row of the same image; None if this is the first.
    """

    name: str
    root: Path
    relative: str
    first: int | None

    @property
    def sequence(self) -> str | None:
        """The folder that holds the image, one a video in DeepLabCut's projects; None without."""
        return self.name.rpartition("/")[0].rpartition("/")[2] or None


def _path_pictures(table: DlcTable, file: Path, images: Path | None) -> list[tuple[int, _Picture]]:
    """The rows with the images that they name, each where it lies itself."""
    names = [str(name).replace("\\", "/") for name in table.index]
    roots = [images] if images else list(file.parents)[:3]
    is_one_video = len({name.rpartition("/")[0] for name in names}) == 1
    root, drop = _image_root(names, roots, is_one_video=is_one_video)
    firsts: dict[str, int] = {}
    pictures = []
    for row, name in enumerate(names):
        first = firsts.setdefault(name, row)
        own = _place_of(name, roots, is_one_video=is_one_video)
        root, drop = own or (root, drop)
        relative = "/".join(name.split("/")[drop:])
        name = relative if portable_name(root, name) != name else name
        pictures.append((row, _Picture(name, root, relative, None if first == row else first)))
    return pictures


def _image_root(
    names: Sequence[str], roots: Sequence[Path], *, is_one_video: bool
) -> tuple[Path, int]:
    """The folder that images are found in, and how many leading parts of their paths to leave out.

    Tables are often moved without their project, so their paths begin with folders that are gone.
    """
    places = (_place_of(name, roots, is_one_video=is_one_video) for name in names[:100])
    return next((place for place in places if place), (roots[0], 0))


def _place_of(name: str, roots: Sequence[Path], *, is_one_video: bool) -> tuple[Path, int] | None:
    """Where an image is found by the longest end of its path; None if it is nowhere.

    The video's folder belongs to a frame's name where a table has several videos.
    """
    parts = name.split("/")
    if ".." in parts:
        return None
    for drop in range(len(parts) if is_one_video else max(len(parts) - 1, 1)):
        for root in roots:
            path = root.joinpath(*parts[drop:])
            if path.is_relative_to(root) and is_file(path):
                return root, drop
    return None


def _frame_pictures(table: DlcTable, root: Path) -> list[tuple[int, _Picture]]:
    """The rows of a video's frames that have an image.

    The last number in an image's name is its frame's.
    """
    files: dict[int, str] = {}
    for path in sorted(root.iterdir()):
        digits = _NUMBER.findall(path.stem)
        if path.suffix.lower() not in IMAGE_SUFFIXES or not digits:
            continue
        if int(digits[-1]) in files:
            raise DatasetFormatError(
                f"{root}: {path.name} and {files[int(digits[-1])]} are both frame"
                f" {int(digits[-1])}: give --images one video's"
            )
        files[int(digits[-1])] = path.name
    rows = [
        (row, files[frame])
        for row, frame in enumerate(table.index)
        if isinstance(frame, int) and frame in files
    ]
    if not rows:
        raise DatasetFormatError(
            f"{table.path} has the frames of a video, but {root} has no images of them (img0042.png"
            " is frame 42): extract some, and give --images"
        )
    return [(row, _Picture(name, root, name, None)) for row, name in rows]


def _check_row(table: DlcTable, row: int, picture: _Picture, sample_id: str) -> None:
    """Raise a SampleError for a second row of an image, and for one of too few or many cells."""
    if picture.first is not None:
        raise SampleError(
            sample_id,
            f"row {row}",
            f"is the image of row {picture.first} once more; remove one, or it counts twice",
        )
    if len(table.rows[row]) != len(table.columns):
        raise SampleError(
            sample_id,
            f"row {row}",
            f"has {len(table.rows[row])} cells, but the header has {len(table.columns)}",
        )


def _record(
    points: NDArray[np.float64],
    picture: _Picture,
    match: NameMatch,
    sample_id: str,
    *,
    individual: str,
    upright: bool,
) -> AnimalRecord | None:
    """The record of one animal in one image; None if the animal is not in the image.

    Args:
        points: (P, 3) x, y, confidence of its bodyparts.
        picture: the image.
        match: of the bodyparts with a vocabulary.
        sample_id: named in every error.
        individual: the animal's name in the table; "" in tables of one animal.
        upright: whether the image is turned as its header says.

    Raises:
        SampleError: there is no such image, or it cannot be read.

    """
    if not points[:, 2].any():
        return None
    image = resolve_inside(picture.root, picture.relative, sample_id, "image")
    return AnimalRecord(
        sample_id=sample_id,
        image_id=picture.name,
        image_path=image,
        image_hw=stored_size(image, sample_id, upright=upright),
        vocabulary=match.vocabulary,
        keypoints_2d=match.rows(points),
        mask_runs=None,
        category="animal",
        sighting=Sighting(sequence=picture.sequence, individual=individual or None),
        upright=upright,
    )


def _points(table: DlcTable, row: int, individual: str, sample_id: str) -> NDArray[np.float64]:
    """The bodyparts (P, 3) of an individual in a row: x, y, confidence; raises SampleError.

    They are zeros where a bodypart is missing, or the network is not sure of it.
    """
    cells, points = table.rows[row], list[tuple[float, float, float]]()
    for part, (x_at, y_at, likelihood_at) in zip(
        table.bodyparts(individual), table.places(individual), strict=True
    ):
        x, y = (_number(cells[at], sample_id, part) for at in (x_at, y_at))
        confidence = (
            1.0 if likelihood_at is None else _number(cells[likelihood_at], sample_id, part)
        )
        if (
            math.isinf(x)
            or math.isinf(y)
            or not (math.isnan(confidence) or -1e-6 <= confidence <= 1 + 1e-6)
        ):
            raise SampleError(
                sample_id,
                part,
                f"must have a finite place and a likelihood from 0 to 1, got {x}, {y},"
                f" {confidence}",
            )
        empty = math.isnan(x) or math.isnan(y) or math.isnan(confidence)
        empty = empty or x == y == 0  # how tables of zeros say that nothing is marked
        sure = not empty and (likelihood_at is None or confidence >= LEAST_LIKELIHOOD)
        points.append((x, y, min(confidence, 1.0)) if sure else (0.0, 0.0, 0.0))
    return np.array(points, dtype=np.float64)


def _number(cell: str | float, sample_id: str, field: str) -> float:
    """The number of a cell, NaN if it is empty; raises SampleError if it is no number."""
    try:
        return float(cell) if cell != "" else math.nan
    except ValueError as error:
        raise SampleError(sample_id, field, f"must be a number, got {cell!r}") from error


def _notes(
    table: DlcTable, with_image: int, matches: dict[str, NameMatch], empty: int
) -> tuple[str, ...]:
    """Notes for the report, in whole sentences.

    Args:
        table: as it was read.
        with_image: number of rows with an image.
        matches: animal -> its bodyparts' match with a vocabulary.
        empty: how often an animal is not in an image.

    """
    notes = []
    if with_image < len(table.index):
        notes.append(
            f"{len(table.index) - with_image} of {len(table.index)} rows are frames without an"
            " image"
        )
    if empty:
        notes.append(
            f"{empty} times an animal is not in an image: no bodypart is marked, or of a likelihood"
            f" of {LEAST_LIKELIHOOD} or more"
        )
    if UNIQUE in table.individuals and UNIQUE not in matches:
        notes.append(
            f"the bodyparts of {UNIQUE!r} ({', '.join(table.bodyparts(UNIQUE))}) belong to no"
            " animal and are not used"
        )
    for match in dict.fromkeys(match for match in matches.values() if match.unused):
        notes.append(
            f"the bodyparts {', '.join(match.unused)} are not in the vocabulary"
            f" {match.vocabulary.name} and not used"
        )
    return tuple(notes)

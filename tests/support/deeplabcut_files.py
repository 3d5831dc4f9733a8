"""DeepLabCut's files made in a folder.

Csv, and h5 as pandas lays them out ("fixed" and "table"), and every fault they can have.
"""

import csv
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from animals import toy_landmarks, toy_mesh
from numpy.typing import NDArray
from photo_dataset import HW, Scene, View, view_of
from PIL import Image

from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_26, VOCABULARIES

NAMES = VOCABULARIES["superanimal39"].keypoints
Column = tuple[str, ...]


@cache
def superanimal_view(azimuth_deg: float) -> View:
    """The toy animal with SuperAnimal's bodyparts; those it has not are zeros."""
    vertices, faces = toy_mesh()
    groups = {name: [row] for row, name in enumerate(ANIMAL3D_26)}
    return view_of(
        Scene(vertices, faces, VOCABULARIES["superanimal39"].on_body(groups, toy_landmarks())),
        azimuth_deg,
    )


@dataclass
class Table:
    """What a file is made of.

    Attributes:
        columns: a label of three or four levels each.
        index: of the rows: a path's parts, a path, or a frame's number.
        rows: (N, C), NaN where there is nothing.
    """

    columns: list[Column]
    index: list[tuple[str, ...] | str | int]
    rows: NDArray[np.float64]


def table(
    azimuths: Sequence[Sequence[float | None]],
    individuals: Sequence[str] = (),
    likelihood: float | None = 0.9,
) -> Table:
    """For each image its animals' views; None for an animal that is not in it."""
    coords = ("x", "y") if likelihood is None else ("x", "y", "likelihood")
    animals = individuals or ("",)
    columns: list[Column] = [
        ("DLC", *((name,) if name else ()), part, coord)
        for name in animals
        for part in NAMES
        for coord in coords
    ]
    rows = []
    for image in azimuths:
        cells: list[float] = []
        for azimuth in image:
            for x, y, seen in (
                [(np.nan, np.nan, 0.0)] * len(NAMES)
                if azimuth is None
                else superanimal_view(azimuth).joints
            ):
                place = [x, y] if seen else [np.nan, np.nan]
                cells += place if likelihood is None else [*place, likelihood if seen else np.nan]
        rows.append(cells)
    return Table(
        columns,
        [("labeled-data", "zoo", f"img{i:03d}.png") for i in range(len(azimuths))],
        np.array(rows),
    )


def write_images(folder: Path, count: int) -> None:
    """img000.png, img001.png, ..."""
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        Image.new("RGB", (HW[1], HW[0]), (i, 90, 90)).save(folder / f"img{i:03d}.png")


def write_csv(path: Path, made: Table) -> Path:
    """As pandas writes it."""
    depth, cells = (
        len(made.columns[0]),
        [list(part) if isinstance(part, tuple) else [part] for part in made.index],
    )
    names = (
        ("scorer", "bodyparts", "coords")
        if depth == 3
        else ("scorer", "individuals", "bodyparts", "coords")
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        for level, name in enumerate(names):
            writer.writerow(
                [name, *[""] * (len(cells[0]) - 1), *(column[level] for column in made.columns)]
            )
        for before, row in zip(cells, made.rows.tolist(), strict=True):
            writer.writerow([*before, *("" if np.isnan(value) else repr(value) for value in row)])
    return path


def write_fixed(path: Path, made: Table, transposed: bool = True, **changes: Any) -> Path:
    """DataFrame.to_hdf(format="fixed"): plain arrays of levels and codes.

    Args:
        path: the file.
        made: what goes into it.
        transposed: whether values are stored by rows, as PyTables does for arrays in C order.
        **changes: replace attributes of the group.

    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        for name, value in {
            "CLASS": b"GROUP",
            "pandas_type": b"frame",
            "encoding": b"UTF-8",
            "ndim": 2,
            "nblocks": 1,
            **changes,
        }.items():
            group.attrs[name] = np.bytes_(value) if isinstance(value, bytes) else value
        _write_axis(group, "axis0", made.columns)
        _write_axis(group, "axis1", made.index)
        _write_axis(group, "block0_items", made.columns)
        values = group.create_dataset(
            "block0_values", data=made.rows if transposed else made.rows.T
        )
        if transposed:
            values.attrs["transposed"] = np.uint8(1)
    return path


def _write_axis(group: Any, name: str, labels: Sequence[Any]) -> None:
    if not isinstance(labels[0], tuple):
        group.attrs[f"{name}_variety"] = np.bytes_(b"regular")
        group.create_dataset(
            name, data=_bytes(labels) if isinstance(labels[0], str) else np.array(labels)
        )
        return
    group.attrs[f"{name}_variety"], group.attrs[f"{name}_nlevels"] = (
        np.bytes_(b"multi"),
        len(labels[0]),
    )
    for level in range(len(labels[0])):
        values = sorted({label[level] for label in labels})
        group.create_dataset(f"{name}_level{level}", data=_bytes(values))
        group.create_dataset(
            f"{name}_label{level}",
            data=np.array([values.index(label[level]) for label in labels], dtype=np.int64),
        )


def _bytes(labels: Sequence[str]) -> NDArray[np.bytes_]:
    return np.array([label.encode() for label in labels], dtype="S")


def write_appendable(path: Path, made: Table, names: bytes | None = None) -> Path:
    """DataFrame.to_hdf(format="table").

    One array of rows, the columns' names pickled by protocol 0 in an attribute.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    index = (
        np.array(made.index)
        if isinstance(made.index[0], int)
        else _bytes(
            ["/".join(part) if isinstance(part, tuple) else str(part) for part in made.index]
        )
    )
    rows = np.zeros(
        len(index), dtype=[("index", index.dtype), ("values_block_0", "<f8", (made.rows.shape[1],))]
    )
    rows["index"], rows["values_block_0"] = index, made.rows
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_(b"frame_table")
        group.create_dataset("table", data=rows).attrs["values_block_0_kind"] = np.bytes_(
            pickle.dumps(made.columns, 0) if names is None else names
        )
    return path


@dataclass(frozen=True)
class DlcFault:
    """One way for a csv to be wrong.

    Attributes:
        field: that the error names; empty if the whole file is refused.
        reason: words of the error.
        spoil: gets the lines of cells; changes them in place.
        folder: gets the folder of images.
    """

    field: str
    reason: str
    spoil: Callable[[list[list[str]]], object] = lambda lines: None
    folder: Callable[[Path], object] = lambda folder: None


def cell(row: int, column: int, value: str) -> Callable[[list[list[str]]], object]:
    """Replace a cell; rows 0 to 2 are the header, columns 0 to 2 the image."""

    def spoil(lines: list[list[str]]) -> None:
        lines[row][column] = value

    return spoil


DLC_FAULTS = {
    "missing_image": DlcFault(
        "image", "there is no file", folder=lambda folder: (folder / "img000.png").unlink()
    ),
    "image_is_no_image": DlcFault(
        "image",
        "cannot be decoded",
        folder=lambda folder: (folder / "img000.png").write_text("<html>"),
    ),
    "image_out_of_root": DlcFault("image", "leads out of", cell(3, 2, "../../../x.png")),
    "image_twice": DlcFault("row 1", "is the image of row 0 once more", cell(4, 2, "img000.png")),
    "word_for_a_number": DlcFault("nose", "must be a number, got 'left'", cell(3, 3, "left")),
    "infinite_place": DlcFault("nose", "must have a finite place", cell(3, 3, "inf")),
    "likelihood_of_2": DlcFault("nose", "a likelihood from 0 to 1", cell(3, 5, "2")),
    "negative_likelihood": DlcFault("nose", "a likelihood from 0 to 1", cell(3, 5, "-0.5")),
    "short_row": DlcFault(
        "row 0", "has 116 cells, but the header has 117", lambda lines: lines[3].pop()
    ),
    "long_row": DlcFault("row 0", "has 118 cells", lambda lines: lines[3].append("1")),
    "unknown_bodypart": DlcFault(
        "", "'snout' (nearest: ", lambda lines: lines[1].__setitem__(slice(3, 6), ["snout"] * 3)
    ),
    "bodypart_twice": DlcFault(
        "", "nose x more than once", lambda lines: lines[1].__setitem__(slice(6, 9), ["nose"] * 3)
    ),
    "two_scorers": DlcFault("", "several scorers (DLC, me)", cell(0, 3, "me")),
    "no_y": DlcFault("", "the column nose x more than once", cell(2, 4, "x")),
    "z_for_y": DlcFault("", "has the coordinate 'z' of nose", cell(2, 4, "z")),
    "likelihood_without_place": DlcFault(
        "", "no x and y of nose", lambda lines: [line.pop(3) for line in lines]
    ),
    "no_coords": DlcFault("", "must begin with rows of scorer", lambda lines: lines.pop(2)),
    "header_of_two_lengths": DlcFault(
        "", "the header's rows have 120 and 121 cells", lambda lines: lines[1].append("x")
    ),
    "no_rows": DlcFault("", "no row of keypoints", lambda lines: lines.__delitem__(slice(3, None))),
    "empty": DlcFault("", "got nothing", lambda lines: lines.clear()),
}

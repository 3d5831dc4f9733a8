"""DeepLabCut's h5 files, read by h5py (extra "deeplabcut") without pandas.

Pandas writes them through PyTables. A "fixed" frame is plain arrays. A "table" has its columns'
names in an attribute that is a pickle: our own stack machine (smal.safe_pickle) makes plain values
of it, and nothing that it names is imported or called.
"""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.readers.deeplabcut.table import DlcTable, table_of
from animal3dbox.errors import ConfigError, DatasetFormatError, ModelFileError
from animal3dbox.smal.safe_pickle.reader import parse_pickle

SUFFIXES = (".h5", ".hdf5")
"""Suffixes of HDF5 files."""
REMEDY = "give DeepLabCut's csv of the same table instead"

Label = str | int | tuple[Any, ...]
"""The label of a column or row; a tuple in an axis of several levels."""
Frame = tuple[list[Label], list[Label], NDArray[np.float64]]
"""A frame's columns, its index, and its values (rows, columns)."""


def read_h5_table(path: Path) -> DlcTable:
    """The table of an h5 file.

    Raises:
        ConfigError: h5py is not installed.
        DatasetFormatError: not an HDF5 file, or not one frame of numbers.

    """
    if importlib.util.find_spec("h5py") is None:
        raise ConfigError(f"{path} needs h5py: pip install 'animal3dbox[deeplabcut]', or {REMEDY}")
    import h5py

    try:
        with h5py.File(path, "r") as file:
            groups = [group for group in file.values() if isinstance(group, h5py.Group)]
            columns, index, values = _frame(groups, path)
    except (OSError, KeyError, IndexError, TypeError, ValueError, ModelFileError) as error:
        # Whatever may be missing or damaged in the file.
        raise DatasetFormatError(
            f"{path} cannot be read as pandas writes tables: {error}; {REMEDY}"
        ) from error
    if not all(isinstance(column, tuple) for column in columns):
        raise DatasetFormatError(
            f"{path} has columns without a header of several rows: it is not DeepLabCut's"
        )
    images = [
        "/".join(str(part) for part in label) if isinstance(label, tuple) else label
        for label in index
    ]
    return table_of(
        path,
        [[str(part) for part in column] for column in columns if isinstance(column, tuple)],
        images,
        values.tolist(),
    )


def _frame(groups: list[Any], path: Path) -> Frame:
    """The one frame among a file's groups; raises DatasetFormatError if there is not one."""
    frames = [
        group for group in groups if _text(group.attrs.get("pandas_type")).startswith("frame")
    ]
    if len(frames) != 1:
        raise DatasetFormatError(f"{path} must hold one table, it holds {len(frames)}; {REMEDY}")
    return _fixed(frames[0]) if "axis0_variety" in frames[0].attrs else _table(frames[0])


def _fixed(group: Any) -> Frame:
    """A fixed frame, in which each block holds the values of some columns."""
    columns, index = _axis(group, "axis0"), _axis(group, "axis1")
    values = np.full((len(index), len(columns)), np.nan)
    places = {label: i for i, label in enumerate(columns)}
    for block in range(int(group.attrs["nblocks"])):
        items, array = _axis(group, f"block{block}_items"), group[f"block{block}_values"]
        cells = np.asarray(array[()], dtype=np.float64)
        values[:, [places[item] for item in items]] = (
            cells if array.attrs.get("transposed") else cells.T
        )
    return columns, index, values


def _axis(group: Any, name: str) -> list[Label]:
    """The labels of an axis of one level, or of several levels as tuples."""
    if _text(group.attrs[f"{name}_variety"]) == "regular":
        return _labels(group[name])
    levels = range(int(group.attrs[f"{name}_nlevels"]))
    parts = [
        [
            _at(_labels(group[f"{name}_level{k}"]), code)
            for code in group[f"{name}_label{k}"][()].tolist()
        ]
        for k in levels
    ]
    return list(zip(*parts, strict=True))


def _at(labels: list[Label], code: int) -> Label:
    """The label of a code, of which a negative one means a missing label."""
    if code < 0:
        raise ValueError("a label of an axis is missing")
    return labels[code]


def _labels(array: Any) -> list[Label]:
    """The strings or whole numbers of an array; raises ValueError for anything else."""
    cells = np.asarray(array[()])
    if cells.dtype.kind not in "SiuU":
        raise ValueError(f"{array.name} holds pickled values")
    return [cell.decode() if isinstance(cell, bytes) else cell for cell in cells.tolist()]


def _table(group: Any) -> Frame:
    """An appendable table, in which each field holds a block of columns."""
    rows = group["table"][()]
    fields = [name for name in rows.dtype.names if name.startswith("values_block_")]
    columns: list[Label] = []
    for name in fields:
        pickled = np.asarray(group["table"].attrs[f"{name}_kind"]).tobytes()
        labels = parse_pickle(pickled, f"the columns' names of {name}")
        if not isinstance(labels, list) or not all(
            isinstance(part, str) for column in labels for part in column
        ):
            raise ValueError(f"the columns' names of {name} are no list of strings")
        columns += labels
    values = np.concatenate(
        [np.asarray(rows[name], dtype=np.float64).reshape(len(rows), -1) for name in fields], axis=1
    )
    if values.shape[1] != len(columns):
        raise ValueError(f"{values.shape[1]} columns have {len(columns)} names")
    cells = rows["index"].tolist()
    return columns, [cell.decode() if isinstance(cell, bytes) else cell for cell in cells], values


def _text(value: Any) -> str:
    """An attribute's text, which HDF5 may hold as bytes."""
    return value.decode() if isinstance(value, bytes) else str(value)

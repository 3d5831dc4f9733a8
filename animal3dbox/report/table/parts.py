"""The parts of a table: files of a folder, each written whole or not at all.

A part is Parquet where pyarrow is installed (the extra `parquet`), else CSV compressed by gzip; a
folder holds one of the two. Its name is made of its shard and its rows' keys: whoever writes the
same rows again writes the same file.
"""

import csv
import gzip
import io
import os
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from animal3dbox.datasets.storage.fingerprint import digest
from animal3dbox.errors import ConfigError, DatasetFormatError
from animal3dbox.files import write_whole
from animal3dbox.report.labels_csv import text_cell
from animal3dbox.report.table.columns import KINDS, Value

if TYPE_CHECKING:
    import pyarrow

PartFormat = Literal["parquet", "csv.gz"]
WHOLE_TABLE = (1, 1)
_NAME = re.compile(r"shard-(\d+)-of-(\d+)-([0-9a-f]{16})\.(parquet|csv\.gz)")
EXTRA = "pip install 'animal3dbox[parquet]'"


@dataclass(frozen=True)
class Part:
    """One file of a table.

    Attributes:
        path: of the file.
        shard: which it is a part of, and of how many: (i, n), counted from 1.
        format: "parquet" or "csv.gz".
    """

    path: Path
    shard: tuple[int, int]
    format: PartFormat


def parts_of(folder: Path) -> list[Part]:
    """The parts in a table's folder, by their names; none if there is no folder."""
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    matches = (match for name in names if (match := _NAME.fullmatch(name)))
    return [
        Part(
            folder / match[0],
            (int(match[1]), int(match[2])),
            "parquet" if match[4] == "parquet" else "csv.gz",
        )
        for match in matches
    ]


def part_format(folder: Path) -> PartFormat:
    """The format of a folder's parts: of those that are there, else the one that can be written.

    Raises:
        ConfigError: they are Parquet and pyarrow is missing, or there are parts of both.

    """
    formats = {part.format for part in parts_of(folder)}
    if len(formats) > 1:
        raise ConfigError(f"{folder} holds parts in Parquet and in CSV: keep those of one of them")
    has_pyarrow = find_spec("pyarrow") is not None
    if formats == {"parquet"} and not has_pyarrow:
        raise ConfigError(f"{folder} holds parts in Parquet, which need pyarrow: {EXTRA}")
    return next(iter(formats), "parquet" if has_pyarrow else "csv.gz")


@contextmanager
def locked_shard(
    folder: Path, shard: tuple[int, int] = WHOLE_TABLE, *, results: Path | None = None
) -> Iterator[None]:
    """Let nobody else write a shard of a table while a ``with`` block lasts.

    Who holds the lock and is killed, loses it. The folder is made if it is missing, and what a
    killed writer left unfinished is removed. On Windows nothing is locked.

    Args:
        folder: of the table, or of the rows of a run that writes no table.
        shard: that is written.
        results: the folder of such a run, which errors name; None: a table is written.

    Raises:
        ConfigError: another process writes the shard, or a shard of another number of them, whose
            rows may be the same; or the folder cannot be made.

    """
    stem = f".shard-{shard[0]}-of-{shard[1]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / f"{stem}.lock").open("ab")  # a link there costs no other file its bytes
    except OSError as error:
        problem = (
            f"the table's folder {folder} cannot be made"
            if results is None
            else f"the results' folder {results} cannot be written to"
        )
        raise ConfigError(f"{problem}: {error}") from error
    with file:
        if os.name == "posix":
            import fcntl

            try:  # a lock of the process, which its forked workers do not inherit
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise ConfigError(
                    f"another process writes this table into {folder}: wait for its end, or give"
                    " another folder or --shard"
                    if results is None
                    else f"another process labels into {results}: wait for its end, or give another"
                    " folder"
                ) from error
            _refuse_other_divisions(folder, shard)
        for unfinished in folder.glob(f"{stem}-*"):
            unfinished.unlink(missing_ok=True)
        yield


def _refuse_other_divisions(folder: Path, shard: tuple[int, int]) -> None:
    """Raise a ConfigError if a process writes a shard of another number of shards."""
    import fcntl

    for lock in folder.glob(".shard-*-of-*.lock"):
        if lock.stem.endswith(f"-of-{shard[1]}"):
            continue
        with lock.open("rb+") as file:
            try:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise ConfigError(
                    f"another process writes {lock.stem.removeprefix('.')} into {folder}, whose"
                    f" rows may be those of shard {shard[0]}/{shard[1]}: wait for its end, or give"
                    " the same number of shards"
                ) from error


def write_part(
    folder: Path, table: Mapping[str, Sequence[Any]], shard: tuple[int, int] = WHOLE_TABLE
) -> Path | None:
    """Write rows as one part of a table, whole or not at all.

    Args:
        folder: of the table, made if it is missing.
        table: as label_table gives it.
        shard: that the rows are of.

    Returns:
        The file; None if there are no rows.

    Raises:
        ConfigError: see part_format.
        OSError: it cannot be written.

    Example:
        >>> import tempfile
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> from animal3dbox.report import label_table
        >>> table = label_table(SyntheticDataset(2, seed=0, image_hw=(120, 160)), [0, 1])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = write_part(Path(folder), table)
        ...     read_part(parts_of(Path(folder))[0], ["image"])["image"]
        ['0-000000', '0-000001']
    """
    keys = table["key"]
    if not keys:
        return None
    format = part_format(folder)
    name = digest(*(key.encode() for key in keys)).hex()[:16]
    path = folder / f"shard-{shard[0]}-of-{shard[1]}-{name}.{format}"
    write_whole(path, _parquet(table) if format == "parquet" else _compressed_csv(table))
    return path


def read_part(part: Part, columns: Sequence[str]) -> dict[str, list[Value]]:
    """Columns of a part, whose checksums must be right.

    Parquet has one for each page of each column: only those of the columns that are read are
    verified. CSV has one for the whole part.

    Raises:
        DatasetFormatError: the file is damaged or lacks a column.

    """
    with _named_damage(part):
        if part.format == "parquet":
            arrow = _arrow_columns(part, columns)
            return {name: arrow.column(name).to_pylist() for name in columns}
        rows = [*_csv_rows(part.path)]
        return {name: [_value(row[name], KINDS[name]) for row in rows] for name in columns}


def check_part(part: Part) -> None:
    """Raise a DatasetFormatError if any column of a part is damaged, also one that nobody reads."""
    with _named_damage(part):
        if part.format == "parquet":
            _arrow_columns(part, [*KINDS])
        else:
            with gzip.open(part.path) as file:
                while file.read(1 << 20):
                    pass


@contextmanager
def _named_damage(part: Part) -> Iterator[None]:
    """Name the part, and the remedy, in whatever its reader raises of a damaged file."""
    try:
        yield
    except (OSError, EOFError, ValueError, KeyError, csv.Error, zlib.error) as error:
        raise DatasetFormatError(
            f"{part.path} cannot be read ({error}): delete it and --resume, which makes its rows"
            " anew"
        ) from error


def _arrow_columns(part: Part, columns: Sequence[str]) -> "pyarrow.Table":
    """Columns of a part in Parquet; raises a ValueError, KeyError or OSError if it is damaged."""
    import pyarrow.parquet

    try:
        return pyarrow.parquet.read_table(
            part.path, columns=list(columns), page_checksum_verification=True
        ).select(list(columns))
    except pyarrow.ArrowException as error:  # such as NotImplementedError of a type it never had
        raise ValueError(str(error)) from error


def arrow_table(table: Mapping[str, Sequence[Any]]) -> "pyarrow.Table":
    """The rows as an Arrow table whose columns have the types of their kinds, known or not.

    Raises:
        ConfigError: pyarrow is missing.

    """
    if find_spec("pyarrow") is None:
        raise ConfigError(f"Parquet needs pyarrow: {EXTRA}")
    import pyarrow

    types = {
        "text": pyarrow.string(),
        "number": pyarrow.float64(),
        "whole": pyarrow.int64(),
        "flag": pyarrow.bool_(),
    }
    schema = pyarrow.schema([(name, types[KINDS[name]]) for name in table])
    return pyarrow.table(dict(table), schema=schema)


def _parquet(table: Mapping[str, Sequence[Any]]) -> bytes:
    import pyarrow.parquet

    buffer = io.BytesIO()
    pyarrow.parquet.write_table(
        arrow_table(table), buffer, compression="zstd", write_page_checksum=True
    )
    return buffer.getvalue()


def _compressed_csv(table: Mapping[str, Sequence[Any]]) -> bytes:
    """The rows as CSV, compressed; the same bytes at any time."""
    text = io.StringIO(newline="")
    writer = csv.writer(_Lines(text))
    writer.writerow(table)
    cells = [[*map(partial(_cell, KINDS[name]), values)] for name, values in table.items()]
    writer.writerows(zip(*cells, strict=True))
    return gzip.compress(text.getvalue().encode("utf-8", "surrogateescape"), 6, mtime=0)


class _Lines:
    r"""Ends the lines of a csv.writer by \n.

    Told to end them so, before Python 3.13, it would not quote a text with \r, where readers begin
    another row.
    """

    def __init__(self, text: io.StringIO) -> None:
        self._text = text

    def write(self, line: str) -> int:
        return self._text.write(line.removesuffix("\r\n") + "\n")


def _cell(kind: str, value: Value) -> str:
    """A cell: empty where nothing is known, numbers with all their digits, flags in words."""
    if value is None:
        return ""
    if kind == "text":
        text = str(value)
        return f"'{text}" if _marks(text) or text_cell(text) != text else text
    return str(value).lower() if kind == "flag" else repr(value)


def _marks(text: str) -> bool:
    """Whether a text begins as a cell that has a mark: with one, or more, and a formula's sign."""
    bare = text.lstrip("'")
    return bare != text and text_cell(bare) != bare


def _csv_rows(path: Path) -> Iterator[dict[str, str]]:
    with gzip.open(path, "rt", encoding="utf-8", errors="surrogateescape", newline="") as file:
        reader = csv.DictReader(file)
        if reader.fieldnames is None:
            raise EOFError("it is empty")
        yield from reader


def _value(cell: str, kind: str) -> Value:
    """The value of a cell; None of an empty one."""
    if not cell:
        return None
    if kind == "text":
        return cell[1:] if _marks(cell) else cell
    if kind == "flag":
        return cell == "true"
    return int(cell) if kind == "whole" else float(cell)

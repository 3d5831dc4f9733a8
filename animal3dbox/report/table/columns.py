"""The columns of the table of labels: derived from what labels, targets and labels.csv hold.

The numbers of a label are the fields of `target_schema.FILE_FIELDS`, how it came about those of
`Quality`, and the columns of labels.csv are here under their names. What is new here is what a row
is: its key, its image's place, and what became of the animal.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args, get_type_hints

from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.labels.types import Quality
from animal3dbox.report.label_files import AnimalRow
from animal3dbox.report.labels_csv import CSV_COLUMNS, DECIMALS, FIELD_COLUMNS, csv_values
from animal3dbox.target_schema import FILE_FIELDS, Field

Kind = Literal["text", "number", "whole", "flag"]
Value = str | float | int | bool | None
Table = dict[str, list[Any]]
"""Column -> its values, one a row, None where nothing is known: what Ray Data's map_batches and
pyarrow.table take as it is."""
Status = Literal["labelled", "rejected", "faulty", "filtered"]
"""What becomes of an animal: it has a label; none can be made; something is wrong with its
annotation or files; it has a label that the Dataset's filters refuse."""


@dataclass(frozen=True)
class Column:
    """One column, or several that hold the numbers of one field.

    Attributes:
        names: of the columns.
        kind: of their values: "text", "number" (float64), "whole" (int64) or "flag" (true, false).
        meaning: one phrase for the docs.
    """

    names: tuple[str, ...]
    kind: Kind
    meaning: str


ROW_COLUMNS = (
    Column(("key",), "text", "32 hex digits, another for each row; see below"),
    Column(("labels_digest",), "text", "names all that labels depend on but the animals"),
    Column(
        ("image_index",),
        "whole",
        "of the image in the Dataset; annotations that cannot be read are counted on after the"
        " last image",
    ),
    Column(("status",), "text", f"one of {', '.join(get_args(Status))}"),
    Column(("reason",), "text", "why not labelled: a reason, or the field that is at fault"),
    Column(("problem",), "text", "the same in words, with the remedy"),
)
"""What a row is."""
CSV_WHOLE = frozenset({"animal"})


def _csv_kind(name: str) -> Kind:
    return "whole" if name in CSV_WHOLE else "number" if name in DECIMALS else "text"


ROW_FIELDS = (
    Column(("image_height", "image_width"), "whole", "px"),
    Column(("upright",), "flag", "whether the picture was turned by its EXIF header"),
    Column(("scale_m_per_unit",), "number", "metres a unit of the body; lengths are metres then"),
)
"""What labels.json says of a row beside its numbers and labels.csv's columns."""


def _numbers_of(field: Field) -> Column:
    """The columns of a field: its name and the place of each number, a face's by its name."""
    axes = [
        FACE_NAMES if size == len(FACE_NAMES) else range(size) for size in field.entry_shape or ()
    ]
    places = itertools.product(*axes)
    name = field.label_name or field.name
    names = tuple("_".join((name, *map(str, place))) for place in places)
    return Column(names, "flag" if field.kind == "flag" else "number", field.meaning)


SCHEMA_FIELDS = tuple(field for field in FILE_FIELDS if field.label_name not in FIELD_COLUMNS)
"""The fields of a target that labels.csv has no columns for."""
_KINDS: dict[Any, Kind] = {float: "number", int: "whole", str: "text"}
_HINTS = get_type_hints(Quality)


def _quality_kind(name: str) -> Kind:
    """The kind of a quality: of what it is where it is known."""
    known = [kind for kind in get_args(_HINTS[name]) or (_HINTS[name],) if kind in _KINDS]
    return _KINDS[known[0]]


QUALITY_FIELDS = tuple(field.name for field in fields(Quality) if field.name not in CSV_COLUMNS)
"""How a label came about, but for what labels.csv has a column for."""
CSV_MEANING = "as in labels.csv, not rounded"
FROM_QUALITY = "as in quality of labels.json"
COLUMNS = (
    *ROW_COLUMNS,
    *(Column((name,), _csv_kind(name), CSV_MEANING) for name in CSV_COLUMNS),
    *ROW_FIELDS,
    *map(_numbers_of, SCHEMA_FIELDS),
    *(
        Column((name,), _quality_kind(name), "as in quality of labels.json")
        for name in QUALITY_FIELDS
    ),
)
"""All columns in their order."""
KINDS: dict[str, Kind] = {name: column.kind for column in COLUMNS for name in column.names}
"""The name of each column -> the kind of its values."""


def label_values(row: AnimalRow, flags: Sequence[str]) -> list[Value]:
    """The values of a labelled animal, in the order of the columns after ROW_COLUMNS."""
    cells = csv_values(row, flags)
    values: list[Value] = [_known(cells.get(name)) for name in CSV_COLUMNS]
    values += (*row.image_hw, row.upright, row.scale_m_per_unit)
    for field in SCHEMA_FIELDS:
        values += _flat(getattr(row, field.label_name or field.name), field.entry_shape or ())
    for name in QUALITY_FIELDS:
        value = row.quality[name]
        values.append(_known("; ".join(value) if isinstance(value, list) else value))
    return values


def _known(value: Value) -> Value:
    """A value; None for a text without a letter, which says nothing."""
    return None if value == "" else value


def _flat(value: Any, shape: tuple[int, ...]) -> Sequence[Value]:
    """The numbers of a field in one row; None for each of what is not known."""
    if value is None:
        return (None,) * math.prod(shape)
    if not shape:
        return (value,)
    if len(shape) == 1:
        return tuple(value)
    unknown = (None,) * math.prod(shape[1:])
    return [number for row in value for number in (unknown if row is None else row)]


def unlabelled_values(entry: dict[str, Value]) -> list[Value]:
    """The values of an animal without a label: of what its annotation says, else None."""
    return [entry.get(name) for name in _LABEL_NAMES]


_LABEL_NAMES = tuple(KINDS)[sum(len(column.names) for column in ROW_COLUMNS) :]


def columns_of(name: str) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """The columns of a field of SCHEMA_FIELDS by its name in a label, and the field's shape.

    Example:
        >>> columns_of("center")
        (('center_0', 'center_1', 'center_2'), (3,))
    """
    (field,) = (one for one in SCHEMA_FIELDS if one.label_name == name)
    return _numbers_of(field).names, field.entry_shape or ()


def columns_table() -> str:
    """The columns as a Markdown table: that of docs/formats.md."""
    rows = ["| columns | | are |", "| --- | --- | --- |"]
    meanings = {CSV_MEANING: "csv", FROM_QUALITY: "quality"}
    for source, group in itertools.groupby(
        COLUMNS, key=lambda column: meanings.get(column.meaning, column.names[0])
    ):
        columns = [*group]
        names = [f"`{name}`" for column in columns for name in column.names]
        is_listed = source in meanings.values() or len(names) < 3
        words = ", ".join(names) if is_listed else f"{names[0]} ... {names[-1]}"
        kinds = ", ".join(dict.fromkeys(column.kind for column in columns))
        rows.append(f"| {words} | {kinds} | {columns[0].meaning} |")
    return "\n".join(rows) + "\n"

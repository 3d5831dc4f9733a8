"""The numbers of one label in one row of float64, of a fixed layout.

A row is what the cache stores and what targets are cut out of: reading one costs no more than
looking at it. Its layout follows from `target_schema.LABEL_FIELDS`; whole numbers stand behind the
other numbers, and flags, which are 0 and 1, last.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from animal3dbox.target_schema import LABEL_FIELDS

Array = NDArray[np.float64]

MESH_BOX: dict[str, tuple[int, ...]] = {
    "mesh_center": (3,),
    "mesh_rotation": (3, 3),
    "mesh_size": (3,),
}
"""The cuboid in the mesh's own frame: part of a label, but of no target."""


def _layout() -> dict[str, tuple[int, ...]]:
    """Name in a label -> shape, in the row's order."""
    by_kind: dict[str, dict[str, tuple[int, ...]]] = {"float": {}, "whole": {}, "flag": {}}
    for field in LABEL_FIELDS:
        if field.label_name is None or field.entry_shape is None:
            raise ValueError(f"{field.name} is of no fixed shape: it cannot be part of a label")
        by_kind[field.kind][field.label_name] = field.entry_shape
    return {**by_kind["float"], **MESH_BOX, **by_kind["whole"], **by_kind["flag"]}


LAYOUT = _layout()
FLAGS = frozenset(field.label_name for field in LABEL_FIELDS if field.kind == "flag")
LENGTHS = tuple(
    field.label_name for field in LABEL_FIELDS if field.is_length and field.label_name is not None
)
"""The fields that grow with the unit of the body."""
NOT_MEASURED = -1.0
"""All numbers of surface_share where it was not measured."""


def _spans() -> dict[str, slice]:
    spans, start = {}, 0
    for name, shape in LAYOUT.items():
        width = int(np.prod(shape))
        spans[name] = slice(start, start + width)
        start += width
    return spans


SPANS = _spans()
"""Where each field stands in the row."""
WIDTH = max(span.stop for span in SPANS.values())
FIRST_WHOLE = min(
    SPANS[field.label_name].start
    for field in LABEL_FIELDS
    if field.kind == "whole" and field.label_name is not None
)
"""Where the whole numbers begin."""
FIRST_FLAG = min(SPANS[name].start for name in LAYOUT if name in FLAGS)
"""Where the numbers end and the flags begin."""


def rows_of(fields: Mapping[str, NDArray[np.generic]]) -> Array:
    """Rows (B, WIDTH) of B labels.

    Args:
        fields: every name of LAYOUT -> (B, ...) its values.

    """
    count = len(fields["center"])
    columns = [np.asarray(fields[name], dtype=np.float64).reshape(count, -1) for name in LAYOUT]
    return np.concatenate(columns, axis=1)


def row_field(row: Array, name: str) -> Array:
    """A field of LAYOUT in its shape: a view of the row.

    Example:
        >>> row = np.arange(float(WIDTH))
        >>> row_field(row, "corners_3d")[1].tolist()
        [3.0, 4.0, 5.0]
    """
    return row[SPANS[name]].reshape(LAYOUT[name])


def with_fields(row: Array, **values: object) -> Array:
    """A copy of a row with some fields replaced; raises KeyError of a name that no label has."""
    changed = row.copy()
    for name, value in values.items():
        changed[SPANS[name]] = np.asarray(value, dtype=np.float64).ravel()
    return changed

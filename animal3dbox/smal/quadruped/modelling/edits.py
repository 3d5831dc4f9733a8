"""Small edits of a table, of which the measures consist; none changes its argument."""

from collections.abc import Callable, Sequence

import numpy as np

from animal3dbox.smal.quadruped.modelling.anatomy import BODY_BLOBS, FOOT_BLOBS, Table
from animal3dbox.smal.quadruped.modelling.implicit import Array

Change = Callable[[Array], Array]

BODY_POINTS = (
    "fore",
    "hind",
    "fore_foot",
    "hind_foot",
    *BODY_BLOBS,
    *FOOT_BLOBS,
)  # rows start with x, y, z
MIDLINE_POINTS = ("neck", "tail", "mane")  # rows start with x, z
FORE_PARTS = (
    "fore",
    "fore_foot",
    "elbow_point",
    "arm_muscle",
    "shoulder_muscle",
    *(n for n in FOOT_BLOBS if n.startswith("fore")),
)
HIND_PARTS = (
    "hind",
    "hind_foot",
    "hock_point",
    "thigh_muscle",
    "buttock",
    *(n for n in FOOT_BLOBS if n.startswith("hind")),
)


def scaled(
    table: Table, key: str, columns: Sequence[int], factor: float, *, rows: slice = slice(None)
) -> Table:
    """Some columns of one entry times a factor; rows only matter for chains."""
    return with_entry(table, key, columns, lambda values: values * factor, rows=rows)


def shifted(
    table: Table,
    key: str,
    columns: Sequence[int],
    offset: float | Array,
    *,
    rows: slice = slice(None),
) -> Table:
    """Some columns of one entry plus an offset."""
    return with_entry(table, key, columns, lambda values: values + offset, rows=rows)


def with_entry(
    table: Table, key: str, columns: Sequence[int], change: Change, *, rows: slice = slice(None)
) -> Table:
    """A table with some columns of one entry changed by a function of their values."""
    entry = table[key].copy()
    view = entry if entry.ndim == 1 else entry[rows]
    view[..., list(columns)] = change(view[..., list(columns)])
    return {**table, key: entry}


def warped(table: Table, ankle: float, elbow: float, rise: float) -> Table:
    """Longer legs: all above the elbow rises, and what is below it in proportion."""

    def lifted(z: Array) -> Array:
        """Heights that rise by their share of the way from ankle to elbow."""
        return z + rise * np.clip((z - ankle) / (elbow - ankle), 0.0, 1.0)

    out = with_entry(table, "trunk", (1, 2), lambda z: z + rise)
    for key in BODY_POINTS:
        legs = key in FORE_PARTS + HIND_PARTS and key not in (
            "shoulder_muscle",
            "buttock",
            "thigh_muscle",
        )
        out = with_entry(out, key, (2,), lifted if legs else lambda z: z + rise)
    for key in MIDLINE_POINTS:
        out = shifted(out, key, (1,), rise)
    return shifted(out, "head_frame", (1,), rise)


def stretched(table: Table, amount: float) -> Table:
    """A longer trunk, in trunk lengths: all from the shoulders on goes ahead, the hips go back."""

    def along(x: Array) -> Array:
        """Places that move away from the trunk's middle."""
        return x + amount * np.clip(x / 0.35, -1.0, 1.0)

    out = with_entry(table, "trunk", (0,), along)
    for key in ("belly", "udder", "hump", "breast"):
        out = with_entry(out, key, (0,), along)
    for key in (*FORE_PARTS, "neck", "mane", "head_frame"):
        out = shifted(out, key, (0,), amount)
    for key in (*HIND_PARTS, "tail"):
        out = shifted(out, key, (0,), -amount)
    return out


def moved_head(table: Table, offset: Array) -> Table:
    """The head carried along by an offset (x, z)."""
    return shifted(table, "head_frame", (0, 1), offset)


def swung(points: Array, about: Array, angle_deg: float) -> Array:
    """Points (N, 2) of the x-z plane turned about a point, positive raising what is ahead."""
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    rotated: Array = (points - about) @ np.array([[c, s], [-s, c]]) + about
    return rotated

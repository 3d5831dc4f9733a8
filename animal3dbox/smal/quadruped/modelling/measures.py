"""The shape columns that change one named measure each: the edit of a table by one unit of beta."""

from collections.abc import Callable
from functools import partial

import numpy as np

from animal3dbox.smal.quadruped.modelling.anatomy import FOOT_BLOBS, Table
from animal3dbox.smal.quadruped.modelling.edits import (
    FORE_PARTS,
    HIND_PARTS,
    moved_head,
    scaled,
    shifted,
    stretched,
    swung,
    warped,
    with_entry,
)
from animal3dbox.smal.quadruped.modelling.implicit import Array

Edit = Callable[[Table], Table]


def leg_length(table: Table) -> Table:
    """Legs below the elbow and the knee 0.06 trunk lengths longer."""
    return warped(table, 0.06, float(table["fore"][3, 2]), 0.06)


def leg_thickness(table: Table) -> Table:
    """Legs 15 % thicker below elbow and knee."""
    out = scaled(
        scaled(table, "fore", (3, 4), 1.15, rows=slice(3, None)),
        "hind",
        (3, 4),
        1.15,
        rows=slice(3, None),
    )
    return scaled(
        scaled(out, "fore_foot", (3, 4), 1.15, rows=slice(0, 1)),
        "hind_foot",
        (3, 4),
        1.15,
        rows=slice(0, 1),
    )


def foot_size(table: Table) -> Table:
    """Paws or hooves 20 % wider and longer."""
    out = dict(table)
    for limb in ("fore", "hind"):
        center = table[f"{limb}_foot"][1, :2]
        for key in (f"{limb}_foot", *(name for name in FOOT_BLOBS if name.startswith(limb))):
            rows = slice(1, None)
            out = dict(with_entry(out, key, (0, 1), partial(_grown, about=center), rows=rows))
            out = dict(scaled(out, key, (3, 4), 1.2, rows=rows))
    return out


def trunk_length(table: Table) -> Table:
    """The trunk 0.10 longer between shoulders and hips."""
    return stretched(table, 0.05)


def trunk_width(table: Table) -> Table:
    """The trunk 12 % wider, the legs further apart with it."""
    out = scaled(scaled(table, "trunk", (3,), 1.12), "belly", (4,), 1.12)
    for key in FORE_PARTS + HIND_PARTS:
        out = shifted(out, key, (1,), 0.01)
    return out


def chest_depth(table: Table) -> Table:
    """The underline of the chest 0.04 lower."""
    drop = np.array([0.0, 0.0, 0.0, 0.01, 0.03, 0.04, 0.04, 0.02])[:, None]
    return shifted(shifted(table, "trunk", (2,), -drop), "breast", (2,), -0.02)


def belly(table: Table) -> Table:
    """The belly 0.05 lower and wider."""
    bulge = np.array([0.0, 0.01, 0.035, 0.05, 0.045, 0.02, 0.0, 0.0])[:, None]
    out = shifted(shifted(table, "trunk", (2,), -bulge), "trunk", (3,), 0.6 * bulge)
    return shifted(scaled(out, "belly", (4,), 1.15), "belly", (2,), -0.05)


def neck_length(table: Table) -> Table:
    """The neck 20 % longer."""
    base = table["neck"][0, :2]
    stretch = 0.2 * (table["neck"][:, :2] - base)
    out = shifted(table, "neck", (0, 1), stretch)
    out = with_entry(out, "mane", (0, 1), lambda xz: xz + 0.2 * (xz - base))
    return moved_head(out, stretch[-1])


def neck_thickness(table: Table) -> Table:
    """The neck 15 % thicker."""
    return scaled(table, "neck", (2, 3), 1.15, rows=slice(1, None))


def neck_raise(table: Table) -> Table:
    """The neck carried 10 degrees higher, the head level with it."""
    base = table["neck"][0, :2]
    out = with_entry(table, "neck", (0, 1), lambda xz: swung(xz, base, 10.0))
    out = with_entry(out, "mane", (0, 1), lambda xz: swung(xz, base, 10.0))
    return with_entry(out, "head_frame", (0, 1), lambda xz: swung(xz[None], base, 10.0)[0])


def head_size(table: Table) -> Table:
    """The head 12 % larger."""
    return scaled(table, "head_frame", (3,), 1.12)


def muzzle_length(table: Table) -> Table:
    """The face before the eyes 15 % longer."""

    def along(u: Array) -> Array:
        """Places that move ahead by their way from the eyes."""
        return u + 0.15 * np.maximum(u - float(table["eye"][0]), 0.0)

    out = table
    for key in ("head", "jaw", "nose_pad", "lip", "chin"):
        out = with_entry(out, key, (0,), along)
    return out


def ear_size(table: Table) -> Table:
    """The ears 20 % longer and wider."""
    base = table["ear"][0, :3]
    return scaled(
        with_entry(table, "ear", (0, 1, 2), lambda p: base + 1.2 * (p - base)), "ear", (3,), 1.2
    )


def tail_length(table: Table) -> Table:
    """The tail 20 % longer."""
    base = table["tail"][0, :2]
    return with_entry(table, "tail", (0, 1), lambda xz: base + 1.2 * (xz - base))


def tail_thickness(table: Table) -> Table:
    """The tail 25 % thicker."""
    return scaled(table, "tail", (2, 3), 1.25, rows=slice(1, None))


def _grown(points: Array, about: Array) -> Array:
    """Points 20 % further from a place."""
    outer: Array = about + 1.2 * (points - about)
    return outer


MEASURE_EDITS: dict[str, Edit] = {
    f.__name__: f
    for f in (
        *(leg_length, leg_thickness, foot_size, trunk_length, trunk_width, chest_depth, belly),
        *(neck_length, neck_thickness, neck_raise, head_size, muzzle_length, ear_size),
        *(tail_length, tail_thickness),
    )
}

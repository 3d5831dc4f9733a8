"""Further shape columns: smaller variations within a species."""

from functools import partial

import numpy as np

from animal3dbox.smal.quadruped.modelling.anatomy import Table
from animal3dbox.smal.quadruped.modelling.edits import (
    FORE_PARTS,
    HIND_PARTS,
    scaled,
    shifted,
    swung,
    with_entry,
)
from animal3dbox.smal.quadruped.modelling.measures import Edit

_EAR_TURN_DEG = 20.0


def _ear_droop(table: Table) -> Table:
    base = table["ear"][0, 1:3]
    return with_entry(table, "ear", (1, 2), lambda p: swung(p, base, -_EAR_TURN_DEG))


def _tail_raise(table: Table) -> Table:
    base = table["tail"][0, :2]
    return with_entry(table, "tail", (0, 1), lambda xz: swung(xz, base, -15.0))


def _bent_topline(table: Table, heights: tuple[float, ...]) -> Table:
    return shifted(table, "trunk", (1,), np.array(heights)[:, None])


def _stance(table: Table) -> Table:
    out = table
    for key in FORE_PARTS + HIND_PARTS:
        out = shifted(out, key, (1,), 0.015)
    return out


def _hock_bend(table: Table) -> Table:
    out = shifted(table, "hind", (0,), -0.025, rows=slice(4, 5))
    return shifted(out, "hock_point", (0,), -0.025)


def _blob(table: Table, key: str, factor: float) -> Table:
    return scaled(table, key, (3, 4, 5), factor)


def _head_pitch(table: Table) -> Table:
    return shifted(table, "head_frame", (2,), 10.0)


def _tail_curl(table: Table) -> Table:
    rise = np.linspace(0.0, 1.0, 8)[:, None] ** 2 * 0.12
    return shifted(table, "tail", (1,), rise)


VARIATION_EDITS: dict[str, Edit] = {
    "head_width": lambda t: scaled(scaled(t, "head", (3,), 1.12), "jaw", (3,), 1.12),
    "muzzle_depth": lambda t: scaled(
        scaled(t, "head", (2,), 1.15, rows=slice(3, None)), "jaw", (2,), 1.15, rows=slice(1, None)
    ),
    "muzzle_width": lambda t: scaled(
        scaled(t, "head", (3,), 1.15, rows=slice(3, None)), "jaw", (3,), 1.15, rows=slice(1, None)
    ),
    "head_pitch": _head_pitch,
    "ear_droop": _ear_droop,
    "horn_length": lambda t: with_entry(
        t, "horn", (0, 1, 2), lambda p: t["horn"][0, :3] + 1.3 * (p - t["horn"][0, :3])
    ),
    "tail_raise": _tail_raise,
    "tail_curl": _tail_curl,
    "tail_tuft": lambda t: scaled(t, "tail", (2, 3), 1.5, rows=slice(5, 7)),
    "withers": partial(_bent_topline, heights=(0.0, 0.0, 0.0, 0.0, 0.01, 0.03, 0.03, 0.01)),
    "shoulder_muscle": lambda t: _blob(_blob(t, "shoulder_muscle", 1.12), "arm_muscle", 1.15),
    "thigh_muscle": lambda t: _blob(_blob(t, "thigh_muscle", 1.12), "buttock", 1.1),
    "stance": _stance,
    "hock_bend": _hock_bend,
    "udder": lambda t: shifted(_blob(t, "udder", 1.1), "udder", (2,), -0.03),
}

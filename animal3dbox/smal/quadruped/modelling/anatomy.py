"""From a species' table of stations to the primitives of its skin and the joints of its skeleton.

A table holds, in trunk lengths, the stations of chains: places along a limb or the trunk with the
half sizes of its cross-section there. All species have the same chains with the same number of
stations, so tables can be averaged, and a place on one animal has its counterpart on every other.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from animal3dbox.smal.quadruped.modelling.implicit import Array, Primitive

Table = Mapping[str, Array]

BODY_BLOBS = (
    "shoulder_muscle",
    "arm_muscle",
    "elbow_point",
    "thigh_muscle",
    "buttock",
    "hock_point",
    "udder",
    "hump",
    "breast",
    "belly",
)
HEAD_BLOBS = ("cheek", "brow", "eye", "nose_pad", "lip", "chin")
FOOT_BLOBS = (
    "fore_toe_in",
    "fore_toe_mid_in",
    "fore_toe_mid_out",
    "fore_toe_out",
    "hind_toe_in",
    "hind_toe_mid_in",
    "hind_toe_mid_out",
    "hind_toe_out",
)
_UNPAIRED_BLOBS = ("hump", "breast", "belly", "nose_pad", "chin")
_GROUP = {
    "neck": "trunk",
    "jaw": "head",
    "fore_foot": "foot",
    "hind_foot": "foot",
    "mane": "detail",
}
_CHAIN_PAIRED = ("fore", "hind", "fore_foot", "hind_foot", "ear", "horn")
_REFINEMENTS = {"trunk": 2, "neck": 2, "fore_foot": 0, "hind_foot": 0, "horn": 0, "mane": 0}
_INNER_CAP = {
    "trunk": 0.5,
    "head": 0.4,
    "jaw": 0.4,
    "ear": 0.5,
}  # full round caps of neighbours would meet in creases, and blunt what tapers
_SPINE_HEIGHT = 0.70  # of the trunk's depth, above its underline


@dataclass(frozen=True)
class Chain:
    """Stations with an elliptic cross-section each.

    Attributes:
        places: (S, 3) in the template frame.
        radii: (S, 2) half sizes: across (sideways; for an ear its half width) and through.
        through: (3,) roughly the direction of the second radius; None: the first one is sideways,
            along y.
        cup: see Primitive.
    """

    places: Array
    radii: Array
    through: Array | None = None
    cup: float = 0.0


def head_to_body(table: Table, points: Array) -> Array:
    """Points (N, 3) of the head in the template frame.

    The head's frame has u to the nose, y left and w up, in head lengths.
    """
    x, z, pitch_deg, length = table["head_frame"]
    c, s = np.cos(np.deg2rad(pitch_deg)), np.sin(np.deg2rad(pitch_deg))
    u, y, w = (points * length).T
    return np.stack([x + c * u - s * w, y, z + s * u + c * w], axis=1)


def chains_of(table: Table) -> dict[str, Chain]:
    """The chains of an animal in the template frame (left side only for the paired ones)."""
    ahead = np.array([1.0, 0.0, 0.0])
    x, top, bottom, half_width = table["trunk"].T
    chains = {
        "trunk": Chain(
            _on_midline(x, (top + bottom) / 2), np.stack([half_width, (top - bottom) / 2], axis=1)
        )
    }
    for name in ("neck", "tail", "mane"):
        x, z, through, across = table[name].T
        chains[name] = Chain(_on_midline(x, z), np.stack([across, through], axis=1))
    length = float(table["head_frame"][3])
    for name in ("head", "jaw"):
        u, w, through, across = table[name].T
        chains[name] = Chain(
            head_to_body(table, _on_midline(u, w)), length * np.stack([across, through], axis=1)
        )
    for name in ("fore", "hind", "fore_foot", "hind_foot"):
        rows = table[name]
        chains[name] = Chain(rows[:, :3], rows[:, [4, 3]])
    facing = (
        head_to_body(table, table["ear_facing"][None, :3])[0]
        - head_to_body(table, np.zeros((1, 3)))[0]
    )
    chains["ear"] = Chain(
        head_to_body(table, table["ear"][:, :3]),
        length * table["ear"][:, 3:5],
        facing,
        float(table["ear_facing"][3]),
    )
    chains["horn"] = Chain(
        head_to_body(table, table["horn"][:, :3]), length * table["horn"][:, [3, 3]], ahead
    )
    return chains


def primitives_of(table: Table) -> list[Primitive]:
    """The primitives of the skin; the same names in the same order for every table."""
    primitives = []
    for name, chain in chains_of(table).items():
        places, radii = chain.places, chain.radii
        for _ in range(_REFINEMENTS.get(name, 1)):
            places, radii = _refined(places), _refined(radii)
        inner = _INNER_CAP.get(name, 1.0)
        for i in range(len(places) - 1):
            ends, pair = places[i : i + 2], radii[i : i + 2]
            caps = pair.min(axis=1, keepdims=True) * np.array(
                [[1.0 if i == 0 else inner], [1.0 if i == len(places) - 2 else inner]]
            )
            frame = _frame(ends[1] - ends[0], chain.through)
            primitives.append(
                Primitive(
                    f"{name}.{i}",
                    _GROUP.get(name, name),
                    ends,
                    frame,
                    np.hstack([pair, caps]),
                    chain.cup,
                    name in _CHAIN_PAIRED,
                )
            )
    return primitives + _blobs(table)


def _blobs(table: Table) -> list[Primitive]:
    primitives = []
    for name in BODY_BLOBS + FOOT_BLOBS + HEAD_BLOBS:
        x, y, z, rx, ry, rz, pitch_deg = table[name]
        center, radii = np.array([[x, y, z]]), np.array([ry, rz, rx])
        if name in HEAD_BLOBS:
            center, radii = head_to_body(table, center), radii * table["head_frame"][3]
            pitch_deg = pitch_deg + table["head_frame"][2]
        c, s = np.cos(np.deg2rad(pitch_deg)), np.sin(np.deg2rad(pitch_deg))
        frame = np.array([[0.0, 1.0, 0.0], [-s, 0.0, c], [c, 0.0, s]])
        group = "detail" if name in HEAD_BLOBS else "foot" if name in FOOT_BLOBS else "muscle"
        ends = np.repeat(center, 2, axis=0)
        primitives.append(
            Primitive(
                name, group, ends, frame, np.stack([radii, radii]), 0.0, name not in _UNPAIRED_BLOBS
            )
        )
    return primitives


def joints_of(table: Table) -> dict[str, Array]:
    """Joint name -> (3,) place in the template frame, left and middle ones only."""
    chains = chains_of(table)
    fore, hind, tail, neck = (chains[name].places for name in ("fore", "hind", "tail", "neck"))
    x, top, bottom, _ = table["trunk"].T
    height = bottom + _SPINE_HEIGHT * (top - bottom)
    stops = np.linspace(hind[0, 0], neck[0, 0] - 0.02, 7)
    names = ("pelvis", "pelvis0", "spine", "spine0", "spine1", "spine2", "spine3")
    joints = {
        name: np.array([stop, 0.0, np.interp(stop, x, height)])
        for name, stop in zip(names, stops, strict=True)
    }
    joints |= {f"LLeg{i + 1}": fore[k] for i, k in enumerate((1, 3, 5))} | {"LFoot": fore[7]}
    joints |= {f"LLegBack{i + 1}": hind[k] for i, k in enumerate((0, 2, 4))} | {
        "LFootBack": hind[6]
    }
    joints |= {f"Tail{i + 1}": tail[i] for i in range(7)}
    joints |= {
        "Neck": neck[1],
        "Head": chains["head"].places[0],
        "Mouth": chains["jaw"].places[0],
        "LEar": chains["ear"].places[0],
    }
    return joints


def mean_table(tables: list[Table], shares: list[float]) -> Table:
    """The weighted mean of tables, entry by entry."""
    return {
        key: sum(
            (s * t[key] for s, t in zip(shares, tables, strict=True)), np.zeros_like(tables[0][key])
        )
        for key in tables[0]
    }


def _on_midline(x: Array, z: Array) -> Array:
    return np.stack([x, np.zeros_like(x), z], axis=1)


def _refined(values: Array) -> Array:
    """A station between each two by the Catmull-Rom spline: (S, C) -> (2S - 1, C)."""
    padded = np.vstack([2 * values[0] - values[1], values, 2 * values[-1] - values[-2]])
    middle = (9 * (padded[1:-2] + padded[2:-1]) - padded[:-3] - padded[3:]) / 16
    out = np.empty((2 * len(values) - 1, values.shape[1]))
    out[0::2], out[1::2] = values, np.maximum(middle, np.minimum(values[:-1], values[1:]) - 0.02)
    return out


def _frame(axis: Array, through: Array | None) -> Array:
    """The rows across, through and along of a chain's frame.

    Across is perpendicular to axis and through, or as near to y as it can be.
    """
    along = axis / np.linalg.norm(axis)
    sideways = np.array([0.0, 1.0, 0.0])
    across = sideways - (sideways @ along) * along if through is None else np.cross(through, along)
    across = across / np.linalg.norm(across)
    return np.stack([across, np.cross(along, across), along])

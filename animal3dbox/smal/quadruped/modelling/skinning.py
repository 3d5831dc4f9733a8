"""Skinning weights and the joint regressor, from the primitives that shape the skin."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from animal3dbox.smal.quadruped.modelling.anatomy import Table, chains_of, joints_of
from animal3dbox.smal.quadruped.modelling.implicit import Array, Primitive
from animal3dbox.smal.quadruped.modelling.meshing import Faces, HalfMesh, neighbour_average
from animal3dbox.smal.quadruped.modelling.transfer import shares

SPINE = ("pelvis", "pelvis0", "spine", "spine0", "spine1", "spine2", "spine3")
JOINT_NAMES = (
    *SPINE, "LLeg1", "LLeg2", "LLeg3", "LFoot", "RLeg1", "RLeg2", "RLeg3", "RFoot", "Neck", "Head",
    "LLegBack1", "LLegBack2", "LLegBack3", "LFootBack", "RLegBack1", "RLegBack2", "RLegBack3",
    "RFootBack",
    *(f"Tail{i}" for i in range(1, 8)), "Mouth", "LEar", "REar",
)  # fmt: skip
PARENTS = (
    -1,
    0,
    1,
    2,
    3,
    4,
    5,
    6,
    7,
    8,
    9,
    6,
    11,
    12,
    13,
    6,
    15,
    0,
    17,
    18,
    19,
    0,
    21,
    22,
    23,
    0,
    25,
    26,
    27,
    28,
    29,
    30,
    16,
    16,
    16,
)
MAX_INFLUENCES = 4
_HEAD_BLOBS = ("cheek", "brow", "eye", "nose_pad", "lip")
_FORE_STATIONS = (("trunk", 1.2), ("LLeg1", 3.0), ("LLeg2", 5.0), ("LLeg3", 7.0), ("LFoot", np.inf))
_HIND_STATIONS = (
    ("trunk", 0.15),
    ("LLegBack1", 2.0),
    ("LLegBack2", 4.0),
    ("LLegBack3", 6.0),
    ("LFootBack", np.inf),
)
_SMOOTHING_ROUNDS = {"trunk": 20, "limb": 5, "fine": 4}
_REGRESSOR_CANDIDATES = 60
_REGRESSOR_PER_DIRECTION = 4
_REGRESSOR_KEPT = 1e-3


def mirrored_joint(name: str) -> str:
    """LLeg1 -> RLeg1 and back; joints of the midline stay."""
    swap = {"L": "R", "R": "L"}
    return swap[name[0]] + name[1:] if name[0] in swap else name


def skin_weights(table: Table, primitives: Sequence[Primitive], half: HalfMesh) -> Array:
    """Weights (H, J) of the left half's vertices: hard regions, then smoothed over the surface."""
    say = shares(primitives, half.vertices)
    count = len(primitives)
    hard = np.zeros((len(half.vertices), len(JOINT_NAMES)))
    owner = (say[:count] + say[count:]).argmax(axis=0)
    rounds = np.full(len(half.vertices), _SMOOTHING_ROUNDS["trunk"])
    for v, place in enumerate(half.vertices):
        name = _region(table, primitives[owner[v]].name, place)
        hard[v, JOINT_NAMES.index(name)] = 1.0
        rounds[v] = _SMOOTHING_ROUNDS[
            "trunk"
            if name in (*SPINE, "Neck", "LLegBack1", "LLeg1")
            else "limb"
            if "Leg" in name
            else "fine"
        ]
    average = neighbour_average(half)
    weights = hard
    for i in range(max(_SMOOTHING_ROUNDS.values())):
        weights = np.where((i < rounds)[:, None], 0.5 * weights + 0.5 * average(weights), weights)
    seam = weights[: half.seam]
    mirror = [JOINT_NAMES.index(mirrored_joint(name)) for name in JOINT_NAMES]
    weights[: half.seam] = (seam + seam[:, mirror]) / 2
    return _sparsified(weights)


def _sparsified(weights: Array) -> Array:
    """The largest few weights of each row, in steps of 1/65535, summing to 1."""
    largest = np.where(weights >= np.sort(weights, axis=1)[:, [-MAX_INFLUENCES]], weights, 0.0)
    largest = np.where(largest < 0.01, 0.0, largest)
    return np.asarray(largest / largest.sum(axis=1, keepdims=True), dtype=np.float64)


def _region(table: Table, primitive: str, place: Array) -> str:
    """The joint that carries a place whose skin is shaped by a primitive."""
    chain, _, number = primitive.partition(".")
    station = int(number) / 2 if number else 0.0
    if chain in ("fore", "fore_foot", "elbow_point", "arm_muscle") or chain.startswith("fore_toe"):
        return _limb_region(table, "fore", chain, place)
    if chain in ("hind", "hind_foot", "hock_point", "thigh_muscle") or chain.startswith("hind_toe"):
        return _limb_region(table, "hind", chain, place)
    if chain == "tail":
        return f"Tail{min(int(station) + 1, 7)}"
    if chain in ("jaw", "chin"):
        return "Mouth" if chain == "chin" or station >= 0.5 else "Head"
    if chain in ("neck", "mane"):
        return _neck_region(table, place)
    if chain == "ear":
        return "LEar"
    return "Head" if chain in ("head", "horn", *_HEAD_BLOBS) else _spine_region(table, place)


def _limb_region(table: Table, limb: str, chain: str, place: Array) -> str:
    stations = table[limb][:, :3]
    along = (
        float(len(stations))
        if chain.endswith("foot") or "_toe" in chain
        else _station_at(stations, place)
    )
    for name, end in _FORE_STATIONS if limb == "fore" else _HIND_STATIONS:
        if along < end:
            return _spine_region(table, place) if name == "trunk" else name
    raise AssertionError("the last end is infinite")


def _station_at(stations: Array, place: Array) -> float:
    """The fractional number of the place on a polyline (S, 3) that is nearest to a point."""
    start, axis = stations[:-1], np.diff(stations, axis=0)
    along = np.clip(((place - start) * axis).sum(axis=1) / (axis**2).sum(axis=1), 0.0, 1.0)
    gap = np.linalg.norm(start + along[:, None] * axis - place, axis=1)
    nearest = int(gap.argmin())
    return nearest + float(along[nearest])


def _neck_region(table: Table, place: Array) -> str:
    places = chains_of(table)["neck"].places
    along = _station_at(places, place)
    return (
        _spine_region(table, place)
        if along < 0.8
        else "Neck"
        if along < len(places) - 1.15
        else "Head"
    )


def _spine_region(table: Table, place: Array) -> str:
    joints = joints_of(table)
    ahead = [name for name in SPINE if joints[name][0] <= place[0]]
    return ahead[-1] if ahead else "pelvis"


def joint_regressor(
    left_joints: Sequence[Mapping[str, Array]], vertices: Array, symmetry: Faces, half_count: int
) -> Array:
    """A sparse regressor (J, V) that gives the joints of all shapes as well as can be.

    Its entries are not negative, and its rows sum to 1.

    Args:
        left_joints: for each of N shapes the joints of the left and the middle.
        vertices: (N, V, 3) the shapes, the template first.
        symmetry: (V,) the mirror's permutation.
        half_count: the first so many vertices are the left half.
    """
    regressor = np.zeros((len(JOINT_NAMES), vertices.shape[1]))
    for name, rest in left_joints[0].items():
        row = JOINT_NAMES.index(name)
        near = _candidates(vertices[0, :half_count] - rest)
        middle = mirrored_joint(name) == name
        places = (
            (vertices[:, near] + vertices[:, symmetry[near]]) / 2 if middle else vertices[:, near]
        )
        targets = np.stack([joints[name] for joints in left_joints])
        share = _convex_fit(places, targets, np.linalg.norm(vertices[0, near] - rest, axis=1))
        regressor[row, near] += share / 2 if middle else share
        other = JOINT_NAMES.index(mirrored_joint(name))
        np.add.at(regressor[other], symmetry[near], share / 2 if middle else share)
    return regressor


def _candidates(offsets: Array) -> NDArray[np.int64]:
    """The indices of vertices that surround a joint: the nearest ones, and some in each direction.

    Args:
        offsets: (H, 3) of the vertices from the joint.

    """
    distances = np.linalg.norm(offsets, axis=1)
    order = np.argsort(distances, kind="stable")
    near = set(order[:_REGRESSOR_CANDIDATES].tolist())
    for direction in np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3):
        ahead = offsets[order] @ direction > 0.8 * distances[order] * np.linalg.norm(direction)
        near |= set(order[ahead][:_REGRESSOR_PER_DIRECTION].tolist()) if direction.any() else set()
    return np.array(sorted(near), dtype=np.int64)


def _convex_fit(places: Array, targets: Array, distances: Array) -> Array:
    """The shares (C,) of places (N, C, 3) whose weighted sums are nearest to targets (N, 3).

    Not negative and summing to 1; the farther a place (C,) is, the less it gets.
    """
    rows = np.moveaxis(places - targets[:, None], 1, 2).reshape(-1, places.shape[1])
    rows[:3] *= 10.0  # the template counts most
    system = np.vstack(
        [rows, 1e-2 * np.diag(distances / distances.mean()), 1e3 * np.ones((1, rows.shape[1]))]
    )
    share, _ = nnls(system, np.concatenate([np.zeros(len(system) - 1), [1e3]]))
    share = np.where(share < _REGRESSOR_KEPT * share.max(), 0.0, share)
    return np.asarray(share / share.sum(), dtype=np.float64)

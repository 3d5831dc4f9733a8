"""Vertex groups of the named landmarks, next to anatomical points of the table."""

from dataclasses import dataclass

import numpy as np

from animal3dbox.smal.keypoints.vocabularies import ANIMAL3D_LANDMARKS
from animal3dbox.smal.quadruped.modelling.anatomy import Table, chains_of, head_to_body
from animal3dbox.smal.quadruped.modelling.implicit import Array
from animal3dbox.smal.quadruped.modelling.meshing import Faces, HalfMesh

EXTRA_NAMES = (
    "withers",
    "throat",
    "left_hip",
    "right_hip",
    "left_ear_base",
    "right_ear_base",
    "left_ear_tip",
    "right_ear_tip",
    "left_shoulder_point",
    "right_shoulder_point",
)
BLADE_TOP = np.array([[0.05, 0.01, 0.068]])
"""From the foreleg's first station, within the shoulder blade, to the skin over its upper edge.

In trunk lengths: forward, out and up. SMAL's group for Animal3D's "shoulder" lies there, as high as
the tail's base (tests/smal/quadruped/test_shoulders.py).
"""


@dataclass(frozen=True)
class Spot:
    """The place of a landmark on the skin.

    Attributes:
        places: (P, 3) points on or near the skin, left side or middle.
        count: how many nearest vertices to take at each.
        seam: take them from the mirror plane only.
    """

    places: Array
    count: int
    seam: bool = False


def landmark_groups(table: Table, half: HalfMesh, symmetry: Faces) -> dict[str, tuple[int, ...]]:
    """Vertex ids of all landmarks, the 26 keypoints first, then the extra ones."""
    groups: dict[str, tuple[int, ...]] = {}
    spots = _spots(table)
    for name in ANIMAL3D_LANDMARKS + EXTRA_NAMES:
        side, _, rest = name.partition("_")
        if side == "right":
            groups[name] = tuple(int(symmetry[i]) for i in groups[f"left_{rest}"])
            continue
        spot = spots[rest if side == "left" else name]
        pool = half.vertices[: half.seam] if spot.seam else half.vertices
        free_pool = (
            pool
            if side != "left"
            else np.where(np.arange(len(pool))[:, None] < half.seam, np.inf, pool)
        )
        ids = {
            int(i)
            for place in spot.places
            for i in np.argsort(np.linalg.norm(free_pool - place, axis=1), kind="stable")[
                : spot.count
            ]
        }
        if side != "left":
            ids |= {int(symmetry[i]) for i in ids}
        groups[name] = tuple(sorted(ids))
    return groups


def _spots(table: Table) -> dict[str, Spot]:
    """The landmarks of the middle and the left, by their names without a side."""
    chains = chains_of(table)
    return _body_spots(table) | {
        "ear": Spot(chains["ear"].places[2:3], 5),
        "ear_base": Spot(chains["ear"].places[0:1], 4),
        "ear_tip": Spot(chains["ear"].places[3:4], 2),
        "tail_tip": Spot(chains["tail"].places[7:], 5),
        "tail_middle": Spot(chains["tail"].places[4:5], 5),
    } | _head_spots(table)  # fmt: skip


def _head_spots(table: Table) -> dict[str, Spot]:
    """The landmarks of the head."""

    def at(u: float, y: float, w: float) -> Array:
        """A place (1, 3) of the head's frame in the template's."""
        return head_to_body(table, np.array([[u, y, w]]))

    eye, nose, chin = table["eye"], table["nose_pad"], table["chin"]
    half_jaw = table["jaw"][1, 3]
    length = float(table["head_frame"][3])
    return {
        "eye": Spot(at(eye[0] + 0.3 * eye[3], eye[1] + eye[4], eye[2]), 4),
        "nose": Spot(at(nose[0] + nose[3], 0.0, nose[2]), 4),
        "chin": Spot(at(chin[0], 0.0, chin[2] - chin[5]), 2, seam=True),
        "mouth": Spot(
            at(table["jaw"][1, 0], half_jaw + 0.03, (table["jaw"][1, 1] + table["head"][3, 1]) / 2),
            4,
        ),
        "throat": Spot(
            at(float(table["jaw"][0, 0]) - 0.05, 0.0, -0.42 * min(1.0, length / 0.4)), 2, seam=True
        ),
    }


def _body_spots(table: Table) -> dict[str, Spot]:
    """The landmarks of trunk, neck and legs."""
    chains = chains_of(table)
    fore, hind, neck = table["fore"], table["hind"], chains["neck"]
    out, ahead = np.array([[0.0, 1.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    axis = neck.places[2] - neck.places[1]
    crest = np.array([[-axis[2], 0.0, axis[0]]]) / np.linalg.norm(axis) * neck.radii[2, 1]
    middle, side = neck.places[2:3], out * neck.radii[2, 0]
    hump = table["hump"]
    return {
        "front_paw": Spot(table["fore_foot"][2:, :3] + ahead * 0.03, 6),
        "back_paw": Spot(table["hind_foot"][2:, :3] + ahead * 0.03, 6),
        "tail_base": Spot(
            table["tail"][:1, [0, 0, 1]] * [1, 0, 1] + [[-0.02, 0.0, 0.03]], 2, seam=True
        ),
        "front_elbow": Spot(table["elbow_point"][None, :3] + 0.02 * out, 4),
        "back_knee": Spot(hind[2:3, :3] + ahead * hind[2, 3], 3),
        "shoulder_blade": Spot(fore[0:1, :3] + BLADE_TOP, 4),
        "shoulder_point": Spot(fore[1:2, :3] + out * fore[1, 4] + ahead * 0.02, 4),
        "front_wrist": Spot(fore[5:6, :3], 6),
        "back_hock": Spot(table["hock_point"][None, :3], 4),
        "neck": Spot(np.concatenate([middle + crest, middle - crest, middle + side]), 1),
        "withers": Spot(np.array([[hump[0], 0.0, hump[2] + hump[5]]]), 2, seam=True),
        "hip": Spot(hind[0:1, :3] + out * 0.1, 4),
    }

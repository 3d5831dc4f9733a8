"""Whether a mesh that comes without its model has SMAL's topology: its vertices in SMAL's order.

The count alone tells nothing: any mesh may have 3889 vertices, and one that was written anew has
SMAL's in another order. So the places of SMAL's landmark ids are looked at too, which no pose, no
species, no frame and no unit makes implausible, but another order does:

- The vertices of one landmark lie together.
- Places are nearer to their neighbours on the body than to its other end.
- The animal is no mirror image: seen with its head ahead and its paws below, left is on the left.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from animal3dbox.smal.keypoints.smal_topology import (
    SMAL_EXTRA_LANDMARKS,
    SMAL_FACES,
    SMAL_LANDMARKS,
    SMAL_VERTICES,
)

Array = NDArray[np.float64]

SMAL_GROUPS: Mapping[str, tuple[int, ...]] = {**SMAL_LANDMARKS, **SMAL_EXTRA_LANDMARKS}
"""Every landmark of SMAL's public topology -> its vertex ids."""
GROUP_RADIUS = 0.2
"""A landmark's vertices lie within this of their mean, as a part of the body's diagonal, which
leaves 2 % of the vertices out on each side."""
LEAST_TOGETHER = 0.9
"""Least part of the landmarks' vertices that must do so."""
LEAST_NEAR = 0.75
"""Least part of NEARER that must hold."""
LEAST_KNOWN = 20
"""With fewer landmarks on the mesh's faces than this there is too little to look at."""

_HEAD = ("left_eye", "right_eye", "chin", "left_ear", "right_ear", "left_mouth", "right_mouth")
_FORE = ("left_front_elbow", "right_front_elbow", "left_front_wrist", "right_front_wrist")
_SHOULDER = {
    side: next(name for name in SMAL_LANDMARKS if name.startswith(f"{side}_shoulder"))
    for side in ("left", "right")
}
NEARER: tuple[tuple[str, str, str], ...] = (
    *((name, "nose", "tail_base") for name in (*_HEAD, "neck")),
    *((name, "neck", "tail_base") for name in (*_FORE, *_SHOULDER.values(), "nose")),
    *((name, "tail_base", "nose") for name in ("tail_middle", "tail_tip")),
    *(
        (f"{side}_{part}", near, far)
        for side in ("left", "right")
        for part, near, far in (
            ("front_wrist", f"{side}_front_elbow", "tail_base"),
            ("front_paw", f"{side}_front_wrist", _SHOULDER[side]),
            ("back_knee", "tail_base", "nose"),
            ("back_hock", f"{side}_back_knee", "nose"),
            ("back_paw", f"{side}_back_hock", "tail_base"),
        )
    ),
)
"""A landmark, one that it is nearer to, and one that it is farther from."""
_PAIRS = tuple(
    (name, name.replace("left_", "right_")) for name in SMAL_LANDMARKS if name.startswith("left_")
)
TRUNK_PAIRS = tuple(
    pair for pair in _PAIRS if any(part in pair[0] for part in ("shoulder", "elbow", "knee"))
)
"""Left and right landmarks that no pose takes to the other side."""
PAWS = ("left_front_paw", "right_front_paw", "left_back_paw", "right_back_paw")


def why_not_smal(
    vertices: Array, n_faces: int | None, used: NDArray[np.bool_] | None = None
) -> str | None:
    """Why a mesh is not taken for one of SMAL's topology, in a few words; None if it is.

    Args:
        vertices: (V, 3) in any frame and unit, posed or not.
        n_faces: how many triangles it has; None if they are not known.
        used: (V,) which vertices some face uses; None: all.

    Example:
        >>> why_not_smal(np.zeros((4, 3)), n_faces=4)
        "it has 4 vertices, not SMAL's 3889"
        >>> why_not_smal(np.random.default_rng(0).normal(size=(3889, 3)), n_faces=7774)
        "the vertices of SMAL's landmarks do not lie together"
    """
    if len(vertices) != SMAL_VERTICES:
        return f"it has {len(vertices)} vertices, not SMAL's {SMAL_VERTICES}"
    if n_faces is not None and not 0 < n_faces <= SMAL_FACES:
        return f"it has {n_faces} faces, and SMAL has {SMAL_FACES}"
    places, together = _places(vertices, used)
    if len(places) < LEAST_KNOWN:
        return "its faces use too few of the vertices of SMAL's landmarks"
    if together < LEAST_TOGETHER:
        return "the vertices of SMAL's landmarks do not lie together"
    if _part_near(places) < LEAST_NEAR:
        return "SMAL's landmarks are not where an animal has them"
    if _is_mirrored(places):
        return "SMAL's left landmarks lie on the right: it is mirrored, or in another order"
    return None


def _places(vertices: Array, used: NDArray[np.bool_] | None) -> tuple[dict[str, Array], float]:
    """The landmarks (3,) that are on the mesh, and which part of their vertices lie together."""
    counts = np.ones(len(vertices), dtype=np.bool_) if used is None else used
    extent = np.quantile(vertices[counts], (0.02, 0.98), axis=0)
    diagonal = np.linalg.norm(extent[1] - extent[0])
    places, distances = {}, []
    for name, ids in SMAL_GROUPS.items():
        group = vertices[[i for i in ids if counts[i]]]
        if len(group):
            places[name] = group.mean(0)
            if len(group) > 1:
                distances.append(np.linalg.norm(group - places[name], axis=1))
    if not distances:
        return {}, 0.0
    return places, float((np.concatenate(distances) < GROUP_RADIUS * diagonal).mean())


def _part_near(places: Mapping[str, Array]) -> float:
    """Which part of the relations of NEARER hold, of those whose landmarks are there."""
    holds = [
        np.linalg.norm(places[name] - places[near]) < np.linalg.norm(places[name] - places[far])
        for name, near, far in NEARER
        if name in places and near in places and far in places
    ]
    return float(np.mean(holds)) if holds else 0.0


def _is_mirrored(places: Mapping[str, Array]) -> bool:
    """Whether the trunk's left lies on its right, with the head ahead and the paws below."""
    pairs = [pair for pair in TRUNK_PAIRS if pair[0] in places and pair[1] in places]
    paws = [places[name] for name in PAWS if name in places]
    if not pairs or not paws or "tail_base" not in places or "neck" not in places:
        return True
    forward = places["neck"] - places["tail_base"]
    middle = (places["neck"] + places["tail_base"]) / 2
    leftward = [places[left] - places[right] for left, right in pairs]
    down = np.mean(paws, axis=0) - middle
    # left = up x forward = forward x down
    left = np.cross(forward, down)
    return bool(min(float(step @ left) for step in leftward) <= 0)

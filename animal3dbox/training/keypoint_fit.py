"""Where each named keypoint sits in its animal's cuboid, learned from many targets.

A place m is a part of the box's sides from its centre: X = c + R diag(size) m in the camera frame.
Each marked keypoint (u, v) gives two equations that are linear in m (f_x X_0 + s X_1 +
(c_x - u) X_2 = 0 and likewise for v); over many animals they are solved by least squares. Animals
move, so a place is known to a tenth of the box: enough to see names that were exchanged, a box that
was turned head for tail, or points of another picture. A lens is not taken into account.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from animal3dbox.training.packed import Floats, Packed

FEWEST_MARKED = 4
"""Marked keypoints below which nothing is said of an animal."""
FEWEST_PAIRED = 4
"""Marked keypoints with a counterpart on the other side, likewise."""
RIDGE = 1e-3
"""Weight of the box's centre, for keypoints that are hardly ever marked."""
GREATEST_OFF = 0.25
"""A keypoint's distance from its place counts up to this part of the outline's diagonal."""


def learned_places(batches: Sequence[Packed]) -> Floats | None:
    """The place (J, 3) of each keypoint; None without cuboids, or if targets differ in J."""
    usable = [packed for packed in batches if _has_parts(packed)]
    joints = {packed.keypoints.shape[1] for packed in usable if packed.keypoints is not None}
    if len(joints) != 1:
        return None
    count = joints.pop()
    left = np.tile(RIDGE * np.eye(3), (count, 1, 1))
    right = np.zeros((count, 3))
    for packed in usable:
        rows, values, weight = _equations(packed)
        left += np.einsum("njak,njal,nj->jkl", rows, rows, weight)
        right += np.einsum("njak,nja,nj->jk", rows, values, weight)
    return np.asarray(np.linalg.solve(left, right[..., None])[..., 0])


def place_measures(packed: Packed, places: Floats) -> dict[str, Floats]:
    """How far keypoints lie from their places, and whether they fit better with sides exchanged.

    Args:
        packed: targets whose keypoints are those of the places; others give nothing.
        places: (J, 3) of learned_places.

    Returns:
        The median distance as a part of the outline's diagonal, and the difference of the squared
        distances with names as they are and exchanged, over their sum (-1 to 1), (N,) each; NaN
        where too few keypoints are marked.
    """
    keypoints = packed.keypoints
    if keypoints is None or not _has_parts(packed) or keypoints.shape[1] != len(places):
        return {}
    marked = (keypoints[..., 2] > 0) & _in_front(packed)[:, None]
    off = _distances(packed, keypoints, places)
    median = np.full(packed.count, np.nan)
    enough = marked.sum(1) >= FEWEST_MARKED
    if enough.any():
        median[enough] = np.nanmedian(np.where(marked, off, np.nan)[enough], axis=1)
    measures = {"keypoints off their places": median}
    mirror = packed.targets[0].get("keypoint_mirror")
    if mirror is None:
        return measures
    counterpart = np.asarray(mirror)
    paired = marked & (counterpart != np.arange(len(counterpart)))
    exchanged = _distances(packed, keypoints, places[counterpart])
    given, other = (
        (np.where(paired, np.minimum(distance, GREATEST_OFF), 0) ** 2).sum(1)
        for distance in (off, exchanged)
    )
    share = (given - other) / np.maximum(given + other, 1e-12)
    measures["keypoints better exchanged"] = np.where(paired.sum(1) >= FEWEST_PAIRED, share, np.nan)
    return measures


def _has_parts(packed: Packed) -> bool:
    """Whether targets say where boxes, cameras and keypoints are."""
    return (
        packed.keypoints is not None
        and packed.has_box
        and packed.K is not None
        and packed.outline is not None
    )


def _in_front(packed: Packed) -> NDArray[np.bool_]:
    return np.asarray(packed.all_in_front, dtype=np.bool_)


def _outline_diagonal(packed: Packed) -> Floats:
    """The diagonal (N,) of the projected cuboid, px."""
    low, high = packed.outline or (np.zeros((packed.count, 2)),) * 2
    return np.asarray(np.maximum(np.linalg.norm(high - low, axis=1), 1e-9))


def _axes(packed: Packed) -> Floats:
    """R diag(size), (N, 3, 3): columns along the box's axes with its sides as lengths."""
    return packed.floats["rotation"] * packed.floats["size"][:, None]


def _equations(packed: Packed) -> tuple[Floats, Floats, Floats]:
    """Rows (N, J, 2, 3), right sides (N, J, 2) and weights (N, J) of the equations of places."""
    keypoints, K = np.asarray(packed.keypoints), np.asarray(packed.K)
    center, axes = packed.floats["center"], _axes(packed)
    # K's rows, with the pixel taken off: ((f_x, s, c_x - u), (0, f_y, c_y - v)).
    camera = np.tile(K[:, None, :2], (1, keypoints.shape[1], 1, 1))
    camera[..., 2] -= keypoints[..., :2]
    weight = (keypoints[..., 2] > 0) & _in_front(packed)[:, None]
    scale = np.abs(center[:, 2]) * _outline_diagonal(packed)
    rows = np.einsum("njad,ndk->njak", camera, axes)
    values = -np.einsum("njad,nd->nja", camera, center)
    return rows, values, weight / np.maximum(scale, 1e-9)[:, None] ** 2


def _distances(packed: Packed, keypoints: Floats, places: Floats) -> Floats:
    """Distances (N, J) of keypoints from their places, as a part of the outline's diagonal."""
    K, axes = np.asarray(packed.K), _axes(packed)
    points = packed.floats["center"][:, None] + np.einsum("ndk,jk->njd", axes, places)
    px = np.einsum("nad,njd->nja", K, points)
    depth = np.where(np.abs(px[..., 2:]) < 1e-9, 1e-9, px[..., 2:])
    off = np.linalg.norm(px[..., :2] / depth - keypoints[..., :2], axis=-1)
    return np.asarray(off / _outline_diagonal(packed)[:, None])

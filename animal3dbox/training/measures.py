"""Measures of animals and their cameras that lie in one range in all targets of a data set.

None of them is wrong in itself: what is usual is stated by the user, or learned from targets that
are known to be right (training.ranges).
"""

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import norm
from animal3dbox.training.packed import Floats, Packed

EDGES = ("left", "top", "right", "bottom")
EDGE_TOLERANCE_PX = 0.05
FEWEST_MARKED = 4
"""Marked keypoints below which nothing is said of an animal's keypoints."""


def measures_of(packed: Packed) -> dict[str, Floats]:
    """Every measure that the fields of some targets allow, (N,) each; NaN where it is unknown."""
    measures: dict[str, Floats] = {}
    for measure in (_sizes, _depths, _views, _gaps, _cameras, _surfaces, _keypoints):
        measures |= measure(packed)
    return measures


def _sizes(packed: Packed) -> dict[str, Floats]:
    """The sides of a cuboid, in the unit of the targets, and how long and wide it is for them."""
    if "size" not in packed.floats:
        return {}
    length, width, height = np.maximum(packed.floats["size"], 1e-12).T
    return {
        "length": length,
        "width": width,
        "height": height,
        "length per width": length / width,
        "length per height": length / height,
    }


def _depths(packed: Packed) -> dict[str, Floats]:
    """The depth of a cuboid's centre, z in the camera frame."""
    return {"depth": packed.floats["center"][:, 2]} if "center" in packed.floats else {}


def _views(packed: Packed) -> dict[str, Floats]:
    """The sine of the camera's elevation over the animal, and how upright its back is in the image.

    The camera stands at -R^T c in the box frame; the box's up axis is the third column of R.
    """
    if not packed.has_box:
        return {}
    rotation, center = packed.floats["rotation"], packed.floats["center"]
    up = rotation[:, :, 2]
    return {
        "sine of elevation": -(up * center).sum(1) / np.maximum(norm(center), 1e-12),
        "uprightness": -up[:, 1],
    }


def _gaps(packed: Packed) -> dict[str, Floats]:
    """How far a 2D box stays inside its projected cuboid at each edge, as a part of its side.

    Negative where it sticks out. Unknown at edges that the frame cuts, and of cuboids that reach
    behind the camera.
    """
    if "boxes" not in packed.floats or packed.outline is None or packed.all_in_front is None:
        return {}
    boxes, (low, high) = packed.floats["boxes"], packed.outline
    side = np.maximum(high - low, 1e-9)
    gaps = np.concatenate((boxes[:, :2] - low, high - boxes[:, 2:]), 1) / np.tile(side, 2)
    with_area = np.asarray((boxes[:, 2:] > boxes[:, :2]).all(1))
    known = (packed.all_in_front & with_area)[:, None]
    if packed.frame is not None:
        cut_low = (boxes[:, :2] < -0.5 + EDGE_TOLERANCE_PX) | (low < -0.5)
        cut_high = (boxes[:, 2:] > packed.frame - EDGE_TOLERANCE_PX) | (high > packed.frame)
        known = known & ~np.concatenate((cut_low, cut_high), 1)
    gaps = np.where(known, gaps, np.nan)
    return {
        **{f"gap at the {edge}": gaps[:, k] for k, edge in enumerate(EDGES)},
        "box beyond its cuboid": _beyond(packed, with_area),
    }


def _beyond(packed: Packed, with_area: NDArray[np.bool_]) -> Floats:
    """By how many pixels a 2D box sticks out of its projected cuboid; negative if it lies in it."""
    low, high = packed.outline or (np.zeros((packed.count, 2)),) * 2
    boxes = packed.floats["boxes"]
    beyond = np.concatenate((low - boxes[:, :2], boxes[:, 2:] - high), 1).max(1)
    return np.where(np.asarray(packed.all_in_front) & with_area, beyond, np.nan)


def _cameras(packed: Packed) -> dict[str, Floats]:
    """The intrinsics of each animal's image, for its size where that is known."""
    if packed.K is None:
        return {}
    fx, fy = packed.K[:, 0, 0], packed.K[:, 1, 1]
    measures = {"fy per fx": fy / np.where(fx == 0, np.nan, fx)}
    if packed.frame is not None:
        sides = packed.frame + 0.5
        offset = (packed.K[:, :2, 2] - (sides - 1) / 2) / sides
        measures |= {
            "fx per image width": fx / sides[:, 0],
            "principal point across": offset[:, 0],
            "principal point down": offset[:, 1],
        }
    return measures


def _surfaces(packed: Packed) -> dict[str, Floats]:
    """How far the animal's visible surface faces where the camera stands: -1 to 1.

    The shares of opposite sides, subtracted, are a direction in the box frame.
    """
    share = packed.floats.get("surface_share")
    if share is None or not packed.has_box:
        return {}
    facing = share[:, 0::2] - share[:, 1::2]  # front - back, left - right, top - bottom
    camera = -(packed.floats["center"][:, None] @ packed.floats["rotation"])[:, 0]
    length = norm(facing) * norm(camera)
    cosine = (facing * camera).sum(1) / np.maximum(length, 1e-12)
    return {"surface towards the camera": np.where(length > 0, cosine, np.nan)}


def _keypoints(packed: Packed) -> dict[str, Floats]:
    """The part of an animal's marked keypoints in its box, grown by a fiftieth of its side."""
    if packed.keypoints is None or "boxes" not in packed.floats or packed.keypoints.shape[1] == 0:
        return {}
    boxes = packed.floats["boxes"]
    growth = 1.0 + 0.02 * (boxes[:, 2:] - boxes[:, :2]).max(1)[:, None, None]
    px, marked = packed.keypoints[..., :2], packed.keypoints[..., 2] > 0
    inside = (px >= boxes[:, None, :2] - growth) & (px <= boxes[:, None, 2:] + growth)
    count = marked.sum(1)
    part = (inside.all(2) & marked).sum(1) / np.maximum(count, 1)
    return {"keypoints in the box": np.where(count >= FEWEST_MARKED, part, np.nan)}


FIELD_OF = {
    "length": "size",
    "width": "size",
    "height": "size",
    "length per width": "size",
    "length per height": "size",
    "depth": "center",
    "sine of elevation": "rotation",
    "uprightness": "rotation",
    **{f"gap at the {edge}": "boxes" for edge in EDGES},
    "fy per fx": "K",
    "fx per image width": "K",
    "principal point across": "K",
    "principal point down": "K",
    "surface towards the camera": "surface_share",
    "keypoints in the box": "keypoints",
    "keypoints off their places": "keypoints",
    "keypoints better exchanged": "keypoints",
    **dict.fromkeys(("box beyond its cuboid", "box growth", "box shift"), "boxes"),
    "box edge beyond its place": "boxes",
    "boxes better as x, y, w, h": "boxes",
    "boxes better as cx, cy, w, h": "boxes",
    "boxes better mirrored": "boxes",
    "K better with cx and cy exchanged": "K",
    "center better as the bottom's": "center",
    "rotation better transposed": "rotation",
}
"""Each measure, and the field that is named when it is out of its range."""
RATIOS = frozenset(
    ("length", "width", "height", "length per width", "length per height", "depth", "fy per fx",
     "fx per image width")
)  # fmt: skip
"""The measures whose ranges are widened by a factor, not by a difference."""
SIZES = ("length", "width", "height", "length per width", "length per height")
"""The measures that belong to a class of animals."""
INTRINSICS = ("fy per fx", "fx per image width", "principal point across", "principal point down")
"""The measures of cameras, which are often one number exactly."""
MISFITS = frozenset(name for name in FIELD_OF if name.startswith("box ") or " better " in name)
"""The measures of which only large values are unusual: of boxes, K, centers and rotations, and of
keypoints' names."""

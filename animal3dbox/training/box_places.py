"""How far a body reaches in its cuboid, learned from many 2D boxes, and where a box must lie so.

An edge of a 2D box at u is the plane n . X = 0 through the camera with n = K_0 - u K_2, and the
body touches it. In the box frame, where X = c + R diag(size) m, the body's reach in the direction
q = -(R diag(size))^T n is n . c; the cuboid's own is |q|_1 / 2. Their ratio r is 1 where the body
touches the cuboid's corner, and of bodies that are alike a smooth function of q alone: one function
for all four edges, all views and all distances. It is learned as a polynomial in the direction
q / |q|_1, alike for left and right. Limbs move r by some 7 %; what hides an animal makes it less.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from animal3dbox.training.packed import Floats, Packed

EDGES = ((0, 1.0), (1, 1.0), (0, -1.0), (1, -1.0))
"""The row of K and the sign with which each edge of xyxy bounds the body."""
DEGREE = 4
RIDGE = 1e-3
ROUNDS, TOO_SMALL, TOO_LARGE = 6, -2.5, 4.0
"""Rounds of the fit, and residuals, in robust standard deviations, that it leaves out."""
MAD = 1.4826
FEWEST_EDGES = 200
"""Edges below which nothing is learned."""
CUT_PX = 0.05
"""An edge that is nearer to the frame's is cut by it."""
SPREAD = (0.12, 0.08)
"""How far r usually lies below and above what was learned."""
GREATEST = (6.0, 16.0)
"""What an edge costs at most, half of squared standard deviations: below and above."""

Change = Callable[[Packed], Packed | None]


def learned_reach(batches: Sequence[Packed]) -> Floats | None:
    """The coefficients (F,) of r; None of too few boxes with cuboids and cameras."""
    directions, ratios = [], []
    for packed in batches:
        if not has_boxes(packed):
            continue
        ratio, direction = edge_ratios(packed)
        usable = whole_boxes(packed)
        ratios.append(ratio[usable].ravel())
        directions.append(direction[usable].reshape(-1, 3))
    r = np.concatenate(ratios) if ratios else np.zeros(0)
    if len(r) < FEWEST_EDGES:
        return None
    rows = features(np.concatenate(directions))
    kept = np.ones(len(r), dtype=np.bool_)
    for _ in range(ROUNDS):
        left = rows[kept].T @ rows[kept] + RIDGE * np.eye(rows.shape[1])
        reach = np.linalg.solve(left, rows[kept].T @ r[kept])
        off = r - rows @ reach
        spread = MAD * float(np.median(np.abs(off[kept])))
        kept = (off >= TOO_SMALL * spread) & (off <= TOO_LARGE * spread)
    return np.asarray(reach)


def box_place_measures(packed: Packed, reach: Floats) -> dict[str, Floats]:
    """Measures (N,) of 2D boxes against the places that a learned reach gives; NaN where unknown.

    `box growth` is how much larger than its place a box is, across or down, `box shift` how far it
    is moved, both as a part of its cuboid's half side. `... better ...` is by how much less, in
    halves of squared standard deviations, the boxes of an image lie off their places if one of the
    usual mistakes is undone.
    """
    if not has_boxes(packed):
        return {}
    known = np.asarray(packed.all_in_front) & positive(packed)
    off = np.where(known[:, None], edges_off(packed, reach), np.nan)
    free = np.where(cut_edges(packed), np.nan, off)
    measures = {
        "box growth": np.fmax(free[:, 0] + free[:, 2], free[:, 1] + free[:, 3]) / 2,
        "box shift": np.fmax(shift_of(free[:, 0], free[:, 2]), shift_of(free[:, 1], free[:, 3])),
        "box edge beyond its place": np.fmax.reduce(off, axis=1),
    }
    given = image_costs(packed, reach)
    for name, change in MISTAKES.items():
        changed = change(packed)
        if changed is not None:
            measures[name] = (given - image_costs(changed, reach))[packed.owner]
    return measures


def shift_of(first: Floats, last: Floats) -> Floats:
    """How far both edges (N,) of an axis are moved the same way, 0 or more.

    Each is positive where it lies farther out; what hides an animal moves one of them only.
    """
    return np.asarray(np.maximum(np.minimum(first, -last), np.minimum(last, -first)))


def has_boxes(packed: Packed) -> bool:
    """Whether targets say where 2D boxes, cuboids and cameras are."""
    return (
        "boxes" in packed.floats
        and packed.has_box
        and packed.K is not None
        and packed.all_in_front is not None
    )


def positive(packed: Packed) -> NDArray[np.bool_]:
    """The boxes (N,) that have an area."""
    boxes = packed.floats["boxes"]
    return np.asarray((boxes[:, 2:] > boxes[:, :2]).all(1))


def edge_ratios(packed: Packed) -> tuple[Floats, Floats]:
    """The ratio r (N, 4) at each edge of xyxy, and its direction q / |q|_1 (N, 4, 3)."""
    boxes, K, center = packed.floats["boxes"], np.asarray(packed.K), packed.floats["center"]
    axes = packed.floats["rotation"] * packed.floats["size"][:, None]
    normals = np.stack(
        [sign * (K[:, row] - boxes[:, [k]] * K[:, 2]) for k, (row, sign) in enumerate(EDGES)], 1
    )
    q = -normals @ axes
    extent = np.maximum(np.abs(q).sum(2), 1e-12)
    return np.einsum("nei,ni->ne", normals, center) / (0.5 * extent), q / extent[..., None]


def features(direction: Floats) -> Floats:
    """Monomials (..., F) of directions (..., 3) up to DEGREE, and their length; alike for sides."""
    x, y, z = direction[..., 0], np.abs(direction[..., 1]), direction[..., 2]
    powers = [np.stack([axis**k for k in range(DEGREE + 1)], -1) for axis in (x, y, z)]
    i, j, k = np.array(
        [
            (i, j, k)
            for i in range(DEGREE + 1)
            for j in range(DEGREE + 1 - i)
            for k in range(DEGREE + 1 - i - j)
        ]
    ).T
    monomials = powers[0][..., i] * powers[1][..., j] * powers[2][..., k]
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.concatenate((monomials, length), -1)


def edges_off(packed: Packed, reach: Floats) -> Floats:
    """How far each edge (N, 4) lies outside its place, as a part of the cuboid's half side.

    An edge that the frame cuts lies inside its place as it must: 0 there.
    """
    ratio, direction = edge_ratios(packed)
    off = ratio - features(direction) @ reach
    return np.where(cut_edges(packed), np.maximum(off, 0), off)


def cut_edges(packed: Packed) -> NDArray[np.bool_]:
    """The edges (N, 4) that lie at the frame's own."""
    boxes, far = packed.floats["boxes"], packed.frame
    if far is None:
        return np.zeros(boxes.shape, dtype=np.bool_)
    return np.concatenate((boxes[:, :2] < CUT_PX - 0.5, boxes[:, 2:] > far - CUT_PX), 1)


def whole_boxes(packed: Packed) -> NDArray[np.bool_]:
    """The animals (N,) in front of the camera whose box no edge of the frame cuts."""
    return np.asarray(~cut_edges(packed).any(1) & positive(packed)) & np.asarray(
        packed.all_in_front, dtype=np.bool_
    )


def image_costs(packed: Packed, reach: Floats) -> Floats:
    """How far all boxes of each image lie off their places, halves of squared deviations, (B,)."""
    off = edges_off(packed, reach)
    below = np.minimum(np.square(np.minimum(off, 0) / SPREAD[0]) / 2, GREATEST[0])
    above = np.minimum(np.square(np.maximum(off, 0) / SPREAD[1]) / 2, GREATEST[1])
    cost = below + above
    if packed.frame is not None:
        boxes = packed.floats["boxes"]
        outside = np.concatenate((boxes[:, :2] < -1.5, boxes[:, 2:] > packed.frame + 1), 1)
        cost = np.where(outside, sum(GREATEST), cost)
    usable = np.asarray(packed.all_in_front, dtype=np.bool_) & np.isfinite(cost).all(1)
    wrong = ~positive(packed)[:, None] & np.ones((1, 4), dtype=np.bool_)
    cost = np.where(wrong, GREATEST[1], cost)
    total = np.where(usable, cost.sum(1), 0.0)
    return np.bincount(packed.owner, weights=total, minlength=len(packed.targets)).astype(float)


def _with(packed: Packed, **fields: Floats) -> Packed:
    """The targets with other floats of animals; nothing computed from the old ones is kept."""
    floats = {**packed.floats, **fields}
    floats.pop("corners_3d", None)
    floats.pop("corners_2d", None)
    return replace(packed, floats=floats)


def _as_widths(packed: Packed) -> Packed:
    """Boxes that were x, y, w, h."""
    boxes = packed.floats["boxes"]
    return _with(packed, boxes=np.concatenate((boxes[:, :2], boxes[:, :2] + boxes[:, 2:]), 1))


def _as_centers(packed: Packed) -> Packed:
    """Boxes that were cx, cy, w, h."""
    middle, half = packed.floats["boxes"][:, :2], packed.floats["boxes"][:, 2:] / 2
    return _with(packed, boxes=np.concatenate((middle - half, middle + half), 1))


def _mirrored(packed: Packed) -> Packed | None:
    """Boxes that were mirrored left to right, or not mirrored with the rest."""
    if packed.frame is None:
        return None
    boxes = packed.floats["boxes"].copy()
    boxes[:, 0::2] = packed.frame[:, :1] - 0.5 - boxes[:, 2::-2]
    return _with(packed, boxes=boxes)


def _exchanged_center(packed: Packed) -> Packed:
    """K whose principal point was (c_y, c_x)."""
    K = packed.per_image["K"].copy()
    K[:, [0, 1], 2] = K[:, [1, 0], 2]
    return replace(_with(packed), per_image={**packed.per_image, "K": K})


def _lifted(packed: Packed) -> Packed:
    """Centres that were those of the bottom face."""
    up = packed.floats["rotation"][:, :, 2] * packed.floats["size"][:, 2:]
    return _with(packed, center=packed.floats["center"] + up / 2)


def _transposed(packed: Packed) -> Packed:
    """Rotations that were those of the camera in the box frame."""
    return _with(packed, rotation=packed.floats["rotation"].swapaxes(1, 2))


MISTAKES: dict[str, Change] = {
    "boxes better as x, y, w, h": _as_widths,
    "boxes better as cx, cy, w, h": _as_centers,
    "boxes better mirrored": _mirrored,
    "K better with cx and cy exchanged": _exchanged_center,
    "center better as the bottom's": _lifted,
    "rotation better transposed": _transposed,
}
"""The usual mistakes, and what undoes each."""

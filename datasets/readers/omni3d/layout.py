"""The corner order, dimension order and axes that an Omni3D file really has.

Files in the wild differ from the documentation, so the corners are matched to the other fields:
R_cam turns the corners into the box's own axes, where they must be all eight sign combinations of
one half size. Their order is then read off, and so is which dimension belongs to which axis.
R_cam's columns keep their documented meaning (forward, down, left) unless dimensions and corners
agree on another.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.readers.cuboid_conventions import LOOP, OMNI3D, Floats

TOLERANCE = 5e-3
"""Greatest difference between fields that agree, as a part of the box's diagonal.

Files are rounded to a few decimals; fields that differ by more contradict each other.
"""

DOCUMENTED = np.array(LOOP, dtype=np.float64)
"""Signs (8, 3) of the corners along R_cam's axes, in the documented order."""
CODES = np.array([4, 2, 1])
"""Bits by which the signs of a corner are one number."""

Problem = tuple[str, str]
"""The field of an annotation that is wrong, and why."""


@dataclass(frozen=True)
class StatedBoxes:
    """The boxes that M annotations state, before it is known in which order.

    Fields that are missing are NaN.

    Attributes:
        corners: (M, 8, 3) camera frame.
        center: (M, 3) camera frame.
        dimensions: (M, 3) in the file's order.
        rotation: (M, 3, 3) proper rotations.
    """

    corners: Floats
    center: Floats
    dimensions: Floats
    rotation: Floats


@dataclass(frozen=True)
class Layout:
    """The boxes of a file in the documented order.

    Attributes:
        rotation: (M, 3, 3) with the columns forward, down, left.
        dimensions: (M, 3) [W, H, L].
        problems: index -> field and problem, of the annotations that contradict themselves.
        notes: what a careful person should know of the file's orders, in whole sentences.
    """

    rotation: Floats
    dimensions: Floats
    problems: dict[int, Problem]
    notes: tuple[str, ...]


def infer_layout(boxes: StatedBoxes) -> Layout:
    """The boxes of a file in the documented order, and the annotations that contradict theirs."""
    has_corners, has_rotation = ~_is_missing(boxes.corners), ~_is_missing(boxes.rotation)
    problems = dict(_corner_problems(boxes, has_corners & has_rotation))
    orders = _corner_orders(boxes, has_corners & has_rotation & ~_among(problems, has_corners))
    usual = orders.most_common(1)[0][0] if orders else _order(DOCUMENTED)
    rotation, rotation_problems = _all_rotations(boxes, has_corners, has_rotation, _signs(usual))
    problems |= rotation_problems
    half = np.abs(_local(boxes, rotation)).mean(1)
    half[~has_corners] = boxes.dimensions[~has_corners][:, [2, 1, 0]] / 2
    problems = {**dict(_center_problems(boxes, has_corners)), **problems}
    sound = ~_among(problems, has_corners)
    order, axes, notes = _naming(
        boxes.dimensions[sound & has_corners], half[sound & has_corners], _signs(usual)
    )
    problems |= {
        index: problem for index, problem in _dimension_problems(boxes, half, order) if sound[index]
    }
    notes = _order_notes(orders, usual) + notes
    if not has_rotation.all():
        notes += (
            f"R_cam is missing in {int((~has_rotation).sum())} annotations: their axes were read"
            " off the corners",
        )
    notes += _trust_note(has_corners)
    dimensions = (2 * half @ np.abs(axes))[:, list(OMNI3D.dimensions)]
    # The file's own numbers are kept where they need no reordering.
    as_stated = np.array_equal(axes, np.eye(3)) and order == OMNI3D.dimensions
    own = (has_corners & has_rotation)[:, None] & as_stated
    return Layout(
        rotation=rotation @ axes,
        dimensions=np.where(own, boxes.dimensions, dimensions),
        problems=problems,
        notes=notes,
    )


def _trust_note(has_corners: NDArray[np.bool_]) -> tuple[str, ...]:
    """A sentence on boxes whose orientation no corner confirms, if there are any."""
    alone = int((~has_corners).sum())
    if not alone:
        return ()
    return (
        f"bbox3D_cam is missing in {alone} of {len(has_corners)} annotations: that R_cam's columns"
        " are forward, down, left, and dimensions W, H, L, is taken on trust there",
    )


def _corner_orders(boxes: StatedBoxes, sound: NDArray[np.bool_]) -> Counter[tuple[int, ...]]:
    """The corner orders of the sound boxes (M,), with the number of boxes of each.

    Boxes that are too flat for their corners' sides to be certain do not count.
    """
    local = _local(boxes, boxes.rotation)
    return Counter(_order(signs) for signs in np.sign(local[sound & ~_flat(boxes, local)]))


def _all_rotations(
    boxes: StatedBoxes,
    has_corners: NDArray[np.bool_],
    has_rotation: NDArray[np.bool_],
    signs: Floats,
) -> tuple[Floats, dict[int, Problem]]:
    """The rotations (M, 3, 3), missing ones read off the corners, and the boxes where that fails.

    Args:
        boxes: M of them.
        has_corners: (M,).
        has_rotation: (M,).
        signs: (8, 3) of the file's usual corner order.

    """
    rotation, problems = boxes.rotation.copy(), dict[int, Problem]()
    for index in map(int, np.flatnonzero(~has_rotation)):
        if not has_corners[index]:
            problems[index] = ("R_cam", "is missing, and so are the corners")
            continue
        problem = _recover(boxes, rotation, index, signs)
        if problem is not None:
            problems[index] = problem
    return rotation, problems


def _among(problems: dict[int, Problem], boxes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether each of boxes (M,) has a problem, (M,)."""
    return np.isin(np.arange(len(boxes)), list(problems))


def _is_missing(values: Floats) -> NDArray[np.bool_]:
    """Whether each of values (M, a, b) holds a NaN, (M,)."""
    return np.asarray(np.isnan(values).any((-1, -2)))


def _local(boxes: StatedBoxes, rotation: Floats) -> Floats:
    """The corners (M, 8, 3) about their mean, in R_cam's axes."""
    local: Floats = (boxes.corners - boxes.corners.mean(1, keepdims=True)) @ rotation
    return local


def _tolerance(boxes: StatedBoxes) -> Floats:
    """The difference between agreeing fields that rounding may make, (M,), in the boxes' unit."""
    spread = np.linalg.norm(boxes.corners - boxes.corners.mean(1, keepdims=True), axis=-1).max(1)
    return np.asarray(2 * TOLERANCE * spread)


def _flat(boxes: StatedBoxes, local: Floats) -> NDArray[np.bool_]:
    """Whether a box is so thin that rounding decides on which side a corner lies, (M,)."""
    return np.asarray(np.abs(local).mean(1).min(1) <= _tolerance(boxes))


def _corner_problems(
    boxes: StatedBoxes, complete: NDArray[np.bool_]
) -> Iterator[tuple[int, Problem]]:
    """The complete boxes (M,) whose corners are no box, or not the one that R_cam turns."""
    local, tolerance = _local(boxes, boxes.rotation), _tolerance(boxes)
    half, flat = np.abs(local).mean(1), _flat(boxes, local)
    # The corners of a box along the axes are all eight (±hx, ±hy, ±hz).
    off = np.abs(np.abs(local) - half[:, None]).max((1, 2))
    for index in map(int, np.flatnonzero(complete)):
        if off[index] > tolerance[index]:
            yield (
                index,
                _misaligned(
                    boxes.corners[index],
                    boxes.rotation[index],
                    float(off[index]),
                    float(tolerance[index]),
                ),
            )
        elif not flat[index] and len({tuple(row) for row in np.sign(local[index]).tolist()}) < 8:
            yield index, ("bbox3D_cam", "does not hold eight different corners of a box")


def _misaligned(corners: Floats, rotation: Floats, off: float, tolerance: float) -> Problem:
    """The problem of corners (8, 3) that do not lie along the axes of a rotation (3, 3).

    Either they are no box, or the rotation is another box's or transposed.
    """
    about = corners - corners.mean(0)
    distances = np.linalg.norm(about, axis=-1)
    opposite = np.linalg.norm(about[:, None] + about[None], axis=-1).min(1)
    if max(float(np.ptp(distances)), float(opposite.max())) > 2 * tolerance:
        return (
            "bbox3D_cam",
            f"is not a box: its corners are up to {off:.3g} away from those of any box along R_cam",
        )
    local = np.abs(about @ rotation.T)
    hint = (
        "; its transpose does: R_cam maps the box's axes to the camera's"
        if np.ptp(local, axis=0).max() <= tolerance
        else ""
    )
    return (
        "R_cam",
        f"does not turn the box that bbox3D_cam holds (corners differ by {off:.3g}){hint}",
    )


def _order(signs: Floats) -> tuple[int, ...]:
    """The corner order of signs (8, 3): one number a corner, its signs along x, y, z as bits."""
    return tuple(((signs > 0) @ CODES).tolist())


def _signs(order: tuple[int, ...]) -> Floats:
    """The signs (8, 3) of a corner order; the inverse of _order."""
    return np.where((np.array(order)[:, None] & CODES) > 0, 1.0, -1.0)


def _recover(boxes: StatedBoxes, rotation: Floats, index: int, signs: Floats) -> Problem | None:
    """Fill in a missing rotation from the box's corners.

    Args:
        boxes: M of them.
        rotation: (M, 3, 3), of which one is filled in.
        index: of the box.
        signs: (8, 3) of the corners' order.

    Returns:
        The problem of corners that are no box in this order; None if the rotation is filled in.

    """
    about = boxes.corners[index] - boxes.corners[index].mean(0)
    edges = signs.T @ about / 8  # rows: half sizes times axes
    length = np.linalg.norm(edges, axis=1, keepdims=True)
    off = np.abs(signs @ edges - about).max()
    tolerance = float(_tolerance(boxes)[index])
    if off > tolerance or length.min() <= 0:
        return (
            "R_cam",
            "is missing, and bbox3D_cam is no box in the file's corner order (corners differ by"
            f" {off:.3g})",
        )
    axes = (edges / length).T
    if np.abs(axes.T @ axes - np.eye(3)).max() > 4 * TOLERANCE or np.linalg.det(axes) < 0:
        return (
            "R_cam",
            "is missing, and the edges of bbox3D_cam are not at right angles or left-handed in the"
            " file's corner order",
        )
    rotation[index] = axes
    return None


def _center_problems(
    boxes: StatedBoxes, has_corners: NDArray[np.bool_]
) -> Iterator[tuple[int, Problem]]:
    """The boxes whose centre is not the middle of their corners."""
    off = np.linalg.norm(boxes.center - boxes.corners.mean(1), axis=-1)
    for index in map(int, np.flatnonzero(has_corners & (off > _tolerance(boxes)))):
        problem = (
            f"is {off[index]:.3g} away from the middle of bbox3D_cam; it must be the box's centre,"
            " not its bottom"
        )
        yield index, ("center_cam", problem)


def _matches(dimensions: Floats, half: Floats, order: tuple[int, ...]) -> NDArray[np.bool_]:
    """Whether the dimensions (M, 3) of boxes are their lengths along axes in an order, (M,)."""
    along = 2 * half[:, list(order)]
    tolerance = 4 * TOLERANCE * np.linalg.norm(half, axis=-1)
    return np.asarray((np.abs(along - dimensions) <= tolerance[:, None]).all(-1))


def _naming(
    dimensions: Floats, half: Floats, signs: Floats
) -> tuple[tuple[int, ...], Floats, tuple[str, ...]]:
    """The meaning of R_cam's axes by the dimensions along them.

    Args:
        dimensions: (M, 3) of the sound boxes, in the file's order.
        half: (M, 3) half sizes along R_cam's axes.
        signs: (8, 3) of the file's usual corner order.

    Returns:
        The numbers of R_cam's axes along which W, H, L lie; the axes (3, 3) forward, down, left in
        R_cam's; and a note if that is not as documented.

    """
    documented = OMNI3D.dimensions
    counts = {
        order: int(_matches(dimensions, half, order).sum()) for order in permutations(range(3))
    }
    order = max(counts, key=lambda o: (counts[o], o == documented)) if len(half) else documented
    if order == documented:
        return order, np.eye(3), ()
    names = "".join("xyz"[axis] for axis in order)
    for axes in _signed_permutations():
        same_axes = tuple(int(np.abs(axes)[:, axis].argmax()) for axis in documented)
        if (
            same_axes == order
            and np.array_equal(signs @ axes, DOCUMENTED)
            and np.linalg.det(axes) > 0
        ):
            note = (
                "R_cam's columns are other axes: dimensions and corners agree that W, H, L lie"
                f" along its {names}; they were renamed"
            )
            return order, axes, (note,)
    letters = ", ".join("LHW"[axis] for axis in order)
    note = (
        f"dimensions are listed along R_cam's axes {names}, as [{letters}], not [W, H, L]; they"
        " were reordered"
    )
    return order, np.eye(3), (note,)


def _signed_permutations() -> Iterator[Floats]:
    """The 48 matrices (3, 3) whose columns are R_cam's axes in any order and of either sign."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            yield np.eye(3)[:, list(order)] * signs


def _dimension_problems(
    boxes: StatedBoxes, half: Floats, order: tuple[int, ...]
) -> Iterator[tuple[int, Problem]]:
    """The boxes whose dimensions are not the distances of their corners, in the file's order."""
    differ = ~_matches(boxes.dimensions, half, order) & ~np.isnan(half).any(-1)
    for index in map(int, np.flatnonzero(differ)):
        of_corners = ", ".join(f"{2 * half[index][axis]:.4g}" for axis in order)
        stated = ", ".join(f"{value:.4g}" for value in boxes.dimensions[index])
        problem = (
            f"[{stated}] are not those of bbox3D_cam, which are [{of_corners}] in the order of this"
            " file"
        )
        yield index, ("dimensions", problem)


def _order_notes(orders: Counter[tuple[int, ...]], usual: tuple[int, ...]) -> tuple[str, ...]:
    """A sentence on the corner orders of a file, if any was found."""
    documented = _order(DOCUMENTED)
    if not orders:
        return ()
    total = sum(orders.values())
    if set(orders) == {documented}:
        return (f"the corners of all {total} boxes are in the documented order",)
    signs = " ".join(
        f"{k}({''.join('-+'[int(s > 0)] for s in row)})" for k, row in enumerate(_signs(usual))
    )
    loop = any(np.array_equal(_signs(usual) @ axes, DOCUMENTED) for axes in _signed_permutations())
    kind = "the documented loop on other axes" if loop else "no loop that is known"
    place = (
        "in the documented order"
        if usual == documented
        else f"not in the documented order but {signs} along R_cam's axes ({kind})"
    )
    return (
        f"the corners of {orders[usual]} of {total} boxes are {place}; {len(orders)} orders in"
        " all; corners were matched by R_cam, not by number",
    )

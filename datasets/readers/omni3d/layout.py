"""Which corner order, dimension order and axes an Omni3D file really has.

Found by matching its corners to its other fields.

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
"""Of the box's diagonal: files are rounded to a few decimals.

What differs by more contradicts itself.
"""

DOCUMENTED = np.array(LOOP, dtype=np.float64)
CODES = np.array([4, 2, 1])


@dataclass(frozen=True)
class StatedBoxes:
    """What annotations say of their boxes, before anybody knows in which order.

    NaN where a field is missing.

    Attributes:
        corners: (M, 8, 3) camera frame.
        center: (M, 3).
        dimensions: (M, 3).
        rotation: (M, 3, 3) proper rotations, or NaN.
    """

    corners: Floats
    center: Floats
    dimensions: Floats
    rotation: Floats


@dataclass(frozen=True)
class Layout:
    """What the boxes are, in the documented order.

    Attributes:
        rotation: (M, 3, 3) with the columns forward, down, left.
        dimensions: (M, 3) [W, H, L].
        problems: index -> (field, problem), of the annotations that contradict themselves.
        notes: what was found out about the file.
    """

    rotation: Floats
    dimensions: Floats
    problems: dict[int, tuple[str, str]]
    notes: tuple[str, ...]


def infer_layout(boxes: StatedBoxes) -> Layout:
    """Corner order, dimension order and axes of a file's boxes, and what contradicts them."""
    rotation = boxes.rotation.copy()
    recovered, known = _missing(boxes.rotation), ~_missing(boxes.corners)
    problems: dict[int, tuple[str, str]] = {}
    problems |= dict(_corner_problems(boxes, rotation, known & ~recovered))
    local = _local(boxes, rotation)
    sound = (
        known & ~recovered & ~np.isin(np.arange(len(known)), list(problems)) & ~_flat(boxes, local)
    )
    orders = Counter(_order(signs) for signs in np.sign(local[sound]))
    usual = orders.most_common(1)[0][0] if orders else _order(DOCUMENTED)
    for index in np.flatnonzero(recovered):
        problem = (
            _recover(boxes, rotation, int(index), _signs(usual))
            if known[index]
            else ("R_cam", "is missing, and so are the corners")
        )
        problems |= {} if problem is None else {int(index): problem}
    local = _local(boxes, rotation)
    half = np.abs(local).mean(1)
    half[~known] = boxes.dimensions[~known][:, [2, 1, 0]] / 2
    problems |= {
        index: problem for index, problem in _center_problems(boxes, known) if index not in problems
    }
    checked = ~np.isin(np.arange(len(known)), list(problems))
    order, axes, notes = _naming(
        boxes.dimensions[checked & known], half[checked & known], _signs(usual)
    )
    problems |= {
        index: problem
        for index, problem in _dimension_problems(boxes, half, order)
        if checked[index]
    }
    notes = _order_notes(orders, usual) + notes
    if recovered.any():
        notes += (
            (
                f"R_cam is missing in {int(recovered.sum())} annotations: their axes were read off"
                " the corners"
            ),
        )
    turned = rotation @ axes
    dimensions = (2 * half @ np.abs(axes))[:, list(OMNI3D.dimensions)]
    own = np.array_equal(axes, np.eye(3)) and order == OMNI3D.dimensions
    return Layout(
        turned,
        np.where((known & ~recovered)[:, None] & own, boxes.dimensions, dimensions),
        problems,
        notes,
    )


def _missing(values: Floats) -> NDArray[np.bool_]:
    """Which (M,) of values (M, a, b) hold NaN."""
    return np.asarray(np.isnan(values).any((-1, -2)))


def _local(boxes: StatedBoxes, rotation: Floats) -> Floats:
    """Corners (M, 8, 3) about their mean in R_cam's axes."""
    local: Floats = (boxes.corners - boxes.corners.mean(1, keepdims=True)) @ rotation
    return local


def _tolerance(boxes: StatedBoxes) -> Floats:
    """What may differ, (M,), in the boxes' unit."""
    spread = np.linalg.norm(boxes.corners - boxes.corners.mean(1, keepdims=True), axis=-1).max(1)
    return np.asarray(2 * TOLERANCE * spread)


def _flat(boxes: StatedBoxes, local: Floats) -> NDArray[np.bool_]:
    """Boxes (M,) so thin that rounding decides on which side a corner lies."""
    return np.asarray(np.abs(local).mean(1).min(1) <= _tolerance(boxes))


def _corner_problems(
    boxes: StatedBoxes, rotation: Floats, asked: NDArray[np.bool_]
) -> Iterator[tuple[int, tuple[str, str]]]:
    """Corners that are no box, or not the box that R_cam turns."""
    local, tolerance = _local(boxes, rotation), _tolerance(boxes)
    half, flat = np.abs(local).mean(1), _flat(boxes, local)
    off = np.abs(np.abs(local) - half[:, None]).max((1, 2))
    for index in np.flatnonzero(asked):
        if off[index] > tolerance[index]:
            yield (
                int(index),
                _misaligned(
                    boxes.corners[index],
                    rotation[index],
                    float(off[index]),
                    float(tolerance[index]),
                ),
            )
        elif not flat[index] and len({tuple(row) for row in np.sign(local[index]).tolist()}) < 8:
            yield int(index), ("bbox3D_cam", "does not hold eight different corners of a box")


def _misaligned(corners: Floats, rotation: Floats, off: float, tolerance: float) -> tuple[str, str]:
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
    """A corner order as one number a corner: its signs along x, y, z as bits."""
    return tuple(((signs > 0) @ CODES).tolist())


def _signs(order: tuple[int, ...]) -> Floats:
    return np.where((np.array(order)[:, None] & CODES) > 0, 1.0, -1.0)


def _recover(
    boxes: StatedBoxes, rotation: Floats, index: int, signs: Floats
) -> tuple[str, str] | None:
    """Fill a missing rotation from corners in a known order.

    What is wrong if they are no box in it.
    """
    about = boxes.corners[index] - boxes.corners[index].mean(0)
    edges = signs.T @ about / 8  # rows: half sizes times axes
    length = np.linalg.norm(edges, axis=1, keepdims=True)
    off = np.abs(signs @ edges - about).max()
    tolerance = float(_tolerance(boxes)[index])
    if off > tolerance or length.min() <= 0:
        return (
            "R_cam",
            (
                "is missing, and bbox3D_cam is no box in the file's corner order (corners differ"
                f" by {off:.3g})"
            ),
        )
    axes = (edges / length).T
    if np.abs(axes.T @ axes - np.eye(3)).max() > 4 * TOLERANCE or np.linalg.det(axes) < 0:
        return (
            "R_cam",
            (
                "is missing, and the edges of bbox3D_cam are not at right angles or left-handed in"
                " the file's corner order"
            ),
        )
    rotation[index] = axes
    return None


def _center_problems(
    boxes: StatedBoxes, known: NDArray[np.bool_]
) -> Iterator[tuple[int, tuple[str, str]]]:
    """Centres that are not the middle of the corners."""
    off = np.linalg.norm(boxes.center - boxes.corners.mean(1), axis=-1)
    for index in np.flatnonzero(known & (off > _tolerance(boxes))):
        yield (
            int(index),
            (
                "center_cam",
                (
                    f"is {off[index]:.3g} away from the middle of bbox3D_cam; it must be the box's"
                    " centre, not its bottom"
                ),
            ),
        )


def _matches(dimensions: Floats, half: Floats, order: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which boxes have dimensions that lie along the axes that an order says, (M,)."""
    along = 2 * half[:, list(order)]
    tolerance = 4 * TOLERANCE * np.linalg.norm(half, axis=-1)
    return np.asarray((np.abs(along - dimensions) <= tolerance[:, None]).all(-1))


def _naming(
    dimensions: Floats, half: Floats, signs: Floats
) -> tuple[tuple[int, ...], Floats, tuple[str, ...]]:
    """Along which of R_cam's axes W, H, L lie, the axes forward, down, left in R_cam's, and a note
    if that is not as documented."""
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
    listed = ", ".join("LHW"[axis] for axis in order)
    return (
        order,
        np.eye(3),
        (
            (
                f"dimensions are listed along R_cam's axes {names}, as [{listed}], not [W, H, L];"
                " they were reordered"
            ),
        ),
    )


def _signed_permutations() -> Iterator[Floats]:
    """The 48 axes whose columns are R_cam's, in any order and of either sign."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            yield np.eye(3)[:, list(order)] * signs


def _dimension_problems(
    boxes: StatedBoxes, half: Floats, order: tuple[int, ...]
) -> Iterator[tuple[int, tuple[str, str]]]:
    """Dimensions that are not the corners' distances, in the order of the file."""
    for index in np.flatnonzero(~_matches(boxes.dimensions, half, order) & ~np.isnan(half).any(-1)):
        found = ", ".join(f"{2 * half[index][axis]:.4g}" for axis in order)
        said = ", ".join(f"{value:.4g}" for value in boxes.dimensions[index])
        yield (
            int(index),
            (
                "dimensions",
                (
                    f"[{said}] are not those of bbox3D_cam, which are [{found}] in the order of"
                    " this file"
                ),
            ),
        )


def _order_notes(orders: Counter[tuple[int, ...]], usual: tuple[int, ...]) -> tuple[str, ...]:
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
    what = (
        "in the documented order"
        if usual == documented
        else f"not in the documented order but {signs} along R_cam's axes ({kind})"
    )
    return (
        (
            f"the corners of {orders[usual]} of {total} boxes are {what}; {len(orders)} orders in"
            " all; corners were matched by R_cam, not by number"
        ),
    )

"""The order of dimensions of Omni3D boxes without corners, as their 2D boxes tell it.

Corners say which dimension lies along which axis (`layout`). Without them the documented
[W, H, L] is taken on trust, unless the 2D boxes of the file fit another order clearly better.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from animal3dbox.datasets.readers.cuboid_checks import (
    BOX_GAIN,
    BOX_OVERLAP,
    FILE_GAIN,
    FILE_OVERLAP,
    MANY,
    SAMPLED,
    overlap,
)
from animal3dbox.datasets.readers.cuboid_conventions import Convention, Floats
from animal3dbox.datasets.readers.omni3d.elements import StatedBox, box_2d
from animal3dbox.datasets.readers.visible_boxes import visible_boxes
from animal3dbox.datasets.records import CuboidRecord
from animal3dbox.errors import SampleError

DOCUMENTED = "WHL"
"""Omni3D's order of dimensions: width, height, length."""
SIZE = "LWH"
"""The order in which a record has its size."""
MANY_THINGS, ENOUGH = 10, 25
"""Number of boxes round things from which they can tell an order, and are evidence in full."""
CHANCE_GAIN, THING_OVERLAP = 0.25, 0.5
"""Least gain times the root of the number of such boxes, and their least median overlap.

Of 200 random files of 10 such boxes of the synthetic world, in the documented order, none comes to
more than 0.17; in [L, H, W] the median is 0.35. `benchmarks/omni3d_orders.py` counts both.
"""
OTHER_ORDERS = tuple(
    "".join(names) for names in permutations(DOCUMENTED) if "".join(names) != DOCUMENTED
)
"""Every order of dimensions that is not the documented one."""


def order_problems(
    records: Sequence[tuple[int, CuboidRecord]], boxes: Sequence[StatedBox], convention: Convention
) -> dict[int, SampleError]:
    """Index -> error, of all boxes without corners of a file whose 2D boxes fit another order.

    Args:
        records: each with its index among the boxes, dimensions taken as documented.
        boxes: of the file.
        convention: of the file.

    """
    alone = [pair for pair in records if np.isnan(boxes[pair[0]].corners).any()]
    members = []
    for index, record in alone:
        if (stated := _stated_2d(record, boxes[index], convention)) is not None:
            members.append((record, *stated))
    members = members[:: max(1, -(-len(members) // SAMPLED))]
    if not members:
        return {}
    fits = {order: _fits(order, members) for order in (DOCUMENTED, *OTHER_ORDERS)}
    medians = {order: float(np.median(values)) for order, values in fits.items()}
    best = max(OTHER_ORDERS, key=lambda order: medians[order])
    before, after = medians[DOCUMENTED], medians[best]
    gain = float(np.median(fits[best] - fits[DOCUMENTED]))
    if not _is_clear(gain, after, len(members)):
        return {}
    problem = (
        f"look like [{', '.join(best)}], not [W, H, L]: so read, 2D boxes overlap the projected"
        f" ones by {after:.2f}, as they stand by {before:.2f} (medians of {len(members)} boxes);"
        " reorder them, or give the corners (bbox3D_cam)"
    )
    return {index: SampleError(record.sample_id, "dimensions", problem) for index, record in alone}


def _is_clear(gain: float, after: float, count: int) -> bool:
    """Whether another order explains a file's 2D boxes so much better that it must be theirs.

    Boxes round projected cuboids fit the right order nearly exactly. Those round things alone do
    not, since a thing fills no cuboid: there many boxes must tell it together.

    Args:
        gain: median difference of overlaps.
        after: median overlap in the other order.
        count: number of boxes.

    """
    if gain >= BOX_GAIN and after >= BOX_OVERLAP:
        return True
    if count >= MANY and gain >= FILE_GAIN and after >= FILE_OVERLAP:
        return True
    by_chance = CHANCE_GAIN / math.sqrt(min(count, ENOUGH))
    return count >= MANY_THINGS and gain >= by_chance and after >= THING_OVERLAP


def _stated_2d(
    record: CuboidRecord, box: StatedBox, convention: Convention
) -> tuple[bool, Floats] | None:
    """Whether a stated 2D box (4,) goes on beyond the frame, and it; None without one.

    Those of the cuboid come before the thing's own, which the cuboid's may exceed.
    """
    for field in ("bbox2D_proj", "bbox2D_trunc"):
        try:
            stated = box_2d(getattr(box.annotation, field), record.sample_id, field, convention)
        except SampleError:
            continue  # it is reported when 2D boxes are checked
        if stated is not None:
            return field == "bbox2D_proj", stated
    return None if record.box is None else (False, record.box)


def _fits(order: str, members: Sequence[tuple[CuboidRecord, bool, Floats]]) -> Floats:
    """Overlaps (n,) of 2D boxes with those of cuboids whose dimensions are in an order."""
    visible = visible_boxes(
        [
            # What is documented as DOCUMENTED[k] is the dimension order[k].
            replace(
                record,
                size=record.size[[SIZE.index(DOCUMENTED[order.index(name)]) for name in SIZE]],
            )
            for record, _, _ in members
        ]
    )
    return np.array(
        [
            max(
                overlap(stated, visible.in_frame[k]),
                overlap(stated, visible.projected[k]) if is_whole else 0.0,
            )
            for k, (_, is_whole, stated) in enumerate(members)
        ]
    )

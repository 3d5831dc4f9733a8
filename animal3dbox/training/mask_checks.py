"""Checks of masks against the image's size and their boxes, which bound them.

Reading masks costs more than all other checks together: in a training loop one animal's mask is
read at each even step, outside of one every mask.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.training.findings import Finding
from animal3dbox.training.packed import Packed
from animal3dbox.training.places import animal_findings

MASK_MARGIN_PX = 1.0
"""By how much a mask may leave its box."""
EMPTY_EDGE = (1.5, 0.1)
"""Pixels, and a part of its side, of a box's edge that its mask may leave empty."""


def mask_findings(packed: Packed) -> Iterator[Finding]:
    """Masks that are no masks, of another size than the image, or not those of their boxes."""
    if packed.count == 0 or "masks" not in packed.targets[0]:
        return
    problems = {n: _problem(packed, n) for n in packed.in_turn(even=True)}
    wrong = np.array([problems.get(n) is not None for n in range(packed.count)])
    if wrong.any():
        yield from animal_findings(
            packed,
            wrong,
            check="masks",
            field="masks",
            problem=lambda n: str(problems[n]),
        )


def _problem(packed: Packed, n: int) -> str | None:
    """The fault of the mask of animal n, if there is one."""
    target = int(packed.owner[n])
    mask = as_numpy(packed.targets[target]["masks"][n - int(packed.first[target])])
    if packed.image_hw is not None and mask.shape != tuple(packed.image_hw[target]):
        hw = tuple(packed.image_hw[target].tolist())
        return f"cover {mask.shape}, but the image is {hw}"
    if mask.dtype != np.bool_ and mask.max(initial=0) > 1:
        return f"must be 0 and 1, got up to {mask.max()}"
    if "boxes" not in packed.floats:
        return None
    return _against_box(mask.view(np.bool_), packed.floats["boxes"][n])


def _against_box(bits: Any, box: Any) -> str | None:
    """The fault of a mask (H, W) against its box (4,), if there is one."""
    x1, y1, x2, y2 = box
    left, top = (max(int(np.floor(edge - MASK_MARGIN_PX)), 0) for edge in (x1, y1))
    right, bottom = (max(int(np.ceil(edge + MASK_MARGIN_PX)) + 1, 0) for edge in (x2, y2))
    inside = bits[top:bottom, left:right]
    beyond = int(np.count_nonzero(bits)) - int(np.count_nonzero(inside))
    if beyond:
        return f"has {beyond} pixels outside its box: one of them is stale"
    rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
    if len(rows) == 0:
        return None  # all of the animal that is in the picture may be hidden
    covered = (left + columns[0], top + rows[0], left + columns[-1], top + rows[-1])
    bounds = np.array(covered) + np.array((-0.5, -0.5, 0.5, 0.5))
    empty = np.abs(bounds - box)
    sides = np.array((x2 - x1, y2 - y1) * 2)
    if (empty <= EMPTY_EDGE[0] + EMPTY_EDGE[1] * sides).all():
        return None
    return f"ends {empty.max():.1f} px from its box's edge: is it all of this animal's mask?"

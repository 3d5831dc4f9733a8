"""Checks of keypoints against the animal that they belong to.

Its box and cuboid in each step, its mask in turns.
"""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.training.findings import Finding
from animal3dbox.training.packed import Floats, Packed
from animal3dbox.training.places import animal_findings

FEWEST_MARKED = 4
"""Marked keypoints below which nothing is said of an animal."""
MIRRORED_PART, MIRRORED_LEAST = 0.3, 3
"""How many more keypoints, as a part and at least, must lie in an animal's frame if mirrored: good
ones with 10 % outliers reach 0.11."""
ON_MASK_PART, ON_MASK_LEAST = 0.5, 4
"""The same on its mask: good ones, with those marked that something hides, reach 0.38."""
NEAR_MASK = 0.02
"""Part of its box's longer side by which a keypoint on a mask may be off."""
NEAR_FRAME, OFF_PART, OFF_LEAST = 0.1, 2 / 3, 6
"""Keypoints are another animal's if more than this part, and at least so many, lie outside its
frame grown by a tenth."""
AXES = ("left to right", "top to bottom")
REMEDY = "a transform must move keypoints with the picture, K and boxes"

Count = Callable[[Floats], int]
"""How many of some points (K, 2) lie on an animal."""


def keypoint_findings(packed: Packed) -> Iterator[Finding]:
    """Animals whose keypoints lie off them, or lie on them only if mirrored."""
    if packed.keypoints is None or "boxes" not in packed.floats or packed.count == 0:
        return
    px, marked = packed.keypoints[..., :2], packed.keypoints[..., 2] > 0
    problems = _frame_problems(packed, px, marked)
    if "masks" in packed.targets[0] and packed.image_hw is not None:
        for n in packed.in_turn(even=False):
            if n not in problems:
                problems |= _mask_problem(packed, n, px[n, marked[n]])
    if problems:
        wrong = np.isin(np.arange(packed.count), list(problems))
        yield from animal_findings(
            packed,
            wrong,
            check="keypoints_on_animal",
            field="keypoints",
            problem=problems.__getitem__,
        )


def _frame_problems(packed: Packed, px: Floats, marked: NDArray[np.bool_]) -> dict[int, str]:
    """Faults by animal of keypoints against the frame round its box and its projected cuboid."""
    if packed.outline is None or packed.all_in_front is None:
        return {}
    boxes = packed.floats["boxes"]
    low = np.minimum(boxes[:, :2], packed.outline[0])
    high = np.maximum(boxes[:, 2:], packed.outline[1])
    outside = (px < low[:, None]) | (px > high[:, None])
    off = ((outside[..., 0] | outside[..., 1]) & marked).sum(1)
    if off.max(initial=0) < MIRRORED_LEAST:
        return {}
    count = marked.sum(1)
    doubtful = (
        (off >= np.maximum(MIRRORED_LEAST, MIRRORED_PART * count))
        & (count >= FEWEST_MARKED)
        & packed.all_in_front
    )
    problems = {}
    for n in np.flatnonzero(doubtful).tolist():
        problem = _frame_problem(
            px[n, marked[n]], low[n], high[n], None if packed.frame is None else packed.frame[n]
        )
        if problem is not None:
            problems[n] = problem
    return problems


def _frame_problem(points: Floats, low: Floats, high: Floats, frame: Floats | None) -> str | None:
    """The fault of marked keypoints (K, 2) against their animal's frame [low, high], if any.

    Args:
        points: of one animal.
        low: (2,) least x, y of the animal's frame.
        high: (2,) greatest x, y.
        frame: (2,) the far corner of the image; None if its size is not known.
    """

    def count_inside(points: Floats, margin: float = 0.0) -> int:
        """How many points lie in the animal's frame, grown by a margin."""
        return int(((points >= low - margin) & (points <= high + margin)).all(1).sum())

    mirrored = (
        None
        if frame is None
        else _better_mirrored(points, frame, count_inside, (MIRRORED_PART, MIRRORED_LEAST))
    )
    if mirrored is not None:
        return mirrored
    off = len(points) - count_inside(points, NEAR_FRAME * float((high - low).max()))
    if off < max(OFF_LEAST, OFF_PART * len(points)):
        return None
    return (
        f"{off} of {len(points)} marked ones lie off their animal's box: are they another's, or of"
        f" the picture before a crop? {REMEDY}"
    )


def _mask_problem(packed: Packed, n: int, points: Floats) -> dict[int, str]:
    """The fault, by n, of the marked keypoints (K, 2) of animal n against its mask, if any."""
    target, frame = int(packed.owner[n]), packed.frame
    mask = as_numpy(packed.targets[target]["masks"][n - int(packed.first[target])])
    if (
        len(points) < FEWEST_MARKED
        or frame is None
        or mask.shape != tuple(packed.image_hw[target] if packed.image_hw is not None else ())
    ):
        return {}
    columns, rows = (points + 0.5).astype(np.intp).T
    on = np.count_nonzero(mask.take(rows * mask.shape[1] + columns, mode="clip"))
    if len(points) - on < max(ON_MASK_PART * len(points), ON_MASK_LEAST):
        return {}  # as almost always, and at least so many lie near it
    box = packed.floats["boxes"][n]
    near = NEAR_MASK * float((box[2:] - box[:2]).max()) * np.linspace(-1, 1, 5)
    last = np.array(mask.shape[::-1])[:, None] - 1

    def count_near(points: Floats) -> int:
        """How many points lie on the mask, or near it."""
        columns, rows = (
            np.clip(np.rint(points[..., None] + near), 0, last).astype(np.intp).swapaxes(0, 1)
        )
        return int(mask[rows[:, :, None], columns[:, None]].any((1, 2)).sum())

    problem = _better_mirrored(points, frame[n], count_near, (ON_MASK_PART, ON_MASK_LEAST))
    return {} if problem is None else {n: problem}


def _better_mirrored(
    points: Floats, frame: Floats, count: Count, excess: tuple[float, int]
) -> str | None:
    """The fault of keypoints of which many more lie on their animal if the image is mirrored.

    Args:
        points: (K, 2) the marked keypoints of one animal.
        frame: (2,) the far corner of the image, W - 0.5, H - 0.5.
        count: how many of some points lie on the animal.
        excess: how many more it takes: as a part of the keypoints, and at least.
    """
    enough = max(excess[0] * len(points), excess[1])
    here = count(points)
    if len(points) - here < enough:
        return None
    for axis, name in enumerate(AXES):
        mirrored = points.copy()
        mirrored[:, axis] = frame[axis] - 0.5 - mirrored[:, axis]  # x' = W - 1 - x
        there = count(mirrored)
        if there - here >= enough:
            return (
                f"{here} of {len(points)} marked ones lie on their animal, but {there} if mirrored"
                f" {name}: {REMEDY}"
            )
    return None

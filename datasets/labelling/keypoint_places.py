"""Whether keypoints lie on their animal: in the frame, in its box and on its mask.

Keypoints of another picture, another unit or another order look like any others, and a pose is
found for them too. This is the one check of all readers' records, made when a sample is read.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.records import AnimalRecord

Array = NDArray[np.float64]
Misplaced = Literal["fault", "flag"]
"""What keypoints beside their animal are: an error of the sample, or a flag of its label."""
LEAST_MARKED = 3
"""Fewer marked keypoints tell nothing."""
MARGIN = 0.1
"""A keypoint is outside if it is farther out than this part of the keypoints' extent."""
LEAST_INSIDE, INSIDE_AGAIN = 0.5, 0.7
"""The part of the keypoints that must be inside; and for a cause to be named, once it is undone."""
NORMALISED = 1.5
"""No coordinate is greater where all are parts of the picture's sides."""
LEAST_SHARED, PART_SHARED = 3, 0.15
"""So many keypoints, and this part of all, are at one place only if it stands for missing."""
LEAST_SIDE = 16
"""Pictures of fewer pixels a side are not asked whether their keypoints are normalised."""
SCALES = (0.5, 2.0, 0.25, 4.0)


@dataclass(frozen=True)
class _Place:
    """Where an animal's keypoints should lie: the frame, its box or its mask.

    Attributes:
        name: in words.
        holds: which of points (N, 2) lie in it or within so many px of it, (N,).
    """

    name: str
    holds: Callable[[Array, float], NDArray[np.bool_]]

    def part_inside(self, points: Array) -> float:
        """The part of points (N, 2) that lie in it, or nearly."""
        margin = MARGIN * float(np.ptp(points, axis=0).max())
        return float(self.holds(points, margin).mean())


def keypoints_problem(record: AnimalRecord, mask: NDArray[np.bool_] | None) -> str | None:
    """What is wrong with where an animal's keypoints lie, and the likely cause; None if nothing.

    Args:
        record: with at least LEAST_MARKED marked keypoints, or nothing is said.
        mask: the animal's (H, W); None without.

    Example:
        >>> from dataclasses import replace
        >>> from animal3dbox.datasets import SyntheticSet
        >>> record = SyntheticSet(seed=0, images=1).records().records[0]
        >>> keypoints_problem(record, record.mask) is None
        True
        >>> points = record.keypoints_2d / [record.image_hw[1], record.image_hw[0], 1]
        >>> keypoints_problem(replace(record, keypoints_2d=points), record.mask)[:16]
        'look normalised:'
    """
    points = record.keypoints_2d[record.keypoints_2d[:, 2] > 0, :2]
    points = points[points.any(1)]  # (0, 0) is a keypoint that is missing, whatever its mark
    if len(points) < LEAST_MARKED or not np.isfinite(points).all():
        return None  # labels say themselves that a keypoint is not finite
    shared, count = np.unique(points, axis=0, return_counts=True)
    if count.max() >= max(LEAST_SHARED, PART_SHARED * len(points)):
        x, y = shared[count.argmax()].tolist()
        return (
            f"share one place: {count.max()} of {len(points)} marked ones are at ({x:g}, {y:g}); if"
            " that stands for missing, mark them as missing (visibility 0)"
        )
    greatest = float(np.abs(points).max())
    if greatest <= NORMALISED and min(record.image_hw) >= LEAST_SIDE:
        return (
            f"look normalised: no coordinate is above {np.ceil(10 * greatest) / 10:g}; multiply x"
            f" by the width, {record.image_hw[1]}, and y by the height, {record.image_hw[0]}"
        )
    places = list(_places(record, mask))
    for place in places:
        inside = place.part_inside(points)
        if inside < LEAST_INSIDE:
            return (
                f"only {round(inside * len(points))} of {len(points)} marked ones lie in or near"
                f" {place.name}{_likely_cause(record, points, places)}"
            )
    return None


def _places(record: AnimalRecord, mask: NDArray[np.bool_] | None) -> Iterator[_Place]:
    """What there is to hold keypoints against: the frame, and the animal's own box and mask."""
    height, width = record.image_hw
    frame = np.array([-0.5, -0.5, width - 0.5, height - 0.5])
    yield _Place(f"the image, {width} x {height}", partial(_in_box, box=frame))
    if record.box is not None:
        left, top, right, bottom = (record.box + 0.5).tolist()
        words = f"the box from ({left:g}, {top:g}) to ({right:g}, {bottom:g})"
        yield _Place(words, partial(_in_box, box=record.box))
    if mask is not None and mask.any():
        yield _Place("the mask", partial(_on_mask, mask=mask))


def _in_box(points: Array, margin: float, box: Array) -> NDArray[np.bool_]:
    """Which of points (N, 2) lie in a box (4,) xyxy, or within a margin of it."""
    in_both = (points >= box[:2] - margin) & (points <= box[2:] + margin)
    inside: NDArray[np.bool_] = np.all(in_both, axis=1)
    return inside


def _on_mask(points: Array, margin: float, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of points (N, 2) lie on a mask (H, W), or within a margin along both axes."""
    height, width = mask.shape
    near = np.clip(np.rint(points - margin), 0, [width, height]).astype(np.intp)
    far = np.clip(np.rint(points + margin), -1, [width - 1, height - 1]).astype(np.intp) + 1
    x, y = np.clip(np.rint(points), 0, [width - 1, height - 1]).astype(np.intp).T
    in_frame = np.all(np.abs(points - np.stack((x, y), 1)) <= margin + 0.5, axis=1)
    on: NDArray[np.bool_] = mask[y, x] & in_frame
    for i in np.flatnonzero(~on).tolist():
        (left, top), (right, bottom) = near[i].tolist(), far[i].tolist()
        on[i] = mask[top:bottom, left:right].any()
    return on


def _likely_cause(record: AnimalRecord, points: Array, places: list[_Place]) -> str:
    """The mistake that, undone, would bring the keypoints where they belong; "" if none does."""
    height, width = record.image_hw
    undone: list[tuple[str, Array]] = [("x and y were exchanged", points[:, ::-1])]
    undone += [
        (f"they were of an image {1 / scale:g} times as large", scale * points) for scale in SCALES
    ]
    undone.append(("y were counted from the bottom", points * [1, -1] + [0, height - 1]))
    undone.append(("the image had been mirrored", points * [-1, 1] + [width - 1, 0]))
    if record.box is not None:
        undone.append(("they were counted from the corner of the box", points + record.box[:2]))
    for cause, moved in undone:
        if all(place.part_inside(moved) >= INSIDE_AGAIN for place in places):
            return f"; they would fit if {cause}"
    return ": are they pixels of this image, and of this animal?"

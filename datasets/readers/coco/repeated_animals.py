"""Images in which two clean annotations may be one: those whose keypoints are nearly the same.

Whether they are is decided where animals are read plainly (distinct_animals.py).
"""

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.readers.coco.clean_elements import CleanAnnotations, Flags, Places
from animal3dbox.datasets.readers.distinct_animals import (
    LEAST_POINTS,
    SAME_PART,
    SAME_POINTS,
    SAME_PX,
)

SLACK_PX = 0.05
"""Keypoints in float32 may differ by so much more, or none would be missed by their rounding."""
AT_ONCE = 50_000
"""Pairs that are compared at once."""


def images_with_repetitions(annotations: CleanAnnotations) -> Places:
    """The places of images of which two clean annotations may be one."""
    animals = np.nonzero(annotations.is_clean & (annotations.category >= 0))[0]
    in_order = animals[np.argsort(annotations.image[animals], kind="stable")]
    image = annotations.image[in_order]
    repeated, distance = [np.zeros(0, dtype=np.int64)], 0
    earlier = np.arange(len(in_order))
    while len(earlier):
        distance += 1
        earlier = earlier[earlier + distance < len(in_order)]
        earlier = earlier[image[earlier + distance] == image[earlier]]
        for begin in range(0, len(earlier), AT_ONCE):
            first = earlier[begin : begin + AT_ONCE]
            one, other = in_order[first], in_order[first + distance]
            alike = _may_be_same(annotations.keypoints[one], annotations.keypoints[other])
            repeated.append(image[first[alike]])
    for places in annotations.left_out.values():
        pairs = np.column_stack((annotations.image[places], annotations.content[places]))
        values, counts = np.unique(pairs, axis=0, return_counts=True)
        repeated.append(values[counts > 1, 0])
    return np.concatenate(repeated)


def _may_be_same(first: NDArray[np.float32], second: NDArray[np.float32]) -> Flags:
    """Whether (P,) pairs of animals may have the same keypoints (P, J, 2), NaN where missing.

    However few these are: annotations may be copies.
    """
    has_first, has_second = ~np.isnan(first[..., 0]), ~np.isnan(second[..., 0])
    both = has_first & has_second
    most_marked = np.maximum(has_first.sum(1), has_second.sum(1))
    is_enough = both.sum(1) >= np.maximum(LEAST_POINTS, SAME_POINTS * most_marked)
    common = np.where(both[..., None], first, np.nan)
    difference = np.where(both[..., None], np.abs(first - second), 0.0).max((1, 2), initial=0.0)
    filled = np.nan_to_num(common, nan=np.inf)
    lowest = filled.min(1, initial=np.inf)
    highest = np.where(np.isinf(filled), -np.inf, filled).max(1, initial=-np.inf)
    extent = np.where(is_enough[:, None], highest - lowest, 0.0).max(1)
    most = np.maximum(SAME_PX, SAME_PART * extent) + SLACK_PX
    is_copy = (has_first == has_second).all(1) & (difference == 0)
    is_alike: Flags = is_copy | (is_enough & (difference <= most))
    return is_alike

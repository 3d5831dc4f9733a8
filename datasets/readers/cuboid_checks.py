"""Checks of cuboids that hold for every format: repeats, 2D boxes elsewhere, sizes in other units.

Readers call them when all boxes of a file are in our frames. What cannot be right is an error that
names the box; what is only implausible is a note on the file.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Literal, get_args

import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import Floats
from animal3dbox.datasets.readers.visible_boxes import stacked_boxes
from animal3dbox.datasets.records import CuboidRecord
from animal3dbox.errors import ConfigError, SampleError

Metric = Literal["yes", "no", "info"]
"""Whether a file's lengths are metres: the user knows ("yes", "no"), or the file tells ("info")."""
SAME_BOX = 1e-3
"""Greatest difference of two boxes that are one, as a part of the diagonal, and of R's entries."""
LONGEST_M = 30.0
"""Length of a file's median box above which its unit is hardly the metre."""
MILLIMETRES_FROM = 300.0
"""Length of a file's median box from which its unit looks like the millimetre."""
SMALLEST_PX = 16.0
"""Focal length below which it is hardly in pixels, unless the picture's sides are as small."""
SHORTEST_M = 0.02
"""Length of a file's median box below which its unit is hardly the metre."""

FILE_GAIN, FILE_OVERLAP = 0.15, 0.7
"""By how much another reading must fit the median 2D box of a file better, and how well."""
BOX_GAIN, BOX_OVERLAP = 0.3, 0.8
"""The same for a single box of a file that is read rightly, and for a file of few boxes."""
MANY = 5
"""Number of boxes from which on a file's median is evidence enough.

With fewer, one that has lost its pitch may fit another order by chance. There the other reading
must fit much better, or of KITTI's files make the length the greatest dimension where it was not.
"""
SAMPLED = 300
"""Most boxes of a file by which readings are compared."""


def check_metric(metric: str) -> None:
    """Raise a ConfigError for a word that says nothing of a file's lengths."""
    if metric not in get_args(Metric):
        raise ConfigError(f"metric must be one of {', '.join(get_args(Metric))}, got {metric!r}")


def without_repeats(
    records: Sequence[CuboidRecord],
) -> tuple[tuple[CuboidRecord, ...], tuple[SampleError, ...]]:
    """Records without those that are an earlier one's box again, and an error for each of these.

    Two boxes of an image are one if they fill the same space, but for rounding, whatever their
    categories are and whichever of their sides is called front.
    """
    of_image: defaultdict[str, list[int]] = defaultdict(list)
    for index, record in enumerate(records):
        of_image[record.image_id].append(index)
    faults: dict[int, SampleError] = {}
    for members in of_image.values():
        for again, first in _repeats([records[index] for index in members]):
            faults[members[again]] = SampleError(
                records[members[again]].sample_id,
                "box",
                f"is that of {records[members[first]].sample_id} once more (centre, size and"
                " rotation): leave one of them out",
            )
    kept = tuple(record for index, record in enumerate(records) if index not in faults)
    return kept, tuple(faults[index] for index in sorted(faults))


def _repeats(records: Sequence[CuboidRecord]) -> Iterator[tuple[int, int]]:
    """The places of boxes of one image that are an earlier one's again, each with that one's."""
    if len(records) < 2:
        return
    center, rotation, size = stacked_boxes(records)
    tolerance = SAME_BOX * np.linalg.norm(size, axis=-1)[:, None]
    apart = np.abs(center[:, None] - center).max(-1)
    for again, first in np.argwhere(np.tril(apart <= tolerance, -1)).tolist():
        turn = np.abs(rotation[first].T @ rotation[again])  # which axis is which, of either sign
        axes = turn.round()
        is_same_frame = np.abs(turn - axes).max() <= SAME_BOX and (axes.sum(0) == 1).all()
        if is_same_frame and np.abs(size[first] @ axes - size[again]).max() <= tolerance[again]:
            yield again, first


def check_pixels(K: Floats, image_hw: tuple[int, int], sample_id: str, field: str) -> None:
    """Raise a SampleError for intrinsics that are parts of the image, not pixels of it.

    Args:
        K: (3, 3).
        image_hw: height and width.
        sample_id: named in the error.
        field: of K, likewise.

    """
    height, width = image_hw
    focal, principal = max(K[0, 0], K[1, 1]), np.abs(K[:2, 2]).max()
    if min(image_hw) > SMALLEST_PX and focal < SMALLEST_PX and principal <= 2:
        raise SampleError(
            sample_id,
            field,
            f"has a focal length of {focal:.3g}, as parts of the image: it looks normalised; give"
            f" pixels (times {width} and {height})",
        )


def overlap(a: Floats, b: Floats) -> float:
    """Intersection over union of two upright boxes (4,), xyxy; 0 if one of them is NaN."""
    common = _common_area(a, b)
    union = float(np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2])) - common
    return common / union if union > 0 else 0.0


def share_inside(part: Floats, whole: Floats) -> float:
    """The part, 0 to 1, of an upright box (4,) that lies in another one; 0 if one is NaN.

    The upright box of a thing, or of what is visible of it, lies in that of its cuboid.
    """
    area = float(np.prod(part[2:] - part[:2]))
    return _common_area(part, whole) / area if area > 0 else 0.0


def _common_area(a: Floats, b: Floats) -> float:
    sides = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    return float(np.prod(np.maximum(sides, 0))) if not np.isnan(sides).any() else 0.0


def size_note(records: Sequence[CuboidRecord]) -> tuple[str, ...]:
    """A sentence on boxes of a size that no unit but another than the metre explains, if any.

    The median box decides, so that single large or distant things say nothing.
    """
    if not records:
        return ()
    length = float(np.median([record.size.max() for record in records]))
    distance = float(np.median([np.linalg.norm(record.center) for record in records]))
    if SHORTEST_M <= length <= LONGEST_M:
        return ()
    if length < SHORTEST_M:
        unit = "looks as if it were scaled (to a scene of unit size, or kilometres)"
    elif length < MILLIMETRES_FROM:
        unit = "looks like centimetres (0.01 metres per unit)"
    else:
        unit = "looks like millimetres (0.001 metres per unit)"
    return (
        f"the median box is {length:.4g} long and {distance:.4g} away, which {unit}, not like"
        " metres",
    )

"""What only a dataset's animals together tell: one that comes twice, or has another's image or box.

Every reader of keypoints ends here.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.named_files import is_end_of_path
from animal3dbox.datasets.images.remote_files import PicturePath
from animal3dbox.datasets.readers.tolerance import Tolerance
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError

SAME_PX, SAME_PART = 1.0, 0.005
"""Keypoints are the same within so many px, or so much of their extent, as rounding moves them."""
SAME_POINTS = 0.8
"""The part of an animal's marked keypoints that must be the same as another's."""
LEAST_POINTS = 3
"""Fewer common keypoints tell nothing."""
BEYOND_FRAME = 0.05
"""A box that reaches farther beyond the image, as a part of its sides, is no box of it."""
AROUND = 0.1
"""A keypoint is in a box if it is no farther out than this part of the keypoints' extent."""
BETTER = 0.15
"""By how much two corners must overlap the keypoints' bounds better than the box as it was read."""
MOST_IN = 0.9
"""The part of keypoints that a box must hold to be theirs."""

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Checked = tuple[tuple[AnimalRecord, ...], tuple[SampleError, ...]]
"""Records, and an error for each other one."""


def distinct_animals(
    records: Sequence[AnimalRecord], tolerance: Tolerance, *, others_may_be_corners: bool = True
) -> Checked:
    """The records without those that are another one's, and an error for each of these.

    Args:
        records: as they were read, in order.
        tolerance: how bad boxes are taken.
        others_may_be_corners: whether every box of the file's other animals, if there are any, may
            be two corners.

    """
    named, faults = _of_own_images(records)
    once, repeated = _each_once(named)
    boxed, boxes = _with_own_boxes(once, tolerance, others_may_be_corners)
    return boxed, (*faults, *repeated, *boxes)


def elsewhere_notes(records: Sequence[AnimalRecord]) -> tuple[str, ...]:
    """A sentence on images that lie a folder higher than their names say."""
    moved = [record for record in records if _is_elsewhere(record)]
    if not moved:
        return ()
    return (
        f"{len(moved)} animals' images are not where their names say: {moved[0].image_id!r} is"
        f" taken to be {_end_of(moved[0].image_path)}; see that these are the right ones",
    )


def _of_own_images(records: Sequence[AnimalRecord]) -> Checked:
    """Records whose image is certain to be their own.

    It is not if it is another name's file, too, but for the name that it has; or if it was found
    without the folder that its name begins with, while other images lie in theirs.
    """
    names: dict[PicturePath, dict[str, None]] = {}
    for record in records:
        if record.image_path is not None:
            names.setdefault(record.image_path, {})[record.image_id] = None
    is_moved = [_is_elsewhere(record) for record in records]
    some_are_in_place = not all(is_moved)
    kept, faults = [], []
    for record, moved in zip(records, is_moved, strict=True):
        path = record.image_path
        others = [] if path is None else [name for name in names[path] if name != record.image_id]
        has_own_name = not isinstance(path, Path) or path.as_posix().endswith(record.image_id)
        if moved and some_are_in_place:
            problem = not_taken(path)
        elif others and not has_own_name:
            problem = taken_twice(others[0])
        else:
            kept.append(record)
            continue
        faults.append(SampleError(record.sample_id, "image", problem))
    return tuple(kept), tuple(faults)


def not_taken(path: PicturePath | None) -> str:
    """The problem of a name without a file, of a dataset whose other names have theirs."""
    return (
        f"there is no file of this name, and {_end_of(path)!r} is not taken for it, since other"
        " images are where their names say; correct the name or add the file"
    )


def taken_twice(other: str) -> str:
    """The problem of a name whose file is that of another name, too."""
    return (
        f"is the file of {other!r}, too: two images of a dataset are two files; give the folder in"
        " which both names are right (--images)"
    )


def _is_elsewhere(record: AnimalRecord) -> bool:
    """Whether a record's image was found without all of the folders that its name says."""
    path = record.image_path
    return isinstance(path, Path) and is_elsewhere(record.image_id, path)


def is_elsewhere(name: str, file: Path) -> bool:
    """Whether a file was found without all of the folders that its name says."""
    path = file.as_posix()
    if path.endswith(name):  # as nearly always
        return False
    return not is_end_of_path(name, path)


def _end_of(path: PicturePath | None) -> str:
    return "/".join(path.parts[-2:]) if isinstance(path, Path) else ""


def _each_once(records: Sequence[AnimalRecord]) -> Checked:
    """Records whose keypoints are not those of an earlier animal of their image."""
    by_image: dict[str, list[AnimalRecord]] = {}
    kept, faults = [], []
    for record in records:
        before = by_image.setdefault(record.image_id, [])
        first = next((one for one in before if _is_same(one, record)), None)
        before.append(record)
        if first is None:
            kept.append(record)
            continue
        problem = (
            f"are those of {first.sample_id} once more, but for rounding: remove one, or it counts"
            " twice"
        )
        faults.append(SampleError(record.sample_id, "keypoints_2d", problem))
    return tuple(kept), tuple(faults)


def _is_same(one: AnimalRecord, other: AnimalRecord) -> bool:
    """Whether two animals have the same keypoints, but for rounding and single ones."""
    first, second = one.keypoints_2d, other.keypoints_2d
    if first.shape != second.shape:
        return False
    seen = first[:, 2] > 0, second[:, 2] > 0
    both = seen[0] & seen[1]
    common = int(both.sum())
    if common < max(LEAST_POINTS, SAME_POINTS * max(int(seen[0].sum()), int(seen[1].sum()))):
        return False
    points = first[both, :2]
    most = max(SAME_PX, SAME_PART * float(np.ptp(points, axis=0).max()))
    return bool(np.abs(points - second[both, :2]).max() <= most)


def _with_own_boxes(
    records: Sequence[AnimalRecord], tolerance: Tolerance, others_may_be_corners: bool
) -> Checked:
    """Records whose boxes are x, y, width and height, not two corners.

    Read as width and height, a corner makes a box that reaches beyond the image; where one does,
    and holds the keypoints if it is a corner, the others of the file are taken for what they may
    be, too.
    """
    suspects = [*zip(records, *_as_corners(records), strict=True)]
    is_file_of_corners = (
        others_may_be_corners
        and any(evident for _, _, evident in suspects)
        and all(possible for record, possible, _ in suspects if record.box is not None)
    )
    kept, faults = [], []
    for record, possible, evident in suspects:
        if not (evident or (possible and is_file_of_corners)):
            kept.append(record)
            continue
        try:
            tolerance.part(partial(_refuse_corners, record))
            kept.append(replace(record, box=None))
        except SampleError as error:
            faults.append(error)
    return tuple(kept), tuple(faults)


def _refuse_corners(record: AnimalRecord) -> None:
    """Raise the SampleError of a box of two corners."""
    raise SampleError(
        record.sample_id,
        "bbox",
        "looks like two corners, xmin, ymin, xmax, ymax: as x, y, width, height it would reach"
        " beyond the image, or others of the file would; write the width and the height",
    )


def _as_corners(records: Sequence[AnimalRecord]) -> tuple[Flags, Flags]:
    """Whether boxes of records may be two corners, and evidently are; see may_be_corners.

    Records of as many keypoints are looked at together: one by one they took a seventh of opening
    StanfordExtra (benchmarks/opening_lists.py, "stanfordextra").
    """
    groups: dict[int, list[int]] = {}
    for place, record in enumerate(records):
        if record.box is not None:
            groups.setdefault(len(record.keypoints_2d), []).append(place)
    possible, evident = (np.zeros(len(records), dtype=np.bool_) for _ in range(2))
    for places in groups.values():
        possible[places], evident[places] = may_be_corners(
            np.array([records[place].box for place in places]),
            np.stack([records[place].keypoints_2d for place in places]),
            np.array([records[place].image_hw for place in places]),
        )
    return possible, evident


def has_evident_corners(records: Sequence[AnimalRecord]) -> bool:
    """Whether a box of some animals evidently is two corners."""
    return bool(_as_corners(records)[1].any())


def may_be_corners(boxes: Array, keypoints: Array, image_hw: NDArray[Any]) -> tuple[Flags, Flags]:
    """Whether boxes may be two corners that were read as a corner, a width and a height.

    Args:
        boxes: (N, 4) xyxy px, as they were read.
        keypoints: (N, J, 3) of the same animals, the third number 0 where one is missing.
        image_hw: (N, 2) height and width of their images.

    Returns:
        possible: (N,) the keypoints lie between these corners, and fill them better.
        evident: (N,) besides, they fill them much better, and as it was read the box reaches
            beyond the image.
    """
    is_marked, points = keypoints[..., 2] > 0, keypoints[..., :2]
    count = is_marked.sum(1)
    far_off = np.float64(np.inf)
    lowest = np.where(is_marked[..., None], points, far_off).min(1, initial=far_off)
    highest = np.where(is_marked[..., None], points, -far_off).max(1, initial=-far_off)
    has_points = count >= LEAST_POINTS
    lowest[~has_points] = highest[~has_points] = 0.0
    near, far = boxes[:, :2], boxes[:, 2:] - boxes[:, :2] - 0.5
    margin = AROUND * (highest - lowest).max(1)[:, None]
    inside = (points >= (near - margin)[:, None]) & (points <= (far + margin)[:, None])
    inside_count = (inside.all(2) & is_marked).sum(1)
    possible = (far > near).all(1) & (inside_count / np.maximum(count, 1) >= MOST_IN)
    extent = np.concatenate((lowest, highest), axis=1)
    gain = _overlap(np.concatenate((near, far), axis=1), extent) - _overlap(boxes, extent)
    possible &= has_points & (gain > 0)
    reaches_beyond = (boxes[:, 2:] > (1 + BEYOND_FRAME) * image_hw[:, ::-1]).any(1)
    return possible, possible & (gain > BETTER) & reaches_beyond


def _overlap(some: Array, others: Array) -> Array:
    """The intersections over unions (N,) of pairs of boxes (N, 4) xyxy."""
    least_far, greatest_near = (
        np.minimum(some[:, 2:], others[:, 2:]),
        np.maximum(some[:, :2], others[:, :2]),
    )
    common = np.maximum(least_far - greatest_near, 0).prod(1)
    areas = (some[:, 2:] - some[:, :2]).prod(1) + (others[:, 2:] - others[:, :2]).prod(1)
    overlaps: Array = common / np.maximum(areas - common, 1e-9)
    return overlaps

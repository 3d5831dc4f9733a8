"""What only a dataset's animals together tell: one that comes twice, or has another's image or box.

Every reader of keypoints ends here.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.images.named_files import is_end_of_path
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
Checked = tuple[tuple[AnimalRecord, ...], tuple[SampleError, ...]]
"""Records, and an error for each other one."""


def distinct_animals(records: Sequence[AnimalRecord], tolerance: Tolerance) -> Checked:
    """The records without those that are another one's, and an error for each of these.

    Args:
        records: as they were read, in order.
        tolerance: how bad boxes are taken.

    """
    named, faults = _of_own_images(records)
    once, repeated = _each_once(named)
    boxed, boxes = _with_own_boxes(once, tolerance)
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
    names: dict[Path, dict[str, None]] = {}
    for record in records:
        if record.image_path is not None:
            names.setdefault(record.image_path, {})[record.image_id] = None
    is_moved = [_is_elsewhere(record) for record in records]
    some_are_in_place = not all(is_moved)
    kept, faults = [], []
    for record, moved in zip(records, is_moved, strict=True):
        path = record.image_path
        others = [] if path is None else [name for name in names[path] if name != record.image_id]
        has_own_name = path is None or path.as_posix().endswith(record.image_id)
        if moved and some_are_in_place:
            problem = (
                f"there is no file of this name, and {_end_of(path)!r} is not taken for it, since"
                " other images are where their names say; correct the name or add the file"
            )
        elif others and not has_own_name:
            problem = (
                f"is the file of {others[0]!r}, too: two images of a dataset are two files; give"
                " the folder in which both names are right (--images)"
            )
        else:
            kept.append(record)
            continue
        faults.append(SampleError(record.sample_id, "image", problem))
    return tuple(kept), tuple(faults)


def _is_elsewhere(record: AnimalRecord) -> bool:
    """Whether a record's image was found without all of the folders that its name says."""
    if record.image_path is None:
        return False
    path = record.image_path.as_posix()
    if path.endswith(record.image_id):  # as nearly always
        return False
    return not is_end_of_path(record.image_id, path)


def _end_of(path: Path | None) -> str:
    return "/".join(path.parts[-2:]) if path is not None else ""


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


def _with_own_boxes(records: Sequence[AnimalRecord], tolerance: Tolerance) -> Checked:
    """Records whose boxes are x, y, width and height, not two corners.

    Read as width and height, a corner makes a box that reaches beyond the image; where one does,
    and holds the keypoints if it is a corner, the others of the file are taken for what they may
    be, too.
    """
    suspects = [(record, *_as_corners(record)) for record in records]
    is_file_of_corners = any(evident for _, _, evident in suspects) and all(
        possible for record, possible, _ in suspects if record.box is not None
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


def _as_corners(record: AnimalRecord) -> tuple[bool, bool]:
    """Whether a box may be two corners that were read as a corner, a width and a height.

    Returns:
        possible: the keypoints lie between these corners, and fill them better.
        evident: besides, they fill them much better, and as it was read the box reaches beyond
            the image.
    """
    box, points = record.box, record.keypoints_2d[record.keypoints_2d[:, 2] > 0, :2]
    if box is None or len(points) < LEAST_POINTS:
        return False, False
    near, far = box[:2], box[2:] - box[:2] - 0.5
    margin = AROUND * float(np.ptp(points, axis=0).max())
    inside = ((points >= near - margin) & (points <= far + margin)).all(1)
    possible = bool((far > near).all() and inside.mean() >= MOST_IN)
    extent = np.concatenate((points.min(0), points.max(0)))
    gain = _overlap(np.concatenate((near, far)), extent) - _overlap(box, extent)
    possible = possible and gain > 0
    frame = np.array(record.image_hw[::-1], dtype=np.float64)
    reaches_beyond = bool((box[2:] > (1 + BEYOND_FRAME) * frame).any())
    return possible, possible and gain > BETTER and reaches_beyond


def _overlap(one: Array, other: Array) -> float:
    """The intersection over union of two boxes (4,) xyxy."""
    common = np.prod(np.maximum(np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2]), 0))
    areas = np.prod(one[2:] - one[:2]) + np.prod(other[2:] - other[:2])
    return float(common / max(float(areas - common), 1e-9))

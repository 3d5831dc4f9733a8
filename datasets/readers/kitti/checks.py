"""The cross-checks of KITTI's lines: their fields say the same thing several times over.

alpha follows from rotation_y and location; the 2D box is where the calibration projects the
cuboid. A line in degrees, with another order of h, w, l, or with the box's centre for its bottom
contradicts itself by that.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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
    share_inside,
)
from animal3dbox.datasets.readers.cuboid_conventions import KITTI, Floats, yaw_rotation
from animal3dbox.datasets.readers.kitti.files import KittiLine
from animal3dbox.datasets.readers.visible_boxes import visible_boxes
from animal3dbox.datasets.records import CuboidImage, CuboidRecord
from animal3dbox.errors import SampleError

ALPHA_UNKNOWN = -10.0
"""Value of alpha that KITTI writes where it is not known."""
NO_BOX = (-1.0, 0.0)
"""Values of a 2D box that is not known: four times -1, or 0."""
ALPHA_TOLERANCE = 0.15
"""Greatest difference of alpha, in radians, that rounding and the place of the camera explain."""
LEAST_SEEN = 0.5
"""Least part of the 2D box that lies in the picture: KITTI's stay inside, detectors' nearly."""
LEAST_SHARE = 0.2
"""Least part of the 2D box inside the projected cuboid, which has lost pitch and roll."""
GOOD_OVERLAP = 0.75
"""Median overlap of a file whose 2D boxes are near enough to the cuboids to judge a single line."""


@dataclass(frozen=True)
class StatedLine:
    """A line in its image.

    Attributes:
        sample_id: the image, and "#k" for the boxes after its first.
        image: the line's image.
        line: its fields.
        offset: (3,) the place of the first camera, in whose frame the location is, in the image's.
    """

    sample_id: str
    image: CuboidImage
    line: KittiLine
    offset: Floats


@dataclass(frozen=True)
class Reading:
    """One way of taking a line's dimensions and location.

    Attributes:
        order: (3,) the places of height, width, length among the dimensions.
        at_center: whether the location is the box's centre, not the middle of its bottom.
    """

    order: tuple[int, ...] = (0, 1, 2)
    at_center: bool = False

    def box(self, stated: StatedLine) -> tuple[Floats, Floats, Floats]:
        """Centre, rotation and size of a line's cuboid, in our frames."""
        line = stated.line
        dimensions = line.dimensions[list(self.order)]
        location = line.location + np.array([0, dimensions[0] / 2 * self.at_center, 0])
        rotation = yaw_rotation(np.array(line.rotation_y))
        center, rotation, size = KITTI.boxes_in(location, rotation, dimensions)
        return center + stated.offset, rotation, size

    def problem(self) -> tuple[str, str]:
        """The field that is taken otherwise than KITTI has it, and how."""
        named = ", ".join(["height", "width", "length"][k] for k in np.argsort(self.order))
        centre = "like the box's centre, not the middle of its bottom"
        if self.order == (0, 1, 2):
            return "location", f"looks {centre}"
        problem = f"look like {named}, not height, width, length"
        return "dimensions", problem + (f", and location {centre}" if self.at_center else "")


AS_DOCUMENTED = Reading()
OTHER_READINGS = tuple(
    Reading(order, at_center)
    for at_center in (False, True)
    for order in permutations(range(3))
    if (order, at_center) != ((0, 1, 2), False)
)
"""Every way of taking dimensions and location that is not KITTI's."""


def check_line(stated: StatedLine) -> None:
    """Raise a SampleError for a line that cannot be right by itself, whatever its 2D box is."""
    line, sample_id = stated.line, stated.sample_id
    if line.dimensions.min() <= 0:
        raise SampleError(
            sample_id, "dimensions", f"must be positive, got {line.dimensions.tolist()}"
        )
    if line.occluded not in (-1, 0, 1, 2, 3):
        raise SampleError(sample_id, "occluded", f"must be 0, 1, 2 or 3, got {line.occluded}")
    if line.frame is None and line.truncated > 1:
        raise SampleError(
            sample_id, "truncated", f"must lie in 0 to 1, or be -1, got {line.truncated:g}"
        )
    has_area = (line.box[2:] > line.box[:2]).all()
    if not has_area and not np.isin(line.box, NO_BOX).all():
        raise SampleError(
            sample_id,
            "bbox",
            "must be left, top, right, bottom with right > left and bottom > top, got"
            f" {line.box.tolist()}; unknown is four times -1",
        )
    depth = float((line.location + stated.offset)[2])
    if depth <= 0:
        raise SampleError(
            sample_id,
            "location",
            f"has z = {depth:.4g}, which is not in front of the camera: KITTI's x points right, y"
            " down, z forward (OpenGL's and a scanner's axes do not)",
        )
    _check_angles(line, sample_id)


def _check_angles(line: KittiLine, sample_id: str) -> None:
    """Raise a SampleError for angles in degrees, or an alpha that is not that of rotation_y."""
    for field, angle in (("rotation_y", line.rotation_y), ("alpha", line.alpha)):
        if abs(angle) > 2 * np.pi + 1e-3 and angle != ALPHA_UNKNOWN:
            raise SampleError(
                sample_id,
                field,
                f"must be in radians, from -pi to pi, got {angle:g}: it looks like degrees",
            )
    if line.alpha == ALPHA_UNKNOWN:
        return
    sight = float(np.arctan2(line.location[0], line.location[2]))
    difference = _wrapped(line.alpha - (line.rotation_y - sight))
    if abs(difference) <= ALPHA_TOLERANCE:
        return
    causes = (
        ("alpha is rotation_y itself", line.rotation_y),
        ("rotation_y was turned the wrong way, rotation_y + atan2(x, z)", line.rotation_y + sight),
        ("one of them is turned by half a turn", line.rotation_y - sight + np.pi),
        ("one of them is turned by a quarter", line.rotation_y - sight + np.pi / 2),
        ("one of them is turned by a quarter", line.rotation_y - sight - np.pi / 2),
        ("one of them has the other sign", -(line.rotation_y - sight)),
    )
    cause, off = min(
        ((name, abs(_wrapped(line.alpha - angle))) for name, angle in causes),
        key=lambda pair: pair[1],
    )
    likely = f": it looks as if {cause}" if off <= ALPHA_TOLERANCE / 3 else ""
    raise SampleError(
        sample_id,
        "alpha",
        f"is {line.alpha:.4g}, but rotation_y - atan2(x, z) of location is"
        f" {_wrapped(line.rotation_y - sight):.4g}{likely}; write -10 if alpha is not known",
    )


def _wrapped(angle: float) -> float:
    """The same angle in radians, brought between -pi and pi by whole turns."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def box_problems(
    lines: Sequence[StatedLine], records: Sequence[CuboidRecord], *, own: bool
) -> dict[int, SampleError]:
    """Index -> error, of boxes whose 2D box is not where the calibration projects the cuboid.

    Args:
        lines: of the records.
        records: as KITTI documents them.
        own: whether this package wrote the files, whose order is known.

    """
    with_box = [index for index, record in enumerate(records) if record.box is not None]
    if not with_box:
        return {}
    documented = _projections([records[index] for index in with_box])
    problems: dict[int, SampleError] = {}
    for index, projected in zip(with_box, documented, strict=True):
        record = records[index]
        seen = share_inside(np.asarray(record.box), _box(record))
        if seen < LEAST_SEEN and not own:
            problems[index] = SampleError(
                record.sample_id,
                "bbox",
                f"{np.round(np.asarray(record.box), 1).tolist()} lies beside the picture, of"
                f" {record.image_hw[1]} x {record.image_hw[0]} pixels: boxes and calibration are of"
                " a picture of another size",
            )
            continue
        inside = share_inside(_box(record), projected)
        if inside < LEAST_SHARE and (inside <= 0 or not own):
            problems[index] = SampleError(
                record.sample_id,
                "bbox",
                f"lies beside the projected cuboid ({inside:.0%} of it inside): it is another"
                " thing's, or dimensions, location or the calibration (P2) are",
            )
    whole = [k for k, index in enumerate(with_box) if _is_whole(records[index])]
    if own or not whole:
        return problems
    indices = [with_box[k] for k in whole]
    return {**problems, **dict(_misread(lines, records, indices, documented[whole]))}


def _is_whole(record: CuboidRecord) -> bool:
    """Whether a record's 2D box stays off the frame's sides, which may cut the thing."""
    height, width = record.image_hw
    box = _box(record)
    return bool((box[:2] > 0.5).all() and (box[2:] < [width - 1.5, height - 1.5]).all())


def _misread(
    lines: Sequence[StatedLine],
    records: Sequence[CuboidRecord],
    with_box: Sequence[int],
    documented: Floats,
) -> Iterator[tuple[int, SampleError]]:
    """Index and error of boxes that another reading explains better, all of them or single ones.

    Args:
        lines: of all records.
        records: as KITTI documents them.
        with_box: indices of those whose 2D box shows them whole.
        documented: (n, 4) projections of these.

    """
    boxes = np.stack([_box(records[index]) for index in with_box])
    fits = np.array([overlap(*pair) for pair in zip(boxes, documented, strict=True)])
    step = -(-len(with_box) // SAMPLED)
    of_reading = {
        reading: _fits(reading, [lines[index] for index in with_box[::step]], boxes[::step])
        for reading in OTHER_READINGS
    }
    best = max(of_reading, key=lambda reading: float(np.median(of_reading[reading])))
    before, after = float(np.median(fits[::step])), float(np.median(of_reading[best]))
    gain = float(np.median(of_reading[best] - fits[::step]))
    is_sure = (
        len(with_box) >= MANY
        or (gain >= BOX_GAIN and after >= BOX_OVERLAP)
        or _makes_length_greatest(best, [lines[index] for index in with_box])
    )
    if is_sure and gain >= FILE_GAIN and after >= FILE_OVERLAP:
        field, problem = best.problem()
        for index in with_box:
            yield (
                index,
                SampleError(
                    records[index].sample_id,
                    field,
                    f"{problem}: so read, 2D boxes overlap the projected ones by {after:.2f}, as"
                    f" they stand by {before:.2f} (medians of {len(with_box)} boxes)",
                ),
            )
        return
    if before < GOOD_OVERLAP:
        return
    doubtful = [k for k, fit in enumerate(fits) if fit <= 1 - BOX_GAIN]
    yield from _single_misread(
        [lines[with_box[k]] for k in doubtful],
        boxes[doubtful],
        fits[doubtful],
        [with_box[k] for k in doubtful],
    )


def _makes_length_greatest(reading: Reading, lines: Sequence[StatedLine]) -> bool:
    """Whether the length is every box's greatest dimension in a reading, and no box's as stated."""
    height, width, length = reading.order
    return all(
        stated.line.dimensions[length] > max(stated.line.dimensions[[height, width]])
        and stated.line.dimensions[2] < max(stated.line.dimensions[:2])
        for stated in lines
    )


def _single_misread(
    lines: Sequence[StatedLine], boxes: Floats, fits: Floats, indices: Sequence[int]
) -> Iterator[tuple[int, SampleError]]:
    """Index and error of single boxes that another reading explains much better."""
    if not lines:
        return
    others = np.stack([_fits(reading, lines, boxes) for reading in OTHER_READINGS])
    for k, index in enumerate(indices):
        best = int(others[:, k].argmax())
        if others[best, k] < max(BOX_OVERLAP, fits[k] + BOX_GAIN):
            continue
        field, problem = OTHER_READINGS[best].problem()
        yield (
            index,
            SampleError(
                lines[k].sample_id,
                field,
                f"{problem}: so read, the 2D box overlaps the projected one by"
                f" {others[best, k]:.2f}, as it stands by {fits[k]:.2f}",
            ),
        )


def _fits(reading: Reading, lines: Sequence[StatedLine], boxes: Floats) -> Floats:
    """Overlaps (n,) of 2D boxes (n, 4) with the cuboids of their lines, taken in one way."""
    records = []
    for stated in lines:
        center, rotation, size = reading.box(stated)
        image = stated.image
        records.append(
            CuboidRecord(
                sample_id=stated.sample_id,
                image_id=image.image_id,
                image_path=None,
                image_hw=image.image_hw,
                category=stated.line.kind,
                K=image.K,
                center=center,
                rotation=rotation,
                size=size,
            )
        )
    projections = _projections(records)
    return np.array([overlap(*pair) for pair in zip(boxes, projections, strict=True)])


def _projections(records: Sequence[CuboidRecord]) -> Floats:
    """The upright boxes (n, 4) round what the frame shows of cuboids; NaN where that is nothing."""
    return visible_boxes(records).in_frame


def _box(record: CuboidRecord) -> Floats:
    """The 2D box (4,) of a record that has one, as far as it lies in the frame."""
    height, width = record.image_hw
    last = np.array([width - 0.5, height - 0.5] * 2)
    return np.asarray(np.clip(np.asarray(record.box), -0.5, last))

"""Checks of 2D boxes: their form, the frame, and the projected cuboid that they must lie on."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from animal3dbox.training.findings import Finding
from animal3dbox.training.frames import outside_frame
from animal3dbox.training.packed import Floats, Packed
from animal3dbox.training.places import animal_findings

EDGE_TOLERANCE_PX = 0.05
LEAST_PART_ON_CUBOID = 0.5
"""The least part of a box that must lie on its projected cuboid: the boxes of masks and meshes lie
in it whole, those drawn by hand almost."""
MOST_IN_PICTURE = 0.5
"""The greatest part of a cuboid's outline in the frame whose animal is believed to have left it: of
animals that transforms moved out it was 0.25 at most, for outlines are larger than animals."""
GROWTH = (2.0, 0.05)
"""Pixels, and a part of its sides, by which the projected cuboid is grown before it is compared."""

NORMALISED_PX = 16
"""A box within 0 to 1 is one of pixels if its projected cuboid has a side below this, px."""


def box_findings(packed: Packed) -> Iterator[Finding]:
    """Boxes (N, 4) without area, outside the frame, or apart from their cuboid."""
    if "boxes" not in packed.floats:
        return
    boxes = packed.floats["boxes"]
    flat = np.asarray((boxes[:, 2:] <= boxes[:, :2]).any(1))
    if flat.any():
        yield from _flat_boxes(packed, boxes, flat)
    if packed.frame is not None:
        corners = boxes.reshape(-1, 2, 2)
        outside = outside_frame(corners, packed.frame[:, None], EDGE_TOLERANCE_PX).any(1)
        if outside.any():
            remedy = "clip it to [-0.5, W - 0.5]"
            yield from animal_findings(
                packed,
                outside,
                check="boxes_in_frame",
                field="boxes",
                problem=lambda n: f"leaves the frame: {boxes[n].tolist()}; {remedy}",
            )
    if packed.all_in_front is not None and packed.outline is not None:
        yield from _off_cuboid(packed, boxes, packed.outline, packed.all_in_front & ~flat)


def _off_cuboid(
    packed: Packed, boxes: Floats, outline: tuple[Floats, Floats], decidable: NDArray[np.bool_]
) -> Iterator[Finding]:
    """Boxes (N, 4) of which too little lies on the outline of their projected cuboid."""
    beyond = (boxes[:, :2] < outline[0] - GROWTH[0]) | (boxes[:, 2:] > outline[1] + GROWTH[0])
    within_one = np.asarray((np.abs(boxes - 0.5) <= 0.5).all(1))
    if not beyond.any() and not within_one.any():
        return  # as almost always: then all of each box lies on its cuboid
    growth = GROWTH[0] + GROWTH[1] * (outline[1] - outline[0])
    shared = np.minimum(outline[1] + growth, boxes[:, 2:])
    shared -= np.maximum(outline[0] - growth, boxes[:, :2])
    part = np.maximum(shared, 0).prod(1)
    sides = boxes[:, 2:] - boxes[:, :2]
    normalised = within_one & (outline[1] - outline[0] > NORMALISED_PX).all(1)
    off = ((part < LEAST_PART_ON_CUBOID * sides.prod(1)) | normalised) & decidable
    if not off.any():
        return

    def problem(n: int) -> str:
        """How much of the box lies on the cuboid, and the usual reasons."""
        if normalised[n]:
            return "lies in 0 to 1, but its cuboid covers many pixels: multiply it by W and H"
        share = part[n] / sides[n].prod()
        return (
            f"lies on the projected cuboid by {share:.0%} only: is it of another picture, animal"
            " or form (xyxy px), or are K or the cuboid stale?"
        )

    yield from animal_findings(packed, off, check="boxes_on_cuboid", field="boxes", problem=problem)


def _flat_boxes(packed: Packed, boxes: Floats, flat: NDArray[np.bool_]) -> Iterator[Finding]:
    """Boxes without area: right where the animal left the picture, a warning where it may have."""
    at_border = _at_border(packed, boxes)
    remedy = "drop it by the transforms' min_visible if it left the picture"
    yield from animal_findings(
        packed,
        at_border & ~left_picture(packed),
        check="empty_box",
        field="boxes",
        problem=lambda n: (
            f"has no area, {boxes[n].tolist()}, and no cuboid says that its animal left the"
            f" picture; {remedy}"
        ),
    )
    yield from animal_findings(
        packed,
        flat & ~at_border,
        check="boxes",
        field="boxes",
        problem=lambda n: f"must be x1 < x2, y1 < y2, got {boxes[n].tolist()}",
    )


def left_picture(packed: Packed) -> NDArray[np.bool_]:
    """Animals (N,) with an empty box on the frame's border whose cuboid lies beyond it.

    Such a target is right: a transform keeps animals that it moved out of the picture unless
    min_visible drops them. Of the cuboid's outline at most MOST_IN_PICTURE may lie in the frame; a
    cuboid that reaches behind the camera has no outline to tell.
    """
    none = np.zeros(packed.count, dtype=np.bool_)
    if "boxes" not in packed.floats or packed.frame is None:
        return none
    at_border = _at_border(packed, packed.floats["boxes"])
    if not at_border.any() or packed.outline is None or packed.all_in_front is None:
        return none
    low, high = packed.outline
    inside = np.minimum(high, packed.frame) - np.maximum(low, -0.5)
    part = np.maximum(inside, 0).prod(1) / np.maximum((high - low).prod(1), 1e-9)
    return np.asarray(at_border & ((part <= MOST_IN_PICTURE) | ~packed.all_in_front))


def _at_border(packed: Packed, boxes: Floats) -> NDArray[np.bool_]:
    """Boxes (N,) without area on the frame's border, where clipping leaves those beyond it."""
    empty = boxes[:, 2:] == boxes[:, :2]
    if packed.frame is not None:
        empty &= (np.abs(boxes[:, :2] + 0.5) < EDGE_TOLERANCE_PX) | (
            np.abs(boxes[:, :2] - packed.frame) < EDGE_TOLERANCE_PX
        )
    return np.asarray(empty.any(1) & (boxes[:, 2:] >= boxes[:, :2]).all(1))

"""Checks against the picture: 2D boxes, truncation, shares in the frame, keypoints, masks."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import as_numpy
from animal3dbox.geometry.cuboid import FACES
from animal3dbox.geometry.polygon import area_in_box
from animal3dbox.training.findings import Finding
from animal3dbox.training.frames import outside_frame
from animal3dbox.training.packed import Floats, Packed
from animal3dbox.training.places import animal_findings

QUADS = np.array(list(FACES.values()))
EDGE_TOLERANCE_PX = 0.05
SHARE_TOLERANCE = 1e-3
MASK_MARGIN_PX = 1.0


def frame_findings(packed: Packed) -> Iterator[Finding]:
    """Faults of boxes, labels, truncation, face_share_in_image, keypoints and, in turns, masks."""
    if "labels" in packed.others and (packed.others["labels"] < 0).any():
        labels = packed.others["labels"]
        yield from animal_findings(
            packed,
            labels < 0,
            check="labels",
            field="labels",
            problem=lambda n: f"must count from 0, got {labels[n]}",
        )
    if "boxes" in packed.floats:
        yield from _boxes(packed, packed.floats["boxes"])
    yield from _truncation(packed)
    if packed.keypoints is not None:
        yield from _keypoints(packed, packed.keypoints)
    if "masks" in packed.targets[0] and packed.step % 2 == 0:
        yield from _one_mask(packed)


def _boxes(packed: Packed, boxes: Floats) -> Iterator[Finding]:
    """Boxes (N, 4) without area, outside the frame, or apart from their cuboid."""
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
    if packed.all_in_front is None or packed.outline is None:
        return
    apart = (packed.outline[1] < boxes[:, :2]) | (packed.outline[0] > boxes[:, 2:])
    if apart.any():
        problem = "does not touch the projected cuboid: one of them is stale"
        yield from animal_findings(
            packed,
            apart.any(1) & packed.all_in_front & ~flat,
            check="boxes_on_cuboid",
            field="boxes",
            problem=lambda _: problem,
        )


def _flat_boxes(packed: Packed, boxes: Floats, flat: NDArray[np.bool_]) -> Iterator[Finding]:
    """Boxes without area: a warning where the animal left the picture, else a fault."""
    left_picture = _left_the_picture(packed, boxes)
    remedy = "drop it by the transforms' min_visible"
    yield from animal_findings(
        packed,
        left_picture,
        check="empty_box",
        field="boxes",
        problem=lambda n: (
            f"has no area, {boxes[n].tolist()}: its animal left the picture; {remedy}"
        ),
    )
    yield from animal_findings(
        packed,
        flat & ~left_picture,
        check="boxes",
        field="boxes",
        problem=lambda n: f"must be x1 < x2, y1 < y2, got {boxes[n].tolist()}",
    )


def _left_the_picture(packed: Packed, boxes: Floats) -> NDArray[np.bool_]:
    """Boxes (N,) without area on the frame's border, where clipping leaves those beyond it."""
    empty = boxes[:, 2:] == boxes[:, :2]
    if packed.frame is not None:
        empty &= (np.abs(boxes[:, :2] + 0.5) < EDGE_TOLERANCE_PX) | (
            np.abs(boxes[:, :2] - packed.frame) < EDGE_TOLERANCE_PX
        )
    return np.asarray(empty.any(1) & (boxes[:, 2:] >= boxes[:, :2]).all(1))


def _truncation(packed: Packed) -> Iterator[Finding]:
    """Truncations that no picture has, or that are not what the frame cuts off."""
    truncation = packed.floats.get("truncation")
    if truncation is not None:
        beyond = (truncation < 0) | (truncation > 1)
        if beyond.any():
            yield from animal_findings(
                packed,
                beyond,
                check="truncation",
                field="truncation",
                problem=lambda n: f"must lie in 0 to 1, got {truncation[n]}",
            )
    areas = _areas_inside(packed)
    if areas is not None:
        yield from _cut_off(packed, *areas)


def _cut_off(
    packed: Packed, decidable: NDArray[np.bool_], inside: Floats, whole: Floats
) -> Iterator[Finding]:
    """Truncations and shares in the image that are not what the frame cuts off.

    Args:
        packed: the targets.
        decidable: (N,) boxes that lie in front of the camera and show a face.
        inside: (N, 6) areas of the visible faces in the frame.
        whole: (N, 6) altogether.
    """
    truncation, in_image = packed.floats.get("truncation"), packed.floats.get("face_share_in_image")
    area_inside, area = inside.sum(1), whole.sum(1)
    if truncation is not None:
        expected = 1 - area_inside / np.maximum(area, 1e-9)
        allowed = SHARE_TOLERANCE + 1.0 / np.maximum(area, 1.0)  # rounding moves a few px^2 more
        wrong = (np.abs(truncation - expected) > allowed) & decidable
        if wrong.any():
            problem = "of the silhouette lies outside the frame: stale after a crop?"
            yield from animal_findings(
                packed,
                wrong,
                check="truncation",
                field="truncation",
                problem=lambda n: f"is {truncation[n]:.4f}, but {expected[n]:.4f} {problem}",
            )
    if in_image is not None:
        off = np.abs(in_image * area_inside[:, None] - inside)
        wrong = (off > 1.0 + SHARE_TOLERANCE * area_inside[:, None]).any(1) & decidable
        if wrong.any():
            problem = "is not that of the faces' parts in the frame: stale after a crop?"
            yield from animal_findings(
                packed,
                wrong,
                check="share_in_image",
                field="face_share_in_image",
                problem=lambda _: problem,
            )


def _areas_inside(packed: Packed) -> tuple[NDArray[np.bool_], Floats, Floats] | None:
    """The areas of boxes' visible faces in the frame and altogether, where they are decidable.

    Returns:
        (N,) whether a box lies in front of the camera and shows a face, and the two areas (N, 6);
        None without the fields.
    """
    visible, whole = packed.others.get("face_visible"), packed.quad_areas
    if (
        visible is None
        or whole is None
        or packed.all_in_front is None
        or packed.frame is None
        or packed.outline is None
    ):
        return None
    px, frame = packed.floats["corners_2d"], packed.frame
    whole = whole * visible
    low, high = packed.outline
    cut = (outside_frame(low, frame) | outside_frame(high, frame)) & packed.all_in_front
    inside = whole
    if cut.any():
        inside = whole.copy()
        rows, faces = np.nonzero(visible & cut[:, None])
        frames = np.concatenate((np.full_like(frame, -0.5), frame), axis=1)[rows]
        inside[rows, faces] = area_in_box(px[rows[:, None], QUADS[faces]], frames)
    return packed.all_in_front & visible.any(1), inside, whole


def _keypoints(packed: Packed, keypoints: Floats) -> Iterator[Finding]:
    """Keypoints (N, J, 3) of negative visibility, and marked ones outside the frame."""
    v = keypoints[..., 2]
    if v.min(initial=0.0) < 0:
        yield from animal_findings(
            packed,
            (v < 0).any(1),
            check="keypoints",
            field="keypoints",
            problem=lambda n: "have a negative visibility: unknown is 0",
        )
    if packed.frame is None:
        return
    frame = packed.frame[:, None]
    outside = outside_frame(keypoints[..., :2], frame, EDGE_TOLERANCE_PX) & (v > 0)
    if outside.any():
        yield from animal_findings(
            packed,
            outside.any(1),
            check="keypoints",
            field="keypoints",
            problem=lambda n: (
                f"{np.flatnonzero(outside[n]).tolist()} are marked, but lie outside the frame"
            ),
        )


def _one_mask(packed: Packed) -> Iterator[Finding]:
    """Faults of the mask of one animal, another one at each even step.

    Reading all of them would cost more than everything else.
    """
    if packed.count == 0:
        return
    n = packed.step // 2 % packed.count
    target = int(packed.owner[n])
    mask = as_numpy(packed.targets[target]["masks"][n - int(packed.first[target])])
    rows = np.arange(packed.count) == n
    problem = _mask_problem(packed, mask, n, target)
    if problem is not None:
        yield from animal_findings(
            packed, rows, check="masks", field="masks", problem=lambda _: problem
        )


def _mask_problem(packed: Packed, mask: Any, n: int, target: int) -> str | None:
    """The fault of the mask of animal n of a target, if there is one."""
    if packed.image_hw is not None and mask.shape != tuple(packed.image_hw[target]):
        hw = tuple(packed.image_hw[target].tolist())
        return f"cover {mask.shape}, but the image is {hw}"
    if mask.dtype != np.bool_ and mask.max(initial=0) > 1:
        return f"must be 0 and 1, got up to {mask.max()}"
    if "boxes" not in packed.floats:
        return None
    x1, y1, x2, y2 = packed.floats["boxes"][n]
    left, top = (max(int(np.floor(edge - MASK_MARGIN_PX)), 0) for edge in (x1, y1))
    right, bottom = (max(int(np.ceil(edge + MASK_MARGIN_PX)) + 1, 0) for edge in (x2, y2))
    bits = mask.view(np.bool_)
    beyond = int(np.count_nonzero(bits)) - int(np.count_nonzero(bits[top:bottom, left:right]))
    return f"has {beyond} pixels outside its box: one of them is stale" if beyond else None

"""Checks against the picture: 2D boxes, truncation, what the frame cuts off, keypoints, masks."""

from collections.abc import Iterator

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
    """What is wrong with boxes, labels, truncation, face_share_in_image, keypoints and, in turns,
    masks."""
    if "labels" in packed.others and (packed.others["labels"] < 0).any():
        labels = packed.others["labels"]
        yield from animal_findings(
            packed, labels < 0, "labels", "labels", lambda n: f"must count from 0, got {labels[n]}"
        )
    if "boxes" in packed.floats:
        yield from _boxes(packed, packed.floats["boxes"])
    yield from _truncation(packed)
    if packed.keypoints is not None:
        yield from _keypoints(packed, packed.keypoints)
    if "masks" in packed.targets[0] and packed.step % 2 == 0:
        yield from _one_mask(packed)


def _boxes(packed: Packed, boxes: Floats) -> Iterator[Finding]:
    flat = boxes[:, 2:] <= boxes[:, :2]
    if flat.any():
        left = _left_the_picture(packed, boxes)
        said = "drop it by the transforms' min_visible"
        yield from animal_findings(
            packed,
            left,
            "empty_box",
            "boxes",
            lambda n: f"has no area, {boxes[n].tolist()}: its animal left the picture; {said}",
        )
        wrong = flat.any(1) & ~left
        yield from animal_findings(
            packed,
            wrong,
            "boxes",
            "boxes",
            lambda n: f"must be x1 < x2, y1 < y2, got {boxes[n].tolist()}",
        )
    if packed.frame is not None:
        corners = boxes.reshape(-1, 2, 2)
        outside = outside_frame(corners, packed.frame[:, None], EDGE_TOLERANCE_PX).any(1)
        if outside.any():
            remedy = "clip it to [-0.5, W - 0.5]"
            yield from animal_findings(
                packed,
                outside,
                "boxes_in_frame",
                "boxes",
                lambda n: f"leaves the frame: {boxes[n].tolist()}; {remedy}",
            )
    if packed.all_in_front is None or packed.outline is None:
        return
    apart = (packed.outline[1] < boxes[:, :2]) | (packed.outline[0] > boxes[:, 2:])
    if apart.any():
        apart = apart.any(1) & packed.all_in_front & ~flat.any(1)
        problem = "does not touch the projected cuboid: one of them is stale"
        yield from animal_findings(packed, apart, "boxes_on_cuboid", "boxes", lambda _: problem)


def _left_the_picture(packed: Packed, boxes: Floats) -> NDArray[np.bool_]:
    """Boxes (N,) without area that lie on the frame's border, where clipping leaves what is
    outside."""
    empty = boxes[:, 2:] == boxes[:, :2]
    if packed.frame is not None:
        empty &= (np.abs(boxes[:, :2] + 0.5) < EDGE_TOLERANCE_PX) | (
            np.abs(boxes[:, :2] - packed.frame) < EDGE_TOLERANCE_PX
        )
    return np.asarray(empty.any(1) & (boxes[:, 2:] >= boxes[:, :2]).all(1))


def _truncation(packed: Packed) -> Iterator[Finding]:
    truncation, in_image = packed.floats.get("truncation"), packed.floats.get("face_share_in_image")
    if truncation is not None:
        beyond = (truncation < 0) | (truncation > 1)
        if beyond.any():
            yield from animal_findings(
                packed,
                beyond,
                "truncation",
                "truncation",
                lambda n: f"must lie in 0 to 1, got {truncation[n]}",
            )
    seen = _areas_inside(packed)
    if seen is None:
        return
    asked, inside, whole = seen
    kept, total = inside.sum(1), whole.sum(1)
    if truncation is not None:
        expected = 1 - kept / np.maximum(total, 1e-9)
        wrong = (
            np.abs(truncation - expected) > SHARE_TOLERANCE + 1.0 / np.maximum(total, 1.0)
        ) & asked  # of a few px^2, rounding moves more
        if wrong.any():
            problem = "of the silhouette lies outside the frame: stale after a crop?"
            yield from animal_findings(
                packed,
                wrong,
                "truncation",
                "truncation",
                lambda n: f"is {truncation[n]:.4f}, but {expected[n]:.4f} {problem}",
            )
    if in_image is not None:
        off = np.abs(in_image * kept[:, None] - inside)
        wrong = (off > 1.0 + SHARE_TOLERANCE * kept[:, None]).any(1) & asked
        if wrong.any():
            problem = "is not that of the faces' parts in the frame: stale after a crop?"
            yield from animal_findings(
                packed, wrong, "share_in_image", "face_share_in_image", lambda _: problem
            )


def _areas_inside(packed: Packed) -> tuple[NDArray[np.bool_], Floats, Floats] | None:
    """Which boxes can be asked (N,), and the areas (N, 6) of their visible faces in the frame and
    altogether; None without the fields."""
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
    v = keypoints[..., 2]
    if v.min(initial=0.0) < 0:
        yield from animal_findings(
            packed,
            (v < 0).any(1),
            "keypoints",
            "keypoints",
            lambda n: "have a negative visibility: unknown is 0",
        )
    if packed.frame is None:
        return
    frame = packed.frame[:, None]
    outside = outside_frame(keypoints[..., :2], frame, EDGE_TOLERANCE_PX) & (v > 0)
    if outside.any():
        yield from animal_findings(
            packed,
            outside.any(1),
            "keypoints",
            "keypoints",
            lambda n: (
                f"{np.flatnonzero(outside[n]).tolist()} are marked, but lie outside the frame"
            ),
        )


def _one_mask(packed: Packed) -> Iterator[Finding]:
    """The mask of one animal, another one at each even step.

    Reading all of them would cost more than everything else.
    """
    if packed.count == 0:
        return
    n = packed.step // 2 % packed.count
    target = int(packed.owner[n])
    mask = as_numpy(packed.targets[target]["masks"][n - int(packed.first[target])])
    chosen = np.arange(packed.count) == n
    if packed.image_hw is not None and mask.shape != tuple(packed.image_hw[target]):
        hw = tuple(packed.image_hw[target].tolist())
        yield from animal_findings(
            packed, chosen, "masks", "masks", lambda _: f"cover {mask.shape}, but the image is {hw}"
        )
        return
    if mask.dtype != np.bool_ and mask.max(initial=0) > 1:
        yield from animal_findings(
            packed, chosen, "masks", "masks", lambda _: f"must be 0 and 1, got up to {mask.max()}"
        )
        return
    if "boxes" not in packed.floats:
        return
    x1, y1, x2, y2 = packed.floats["boxes"][n]
    left, top = (max(int(np.floor(edge - MASK_MARGIN_PX)), 0) for edge in (x1, y1))
    right, bottom = (max(int(np.ceil(edge + MASK_MARGIN_PX)) + 1, 0) for edge in (x2, y2))
    bits = mask.view(np.bool_)
    beyond = int(np.count_nonzero(bits)) - int(np.count_nonzero(bits[top:bottom, left:right]))
    if beyond:
        yield from animal_findings(
            packed,
            chosen,
            "masks",
            "masks",
            lambda _: f"has {beyond} pixels outside its box: one of them is stale",
        )

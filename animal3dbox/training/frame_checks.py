"""Checks against the picture: truncation, shares in the frame, keypoints."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.cuboid import FACES
from animal3dbox.geometry.polygon import area_in_box
from animal3dbox.training.box_checks import EDGE_TOLERANCE_PX
from animal3dbox.training.findings import Finding
from animal3dbox.training.frames import outside_frame
from animal3dbox.training.packed import Floats, Packed
from animal3dbox.training.places import animal_findings

QUADS = np.array(list(FACES.values()))
SHARE_TOLERANCE = 1e-3


def frame_findings(packed: Packed) -> Iterator[Finding]:
    """Faults of truncation, face_share_in_image and keypoints."""
    yield from _truncation(packed)
    if packed.keypoints is not None:
        yield from _keypoints(packed, packed.keypoints)


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

"""The fields of an Omni3D annotation beside its box that say where the box is in the picture.

A box behind the camera that says it is in front has another library's axes; a 2D box beside the
projected one belongs to another image, or K does.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from animal3dbox.datasets.readers.cuboid_checks import overlap, share_inside
from animal3dbox.datasets.readers.cuboid_conventions import Convention, Floats
from animal3dbox.datasets.readers.omni3d.elements import StatedBox, box_2d
from animal3dbox.datasets.readers.omni3d.layout import Problem
from animal3dbox.datasets.readers.visible_boxes import VisibleBoxes, visible_boxes
from animal3dbox.datasets.records import CuboidRecord
from animal3dbox.errors import SampleError

LEAST_OVERLAP = 0.5
"""Least overlap of bbox2D_proj and bbox2D_trunc with the projected box."""
LIKELY_OVERLAP = 0.8
"""Overlap from which on a likely cause is named."""
MIRRORED = (
    ((1.0, -1.0, 1.0), "axes with y up"),
    ((-1.0, -1.0, 1.0), "PyTorch3D's axes (x left, y up)"),
    ((-1.0, 1.0, 1.0), "axes with x left"),
)
"""Signs of the camera's axes that others write, and their words."""
LEAST_SHARE = 0.5
"""Least part of bbox2D_tight that lies in the projected box: a visible part of a thing does."""


def behind_camera_problems(boxes: Sequence[StatedBox]) -> dict[int, Problem]:
    """Index -> field and problem, of boxes that lie behind the camera against what the file says.

    Omni3D's z points forward. A file all of whose boxes lie at negative z, and that does not say
    they are behind the camera, has axes of OpenGL: y up, z backward.
    """
    behind = [_is_behind(box) for box in boxes]
    is_opengl = all(behind)
    problems: dict[int, Problem] = {}
    for index, box in enumerate(boxes):
        stated = box.annotation.behind_camera
        if not behind[index] or stated in (True, 1) or (stated in (None, -1) and not is_opengl):
            continue
        said = "" if stated in (None, -1) else ", but behind_camera is false"
        cause = (
            f", as are all {len(boxes)} boxes of the file: these look like OpenGL's axes (y up, z"
            " backward); negate y and z of center_cam and bbox3D_cam and the last two rows of R_cam"
            if is_opengl
            else ": z must point forward, or behind_camera be true"
        )
        problems[index] = (
            "center_cam",
            f"has z = {box.center[2]:.4g}, behind the camera{said}{cause}",
        )
    return problems


def all_behind_note(boxes: Sequence[StatedBox]) -> tuple[str, ...]:
    """A sentence on a file that says of each of its boxes that it is behind the camera, if so."""
    if not boxes or not all(
        _is_behind(box) and box.annotation.behind_camera in (True, 1) for box in boxes
    ):
        return ()
    return (
        f"all {len(boxes)} boxes lie behind the camera and say so: no image shows any of them; see"
        " whether z points forward",
    )


def _is_behind(box: StatedBox) -> bool:
    """Whether a box lies behind the camera as a whole; of one without corners, its centre."""
    depths = box.corners[:, 2]
    return bool(box.center[2] < 0 and not (depths > 0).any())


def with_consistent_boxes_2d(
    records: Sequence[tuple[int, CuboidRecord]], boxes: Sequence[StatedBox], convention: Convention
) -> tuple[list[CuboidRecord], list[SampleError]]:
    """The records whose 2D boxes, if any, are where K projects the box; others are errors.

    Args:
        records: each with its index among the boxes.
        boxes: of the file.
        convention: of the file.

    """
    visible = visible_boxes([record for _, record in records])
    consistent, faults = [], []
    for number, (index, record) in enumerate(records):
        try:
            _check_boxes_2d(record, boxes[index], _round(visible, number), convention)
        except SampleError as error:
            faults.append(error)
        else:
            consistent.append(record)
    return consistent, faults


def _likely_cause(record: CuboidRecord, stated: Floats, projections: Sequence[Floats]) -> str:
    """Words on why a stated 2D box (4,) is elsewhere: other axes, a larger picture, or unknown."""
    for signs, axes in MIRRORED:
        turn = np.array(signs)
        # Of a mirrored box the axis to its left is turned back, which its outline does not show.
        rotation = turn[:, None] * record.rotation * [1, turn.prod(), 1]
        turned = replace(record, center=turn * record.center, rotation=rotation)
        if max(_overlaps(stated, _round(visible_boxes([turned]), 0))) >= LIKELY_OVERLAP:
            return f"it would fit in {axes} of the camera; Omni3D's are x right, y down, z forward"
    first = np.array([0.5, 0.5, 0.5, 0.5])  # the image's corner, from which pictures are scaled
    for projected in projections:
        factor = float((stated[2] - stated[0]) / (projected[2] - projected[0]))
        if overlap((stated + first) / factor - first, projected) >= LIKELY_OVERLAP:
            return (
                f"it would fit a picture {factor:.3g} times as large: K or the image size is wrong"
            )
    return "K, the image size or the box belongs to another image"


def _overlaps(stated: Floats, projections: Sequence[Floats]) -> list[float]:
    return [0.0, *(overlap(stated, projected) for projected in projections)]


def _round(visible: VisibleBoxes, number: int) -> list[Floats]:
    """The upright boxes (4,) round a projection, whole and in the frame, that there are."""
    return [
        box
        for box in (visible.projected[number], visible.in_frame[number])
        if not np.isnan(box).any()
    ]


def _check_boxes_2d(
    record: CuboidRecord, box: StatedBox, projections: Sequence[Floats], convention: Convention
) -> None:
    """Raise a SampleError for a stated 2D box that is not where K projects the box."""
    if not projections:
        return
    for field in ("bbox2D_proj", "bbox2D_trunc"):
        stated = box_2d(getattr(box.annotation, field), record.sample_id, field, convention)
        if stated is None:
            continue
        found = max(_overlaps(stated, projections))
        if found < LEAST_OVERLAP:
            raise SampleError(
                record.sample_id,
                field,
                f"is not where K projects bbox3D_cam (overlap {found:.2f}):"
                f" {_likely_cause(record, stated, projections)}",
            )
    if record.box is None:
        return
    inside = max(share_inside(record.box, projected) for projected in projections)
    if inside < LEAST_SHARE:
        raise SampleError(
            record.sample_id,
            "bbox2D_tight",
            f"lies beside the projected bbox3D_cam ({inside:.0%} of it inside): the 2D box is"
            " another animal's, or x, y, w, h; or K or the 3D box belongs to another image",
        )

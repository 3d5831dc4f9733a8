"""The names of a box's sides, where an Omni3D file of animals tells them in keys of its own.

Follow-ups of the format lock faces: {"front": 3, "top": 0, "left": 4}, of 0 -Y, 1 +Y, 2 -X, 3 +X,
4 +Z, 5 -Z along R_cam's columns. Or they give heading_alpha, the angle at which the camera sees the
animal walk (allocentric, in radians), with heading_valid. It is taken for KITTI's alpha: heading =
heading_alpha + atan2(x, z), 0 along the camera's x, pi / 2 towards the camera. That was not tried
on a published file, so it must agree with most boxes' sides before it names any.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import Floats
from animal3dbox.datasets.readers.omni3d.elements import StatedBox
from animal3dbox.datasets.records import CuboidRecord
from animal3dbox.errors import SampleError

FACES = ((1, -1), (1, 1), (0, -1), (0, 1), (2, 1), (2, -1))
"""Axis and sign of the outward normal of faces 0 to 5."""
LOCKS = ("front", "top", "left")
"""Faces that may be locked, by our names."""
GREATEST_TURN = np.deg2rad(45)
"""Greatest angle between a heading and the end of the box that it names."""
LEAST_AGREEING = 0.8
"""Least part of a file's headings that must point along their boxes, for any to count."""

Named = tuple[int, CuboidRecord]
"""A record with its index among the file's boxes."""


def with_named_faces(
    records: Sequence[Named], boxes: Sequence[StatedBox]
) -> tuple[list[Named], list[SampleError], list[str]]:
    """The records, those whose file tells their front turned to it; errors; and notes.

    Args:
        records: each with its index among the boxes, in our frames.
        boxes: of the file.

    """
    named: list[Named] = []
    faults: list[SampleError] = []
    counts: Counter[str] = Counter()
    headings = {index: _heading(boxes[index], record) for index, record in records}
    are_believed = _agree([(headings[index], record) for index, record in records])
    for index, record in records:
        heading = headings[index]
        try:
            if boxes[index].annotation.face_locks:
                record = _locked(record, boxes[index])
                counts["locks"] += 1
            elif heading is not None:
                turned = _turned(record, heading) if are_believed else None
                counts["headings" if turned is not None else "beside"] += 1
                record = record if turned is None else turned
        except SampleError as error:
            faults.append(error)
            continue
        named.append((index, record))
    return named, faults, _notes(counts)


def _notes(counts: Counter[str]) -> list[str]:
    texts = {
        "locks": "boxes have their sides named by the file's face_locks",
        "headings": "boxes have their front by heading_alpha, taken for KITTI's alpha (unverified)",
        "beside": (
            "boxes have a heading_alpha that does not point along them (as KITTI's alpha, like most"
            " of the file's): their sides are not named by it"
        ),
    }
    return [f"{counts[kind]} {text}" for kind, text in texts.items() if counts[kind]]


def _locked(record: CuboidRecord, box: StatedBox) -> CuboidRecord:
    """A record whose axes are the locked faces'; raises SampleError."""
    stated = box.annotation.face_locks or {}
    locks = {name: face for name, face in stated.items() if face is not None and face != -1}
    unknown = [name for name in locks if name not in LOCKS]
    if unknown or any(face not in range(len(FACES)) for face in locks.values()):
        raise SampleError(
            record.sample_id,
            "face_locks",
            f"must give {', '.join(LOCKS)} as faces 0 to 5, got {locks}",
        )
    if np.isnan(box.rotation).any():
        raise SampleError(record.sample_id, "face_locks", "need R_cam, whose columns they count")
    if "front" not in locks:
        raise SampleError(record.sample_id, "face_locks", f"must give the front, got {locks}")
    normals = {name: _normal(box.rotation, face) for name, face in locks.items()}
    forward = normals["front"]
    up = normals.get("top", record.rotation[:, 2])
    if "top" not in normals and "left" in normals:
        up = np.cross(forward, normals["left"])
    if abs(float(forward @ up)) > 0.5 or float(np.linalg.norm(up)) < 0.5:
        raise SampleError(
            record.sample_id, "face_locks", f"has two names for one axis of the box, got {locks}"
        )
    left = np.cross(up, forward)
    if "left" in normals and float(left @ normals["left"]) < 0.5:
        raise SampleError(
            record.sample_id,
            "face_locks",
            f"front, top and left are no right-handed frame, got {locks}: left and right are"
            " exchanged, or an axis is named twice",
        )
    return _along(record, np.stack((forward, left, up), axis=1))


def _normal(rotation: Floats, face: int) -> Floats:
    """The outward normal (3,) of a face by its number, in the camera frame."""
    axis, sign = FACES[face]
    return np.asarray(sign * rotation[:, axis])


def _along(record: CuboidRecord, rotation: Floats) -> CuboidRecord:
    """The same box with other axes of its own as forward, left, up, and known sides."""
    size = np.abs(rotation.T @ record.rotation).round() @ record.size
    return replace(record, rotation=rotation, size=size, heading_known=True)


def _heading(box: StatedBox, record: CuboidRecord) -> Floats | None:
    """The stated direction (3,) of an animal's heading, in the camera's level; None without."""
    annotation = box.annotation
    alpha = annotation.heading_alpha
    if alpha is None or annotation.heading_valid in (False, 0):
        return None
    yaw = alpha + float(np.arctan2(record.center[0], record.center[2]))
    return np.array([np.cos(yaw), 0.0, -np.sin(yaw)])


def _agree(headings: Sequence[tuple[Floats | None, CuboidRecord]]) -> bool:
    """Whether most of a file's headings point along their boxes."""
    stated = [(heading, record) for heading, record in headings if heading is not None]
    along = [_turned(record, heading) is not None for heading, record in stated]
    return bool(along) and sum(along) >= LEAST_AGREEING * len(along)


def _turned(record: CuboidRecord, heading: Floats) -> CuboidRecord | None:
    """A record whose length's end towards a heading is its front; None if it runs across."""
    forward = record.rotation[:, 0] * [1.0, 0.0, 1.0]
    cosine = float(forward @ heading) / max(float(np.linalg.norm(forward)), 1e-9)
    if abs(cosine) < np.cos(GREATEST_TURN):
        return None
    turn = np.diag([1.0, 1, 1]) if cosine > 0 else np.diag([-1.0, -1, 1])
    return _along(record, record.rotation @ turn)

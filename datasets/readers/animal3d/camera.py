"""Which camera an Animal3D copy's bodies were fitted for, found out by projecting them, and what
else they tell."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]

FRAMES = {
    "x right, y down, z forward": (1.0, 1.0, 1.0),
    "x left, y up, z forward": (-1.0, -1.0, 1.0),
    "x right, y up, z backward": (1.0, -1.0, -1.0),
}
"""Camera frames in use (OpenCV, PyTorch3D, OpenGL), and the signs that turn their axes to ours."""
SAMPLES = 60
"""So many animals are asked."""
CLOSE = 0.15
"""A frame is believed if the median animal's keypoints lie within so much of their own extent of
the projected body."""
SAME = 0.01
"""Stored 3D keypoints differ from the body's if they are off by more than this part of their
extent, up to a translation."""

NO_FOCAL = "the dataset's own camera is not used: there is no focal length to project by"
NO_FRAME = (
    "the pose of the dataset's own camera is not used: in no known frame do its bodies project onto"
    " their keypoints; its focal length is used (but for images with one in their EXIF header): if"
    " it is wrong, boxes lie too near or too far, and `animal3dbox inspect` tells another that fits"
)


def stored_camera(
    records: Sequence[AnimalRecord],
    bodies: ParametersBody,
    keypoints_3d: Mapping[str, NDArray[np.float64]],
) -> tuple[Pose | None, tuple[str, ...]]:
    """The pose X_cam = R X + t of the dataset's own camera, X a vertex of its bodies, trans included.

    Args:
        records: with K, or there is nothing to project by.
        bodies: their fitted bodies.
        keypoints_3d: sample id -> (26, 3) as stored, to compare with the bodies' own.

    Returns:
        The pose, None if no frame agrees with the keypoints, and what was found, in whole
        sentences.

    """
    off: dict[str, list[float]] = {name: [] for name in FRAMES}
    wrong = compared = 0
    fitted = [record for record in records if record.sample_id in bodies.parameters]
    for record in fitted[:: max(1, len(fitted) // SAMPLES)]:
        try:
            landmarks = bodies.body(record).landmarks
        except SampleError:
            continue  # it is reported when the animal is labelled
        if record.sample_id in keypoints_3d:
            compared += 1
            wrong += _differs(keypoints_3d[record.sample_id], landmarks)
        for name, signs in FRAMES.items():
            off[name].append(_misfit(landmarks * signs, record))
    medians = {name: float(np.median(values)) for name, values in off.items() if values}
    notes = [_about_keypoints(wrong, compared)] if wrong else []
    best = min(medians, key=lambda name: medians[name], default=None)
    if best is None or not medians[best] < CLOSE:
        return None, (*notes, NO_FOCAL if all(record.K is None for record in fitted) else NO_FRAME)
    notes.append(
        f"the bodies' camera frame is {best}: projected, they are off by {100 * medians[best]:.1f}"
        " % of the keypoints' extent (median)"
    )
    return (np.diag(FRAMES[best]), np.zeros(3)), tuple(notes)


def _about_keypoints(wrong: int, compared: int) -> str:
    return (
        f"keypoint_3d differs from the posed body in {wrong} of {compared} animals compared; the"
        " body's own are used"
    )


def _misfit(landmarks_cam: NDArray[np.float64], record: AnimalRecord) -> float:
    """Median distance of projected landmarks (J, 3) from the marked keypoints by their extent.

    Inf behind the camera or without any.
    """
    marked = (record.keypoints_2d[:, 2] > 0) & np.isfinite(landmarks_cam).all(axis=1)
    if record.K is None or marked.sum() < 4 or not (landmarks_cam[marked, 2] > 0).all():
        return float("inf")
    points = landmarks_cam[marked] @ record.K.T
    px, said = points[:, :2] / points[:, 2:], record.keypoints_2d[marked, :2]
    extent = float(np.ptp(said, axis=0).max())
    return (
        float(np.median(np.linalg.norm(px - said, axis=1))) / extent if extent > 0 else float("inf")
    )


def _differs(stored: NDArray[np.float64], own: NDArray[np.float64]) -> bool:
    """Whether stored landmarks (26, 3) are not the body's own, wherever both stand."""
    if stored.shape != own.shape or not np.isfinite(stored).all():
        return True
    known = np.isfinite(own).all(axis=1)
    a, b = (points[known] - points[known].mean(axis=0) for points in (stored, own))
    return bool(np.abs(a - b).max() > SAME * np.ptp(b, axis=0).max())

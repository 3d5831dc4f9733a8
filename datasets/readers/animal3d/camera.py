"""The camera that an Animal3D copy's bodies were fitted for, found by projecting the bodies.

The files do not say in which camera frame the bodies stand. Each frame in use is tried on a sample
of animals, and the one whose projections meet the keypoints is believed.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""R (3, 3) and t (3,) of X_cam = R X + t."""

FRAMES = {
    "x right, y down, z forward": (1.0, 1.0, 1.0),
    "x left, y up, z forward": (-1.0, -1.0, 1.0),
    "x right, y up, z backward": (1.0, -1.0, -1.0),
}
"""Camera frames in use (OpenCV, PyTorch3D, OpenGL), and the signs that turn their axes to ours."""
SAMPLES = 60
"""Number of animals on which the frames are tried."""
CLOSE = 0.15
"""Greatest distance of the median animal's keypoints from the projected body, by their extent.

A frame with a greater one is not believed.
"""
SAME = 0.01
"""Greatest distance of stored 3D keypoints from the body's own, by their extent.

Those that are farther off, up to a translation, differ.
"""

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
    """The pose of the dataset's own camera, X_cam = R X + t with X a vertex of its bodies.

    The bodies' trans is part of X.

    Args:
        records: with K, or there is nothing to project by.
        bodies: their fitted bodies.
        keypoints_3d: sample id -> (26, 3) as stored, to compare with the bodies' own.

    Returns:
        The pose, None if no frame agrees with the keypoints, and notes for the report, in whole
        sentences.

    """
    misfits: dict[str, list[float]] = {name: [] for name in FRAMES}
    different = compared = 0
    with_body = [
        record
        for record in records
        if record.sample_id in bodies.parameters and record.K is not None
    ]
    for record in with_body[:: max(1, len(with_body) // SAMPLES)]:
        try:
            landmarks = bodies.body(record).landmarks
        except SampleError:
            continue  # it is reported when the animal is labelled
        if record.sample_id in keypoints_3d:
            compared += 1
            different += landmarks_differ(keypoints_3d[record.sample_id], landmarks)
        for name, signs in FRAMES.items():
            misfits[name].append(keypoint_misfit(landmarks * signs, record))
    medians = {name: float(np.median(values)) for name, values in misfits.items() if values}
    notes = [_keypoint_note(different, compared)] if different else []
    best = min(medians, key=lambda name: medians[name], default=None)
    if best is None or not medians[best] < CLOSE:
        return None, (*notes, NO_FRAME if with_body else NO_FOCAL)
    notes.append(
        f"the bodies' camera frame is {best}: projected, they are off by {100 * medians[best]:.1f}"
        " % of the keypoints' extent (median)"
    )
    return (np.diag(FRAMES[best]), np.zeros(3)), tuple(notes)


def _keypoint_note(different: int, compared: int) -> str:
    """A sentence on stored 3D keypoints that are not the bodies' own."""
    return (
        f"keypoint_3d differs from the posed body in {different} of {compared} animals compared;"
        " the body's own are used"
    )


def keypoint_misfit(landmarks_cam: NDArray[np.float64], record: AnimalRecord) -> float:
    """Median distance of projected landmarks (J, 3) from the marked keypoints, by their extent.

    Infinite if a landmark lies behind the camera, or too few keypoints are marked.
    """
    marked = (record.keypoints_2d[:, 2] > 0) & np.isfinite(landmarks_cam).all(axis=1)
    if record.K is None or marked.sum() < 4 or not (landmarks_cam[marked, 2] > 0).all():
        return float("inf")
    points = landmarks_cam[marked] @ record.K.T
    px, keypoints = points[:, :2] / points[:, 2:], record.keypoints_2d[marked, :2]
    extent = float(np.ptp(keypoints, axis=0).max())
    if extent <= 0:
        return float("inf")
    return float(np.median(np.linalg.norm(px - keypoints, axis=1))) / extent


def landmarks_differ(file_points: NDArray[np.float64], own: NDArray[np.float64]) -> bool:
    """Whether a file's landmarks (26, 3) have another form than the body's own, up to a shift.

    Those that are NaN on either side tell nothing.
    """
    if file_points.shape != own.shape:
        return True
    on_body = np.isfinite(own).all(axis=1) & np.isfinite(file_points).all(axis=1)
    if not on_body.any():
        return True
    a, b = (points[on_body] - points[on_body].mean(axis=0) for points in (file_points, own))
    return bool(np.abs(a - b).max() > SAME * np.ptp(b, axis=0).max())

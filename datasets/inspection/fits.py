"""Fits of a file's 2D and 3D points to its keypoints.

The files do not say for which picture, camera frame and translation their points are, so the
simplest relation is looked for under which they meet the marked keypoints.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.inspection.animal3d_entries import points_of
from animal3dbox.datasets.inspection.measures import least_squares_scale, residual, spread
from animal3dbox.datasets.inspection.result import CameraFit, PictureFit, Residual
from animal3dbox.datasets.readers.animal3d.camera import CLOSE, FRAMES
from animal3dbox.datasets.records import AnimalRecord

Points = NDArray[np.float64]
"""Points (N, 2) or (N, 3)."""
ANIMALS = 200
"""Number of animals that are compared."""
LEAST = 6
"""Least number of points of an animal that is compared."""
AS_GOOD = 1.5
"""A simpler relation is believed if its residual is at most so many times that of the freest."""
CERTAIN = 0.5
"""A simpler relation is believed, too, if its residual is below this percentage."""
FREER = ("scaled", "scaled and shifted")
"""Relations of points to keypoints that have parameters, the simpler one first."""
LISTED = 3
"""Number of cameras of each target that an inspection lists."""


@dataclass(frozen=True)
class Subject:
    """An animal whose stored points are fitted, with its entry and its posed body.

    Attributes:
        entry: the file's entry, as it stands.
        record: the entry as it was read.
        landmarks: (26, 3) of the posed body, trans included; None without a model or parameters.
    """

    entry: Mapping[str, Any]
    record: AnimalRecord
    landmarks: Points | None

    @property
    def trans(self) -> Points:
        """The body's translation (3,); 0 if the file has none."""
        trans = self.entry.get("trans")
        return np.array(
            trans if isinstance(trans, list) and len(trans) == 3 else (0.0, 0.0, 0.0),
            dtype=np.float64,
        )

    @property
    def marked(self) -> NDArray[np.bool_]:
        """Whether each keypoint is marked, (26,)."""
        return np.asarray(self.record.keypoints_2d[:, 2] > 0)


def _marks(subject: Subject) -> Points:
    """The keypoints (26, 2) of an animal; NaN where they are not marked."""
    return np.where(subject.marked[:, None], subject.record.keypoints_2d[:, :2], np.nan)


def picture_fit(subjects: Sequence[Subject], key: str) -> PictureFit | None:
    """The picture that a key's 26 points are for; None if too few animals have them.

    Args:
        subjects: the animals.
        key: of 2D points in the file.

    """
    pairs = _pairs_of_key(subjects, key)
    as_stored = residual(pairs)
    if as_stored is None:
        return None
    # marks ≈ scale · points + shift, in pixels counted from the image's corner, about which a
    # resize scales
    fits = {
        name: [
            least_squares_scale(points + 0.5, marks + 0.5, name != "scaled")
            for points, marks in pairs
        ]
        for name in FREER
    }
    residuals = {"as stored": as_stored}
    for name, scales_and_shifts in fits.items():
        after_fit = residual(
            [
                (scale * (points + 0.5) + shift - 0.5, marks)
                for (scale, shift), (points, marks) in zip(scales_and_shifts, pairs, strict=True)
            ]
        )
        if after_fit is not None:
            residuals[name] = after_fit
    relation = _simplest_relation(residuals)
    if relation not in fits:
        return PictureFit(
            key=key, relation=relation, residuals=residuals, scale=None, shift_px=None
        )
    # From the image into the key's picture.
    inverse = [(1 / scale, -shift / scale) for scale, shift in fits[relation]]
    shift_px = np.median([shift for _, shift in inverse], axis=0)
    return PictureFit(
        key=key,
        relation=relation,
        residuals=residuals,
        scale=float(np.median([scale for scale, _ in inverse])),
        shift_px=[float(value) for value in shift_px],
    )


def _pairs_of_key(subjects: Sequence[Subject], key: str) -> list[tuple[Points, Points]]:
    """A key's points (N, 2) and the keypoints marked there (N, 2), of each animal with enough."""
    pairs = []
    for subject in spread(subjects, ANIMALS):
        points, marked = points_of(subject.entry, key), subject.marked
        if points is not None and len(points) == len(marked) and marked.sum() >= LEAST:
            pairs.append((points[marked, :2], subject.record.keypoints_2d[marked, :2]))
    return pairs


def _simplest_relation(residuals: Mapping[str, Residual]) -> str:
    """The first relation that is as good as the freest one; "none" if even that is not close."""
    best = residuals["scaled and shifted"].median_percent
    if best >= 100 * CLOSE:
        return "none"
    limit = max(AS_GOOD * best, CERTAIN)
    return next((name for name, one in residuals.items() if one.median_percent <= limit), "none")


def camera_fits(subjects: Sequence[Subject]) -> list[CameraFit]:
    """The best cameras for each target, of all points with and without trans in all frames."""
    fits: list[CameraFit] = []
    sampled = spread(subjects, ANIMALS)
    for target, target_of in TARGETS.items():
        candidates = [
            fit
            for name, points_3d in POINTS.items()
            for frame in FRAMES
            if (fit := _camera_fit(sampled, (name, points_3d), frame, (target, target_of)))
            is not None
        ]
        fits += sorted(candidates, key=lambda fit: fit.free.median_percent)[:LISTED]
    return fits


def _camera_fit(
    subjects: Sequence[Subject],
    points_3d: tuple[str, "PointsOf"],
    frame: str,
    target: tuple[str, "PointsOf"],
) -> CameraFit | None:
    """The cameras that fit points in a frame to a target.

    None if there is one for fewer than half of the animals that have both.

    Args:
        subjects: the animals.
        points_3d: name of the points, and how an animal's are had.
        frame: of FRAMES.
        target: name of the 2D points, and how an animal's are had.

    """
    pairs = [
        pair
        for subject in subjects
        if (pair := _pair(subject, points_3d[1], target[1])) is not None
    ]
    best_pairs, stored_pairs, cameras = [], [], []
    for subject, points, marks in pairs:
        camera = free_camera(points * FRAMES[frame], marks)
        if camera is None:
            continue
        focal, center, plane = camera
        height, width = subject.record.image_hw
        cameras.append([focal, *(center - ((width - 1) / 2, (height - 1) / 2))])
        best_pairs.append((focal * plane + center, marks))
        if subject.record.K is not None:
            stored_pairs.append((subject.record.K[0, 0] * plane + subject.record.K[:2, 2], marks))
    free = residual(best_pairs)
    if free is None or 2 * len(best_pairs) < len(pairs):
        return None
    focals, offsets = np.array(cameras)[:, 0], np.array(cameras)[:, 1:]
    ends = [float(value) for value in np.percentile(focals, (5, 95))]
    return CameraFit(
        points=points_3d[0],
        frame=frame,
        target=target[0],
        stored=residual(stored_pairs),
        free=free,
        focal_px=float(np.median(focals)),
        focal_range_px=ends,
        offset_px=[float(value) for value in np.median(offsets, axis=0)],
    )


def _pair(
    subject: Subject, points_of_subject: "PointsOf", target_of_subject: "PointsOf"
) -> tuple[Subject, Points, Points] | None:
    """An animal with its 3D points (N, 3) and their 2D targets (N, 2).

    Points without a target are left out; None if the others are too few.
    """
    points, marks = points_of_subject(subject), target_of_subject(subject)
    if points is None or marks is None or len(points) != len(marks):
        return None
    both = np.isfinite(points).all(axis=1) & np.isfinite(marks).all(axis=1)
    return (subject, points[both], marks[both]) if both.sum() >= LEAST else None


def free_camera(points_cam: Points, marks: Points) -> tuple[float, Points, Points] | None:
    """The pinhole camera under which points come nearest to marks, in the least squares.

    Args:
        points_cam: (N, 3) camera frame.
        marks: (N, 2) px.

    Returns:
        The focal length, the principal point (2,), and the points (N, 2) at depth 1; None if a
        point lies behind the camera, or the best picture is mirrored.

    """
    # marks ≈ focal · (X / Z, Y / Z) + center
    if not (points_cam[:, 2] > 0).all():
        return None
    plane = points_cam[:, :2] / points_cam[:, 2:]
    focal, center = least_squares_scale(plane, marks, shifted=True)
    return (focal, center, plane) if focal > 0 else None


PointsOf = Callable[[Subject], Points | None]
"""An animal's points, or None if it has none."""


def _points_3d_of(key: str, *, with_trans: bool) -> PointsOf:
    """The 3D points of a key, moved by trans or not."""

    def points_3d(subject: Subject) -> Points | None:
        points = points_of(subject.entry, key)
        if points is None or points.shape[1] != 3:
            return None
        return points + subject.trans if with_trans else points

    return points_3d


def _landmarks(*, with_trans: bool) -> PointsOf:
    """The landmarks of the posed body, moved by trans or not."""

    def landmarks(subject: Subject) -> Points | None:
        if subject.landmarks is None:
            return None
        return subject.landmarks - (0.0 if with_trans else subject.trans)

    return landmarks


def _points_2d_of(key: str) -> PointsOf:
    """The 2D points of a key."""

    def points_2d(subject: Subject) -> Points | None:
        points = points_of(subject.entry, key)
        return None if points is None else points[:, :2]

    return points_2d


TARGETS: Mapping[str, PointsOf] = {
    "keypoint_2d": _marks,
    "reproj_kp_2d": _points_2d_of("reproj_kp_2d"),
    "joints_2d": _points_2d_of("joints_2d"),
}
"""2D points of the file that cameras are fitted to, by name."""
POINTS: Mapping[str, PointsOf] = {
    "posed body": _landmarks(with_trans=True),
    "posed body without trans": _landmarks(with_trans=False),
    "keypoint_3d + trans": _points_3d_of("keypoint_3d", with_trans=True),
    "keypoint_3d": _points_3d_of("keypoint_3d", with_trans=False),
    "joints_3d + trans": _points_3d_of("joints_3d", with_trans=True),
    "joints_3d": _points_3d_of("joints_3d", with_trans=False),
}
"""3D points of the file or of its bodies, by name."""

"""Fits of a file's 2D and 3D points to its keypoints.

Which picture, camera frame and translation they are for.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.inspection.animal3d_entries import points_of
from animal3dbox.datasets.inspection.measures import least_squares_scale, residual, spread
from animal3dbox.datasets.inspection.result import CameraFit, PictureFit
from animal3dbox.datasets.readers.animal3d.camera import CLOSE, FRAMES
from animal3dbox.datasets.records import AnimalRecord

Points = NDArray[np.float64]
ANIMALS = 200
"""So many animals are compared."""
LEAST = 6
"""With so many points or more."""
AS_GOOD = 1.5
"""A simpler relation is believed if its residual is at most so many times that of the freest, or
below CERTAIN percent."""
CERTAIN = 0.5
FREER = ("scaled", "scaled and shifted")
KEPT = 3
"""So many cameras of each target are told."""


@dataclass(frozen=True)
class Subject:
    """An animal with its entry as it stands and its posed body.

    Attributes:
        entry: of the file.
        record: as it was read.
        landmarks: (26, 3) of the posed body, trans included; None without a model or parameters.
    """

    entry: Mapping[str, Any]
    record: AnimalRecord
    landmarks: Points | None

    @property
    def trans(self) -> Points:
        """(3,); 0 if the file has none."""
        trans = self.entry.get("trans")
        return np.array(
            trans if isinstance(trans, list) and len(trans) == 3 else (0.0, 0.0, 0.0),
            dtype=np.float64,
        )

    @property
    def marked(self) -> NDArray[np.bool_]:
        """(26,) which keypoints are."""
        return np.asarray(self.record.keypoints_2d[:, 2] > 0)


def _marks(subject: Subject) -> Points:
    """The keypoints (26, 2); NaN where they are not marked."""
    return np.where(subject.marked[:, None], subject.record.keypoints_2d[:, :2], np.nan)


def picture_fit(subjects: Sequence[Subject], key: str) -> PictureFit | None:
    """In which picture a key's 26 points live; None if too few animals have them."""
    pairs = []
    for subject in spread(subjects, ANIMALS):
        points = points_of(subject.entry, key)
        if (
            points is not None
            and len(points) == len(subject.marked)
            and subject.marked.sum() >= LEAST
        ):
            pairs.append(
                (points[subject.marked, :2], subject.record.keypoints_2d[subject.marked, :2])
            )
    stored = residual(pairs)
    if stored is None:
        return None
    # marks = scale * points + shift, in pixels counted from the image's corner, about which a
    # resize scales
    fits = {
        name: [
            least_squares_scale(points + 0.5, marks + 0.5, name != "scaled")
            for points, marks in pairs
        ]
        for name in FREER
    }
    found = {"as stored": stored}
    for name, each in fits.items():
        moved = residual(
            [
                (scale * (points + 0.5) + shift - 0.5, marks)
                for (scale, shift), (points, marks) in zip(each, pairs, strict=True)
            ]
        )
        if moved is not None:
            found[name] = moved
    best = found["scaled and shifted"].median_percent
    close = (
        name for name, one in found.items() if one.median_percent <= max(AS_GOOD * best, CERTAIN)
    )
    relation = next(close, "none") if best < 100 * CLOSE else "none"
    if relation not in fits:
        return PictureFit(key, relation, found, None, None)
    back = [
        (1 / scale, -shift / scale) for scale, shift in fits[relation]
    ]  # from the image into the key's picture
    shift_px = np.median([shift for _, shift in back], axis=0)
    return PictureFit(
        key,
        relation,
        found,
        float(np.median([scale for scale, _ in back])),
        [float(value) for value in shift_px],
    )


def camera_fits(subjects: Sequence[Subject]) -> list[CameraFit]:
    """The best cameras for each target, over all points with and without trans and all frames."""
    fits: list[CameraFit] = []
    sampled = spread(subjects, ANIMALS)
    for target, target_of in TARGETS.items():
        found = [
            fit
            for name, points_3d in POINTS.items()
            for frame in FRAMES
            if (fit := _camera_fit(sampled, (name, points_3d), frame, (target, target_of)))
            is not None
        ]
        fits += sorted(found, key=lambda fit: fit.free.median_percent)[:KEPT]
    return fits


def _camera_fit(
    subjects: Sequence[Subject],
    points_3d: tuple[str, "PointsOf"],
    frame: str,
    target: tuple[str, "PointsOf"],
) -> CameraFit | None:
    """One combination; None if it sees fewer than half of the animals that have both."""
    have = [
        pair
        for subject in subjects
        if (pair := _pair(subject, points_3d[1], target[1])) is not None
    ]
    seen, stored, cameras = [], [], []
    for subject, points, marks in have:
        fitted = free_camera(points * FRAMES[frame], marks)
        if fitted is None:
            continue
        focal, center, plane = fitted
        height, width = subject.record.image_hw
        cameras.append([focal, *(center - ((width - 1) / 2, (height - 1) / 2))])
        seen.append((focal * plane + center, marks))
        if subject.record.K is not None:
            stored.append((subject.record.K[0, 0] * plane + subject.record.K[:2, 2], marks))
    free = residual(seen)
    if free is None or 2 * len(seen) < len(have):
        return None
    focals, offsets = np.array(cameras)[:, 0], np.array(cameras)[:, 1:]
    ends = [float(value) for value in np.percentile(focals, (5, 95))]
    return CameraFit(
        points=points_3d[0],
        frame=frame,
        target=target[0],
        stored=residual(stored),
        free=free,
        focal_px=float(np.median(focals)),
        focal_range_px=ends,
        offset_px=[float(value) for value in np.median(offsets, axis=0)],
    )


def _pair(
    subject: Subject, points_of_subject: "PointsOf", target_of_subject: "PointsOf"
) -> tuple[Subject, Points, Points] | None:
    """An animal's 3D points (N, 3) and 2D targets (N, 2), those that it has both of.

    None if they are too few.
    """
    points, marks = points_of_subject(subject), target_of_subject(subject)
    if points is None or marks is None or len(points) != len(marks):
        return None
    both = np.isfinite(points).all(axis=1) & np.isfinite(marks).all(axis=1)
    return (subject, points[both], marks[both]) if both.sum() >= LEAST else None


def free_camera(points_cam: Points, marks: Points) -> tuple[float, Points, Points] | None:
    """The focal length, principal point (2,) and points (N, 2) at depth 1 that come nearest to
    marks; None behind the camera or mirrored."""
    if not (points_cam[:, 2] > 0).all():
        return None
    plane = points_cam[:, :2] / points_cam[:, 2:]
    focal, center = least_squares_scale(plane, marks, shifted=True)
    return (focal, center, plane) if focal > 0 else None


PointsOf = Callable[[Subject], Points | None]


def _stored(key: str, moved: bool) -> PointsOf:
    def points(subject: Subject) -> Points | None:
        found = points_of(subject.entry, key)
        if found is None or found.shape[1] != 3:
            return None
        return found + subject.trans if moved else found

    return points


def _posed(moved: bool) -> PointsOf:
    return lambda subject: (
        None if subject.landmarks is None else subject.landmarks - (0.0 if moved else subject.trans)
    )


def _reprojected(key: str) -> PointsOf:
    def points(subject: Subject) -> Points | None:
        found = points_of(subject.entry, key)
        return None if found is None else found[:, :2]

    return points


TARGETS: Mapping[str, PointsOf] = {
    "keypoint_2d": _marks,
    "reproj_kp_2d": _reprojected("reproj_kp_2d"),
    "joints_2d": _reprojected("joints_2d"),
}
POINTS: Mapping[str, PointsOf] = {
    "posed body": _posed(True),
    "posed body without trans": _posed(False),
    "keypoint_3d + trans": _stored("keypoint_3d", True),
    "keypoint_3d": _stored("keypoint_3d", False),
    "joints_3d + trans": _stored("joints_3d", True),
    "joints_3d": _stored("joints_3d", False),
}

"""KITTI's text files, read and written: for each image a file of boxes and a calibration.

A line has 15 columns, 16 in a detector's results, and two more in front in tracking. images.txt is
this package's own file, which keeps the images' paths and sizes.
"""

from dataclasses import dataclass

import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import KITTI, Floats
from animal3dbox.datasets.records import CuboidImage
from animal3dbox.errors import SampleError

FIELDS = 15
"""Number of fields of a line without a score and without a track."""
TRACK_FIELDS = 2
"""Number of fields in front of these in tracking: the frame, the track."""
OCCLUSION_UNKNOWN = 3
"""Value of occluded that KITTI writes where it is not known."""
NO_LOCATION = -1000.0
"""Value of a coordinate that KITTI writes for a box without a 3D location."""
VISIBILITY = {0: 1.0, 1: 0.7, 2: 0.3}
"""Part that is visible of a thing, which KITTI gives as a level of occlusion."""
UNITS = "# lengths: "
"""Beginning of the line of images.txt that says that lengths are not metres."""
HEADING_UNKNOWN = "# heading: unknown"
"""The line of images.txt that says that forward means nothing, of some boxes at least."""


@dataclass(frozen=True)
class KittiLine:
    """One line of a label file, in KITTI's own frames and pixels, in metres and radians.

    Attributes:
        kind: the category, one word.
        truncated: part outside the image, 0 to 1, or -1 if unknown.
        occluded: 0 fully visible, 1 partly occluded, 2 largely, 3 unknown; -1 in results.
        alpha: rotation_y about the line of sight.
        box: (4,) left, top, right, bottom.
        dimensions: (3,) height, width, length.
        location: (3,) of the middle of the bottom.
        rotation_y: about the camera's y axis; 0 faces along x.
        score: of a result; None of a label.
        frame: the image of a sequence, from 0; None outside tracking.
        track: the thing's number in its sequence; None outside tracking.
    """

    kind: str
    truncated: float
    occluded: int
    alpha: float
    box: Floats
    dimensions: Floats
    location: Floats
    rotation_y: float
    score: float | None = None
    frame: int | None = None
    track: int | None = None

    @property
    def truncation(self) -> float | None:
        """The part outside the image, 0 to 1; None if unknown, as tracking's levels 1 and 2 are."""
        is_level = self.frame is not None and self.truncated > 0
        return None if is_level or self.truncated < 0 else self.truncated

    def text(self) -> str:
        """The line as it stands in a file, without its end."""
        numbers = [
            self.alpha,
            *self.box.tolist(),
            *self.dimensions.tolist(),
            *self.location.tolist(),
            self.rotation_y,
        ]
        return f"{self.kind} {self.truncated:.{KITTI.decimals}f} {self.occluded} " + " ".join(
            f"{value:.{KITTI.decimals}f}" for value in numbers
        )


def parsed_line(line: str, sample_id: str) -> KittiLine:
    """One line of a label file, of results or of tracking.

    Args:
        line: its text.
        sample_id: named in the error.

    Raises:
        SampleError: another number of fields, or one that is no finite number.

    """
    fields = line.split()
    of_tracking = bool(fields) and fields[0].lstrip("-").isdecimal()
    frame, track = fields[:TRACK_FIELDS] if of_tracking else (None, None)
    fields = fields[TRACK_FIELDS:] if of_tracking else fields
    if len(fields) not in (FIELDS, FIELDS + 1):
        raise SampleError(
            sample_id,
            "line",
            f"must have {FIELDS} fields, or {FIELDS + 1} with a score, and in tracking a frame and"
            f" a track before them; got {len(line.split())}",
        )
    try:
        values = np.array([float(field) for field in fields[1:]])
        numbers = None if frame is None or track is None else (int(frame), int(track))
    except ValueError as error:
        raise SampleError(sample_id, "line", f"holds a field that is no number: {error}") from error
    if not np.isfinite(values).all():
        raise SampleError(sample_id, "line", "holds a number that is not finite")
    return KittiLine(
        kind=fields[0],
        truncated=float(values[0]),
        occluded=int(values[1]),
        alpha=float(values[2]),
        box=values[3:7],
        dimensions=values[7:10],
        location=values[10:13],
        rotation_y=float(values[13]),
        score=float(values[14]) if len(values) == FIELDS else None,
        frame=numbers[0] if numbers else None,
        track=numbers[1] if numbers else None,
    )


def calibration_text(K: Floats) -> str:
    """The calibration file of an image with intrinsics K (3, 3).

    Its four cameras are one, and its laser scanner stands in the camera.
    """
    P = " ".join(f"{value:.12e}" for value in np.concatenate((K, np.zeros((3, 1))), axis=1).ravel())
    identity = " ".join(f"{value:.1f}" for value in np.eye(3).ravel())
    still = " ".join(f"{value:.1f}" for value in np.eye(4)[:3].ravel())
    return "".join(
        (
            *(f"P{n}: {P}\n" for n in range(4)),
            f"R0_rect: {identity}\n",
            f"Tr_velo_to_cam: {still}\n",
            f"Tr_imu_to_velo: {still}\n",
        )
    )


def parsed_calibration(text: str, sample_id: str) -> Floats:
    """The projection matrix P2 (3, 4) of a calibration file; raises SampleError."""
    rows = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
    try:
        values = np.array([float(field) for field in rows["P2"].split()])
    except KeyError as error:
        raise SampleError(sample_id, "P2", "is missing in the calibration file") from error
    except ValueError as error:
        raise SampleError(sample_id, "P2", f"holds a field that is no number: {error}") from error
    if values.size != 12 or not np.isfinite(values).all():
        raise SampleError(sample_id, "P2", f"must be 12 finite numbers, got {values.size}")
    return values.reshape(3, 4)


def image_line(number: int, image: CuboidImage) -> str:
    """The line of one image in images.txt: number, width, height, path."""
    return f"{number:06d} {image.image_hw[1]} {image.image_hw[0]} {image.image_id}\n"


def parsed_images(text: str) -> dict[str, tuple[tuple[int, int], str]]:
    """The images of images.txt: number -> size (height, width) and path.

    Raises:
        SampleError: a line is not number, width, height, path.

    """
    images: dict[str, tuple[tuple[int, int], str]] = {}
    for line in text.splitlines():
        if line.startswith(UNITS) or line == HEADING_UNKNOWN:
            continue
        fields = line.split(" ", 3)
        if len(fields) != 4 or not (fields[1].isdecimal() and fields[2].isdecimal()):
            raise SampleError(
                "images.txt", "line", f"must be number, width, height, path, got {line!r}"
            )
        number, width, height, path = fields
        images[number] = ((int(height), int(width)), path)
    return images


def states_heading(text: str) -> bool:
    """Whether images.txt leaves it at KITTI's headings, which all mean something."""
    return HEADING_UNKNOWN not in text.splitlines()


def states_metres(text: str) -> bool:
    """Whether images.txt leaves it at KITTI's unit, the metre."""
    return not any(line.startswith(UNITS) for line in text.splitlines())

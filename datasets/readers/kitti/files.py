"""KITTI's text files, read and written: for each image a file of boxes and a calibration.

images.txt is this package's own file, which keeps the images' paths and sizes.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from animal3dbox.datasets.readers.cuboid_conventions import KITTI, Floats
from animal3dbox.datasets.records import CuboidImage
from animal3dbox.errors import SampleError

FIELDS = 15
"""Number of fields of a line without a score."""
OCCLUSION_UNKNOWN = 3
"""Value of occluded that KITTI writes where it is not known."""
NO_LOCATION = -1000.0
"""Value of a coordinate that KITTI writes for a box without a 3D location."""


@dataclass(frozen=True)
class KittiLine:
    """One line of a label file, in KITTI's own frames and pixels, in metres and radians.

    Attributes:
        kind: the category, one word.
        truncated: part outside the image, 0 to 1, or -1 if unknown.
        occluded: 0 to 3; 3 is unknown.
        alpha: rotation_y about the line of sight.
        box: (4,) left, top, right, bottom.
        dimensions: (3,) height, width, length.
        location: (3,) of the middle of the bottom.
        rotation_y: about the camera's y axis; 0 faces along x.
    """

    kind: str
    truncated: float
    occluded: int
    alpha: float
    box: Floats
    dimensions: Floats
    location: Floats
    rotation_y: float

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


def parsed_lines(text: str, sample_id: str) -> Iterator[KittiLine | SampleError]:
    """The lines of a label file, or an error in the place of a faulty line.

    Results with a sixteenth number, the score, are taken, too.
    """
    for number, line in enumerate(line for line in text.splitlines() if line.strip()):
        fields = line.split()
        name = f"{sample_id}#{number}" if number else sample_id
        if len(fields) not in (FIELDS, FIELDS + 1):
            yield SampleError(
                name,
                "line",
                f"must have {FIELDS} fields, or {FIELDS + 1} with a score, got {len(fields)}",
            )
            continue
        try:
            values = np.array([float(field) for field in fields[1:FIELDS]])
        except ValueError as error:
            yield SampleError(name, "line", f"holds a field that is no number: {error}")
            continue
        if not np.isfinite(values).all():
            yield SampleError(name, "line", "holds a number that is not finite")
            continue
        yield KittiLine(
            kind=fields[0],
            truncated=float(values[0]),
            occluded=int(values[1]),
            alpha=float(values[2]),
            box=values[3:7],
            dimensions=values[7:10],
            location=values[10:13],
            rotation_y=float(values[13]),
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
        fields = line.split(" ", 3)
        if len(fields) != 4 or not (fields[1].isdecimal() and fields[2].isdecimal()):
            raise SampleError(
                "images.txt", "line", f"must be number, width, height, path, got {line!r}"
            )
        number, width, height, path = fields
        images[number] = ((int(height), int(width)), path)
    return images

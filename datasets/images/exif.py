"""What a photograph's own header says of its camera.

How it was held and how long its focal length was.
"""

import math
import warnings
from dataclasses import dataclass
from pathlib import Path

from PIL import ExifTags, Image

FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "GIF", "PPM", "JPEG2000")
"""What a file may be, whatever its name.

Pillow's others are not photographs, and for one of them, EPS, it starts Ghostscript.
"""
FULL_FRAME_MM = math.hypot(36.0, 24.0)
"""The diagonal to which 35 mm-equivalent focal lengths refer."""
SAME_ASPECT = 0.01
"""A picture was cropped after its header was written if its aspect ratio differs from the header's
by more than this part."""
FOCAL_RANGE = (0.2, 100.0)
"""Focal lengths, by the picture's diagonal, that a camera can have.

What lies outside is a writing error.
"""


@dataclass(frozen=True)
class PhotoFacts:
    """The header of a picture.

    Attributes:
        orientation: EXIF's, 1 upright.
        focal_px: focal length in px of the picture as stored; None if the header does not tell.
        warnings: whole sentences.
    """

    orientation: int = 1
    focal_px: float | None = None
    warnings: tuple[str, ...] = ()


def header_facts(path: Path) -> PhotoFacts:
    """The facts of a file without decoding it; none of a file that is no picture."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path, formats=FORMATS) as image:
                return facts_of(image)
    except (OSError, SyntaxError, ValueError, NotImplementedError, Image.DecompressionBombError):
        return PhotoFacts()  # reading the picture says what is wrong with it


def facts_of(image: Image.Image) -> PhotoFacts:
    """The facts of a picture that Pillow has opened.

    The focal length is of the tag FocalLengthIn35mmFilm, by the diagonals; or of FocalLength and
    FocalPlaneXResolution, if the header also tells how wide the picture was. A picture that was
    cropped since tells neither.
    """
    exif = image.getexif()
    if not exif:
        return PhotoFacts()
    turned = exif.get(ExifTags.Base.Orientation, 1)
    orientation = turned if isinstance(turned, int) and 1 <= turned <= 8 else 1
    said = []
    if orientation != 1:
        said.append(
            f"the image's EXIF orientation {orientation} was not applied: are the annotations for"
            " the pixels as stored?"
        )
    try:
        camera = exif.get_ifd(ExifTags.IFD.Exif)
        focal, problem = _focal(camera, image.size)
    except (
        ValueError,
        TypeError,
        KeyError,
        OverflowError,
        SyntaxError,
    ) as error:  # Pillow reads tags when they are asked for
        focal, problem = (
            None,
            f"the image's EXIF header is damaged ({error}): no focal length was taken from it",
        )
    return PhotoFacts(orientation, focal, (*said, *(() if problem is None else (problem,))))


def _focal(camera: dict[int, object], size: tuple[int, int]) -> tuple[float | None, str | None]:
    """The focal length in px, and what a careful person should know."""
    equivalent, focal_mm = (
        _number(camera.get(tag))
        for tag in (ExifTags.Base.FocalLengthIn35mmFilm, ExifTags.Base.FocalLength)
    )
    told = tuple(
        _number(camera.get(tag))
        for tag in (ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight)
    )
    if equivalent is None and focal_mm is None:
        return None, None
    if all(told) and abs((told[0] or 1) / (told[1] or 1) * size[1] / size[0] - 1) > SAME_ASPECT:
        taken = f"{told[0]:.0f} x {told[1]:.0f}"
        return (
            None,
            (
                f"the image was cropped from {taken} to {size[0]} x {size[1]}: its EXIF focal"
                " length does not hold for it and is not used"
            ),
        )
    diagonal = math.hypot(*size)
    if equivalent is not None:
        focal = equivalent / FULL_FRAME_MM * diagonal
    else:
        per_mm = _pixels_per_mm(camera)
        if per_mm is None or told[0] is None or focal_mm is None:
            return None, None
        focal = focal_mm * per_mm * size[0] / told[0]
    if not FOCAL_RANGE[0] * diagonal <= focal <= FOCAL_RANGE[1] * diagonal:
        return (
            None,
            (
                f"the image's EXIF focal length is {focal:.0f} px, which no camera has at {size[0]}"
                f" x {size[1]}: it is not used"
            ),
        )
    return focal, None


def _pixels_per_mm(camera: dict[int, object]) -> float | None:
    resolution = _number(camera.get(ExifTags.Base.FocalPlaneXResolution))
    unit = camera.get(ExifTags.Base.FocalPlaneResolutionUnit, 2)
    mm = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}.get(unit if isinstance(unit, int) else 0)
    return None if resolution is None or mm is None else resolution / mm


def _number(value: object) -> float | None:
    """A positive finite number; None of anything else, 0 being EXIF's unknown."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None

"""EXIF headers: how a photograph's camera was held, and its focal length in pixels.

A header that is damaged or no longer fits its picture gives no focal length, but a warning.
"""

import math
import re
import warnings
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from PIL import ExifTags, Image

FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "GIF", "PPM", "JPEG2000")
"""Pillow's formats that a file may have, whatever its name.

The others are not photographs, and for one of them, EPS, Pillow starts Ghostscript.
"""
FULL_FRAME_MM = math.hypot(36.0, 24.0)
"""The diagonal to which 35 mm-equivalent focal lengths refer."""
SAME_ASPECT = 0.01
"""Greatest difference of a picture's aspect ratio from its header's, as a part of it.

A picture that differs by more was cropped after its header was written.
"""
FOCAL_RANGE = (0.2, 100.0)
"""Focal lengths, by the picture's diagonal, that a camera can have.

What lies outside is a writing error.
"""
_TIME = re.compile(r"(\d{4}):(\d\d):(\d\d) (\d\d:\d\d:\d\d)")
_OFFSET = re.compile(r"[+-]\d\d:\d\d")


@dataclass(frozen=True)
class PhotoFacts:
    """The facts of a picture's header that labelling needs.

    Attributes:
        orientation: EXIF's number from 1 to 8; 1 is upright.
        focal_px: focal length in px of the picture as stored; None if the header does not tell.
        warnings: what a careful person should know of the header, in whole sentences.
        time: when it was taken, ISO 8601, in local time; None if the header does not tell.
    """

    orientation: int = 1
    focal_px: float | None = None
    warnings: tuple[str, ...] = ()
    time: str | None = None


def header_facts(path: Path) -> PhotoFacts:
    """The facts of a file's header, its pixels not decoded; the defaults of a file without one."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path, formats=FORMATS) as image:
                return facts_of(image)
    except (OSError, SyntaxError, ValueError, NotImplementedError, Image.DecompressionBombError):
        return PhotoFacts()  # reading the picture says what is wrong with it


def facts_of(image: Image.Image) -> PhotoFacts:
    """The facts of the header of a picture that Pillow has opened.

    The focal length is of the tag FocalLengthIn35mmFilm, by the diagonals; or of FocalLength and
    FocalPlaneXResolution, if the header also tells how wide the picture was. A picture that was
    cropped since tells neither.
    """
    exif = image.getexif()
    if not exif:
        return PhotoFacts()
    value = exif.get(ExifTags.Base.Orientation, 1)
    orientation = value if isinstance(value, int) and 1 <= value <= 8 else 1
    messages = []
    if orientation != 1:
        messages.append(
            f"the image's EXIF orientation {orientation} was not applied: are the annotations for"
            " the pixels as stored?"
        )
    time = None
    try:
        camera = exif.get_ifd(ExifTags.IFD.Exif)
        time = _time(camera)
        focal, problem = _focal(camera, image.size)
    except (ValueError, TypeError, KeyError, OverflowError, SyntaxError) as error:
        # Pillow decodes a tag only when it is looked up.
        focal = None
        problem = f"the image's EXIF header is damaged ({error}): no focal length was taken from it"
    if problem is not None:
        messages.append(problem)
    return PhotoFacts(orientation, focal, tuple(messages), time)


def _time(camera: dict[int, object]) -> str | None:
    """When a picture was taken, by the clock of its camera; None if its header does not tell."""
    taken = _TIME.fullmatch(str(camera.get(ExifTags.Base.DateTimeOriginal, "")).strip("\0 "))
    if taken is None:
        return None
    year, month, day, clock = taken.groups()
    try:
        time = datetime.fromisoformat(f"{year}-{month}-{day}T{clock}")
    except ValueError:  # 0000:00:00 is how cameras without a clock write it
        return None
    offset = str(camera.get(ExifTags.Base.OffsetTimeOriginal, "")).strip("\0 ")
    return time.isoformat() + (offset if _OFFSET.fullmatch(offset) else "")


def _focal(camera: dict[int, object], size: tuple[int, int]) -> tuple[float | None, str | None]:
    """The focal length in px that a header tells for a picture of a size (width, height).

    Returns:
        The focal length, None if the header tells none; and why it is not used, None if it is or
        there is none.

    """
    width, height = size
    equivalent_mm = _number(camera.get(ExifTags.Base.FocalLengthIn35mmFilm))
    focal_mm = _number(camera.get(ExifTags.Base.FocalLength))
    exif_width = _number(camera.get(ExifTags.Base.ExifImageWidth))
    exif_height = _number(camera.get(ExifTags.Base.ExifImageHeight))
    if equivalent_mm is None and focal_mm is None:
        return None, None
    if (
        exif_width
        and exif_height
        and abs(exif_width / exif_height * height / width - 1) > SAME_ASPECT
    ):
        return None, (
            f"the image was cropped from {exif_width:.0f} x {exif_height:.0f} to {width} x"
            f" {height}: its EXIF focal length does not hold for it and is not used"
        )
    diagonal = math.hypot(width, height)
    if equivalent_mm is not None:
        focal = equivalent_mm / FULL_FRAME_MM * diagonal
    else:
        per_mm = _pixels_per_mm(camera)
        if per_mm is None or exif_width is None or focal_mm is None:
            return None, None
        focal = focal_mm * per_mm * width / exif_width
    if not FOCAL_RANGE[0] * diagonal <= focal <= FOCAL_RANGE[1] * diagonal:
        return None, (
            f"the image's EXIF focal length is {focal:.0f} px, which no camera has at {width} x"
            f" {height}: it is not used"
        )
    return focal, None


def _pixels_per_mm(camera: dict[int, object]) -> float | None:
    """Pixels in a millimetre of the sensor, as the header tells; None if it does not."""
    resolution = _number(camera.get(ExifTags.Base.FocalPlaneXResolution))
    unit = camera.get(ExifTags.Base.FocalPlaneResolutionUnit, 2)
    mm = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}.get(unit if isinstance(unit, int) else 0)
    return None if resolution is None or mm is None else resolution / mm


def _number(value: object) -> float | None:
    """A tag's value if it is a positive finite number; None otherwise, 0 being EXIF's unknown."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0 else None

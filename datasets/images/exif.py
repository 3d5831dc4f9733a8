"""EXIF headers: how a photograph's camera was held, and its focal length in pixels.

A header that is damaged or no longer fits its picture gives no focal length, but a warning.
"""

import math
import re
from dataclasses import dataclass
from datetime import datetime

from PIL import ExifTags, Image

from animal3dbox.datasets.images.orientation import (
    ON_ITS_SIDE,
    UPRIGHT,
    exif_orientation,
    exif_tags,
    stored_width_height,
)

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
        focal_px: focal length in px, the same of stored and of upright pixels; None if the header
            does not tell.
        warnings: what a careful person should know of the header, in whole sentences.
        time: when it was taken, ISO 8601, in local time; None if the header does not tell.
        upright: whether the pixels that go with these facts were turned as orientation says.
        flags: the same as warnings for programs that count, a word each, of labels.types.FLAGS.
    """

    orientation: int = UPRIGHT
    focal_px: float | None = None
    warnings: tuple[str, ...] = ()
    time: str | None = None
    upright: bool = False
    flags: tuple[str, ...] = ()

    @property
    def turn(self) -> dict[str, int | bool]:
        """How the picture lay in its file and whether it was turned, for a target's meta."""
        return {"exif_orientation": self.orientation, "turned_upright": self.upright}


def facts_of(image: Image.Image, *, upright: bool = False) -> PhotoFacts:
    """The facts of the header of a picture that Pillow has opened and not decoded yet.

    The focal length is of the tag FocalLengthIn35mmFilm, by the diagonals; or of FocalLength and
    FocalPlaneXResolution, if the header also tells how wide the picture was. A picture that was
    cropped since tells neither.

    Args:
        image: the picture.
        upright: whether its pixels are used turned as the header says, not as stored.

    """
    exif, orientation = exif_tags(image), exif_orientation(image)
    if not exif and orientation == UPRIGHT:
        return PhotoFacts()
    size = stored_width_height(image)
    messages, flags = _about_turn(orientation, size, upright=upright)
    time = None
    try:
        camera = exif.get_ifd(ExifTags.IFD.Exif)
        time = _time(camera)
        focal, problem = _focal(camera, size)
    except (ValueError, TypeError, KeyError, OverflowError, SyntaxError) as error:
        # Pillow decodes a tag only when it is looked up.
        focal = None
        problem = f"the image's EXIF header is damaged ({error}): no focal length was taken from it"
    if problem is not None:
        messages += (problem,)
    is_turned = upright and orientation != UPRIGHT
    return PhotoFacts(orientation, focal, messages, time, upright=is_turned, flags=flags)


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


def _about_turn(
    orientation: int, size: tuple[int, int], *, upright: bool
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The warnings and flags of a picture that its header says to turn.

    The flag is for pictures whose size does not tell which pixels the annotations are for: of those
    on their side it does, since they are refused where it contradicts.
    """
    if orientation == UPRIGHT:
        return (), ()
    if upright:
        return (f"the image was turned upright by its EXIF orientation {orientation}",), ()
    problem = (
        f"the image's EXIF orientation {orientation} was not applied: are the annotations for the"
        " pixels as stored? If not, apply it (apply_orientation=True, --orientation apply)"
    )
    is_told = orientation in ON_ITS_SIDE and size[0] != size[1]
    return (problem,), () if is_told else ("not_turned",)


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

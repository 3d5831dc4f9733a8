"""Pictures that lie in their files as EXIF's eight orientations say."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Pixels = NDArray[np.uint8]


def stored_pixels(upright: Pixels, orientation: int) -> Pixels:
    """The rows of a file whose header says so of a picture (H, W, ...), by EXIF's own words.

    EXIF names the sides of the picture at which the first stored row and column are.
    """
    row_at, column_at = {
        1: ("top", "left"),
        2: ("top", "right"),
        3: ("bottom", "right"),
        4: ("bottom", "left"),
        5: ("left", "top"),
        6: ("right", "top"),
        7: ("right", "bottom"),
        8: ("left", "bottom"),
    }[orientation]
    if row_at in ("left", "right"):
        upright = upright.swapaxes(0, 1)
    if row_at in ("bottom", "right"):
        upright = upright[::-1]
    if column_at in ("bottom", "right"):
        upright = upright[:, ::-1]
    return np.ascontiguousarray(upright)


def save_turned(path: Path, upright: Pixels, orientation: int, format: str | None = None) -> Path:
    """Store an upright picture as a camera held so does, without loss where the format can."""
    exif = Image.Exif()
    exif[274] = orientation
    options = {"lossless": True} if format == "WEBP" else {"quality": 95}
    image = Image.fromarray(stored_pixels(upright, orientation))
    image.save(path, format, exif=exif, **options)
    return path


def turn_file(path: Path, orientation: int) -> None:
    """Store a picture anew as a camera held so does."""
    with Image.open(path) as image:
        upright, format = np.array(image), image.format
    save_turned(path, upright, orientation, format)

"""JPEGs decoded by OpenCV, where its pixels are Pillow's to the last bit, in less time.

Pillow is the definition: what a picture's pixels are, and what is wrong with a file, is what it
says. Both libraries decode by libjpeg-turbo, whose versions give the same pixels in the settings
that both leave as they are (slow integer DCT, smooth upsampling of chroma). OpenCV copies them less
often, and takes two thirds of Pillow's time (benchmarks/loader.py). Whether the two that are
installed agree is tried once a process, on pictures that are made for it.

Only ordinary files are decoded so: whole ones in one scan (not progressive) of one or three
channels of 8 bits, without a colour profile. All others, and whatever OpenCV refuses, are left to
Pillow: OpenCV gives a picture of many a file that is damaged, where Pillow says so.
"""

import io
import re
import struct
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

_BEGIN, _END = b"\xff\xd8\xff", b"\xff\xd9"
_FRAMES = (0xC0, 0xC1)
"""Markers of the frames of one scan, Huffman coded: baseline and extended. They tell the size."""
_RESTART_INTERVAL, _SCAN = 0xDD, 0xDA
_TABLES = (0xC4, 0xDB, _RESTART_INTERVAL)
"""Markers of the segments that a decoder alone needs."""
_SILENT = (0xE0, 0xFE)
"""Markers of segments that say nothing of how a picture is used: JFIF, a comment."""
_MARKER, _MARKER_OR_RESTART = (re.compile(rb"\xff[^\x00\xd0-\xd7]"), re.compile(rb"\xff[^\x00]"))
"""What is no coded pixel: among those, a byte 0xFF is followed by a 0."""
_COLOUR = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
"""OpenCV would turn a picture by its EXIF orientation, which Pillow does not."""


def whole_jpeg(source: Path | str | bytes) -> bytes | None:
    """The bytes of a JPEG, a file or its content, that ends where its picture does; None of others.

    One that was cut off ends within its picture, and what that is Pillow says.
    """
    if isinstance(source, bytes):
        return source if source.startswith(_BEGIN) and source.endswith(_END) else None
    try:
        with io.FileIO(source) as file:
            if file.read(len(_BEGIN)) != _BEGIN:
                return None
            file.seek(0)
            content = file.readall()
    except (OSError, ValueError):
        return None
    return content if content.endswith(_END) else None


@dataclass(frozen=True)
class JpegHeader:
    """The header of a JPEG that OpenCV may decode.

    Attributes:
        image_hw: height and width as stored.
        is_silent: whether it says nothing else: no EXIF, XMP, colour profile or further picture.
    """

    image_hw: tuple[int, int]
    is_silent: bool


def jpeg_header(content: bytes) -> JpegHeader | None:
    """The header of a whole JPEG; None of one that is left to Pillow, whole or damaged.

    That is one of several scans, of other channels than one or three of 8 bits, or whose pixels are
    not followed by the end of the file and nothing else.
    """
    place, image_hw, is_silent, has_restarts = 2, None, True, False
    while place + 10 <= len(content) and content[place] == 0xFF:
        marker, length = content[place + 1], int.from_bytes(content[place + 2 : place + 4])
        if marker == _SCAN:
            is_whole = _has_one_scan(content, place + 2 + length, has_restarts=has_restarts)
            return JpegHeader(image_hw, is_silent) if image_hw and is_whole else None
        if marker in _FRAMES:
            bits, height, width, channels = struct.unpack_from(">BHHB", content, place + 4)
            if bits != 8 or channels not in (1, 3):
                return None
            image_hw = (height, width)
        elif 0xE0 <= marker <= 0xEF or marker in _SILENT:
            is_silent = is_silent and marker in _SILENT
        elif marker not in _TABLES:
            return None
        has_restarts = has_restarts or marker == _RESTART_INTERVAL
        place += 2 + length
    return None


def _has_one_scan(content: bytes, begin: int, *, has_restarts: bool) -> bool:
    """Whether from its coded pixels on a JPEG has no marker but restarts and, last, its end."""
    marker = (_MARKER_OR_RESTART if not has_restarts else _MARKER).search(content, begin)
    return marker is not None and marker.end() == len(content)


def has_plain_pixels(image: Image.Image) -> bool:
    """Whether a JPEG that Pillow has opened has channels that OpenCV decodes as Pillow does."""
    return image.format == "JPEG" and image.mode in ("L", "RGB") and "icc_profile" not in image.info


def opencv_pixels(content: bytes, image_hw: tuple[int, int]) -> NDArray[np.uint8] | None:
    """The pixels (H, W, 3) RGB of a JPEG as stored, by OpenCV; None if Pillow has to decode it.

    Args:
        content: of a whole_jpeg that has a jpeg_header.
        image_hw: height and width, as that says.

    """
    if not opencv_agrees():
        return None
    pixels = _decoded(content)
    return pixels if pixels is not None and pixels.shape == (*image_hw, 3) else None


def _decoded(content: bytes) -> NDArray[np.uint8] | None:
    try:
        pixels: Any = cv2.imdecode(np.frombuffer(content, np.uint8), _COLOUR)
    except cv2.error:
        return None
    return None if pixels is None else np.asarray(pixels, dtype=np.uint8)


@lru_cache(maxsize=1)
def opencv_agrees() -> bool:
    """Whether the installed OpenCV decodes JPEGs to the very pixels of the installed Pillow.

    Tried on small pictures of odd size with sharp and smooth parts, in colour with each subsampling
    of chroma and in grey.
    """
    y, x = np.mgrid[:37, :53]
    ramps = np.stack((5 * x, 7 * y, 3 * (x + y)), axis=2)
    is_ramp = ((x // 3 + y // 5) % 4 > 0)[..., None]
    picture = Image.fromarray(np.where(is_ramp, ramps, 255 - ramps).astype(np.uint8))
    for mode, subsampling in (("RGB", 0), ("RGB", 1), ("RGB", 2), ("L", 0)):
        file = io.BytesIO()
        picture.convert(mode).save(file, "JPEG", quality=85, subsampling=subsampling)
        pixels = _decoded(file.getvalue())
        if pixels is None or not np.array_equal(pixels, np.array(Image.open(file).convert("RGB"))):
            return False
    return True

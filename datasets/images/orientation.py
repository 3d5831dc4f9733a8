"""How a picture lies in its file, and how it is turned upright.

EXIF numbers the eight ways in which a sensor's rows can lie: 1 is upright, 2 to 4 are mirrored or
upside down, 5 to 8 lie on their side, so that width and height are exchanged. Programs disagree:
OpenCV and browsers turn a picture as its number says, Pillow does not, but for TIFF, whose pixels
it turns while it decodes them and whose number it then forgets. Here pixels are as the file stores
them, or upright, for every format, as the caller says.
"""

import re
import struct
from typing import IO

from PIL import ExifTags, Image

UPRIGHT = 1
"""EXIF's number of a picture whose first stored row is its top."""
ON_ITS_SIDE = (5, 6, 7, 8)
"""EXIF's numbers of pictures whose stored width is the height that viewers show."""
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""What turns stored pixels upright, by EXIF's number."""
_XMP = re.compile(rb"tiff:Orientation(?:=[\"']|>)([0-9])")
_TIFF_SIZE = (int(ExifTags.Base.ImageWidth), int(ExifTags.Base.ImageLength))


def exif_tags(image: Image.Image) -> Image.Exif:
    """The EXIF tags of a picture of which only the header has been read.

    Of a PNG whose tags stand behind its pixels, Pillow would decode the pixels to find them; here
    its chunks are walked over instead.
    """
    if image.format != "PNG":
        return image.getexif()
    if "exif" not in image.info:
        file = getattr(image, "fp", None)
        tags = None if file is None else _last_chunk(file, b"eXIf")
        if tags is None:
            return Image.Image.getexif(image)  # an XMP packet, or a header in the form of a text
        image.info["exif"] = b"Exif\x00\x00" + tags
    return image.getexif()


def exif_orientation(image: Image.Image) -> int:
    """EXIF's number, 1 to 8, of a picture of which only the header has been read.

    Where EXIF says nothing, an XMP packet may, which not every version of Pillow reads. A number
    that EXIF does not have counts as 1. Ask before the pixels are decoded: Pillow forgets a TIFF's
    number then.
    """
    value = exif_tags(image).get(ExifTags.Base.Orientation)
    if value is None:
        value = _xmp_orientation(image)
    return value if isinstance(value, int) and 1 <= value <= 8 else UPRIGHT


def _xmp_orientation(image: Image.Image) -> int:
    """The number in a picture's XMP packet; 1 without."""
    packet = image.info.get("xmp") or image.info.get("XML:com.adobe.xmp") or b""
    text = packet.encode() if isinstance(packet, str) else bytes(packet)
    match = _XMP.search(text)
    return UPRIGHT if match is None else int(match[1])


def stored_width_height(image: Image.Image) -> tuple[int, int]:
    """Width and height of the pixels as a file stores them, of a picture not yet decoded.

    Pillow's size of a TIFF is, in some of its versions, that of the upright picture.
    """
    tags = getattr(image, "tag_v2", None)
    if tags is None:
        return image.size
    width, height = (tags.get(tag) for tag in _TIFF_SIZE)
    return (width, height) if isinstance(width, int) and isinstance(height, int) else image.size


def as_shown(size: tuple[int, int], orientation: int) -> tuple[int, int]:
    """The width and height, or height and width, of a stored picture once it is upright.

    Example:
        >>> as_shown((640, 480), 6), as_shown((640, 480), 3)
        ((480, 640), (640, 480))
    """
    return size[::-1] if orientation in ON_ITS_SIDE else size


def decode_as_stored(image: Image.Image) -> None:
    """Decode the pixels of an opened picture as its file stores them, of a TIFF, too.

    Pillow would turn a TIFF while it decodes it, and garbles one of a single channel that lies on
    its side: it maps the file's rows with width and height exchanged. Without its number, and with
    the stored size, a TIFF is decoded as any other picture.
    """
    tags = getattr(image, "tag_v2", None)
    if tags is not None and exif_orientation(image) != UPRIGHT:
        image._size = stored_width_height(image)
        exif = image.getexif()
        for numbers in (tags, exif):
            if ExifTags.Base.Orientation in numbers:
                del numbers[ExifTags.Base.Orientation]
    image.load()


def turned_upright(image: Image.Image, orientation: int) -> Image.Image:
    """A picture, decoded as stored, with its pixels as viewers show them."""
    return image if orientation == UPRIGHT else image.transpose(_TURNS[orientation])


def _last_chunk(file: IO[bytes], kind: bytes) -> bytes | None:
    """The content of a PNG's last chunk of a kind; None without; the file stays where it is."""
    place, content = file.tell(), None
    try:
        file.seek(8)
        while len(head := file.read(8)) == 8:
            length, name = struct.unpack(">I4s", head)
            if name == kind:
                content = file.read(length)
                length = 0
            file.seek(length + 4, 1)
    finally:
        file.seek(place)
    return content

"""Reading photographs: pixels as stored, or an error that names the sample.

Pixels stay as the file stores them: an EXIF orientation is not applied, because annotations are
made on stored pixels more often than not and because decoders disagree (OpenCV turns them, Pillow
does not). Images of 12 or 16 bits are scaled to 8, palettes are looked up, transparency is dropped.
Masks are read by rules of their own, see masks.py.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

from animal3dbox.datasets.images.exif import FORMATS, PhotoFacts, facts_of
from animal3dbox.errors import SampleError

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp")
"""Suffixes of the files that are images where nothing but their folder names them."""

MAX_PIXELS = 100_000_000
"""A file whose header promises more is not decoded: 100 megapixels are 300 MB."""

_BITS_PER_SAMPLE = 258
"""TIFF's tag of that name."""
_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Photo:
    """A photograph as its file stores it, with the facts of its header.

    Attributes:
        pixels: (H, W, 3) uint8 RGB, as stored.
        facts: orientation and focal length by the header.
    """

    pixels: NDArray[np.uint8]
    facts: PhotoFacts


def is_file(path: Path) -> bool:
    """Whether there is a file of this path.

    False, too, for a name that no file can have; resolve_inside says what is wrong with it.
    """
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_image(
    path: Path, sample_id: str, expected_hw: tuple[int, int] | None = None
) -> NDArray[np.uint8]:
    """The pixels (H, W, 3) of an image file as stored, uint8 RGB; see read_photo."""
    return read_photo(path, sample_id, expected_hw).pixels


def read_photo(
    path: Path | str, sample_id: str, expected_hw: tuple[int, int] | None = None
) -> Photo:
    """The photograph in an image file: its pixels as stored, and the facts of its header.

    Args:
        path: a file in one of exif.FORMATS; its name does not matter.
        sample_id: named in every error.
        expected_hw: height and width that the annotations were made for; None: any.

    Raises:
        SampleError: no image, a truncated one, too large a one, or one of another size.

    """
    return converted_image(
        path,
        sample_id,
        expected_hw,
        lambda image, sample_id: Photo(rgb_pixels(image, sample_id), facts_of(image)),
    )


def converted_image(
    path: Path | str,
    sample_id: str,
    expected_hw: tuple[int, int] | None,
    convert: Callable[[Image.Image, str], _T],
) -> _T:
    """The value that a function makes of a decoded image, with the errors of read_photo.

    Args:
        path: a file in one of exif.FORMATS.
        sample_id: named in every error.
        expected_hw: height and width that the annotations were made for; None: any.
        convert: called with the image and sample_id; Pillow's complaints in it are errors, too.

    """
    with _open_image(path, sample_id) as image:
        _check_size(image, sample_id, expected_hw)
        image.load()
        return convert(image, sample_id)


@contextmanager
def _open_image(path: Path | str, sample_id: str) -> Iterator[Image.Image]:
    """The image of a file for a with block, of which only the header has been read.

    Whatever Pillow complains of inside the block is an error that names the sample.
    """
    try:
        with warnings.catch_warnings():
            # MAX_PIXELS decides what is too large, in _check_size.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path, formats=FORMATS) as image:
                yield image
    except Image.DecompressionBombError as error:
        raise SampleError(
            sample_id, "image", f"{Path(path).name} is too large to decode: {error}"
        ) from error
    except (OSError, SyntaxError, ValueError, NotImplementedError) as error:
        if isinstance(error, SampleError):
            raise
        raise SampleError(
            sample_id, "image", f"{Path(path).name} cannot be decoded ({error}); replace the file"
        ) from error


def stored_size(path: Path, sample_id: str) -> tuple[int, int]:
    """Height and width of an image file by its header, its pixels not decoded.

    Raises:
        SampleError: no image, or too large a one.

    """
    with _open_image(path, sample_id) as image:
        _check_size(image, sample_id, None)
        return image.height, image.width


def checked_facts(path: Path, sample_id: str, expected_hw: tuple[int, int]) -> PhotoFacts:
    """The header's facts of an image file that is as large as annotated, its pixels not decoded.

    Raises SampleError if it is no image, or of another size.
    """
    with _open_image(path, sample_id) as image:
        _check_size(image, sample_id, expected_hw)
        return facts_of(image)


def _check_size(image: Image.Image, sample_id: str, expected_hw: tuple[int, int] | None) -> None:
    """Raise a SampleError unless an image can be decoded and has the size of its annotations."""
    width, height = image.size
    if width * height > MAX_PIXELS:
        raise SampleError(
            sample_id,
            "image",
            f"its header says {width} x {height} pixels, more than {MAX_PIXELS}; scale it down"
            " first",
        )
    if expected_hw is None or (height, width) == tuple(expected_hw):
        return
    sizes = (
        f"its pixels are {width} x {height}, but the annotations are for {expected_hw[1]} x"
        f" {expected_hw[0]}"
    )
    orientation = image.getexif().get(ExifTags.Base.Orientation, 1)
    if (width, height) == tuple(expected_hw) and orientation in (5, 6, 7, 8):
        raise SampleError(
            sample_id,
            "image",
            f"{sizes}: they were made on the image as turned by its EXIF orientation"
            f" {orientation}; store the pixels turned",
        )
    raise SampleError(sample_id, "image", f"{sizes}: the image was resized or swapped")


def rgb_pixels(image: Image.Image, sample_id: str) -> NDArray[np.uint8]:
    """The pixels (H, W, 3) of an image of any mode as 8-bit RGB; raises SampleError."""
    if image.mode.startswith("I"):
        deep = deep_values(image, sample_id)
        has_8_bits = image.mode == "I" and deep.max() <= 255  # in a file of 32
        grey = deep if has_8_bits else 255 * deep // _greatest_grey(image, int(deep.max()))
        return np.repeat(grey.astype(np.uint8)[:, :, None], 3, axis=2)
    if image.mode == "F":
        raise SampleError(sample_id, "image", "holds floating-point values; save it as 8-bit first")
    if image.mode == "P" and "transparency" in image.info:
        image = image.convert("RGBA")
    return np.array(image.convert("RGB"))


def _greatest_grey(image: Image.Image, greatest: int) -> int:
    """The value of white in an image of more than 8 bits a pixel.

    A TIFF says its bits. Of other files, whose 16 bits often hold the 12 of a camera, a picture
    without a greater value is one of 12.
    """
    tags = getattr(image, "tag_v2", {})
    bits = int(tags.get(_BITS_PER_SAMPLE, (16,))[0])
    if not 8 < bits < 16:
        bits = 12 if greatest < 1 << 12 else 16
    return (1 << bits) - 1


def deep_values(image: Image.Image, sample_id: str) -> NDArray[np.int64]:
    """The values (H, W) of an image of 16 bits a pixel, in any of Pillow's modes for it."""
    deep = np.asarray(image).astype(np.int64)
    if deep.min() < 0 or deep.max() > 65535:
        raise SampleError(
            sample_id,
            "image",
            f"has values from {deep.min()} to {deep.max()}: not an 8- or 16-bit picture",
        )
    return deep

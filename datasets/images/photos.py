"""Reading photographs: pixels as stored or upright, or an error that names the sample.

Unless the caller asks for upright pixels, they stay as the file stores them in every format: an
EXIF orientation is not applied, because annotations are made on stored pixels more often than not
and because decoders disagree (orientation.py). Images of 12 or 16 bits are scaled to 8,
palettes are looked up, transparency is dropped. Masks are read by rules of their own, see masks.py.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from animal3dbox.datasets.images.exif import FORMATS, PhotoFacts, facts_of
from animal3dbox.datasets.images.jpeg import (
    has_plain_pixels,
    jpeg_header,
    opencv_pixels,
    whole_jpeg,
)
from animal3dbox.datasets.images.orientation import (
    ON_ITS_SIDE,
    as_shown,
    decode_as_stored,
    exif_orientation,
    stored_width_height,
    turned_upright,
)
from animal3dbox.datasets.images.remote_files import (
    PictureSource,
    is_remote,
    local_source,
    of_header,
    readable,
    without_secrets,
)
from animal3dbox.errors import ConfigError, SampleError, without_addresses

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp")
"""Suffixes of the files that are images where nothing but their folder names them."""

MAX_PIXELS = 100_000_000
"""A file whose header promises more is not decoded: 100 megapixels are 300 MB."""

_BITS_PER_SAMPLE = 258
"""Number of the TIFF tag BitsPerSample, whose value is the depth of a grey."""
_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Photo:
    """A photograph as its file stores it, or upright, with the facts of its header.

    Attributes:
        pixels: (H, W, 3) uint8 RGB, as stored, or upright if the facts say so.
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
    path: PictureSource, sample_id: str, expected_hw: tuple[int, int] | None = None
) -> NDArray[np.uint8]:
    """The pixels (H, W, 3) of an image file as stored, uint8 RGB; see read_photo."""
    return read_photo(path, sample_id, expected_hw).pixels


def read_photo(
    source: PictureSource,
    sample_id: str,
    expected_hw: tuple[int, int] | None = None,
    *,
    upright: bool = False,
) -> Photo:
    """The photograph in an image file: its pixels, and the facts of its header.

    Args:
        source: a file in one of exif.FORMATS, whose name does not matter, the URL of one that
            fsspec reads, or its content.
        sample_id: named in every error.
        expected_hw: height and width that the annotations were made for; None: any.
        upright: whether the pixels are turned as the header says; else they are as stored.

    Raises:
        SampleError: no image, a truncated one, too large a one, or one of another size.

    """
    local = local_source(source, sample_id)
    content = whole_jpeg(local)
    header = None if content is None else jpeg_header(content)
    if content is None or header is None:
        content = b""  # left to Pillow
    elif header.is_silent and _is_expected(header.image_hw, expected_hw):
        pixels = opencv_pixels(content, header.image_hw)
        if pixels is not None:
            return Photo(pixels, PhotoFacts())
    with _open_image(local, sample_id, name=_name_of(source)) as image:
        facts = facts_of(image, upright=upright)
        if content and not facts.upright and has_plain_pixels(image):
            _check_size(image, sample_id, expected_hw, upright=upright)
            pixels = opencv_pixels(content, image.size[::-1])
            if pixels is not None:
                return Photo(pixels, facts)
        image = _decoded(image, sample_id, expected_hw, upright=upright)
        return Photo(rgb_pixels(image, sample_id), facts)


def _is_expected(image_hw: tuple[int, int], expected_hw: tuple[int, int] | None) -> bool:
    """Whether a picture may be decoded, and has the size of its annotations."""
    height, width = image_hw
    has_size = expected_hw is None or tuple(expected_hw) == image_hw
    return has_size and height * width <= MAX_PIXELS


def converted_image(
    path: Path | str,
    sample_id: str,
    expected_hw: tuple[int, int] | None,
    convert: Callable[[Image.Image, str], _T],
    *,
    upright: bool = False,
) -> _T:
    """The value that a function makes of a decoded image, with the errors of read_photo.

    Args:
        path: a file in one of exif.FORMATS.
        sample_id: named in every error.
        expected_hw: height and width that the annotations were made for; None: any.
        convert: called with the image and sample_id; Pillow's complaints in it are errors, too.
        upright: see read_photo.

    """
    with _open_image(path, sample_id) as image:
        return convert(_decoded(image, sample_id, expected_hw, upright=upright), sample_id)


def _decoded(
    image: Image.Image, sample_id: str, expected_hw: tuple[int, int] | None, *, upright: bool
) -> Image.Image:
    """An opened image, checked and decoded, as stored or upright."""
    _check_size(image, sample_id, expected_hw, upright=upright)
    orientation = exif_orientation(image)
    decode_as_stored(image)
    return turned_upright(image, orientation) if upright else image


@contextmanager
def _open_image(
    source: PictureSource, sample_id: str, *, name: str | None = None
) -> Iterator[Image.Image]:
    """The image of a file, URL or content for a with block; only its header has been read.

    Whatever Pillow complains of inside the block is an error that names the sample.
    """
    name = name or _name_of(source)
    try:
        with warnings.catch_warnings():
            # MAX_PIXELS decides what is too large, in _check_size.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            local = readable(local_source(source, sample_id))
            with Image.open(local, formats=FORMATS) as image:
                yield image
    except Image.DecompressionBombError as error:
        raise SampleError(sample_id, "image", f"{name} is too large to decode: {error}") from error
    except UnidentifiedImageError as error:
        # Pillow names the object in memory that it read from, another at every run.
        reason = f"it is no image of the formats {', '.join(FORMATS)}"
        raise SampleError(
            sample_id, "image", f"{name} cannot be decoded ({reason}); replace the file"
        ) from error
    except (OSError, SyntaxError, ValueError, NotImplementedError) as error:
        if isinstance(error, SampleError | ConfigError):
            raise
        raise SampleError(
            sample_id,
            "image",
            f"{name} cannot be decoded ({without_addresses(str(error))}); replace the file",
        ) from error


def _name_of(source: PictureSource) -> str:
    """What a picture is called in an error: the last part of its path or URL, without secrets."""
    if isinstance(source, bytes):
        return "its content"
    return Path(without_secrets(str(source)) if is_remote(str(source)) else source).name


def stored_size(path: PictureSource, sample_id: str, *, upright: bool = False) -> tuple[int, int]:
    """Height and width of an image file's pixels by its header, which are not decoded.

    Args:
        path: a file in one of exif.FORMATS.
        sample_id: named in every error.
        upright: whether the image is used turned as its header says, not as stored.

    Raises:
        SampleError: no image, or too large a one.

    """

    def size(local: Path | str | bytes) -> tuple[int, int]:
        with _open_image(local, sample_id, name=_name_of(path)) as image:
            _check_size(image, sample_id, None, upright=upright)
            width, height = _used_size(image, upright=upright)
            return height, width

    return of_header(path, sample_id, size)


def header_facts(source: PictureSource, sample_id: str, *, upright: bool = False) -> PhotoFacts:
    """The facts of a picture's header, its pixels not decoded; the defaults of one without EXIF.

    Args:
        source: a picture's file, URL or content.
        sample_id: named in every error.
        upright: whether its pixels are used turned as the header says, not as stored.

    Raises:
        SampleError: it cannot be read, or is no image.

    """

    def facts(local: Path | str | bytes) -> PhotoFacts:
        with _open_image(local, sample_id, name=_name_of(source)) as image:
            return facts_of(image, upright=upright)

    return of_header(source, sample_id, facts)


def checked_facts(
    path: PictureSource, sample_id: str, expected_hw: tuple[int, int], *, upright: bool = False
) -> PhotoFacts:
    """The header's facts of an image file that is whole and as large as annotated.

    Pixels are not decoded, but of a JPEG that ends within its picture. So a JPEG or PNG that was
    cut off is refused; other formats, and damage within the pixels of a whole JPEG, are not looked
    at.

    Raises:
        SampleError: no image, a truncated one, too large a one, or one of another size.

    """

    def facts(local: Path | str | bytes) -> PhotoFacts:
        content = whole_jpeg(local)
        header = None if content is None else jpeg_header(content)
        if header is not None and header.is_silent and _is_expected(header.image_hw, expected_hw):
            return PhotoFacts()
        with _open_image(local, sample_id, name=_name_of(path)) as image:
            _check_size(image, sample_id, expected_hw, upright=upright)
            facts = facts_of(image, upright=upright)
            if image.format == "JPEG" and content is None:
                decode_as_stored(image)
            elif image.format == "PNG":
                image.verify()
            return facts

    return of_header(path, sample_id, facts, with_end=True)


def _used_size(image: Image.Image, *, upright: bool) -> tuple[int, int]:
    """Width and height of an opened image as stored, or upright."""
    size = stored_width_height(image)
    return as_shown(size, exif_orientation(image)) if upright else size


def _check_size(
    image: Image.Image, sample_id: str, expected_hw: tuple[int, int] | None, *, upright: bool
) -> None:
    """Raise a SampleError unless an image can be decoded and has the size of its annotations."""
    width, height = stored_width_height(image)
    if width * height > MAX_PIXELS:
        raise SampleError(
            sample_id,
            "image",
            f"its header says {width} x {height} pixels, more than {MAX_PIXELS}; scale it down"
            " first",
        )
    if expected_hw is None:
        return
    size, expected = _used_size(image, upright=upright), tuple(expected_hw)[::-1]
    if size != expected:
        problem = _size_problem(size, expected, exif_orientation(image), upright=upright)
        raise SampleError(sample_id, "image", problem)


def _size_problem(
    size: tuple[int, int], expected: tuple[int, ...], orientation: int, *, upright: bool
) -> str:
    """What is wrong with an image of another size (width, height) than its annotations are for."""
    is_turned = orientation in ON_ITS_SIDE and size == expected[::-1]
    if is_turned and upright:
        return (
            f"turned upright by its EXIF orientation {orientation}, it is {size[0]} x {size[1]},"
            f" but the annotations are for {expected[0]} x {expected[1]}, its pixels as stored:"
            " leave out --orientation apply (apply_orientation=False)"
        )
    sizes = (
        f"its pixels are {size[0]} x {size[1]}, but the annotations are for"
        f" {expected[0]} x {expected[1]}"
    )
    if is_turned:
        return (
            f"{sizes}: they were made on the image as turned by its EXIF orientation {orientation};"
            " turn it so by --orientation apply (apply_orientation=True)"
        )
    return f"{sizes}: the image was resized or swapped"


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

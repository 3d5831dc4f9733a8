"""Reading photographs: pixels as stored, or an error that names the sample.

Pixels stay as the file stores them: an EXIF orientation is not applied, because annotations are
made on stored pixels more often than not and because decoders disagree (OpenCV turns them, Pillow
does not). 16-bit images are scaled to 8, palettes are looked up, transparency is dropped. Masks are
read by their own rules, see read_mask.
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
"""Files of these names are taken for images where nothing but a folder names them."""

MOST_IDS = 31
"""A mask whose levels go no higher holds ids, of which every one is the animal.

A higher one holds brightness.
"""
OTHER_ID = 100
"""So many pixels of one level in the lower half of a mask's range are no blurred edge, if they are
a quarter of the upper half's, too."""

_T = TypeVar("_T")

MAX_PIXELS = 100_000_000
"""A file whose header promises more is not decoded: 100 megapixels are 300 MB."""


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture and its header.

    Attributes:
        pixels: (H, W, 3) uint8 RGB, as stored.
        facts: of its header.
    """

    pixels: NDArray[np.uint8]
    facts: PhotoFacts


def resolve_inside(root: Path, relative: str, sample_id: str, field: str) -> Path:
    """The file that an annotation names, which must lie under root.

    Raises:
        SampleError: the path is absolute, leads out of root (through "..", or a link), or is no
            file.

    """
    home = root.resolve()
    if not relative or "\0" in relative:
        raise SampleError(sample_id, field, f"is {relative!r}, which names no file")
    try:
        path = (home / relative).resolve()
        is_file = path.is_file()
    except (
        OSError,
        RuntimeError,
        ValueError,
    ) as error:  # too long a name, a loop of links, a character no file name has
        raise SampleError(sample_id, field, f"{relative!r} names no file: {error}") from error
    if Path(relative).is_absolute() or not path.is_relative_to(home):
        raise SampleError(
            sample_id,
            field,
            f"{relative!r} leads out of {root}: paths must stay inside the images' root (see"
            " --images)",
        )
    if not is_file:
        raise SampleError(sample_id, field, f"there is no file {relative!r} under {root}")
    return path


def is_file(path: Path) -> bool:
    """Whether there is such a file.

    No, too, for what no file can be called, of which resolve_inside says why.
    """
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_image(
    path: Path, sample_id: str, expected_hw: tuple[int, int] | None = None
) -> NDArray[np.uint8]:
    """The pixels of an image file as stored; see read_photo."""
    return read_photo(path, sample_id, expected_hw).pixels


def read_photo(
    path: Path | str, sample_id: str, expected_hw: tuple[int, int] | None = None
) -> Photo:
    """An image file: its pixels as stored, and its header.

    Args:
        path: a file in one of exif.FORMATS; its name does not matter.
        sample_id: named in every error.
        expected_hw: the size that the annotations were made for.

    Raises:
        SampleError: no image, a truncated one, too large a one, or one of another size.

    """
    return _read(
        path,
        sample_id,
        expected_hw,
        lambda image, name: Photo(_as_rgb(image, name), facts_of(image)),
    )


def _read(
    path: Path | str,
    sample_id: str,
    expected_hw: tuple[int, int] | None,
    what: Callable[[Image.Image, str], _T],
) -> _T:
    """What a function makes of a decoded image; see read_photo."""
    with _opened(path, sample_id) as image:
        _check_size(image, sample_id, expected_hw)
        image.load()
        return what(image, sample_id)


@contextmanager
def _opened(path: Path | str, sample_id: str) -> Iterator[Image.Image]:
    """The file's header read.

    What Pillow complains of in the with block is an error that names the sample.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", Image.DecompressionBombWarning
            )  # MAX_PIXELS decides, in _check_size
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
    with _opened(path, sample_id) as image:
        _check_size(image, sample_id, None)
        return image.height, image.width


def checked_facts(path: Path, sample_id: str, expected_hw: tuple[int, int]) -> PhotoFacts:
    """The facts of an image file that is as large as annotated, its pixels not decoded.

    Raises SampleError.
    """
    with _opened(path, sample_id) as image:
        _check_size(image, sample_id, expected_hw)
        return facts_of(image)


def read_mask(path: Path | str, sample_id: str, expected_hw: tuple[int, int]) -> NDArray[np.bool_]:
    """A mask stored as a picture: all above 0, be it 1, 255 or ids.

    Of one that was compressed or smoothed, the upper half of its range.

    Raises:
        SampleError: no image, of another size than the annotations', without a pixel of the animal,
            or of ids above MOST_IDS.

    """
    levels = mask_levels(path, sample_id, expected_hw)
    top = int(levels.max())
    if top == 0:
        raise SampleError(
            sample_id,
            "mask",
            f"{Path(path).name} has no pixel above 0; leave its path out if there is no mask",
        )
    if top <= MOST_IDS:
        return np.asarray(levels > 0)
    mask = np.asarray(levels > top // 2)
    kept = int(np.count_nonzero(mask))
    if np.count_nonzero(levels) - kept > max(OTHER_ID, kept / 4):
        _check_smoothed(levels, top, kept, sample_id)
    return mask


def mask_levels(
    path: Path | str, sample_id: str, expected_hw: tuple[int, int]
) -> NDArray[np.integer]:
    """The values (H, W) of a mask's file.

    Greys as stored, of colours the brightest channel, of a single one its alpha, of a palette 0 and
    1.

    Raises:
        SampleError: no image, or of another size than the annotations'.

    """
    try:
        return _read(path, sample_id, expected_hw, _levels)
    except SampleError as error:
        raise SampleError(sample_id, "mask", error.problem) from error


def _check_smoothed(levels: NDArray[np.integer], top: int, kept: int, sample_id: str) -> None:
    """Raise a SampleError if one level of the lower half has an area of its own.

    An id, not an edge, nor a background that is not quite 0.
    """
    areas = np.bincount(levels[(levels > 0) & (levels <= top // 2)])
    if np.count_nonzero(levels == 0) > (area := int(areas.max())) > max(OTHER_ID, kept / 4):
        said = (
            f"has {area} pixels of {int(areas.argmax())} beside its {top}: ids of animals or parts"
            f" are read up to {MOST_IDS}"
        )
        raise SampleError(
            sample_id, "mask", f"{said}; save this animal's pixels as 255, all others as 0"
        )


def _levels(image: Image.Image, sample_id: str) -> NDArray[np.integer]:
    if image.mode == "L":
        return np.array(image)
    if image.mode == "P":
        return _of_palette(image, sample_id)
    if image.mode.startswith("I"):
        return _deep(image, sample_id)
    colors = _as_rgb(image, sample_id)
    if image.mode in ("RGBA", "LA") and (colors == colors[0, 0]).all():
        alpha = np.array(image.getchannel("A"))
        if alpha.min() < alpha.max():
            return alpha
    red, green, blue = np.moveaxis(colors, 2, 0)
    levels: NDArray[np.uint8] = np.maximum(np.maximum(red, green), blue)
    return levels


def _of_palette(image: Image.Image, sample_id: str) -> NDArray[np.uint8]:
    """1 for every index but 0, which is no animal, unless the colours say the opposite."""
    indices = np.array(image)
    palette = np.array(image.getpalette("RGB") or [0, 0, 0]).reshape(-1, 3)
    black = np.flatnonzero(~palette.any(axis=1))
    if palette[0].any() and np.isin(indices, black).any():
        raise SampleError(
            sample_id,
            "image",
            "has a palette whose black is not index 0: what is the animal? Save it as grey, 0"
            " and 255",
        )
    return (indices > 0).astype(np.uint8)


def _check_size(image: Image.Image, sample_id: str, expected_hw: tuple[int, int] | None) -> None:
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
    said = (
        f"its pixels are {width} x {height}, but the annotations are for {expected_hw[1]} x"
        f" {expected_hw[0]}"
    )
    turned = image.getexif().get(ExifTags.Base.Orientation, 1)
    if (width, height) == tuple(expected_hw) and turned in (5, 6, 7, 8):
        raise SampleError(
            sample_id,
            "image",
            f"{said}: they were made on the image as turned by its EXIF orientation {turned}; store"
            " the pixels turned",
        )
    raise SampleError(sample_id, "image", f"{said}: the image was resized or swapped")


def _as_rgb(image: Image.Image, sample_id: str) -> NDArray[np.uint8]:
    """8-bit RGB of any mode."""
    if image.mode.startswith("I"):
        deep = _deep(image, sample_id)
        grey = (
            deep if image.mode == "I" and deep.max() <= 255 else deep // 257
        )  # a 32-bit file that only holds 8 bits
        return np.repeat(grey.astype(np.uint8)[:, :, None], 3, axis=2)
    if image.mode == "F":
        raise SampleError(sample_id, "image", "holds floating-point values; save it as 8-bit first")
    if image.mode == "P" and "transparency" in image.info:
        image = image.convert("RGBA")
    return np.array(image.convert("RGB"))


def _deep(image: Image.Image, sample_id: str) -> NDArray[np.int64]:
    """The values of 16 bits a pixel, in one of Pillow's spellings."""
    deep = np.asarray(image).astype(np.int64)
    if deep.min() < 0 or deep.max() > 65535:
        raise SampleError(
            sample_id,
            "image",
            f"has values from {deep.min()} to {deep.max()}: not an 8- or 16-bit picture",
        )
    return deep

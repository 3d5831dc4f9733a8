"""JPEGs decoded by OpenCV: Pillow's pixels and Pillow's errors, whatever the file."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageCms

from animal3dbox.datasets.images import jpeg, photos
from animal3dbox.datasets.images.photos import read_photo
from animal3dbox.errors import SampleError

Picture = NDArray[np.uint8]
SIZES = [(48, 64), (1, 1), (7, 5), (17, 33), (31, 16), (16, 1), (1, 17), (65, 98)]
EXIF = Image.Exif()
EXIF[ExifTags.Base.Orientation] = 6


def picture(image_hw: tuple[int, int], seed: int = 0) -> Image.Image:
    """Smooth parts, sharp edges and noise."""
    height, width = image_hw
    generator = np.random.default_rng([seed, height, width])
    coarse = generator.integers(0, 256, (height // 9 + 2, width // 9 + 2, 3), dtype=np.uint8)
    pixels: Any = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    noise = generator.integers(0, 256, pixels.shape, dtype=np.uint8)
    pixels[: height // 2] = noise[: height // 2]
    return Image.fromarray(pixels.astype(np.uint8))


def written(image: Image.Image, **options: Any) -> bytes:
    file = io.BytesIO()
    image.save(file, "JPEG", **{"quality": 85, **options})
    return file.getvalue()


def by_pillow(content: bytes) -> Picture:
    with Image.open(io.BytesIO(content)) as image:
        return np.array(image.convert("RGB"))


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Of each JPEG that OpenCV was asked for, whether it gave pixels."""
    answers: list[bool] = []

    def watched(content: bytes, image_hw: tuple[int, int]) -> Picture | None:
        pixels = jpeg.opencv_pixels(content, image_hw)
        answers.append(pixels is not None)
        return pixels

    monkeypatch.setattr(photos, "opencv_pixels", watched)
    return answers


def test_the_two_libraries_here_decode_alike() -> None:
    assert jpeg.opencv_agrees()


@pytest.mark.parametrize("image_hw", SIZES)
@pytest.mark.parametrize(
    ("mode", "subsampling"), [("RGB", "4:4:4"), ("RGB", "4:2:2"), ("RGB", "4:2:0"), ("L", 0)]
)
@pytest.mark.parametrize("options", [{}, {"restart_marker_blocks": 3}, {"exif": EXIF}])
def test_ordinary_jpegs_are_decoded_by_opencv_to_pillows_pixels(
    tmp_path: Path,
    decoded: list[bool],
    image_hw: tuple[int, int],
    mode: str,
    subsampling: Any,
    options: dict[str, Any],
) -> None:
    for number, quality in enumerate((30, 75, 92)):
        image = picture(image_hw, number).convert(mode)
        content = written(image, quality=quality, subsampling=subsampling, **options)
        (tmp_path / "a.jpg").write_bytes(content)
        photo = read_photo(tmp_path / "a.jpg", "s", image_hw)
        assert np.array_equal(photo.pixels, by_pillow(content))
        assert photo.facts.orientation == (6 if "exif" in options else 1)
    assert decoded == 3 * [True]


def _srgb() -> bytes:
    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def _cmyk(image: Image.Image) -> bytes:
    return written(image.convert("CMYK"))


def _several_pictures(image: Image.Image) -> bytes:
    file = io.BytesIO()
    image.save(file, "MPO", save_all=True, append_images=[image])
    return file.getvalue()


LEFT_TO_PILLOW: dict[str, Callable[[Image.Image], bytes]] = {
    "progressive": lambda image: written(image, progressive=True),
    "colour profile": lambda image: written(image, icc_profile=_srgb()),
    "CMYK": _cmyk,
    "several pictures": _several_pictures,
    "bytes after its end": lambda image: written(image) + b"made by a camera",
}


@pytest.mark.parametrize("kind", LEFT_TO_PILLOW)
def test_other_jpegs_are_left_to_pillow(tmp_path: Path, decoded: list[bool], kind: str) -> None:
    content = LEFT_TO_PILLOW[kind](picture((48, 64)))
    (tmp_path / "a.jpg").write_bytes(content)
    read = read_photo(tmp_path / "a.jpg", "s", (48, 64)).pixels
    assert np.array_equal(read, by_pillow(content))
    assert not any(decoded)


def test_a_picture_that_is_turned_upright_is_left_to_pillow(
    tmp_path: Path, decoded: list[bool]
) -> None:
    content = written(picture((48, 64)), exif=EXIF)
    (tmp_path / "a.jpg").write_bytes(content)
    photo = read_photo(tmp_path / "a.jpg", "s", (64, 48), upright=True)
    assert np.array_equal(photo.pixels, np.rot90(by_pillow(content), -1))
    assert photo.facts.upright
    assert decoded == []


def _outcome(path: Path) -> Picture | str:
    try:
        return read_photo(path, "s").pixels
    except SampleError as error:
        return str(error)


def _spoiled(content: bytes, generator: np.random.Generator, way: int) -> bytes:
    """A file cut off, with wrong bytes in its pixels or header, or with a piece missing."""
    begin = content.index(b"\xff\xda")
    if way == 0:
        return content[: generator.integers(4, len(content))]
    if way == 1:
        first = int(generator.integers(begin, len(content) - 40))
        return content[:first] + content[first + int(generator.integers(1, 40)) :]
    spoiled = bytearray(content)
    places = (begin, len(content) - 2) if way == 2 else (2, begin)
    for place in generator.integers(*places, size=3):
        spoiled[place] = generator.integers(256)
    return bytes(spoiled)


@pytest.mark.parametrize("way", range(4))
def test_damaged_jpegs_give_pillows_pixels_or_pillows_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: int
) -> None:
    generator = np.random.default_rng(way)
    errors = 0
    for number in range(60):
        mode = "L" if number % 5 == 4 else "RGB"
        image = picture((61, 97), number).convert(mode)
        (tmp_path / "a.jpg").write_bytes(_spoiled(written(image), generator, way))
        outcome = _outcome(tmp_path / "a.jpg")
        with monkeypatch.context() as patched:
            patched.setattr(photos, "opencv_pixels", lambda *_: None)
            right = _outcome(tmp_path / "a.jpg")
        assert isinstance(outcome, str) == isinstance(right, str)
        assert np.array_equal(outcome, right)
        errors += isinstance(right, str)
    assert errors < 60 if way in (1, 2) else errors > 0


def test_an_opencv_that_decodes_otherwise_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = written(picture((48, 64)))
    (tmp_path / "a.jpg").write_bytes(content)
    monkeypatch.setattr(jpeg, "_decoded", lambda content: by_pillow(content) ^ 1)
    jpeg.opencv_agrees.cache_clear()
    try:
        assert np.array_equal(read_photo(tmp_path / "a.jpg", "s").pixels, by_pillow(content))
    finally:
        jpeg.opencv_agrees.cache_clear()


def test_pixels_can_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(written(picture((48, 64))))
    pixels = read_photo(tmp_path / "a.jpg", "s").pixels
    assert pixels.flags.writeable
    assert pixels.flags.c_contiguous

"""Photographs as they come.

Pixels as stored, whatever the file's mode, or an error that names the sample.
"""

import io
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from photo_dataset import png_that_claims
from PIL import EpsImagePlugin, Image, ImageFile

from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.named_files import portable_name, resolve_inside
from animal3dbox.datasets.images.photos import MAX_PIXELS, checked_facts, header_facts, read_image
from animal3dbox.errors import SampleError

Picture = NDArray[np.uint8]
RED, GREEN, BLUE, WHITE, BLACK = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255), (0, 0, 0)


@pytest.fixture(scope="module")
def noise() -> Picture:
    return np.random.default_rng(1).integers(0, 256, (40, 60, 3), dtype=np.uint8)


def stored(folder: Path, image: Image.Image, format: str, **options: object) -> Path:
    path = folder / "photo.jpg"  # the name says nothing about the format
    image.save(path, format, **options)
    return path


def first_row(path: Path) -> list[tuple[int, ...]]:
    return [tuple(pixel) for pixel in read_image(path, "s7")[0].tolist()]


def refusal(read: Callable[[], object], field: str = "image") -> str:
    """The message of the refusal, which names the sample and the field."""
    with pytest.raises(SampleError) as caught:
        read()
    assert (caught.value.sample_id, caught.value.field) == ("s7", field)
    assert str(caught.value).startswith(f"s7: {field}: ")
    return str(caught.value)


# Pixels of every mode
# -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("format", ["PNG", "BMP", "TIFF", "PPM"])
def test_rgb_pixels_come_back_as_stored(tmp_path: Path, noise: Picture, format: str) -> None:
    read = read_image(stored(tmp_path, Image.fromarray(noise), format), "s7", (40, 60))
    assert np.array_equal(read, noise)
    assert read.dtype == np.uint8
    assert read.flags.writeable


def test_16_bit_grey_is_scaled_to_8_bits(tmp_path: Path) -> None:
    deep = np.array([[0, 300, 25_800, 65_535]], dtype=np.uint16)
    assert first_row(stored(tmp_path, Image.fromarray(deep), "PNG")) == [
        BLACK,
        (1, 1, 1),
        (100, 100, 100),
        WHITE,
    ]


def test_big_endian_16_bit_grey_is_scaled_to_8_bits(tmp_path: Path) -> None:
    deep = np.array([[0, 300, 25_800, 65_535]], dtype=">u2")
    path = tmp_path / "photo.pgm"
    path.write_bytes(b"P5\n4 1\n65535\n" + deep.tobytes())
    assert first_row(path) == [BLACK, (1, 1, 1), (100, 100, 100), WHITE]


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_the_12_bits_of_a_camera_are_scaled_to_8(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    grey = np.array([[0, 300, 2_048, 4_095]], dtype=np.uint16)
    if suffix == ".png":  # in 16 bits, of which the highest four are never used
        assert cv2.imwrite(str(path), grey)
    else:
        path.write_bytes(twelve_bit_tiff(grey))
    assert read_image(path, "s5")[0, :, 0].tolist() == [0, 18, 127, 255]


def twelve_bit_tiff(grey: NDArray[np.uint16]) -> bytes:
    """A TIFF (little endian, not compressed) of two 12-bit values in three bytes."""
    height, width = grey.shape
    bits = np.unpackbits(grey.astype(">u2").view(np.uint8).reshape(height, width, 2), axis=2)
    data = np.packbits(bits[:, :, 4:].reshape(height, -1), axis=1).tobytes()
    tags = ((256, width), (257, height), (258, 12), (259, 1), (262, 1), (273, 8), (277, 1))
    entries = [struct.pack("<HHII", tag, 3, 1, value) for tag, value in (*tags, (278, height))]
    entries.append(struct.pack("<HHII", 279, 4, 1, len(data)))
    directory = struct.pack("<H", len(entries)) + b"".join(entries) + struct.pack("<I", 0)
    return b"II*\0" + struct.pack("<I", 8 + len(data)) + data + directory


def test_16_bit_rgb_is_scaled_to_8_bits(tmp_path: Path) -> None:
    bgr = np.array([[(0, 0, 65535), (300, 25_800, 51_500)]], dtype=np.uint16)
    (tmp_path / "photo.png").write_bytes(cv2.imencode(".png", bgr)[1].tobytes())
    assert first_row(tmp_path / "photo.png") == [RED, (201, 100, 1)]


def palette() -> Image.Image:
    image = Image.new("P", (3, 1))
    image.putpalette([*RED, *GREEN, *BLUE])
    image.putdata([0, 1, 2])
    return image


def test_a_palette_is_looked_up(tmp_path: Path) -> None:
    assert first_row(stored(tmp_path, palette(), "PNG")) == [RED, GREEN, BLUE]


@pytest.mark.parametrize("transparency", [1, b"\x00\x80\xff"])
def test_a_palette_with_transparency_keeps_its_colours(
    tmp_path: Path, transparency: int | bytes
) -> None:
    assert first_row(stored(tmp_path, palette(), "PNG", transparency=transparency)) == [
        RED,
        GREEN,
        BLUE,
    ]


def test_transparency_is_dropped_and_colours_stay(tmp_path: Path) -> None:
    rgba = np.array([[(*RED, 0), (*GREEN, 128), (*BLUE, 255)]], dtype=np.uint8)
    assert first_row(stored(tmp_path, Image.fromarray(rgba), "PNG")) == [RED, GREEN, BLUE]


def test_grey_with_transparency_becomes_grey(tmp_path: Path) -> None:
    la = np.array([[(0, 0), (100, 128), (255, 255)]], dtype=np.uint8)
    assert first_row(stored(tmp_path, Image.fromarray(la), "PNG")) == [
        BLACK,
        (100, 100, 100),
        WHITE,
    ]


def test_one_bit_becomes_black_and_white(tmp_path: Path) -> None:
    assert first_row(stored(tmp_path, Image.fromarray(np.array([[True, False]])), "PNG")) == [
        WHITE,
        BLACK,
    ]


def test_a_cmyk_jpeg_comes_out_in_its_colours(tmp_path: Path) -> None:
    path = stored(
        tmp_path, Image.new("CMYK", (16, 16), (0, 255, 255, 0)), "JPEG", quality=95
    )  # no cyan: red
    assert np.abs(read_image(path, "s7").astype(int) - np.array(RED)).max() <= 12


def test_an_animation_gives_its_first_frame(tmp_path: Path) -> None:
    frames = [Image.new("RGB", (4, 4), color) for color in (RED, GREEN)]
    path = stored(tmp_path, frames[0], "GIF", save_all=True, append_images=frames[1:])
    assert first_row(path)[0] == RED


def test_a_cameras_jpeg_of_several_pictures_gives_its_first(tmp_path: Path) -> None:
    frames = [Image.new("RGB", (16, 16), color) for color in (RED, GREEN)]
    path = stored(tmp_path, frames[0], "MPO", save_all=True, append_images=frames[1:])
    assert np.abs(read_image(path, "s7").astype(int) - np.array(RED)).max() <= 12


def test_a_floating_point_image_is_refused(tmp_path: Path) -> None:
    path = stored(tmp_path, Image.fromarray(np.ones((4, 4), dtype=np.float32)), "TIFF")
    assert "floating-point values; save it as 8-bit" in refusal(lambda: read_image(path, "s7"))


@pytest.mark.parametrize("value", [-1, 65536])
def test_a_32_bit_image_beyond_16_bits_is_refused(tmp_path: Path, value: int) -> None:
    path = stored(tmp_path, Image.fromarray(np.array([[0, value]], dtype=np.int32)), "TIFF")
    assert "not an 8- or 16-bit picture" in refusal(lambda: read_image(path, "s7"))


@pytest.mark.parametrize(("value", "grey"), [(200, 200), (65535, 255)])
def test_a_32_bit_image_keeps_its_greys(tmp_path: Path, value: int, grey: int) -> None:
    path = stored(tmp_path, Image.fromarray(np.array([[0, value]], dtype=np.int32)), "TIFF")
    assert first_row(path) == [(0, 0, 0), (grey, grey, grey)]


# Sizes and EXIF
# --------------------------------------------------------------------------------------------------


def turned(folder: Path, picture: Picture) -> Path:
    """A JPEG of 60 x 40 stored pixels that viewers show as 40 x 60."""
    exif = Image.Exif()
    exif[274] = 6
    return stored(folder, Image.fromarray(picture), "JPEG", exif=exif, quality=95)


def test_an_orientation_that_is_not_applied_is_told(tmp_path: Path, noise: Picture) -> None:
    (warning,) = header_facts(turned(tmp_path, noise), "a").warnings
    assert "EXIF orientation 6 was not applied" in warning
    assert header_facts(stored(tmp_path, Image.fromarray(noise), "JPEG"), "a") == PhotoFacts()


def test_pixels_of_a_turned_photo_stay_as_stored(tmp_path: Path) -> None:
    left_half_red = np.zeros((40, 60, 3), dtype=np.uint8)
    left_half_red[:, :30] = RED
    read = read_image(turned(tmp_path, left_half_red), "s7", (40, 60))
    assert read.shape == (40, 60, 3)
    assert read[:, :25, 0].min() > 200
    assert read[:, 35:, 0].max() < 50


def test_annotations_of_the_turned_photo_are_refused_and_exif_named(
    tmp_path: Path, noise: Picture
) -> None:
    said = refusal(lambda: read_image(turned(tmp_path, noise), "s7", (60, 40)))
    assert "its pixels are 60 x 40, but the annotations are for 40 x 60" in said
    assert "EXIF orientation 6" in said


@pytest.mark.parametrize("expected_hw", [(60, 40), (40, 61), (80, 120)])
def test_a_photo_of_another_size_is_refused_without_blaming_exif(
    tmp_path: Path, noise: Picture, expected_hw: tuple[int, int]
) -> None:
    said = refusal(
        lambda: read_image(stored(tmp_path, Image.fromarray(noise), "PNG"), "s7", expected_hw)
    )
    assert (
        f"its pixels are 60 x 40, but the annotations are for {expected_hw[1]} x {expected_hw[0]}"
        in said
    )
    assert "EXIF" not in said


def test_a_turned_photo_of_a_wholly_different_size_is_not_blamed_on_exif(
    tmp_path: Path, noise: Picture
) -> None:
    assert "EXIF" not in refusal(lambda: read_image(turned(tmp_path, noise), "s7", (61, 40)))


# Files that are no images
# ---------------------------------------------------------------------------------------------


def jpeg(picture: Picture) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG")
    return buffer.getvalue()


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(lambda good: good[: len(good) // 2], id="truncated"),
        pytest.param(lambda good: good[:3], id="almost_empty"),
        pytest.param(lambda good: b"", id="empty"),
        pytest.param(lambda good: b"not an image\n", id="text"),
        pytest.param(lambda good: b"\0" * 1000, id="zeros"),
        pytest.param(lambda good: png_that_claims(60, 40), id="png_without_its_pixels"),
        pytest.param(lambda good: b"\x89PNG\r\n\x1a\n" + b"\0" * 20, id="png_without_header"),
    ],
)
def test_a_damaged_file_is_refused(
    tmp_path: Path, noise: Picture, data: Callable[[bytes], bytes]
) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(data(jpeg(noise)))
    assert "photo.jpg cannot be decoded" in refusal(lambda: read_image(path, "s7"))


@pytest.mark.parametrize("format", ["JPEG", "PNG"])
def test_a_picture_that_was_cut_off_is_refused_when_its_header_is_read(
    tmp_path: Path, noise: Picture, format: str
) -> None:
    path = stored(tmp_path, Image.fromarray(noise), format)
    assert checked_facts(path, "s7", (40, 60)) == PhotoFacts()
    whole = path.read_bytes()
    path.write_bytes(whole + b"\0" * 7)  # some cameras fill a file up
    assert checked_facts(path, "s7", (40, 60)) == PhotoFacts()
    path.write_bytes(whole[: len(whole) // 2])
    assert "photo.jpg cannot be decoded" in refusal(lambda: checked_facts(path, "s7", (40, 60)))


def test_damaged_bytes_never_raise_anything_but_a_refusal(tmp_path: Path, noise: Picture) -> None:
    rng, path, good = np.random.default_rng(0), tmp_path / "photo.jpg", jpeg(noise)
    refused = 0
    for _ in range(300):
        data = np.frombuffer(good, dtype=np.uint8).copy()
        data[rng.integers(20, len(data), 4)] = rng.integers(0, 256, 4)
        path.write_bytes(data.tobytes())
        try:
            assert read_image(path, "s7").shape[2] == 3
        except SampleError:
            refused += 1
    assert refused > 0


@pytest.mark.parametrize("make", [Path.mkdir, lambda path: None], ids=["folder", "missing"])
def test_what_is_no_file_is_refused(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / "photo.jpg")
    assert "photo.jpg cannot be decoded" in refusal(
        lambda: read_image(tmp_path / "photo.jpg", "s7")
    )


def test_postscript_under_a_photos_name_is_refused_and_never_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(*arguments: object) -> None:
        raise AssertionError("Ghostscript was started")

    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", run)
    path = tmp_path / "photo.jpg"
    Image.new("RGB", (4, 4)).save(path, "EPS")
    assert "cannot be decoded" in refusal(lambda: read_image(path, "s7"))


@pytest.mark.parametrize(
    ("width", "height", "reason"),
    [
        (
            60_000,
            60_000,
            "photo.jpg is too large to decode",
        ),  # beyond twice Pillow's limit, which refuses by itself
        (12_000, 10_000, "12000 x 10000 pixels, more than 100000000"),  # where Pillow only warns
        (10_001, 10_000, "10001 x 10000 pixels, more than 100000000"),  # where the limit lies
    ],
)
def test_an_image_that_claims_too_many_pixels_is_refused_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int, height: int, reason: str
) -> None:
    def load(image: object) -> None:
        raise AssertionError("the pixels were decoded")

    monkeypatch.setattr(ImageFile.ImageFile, "load", load)
    path = tmp_path / "photo.jpg"
    path.write_bytes(png_that_claims(width, height))
    assert reason in refusal(lambda: read_image(path, "s7", (height, width)))


def test_an_image_of_just_the_most_pixels_goes_on_to_be_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded = []
    monkeypatch.setattr(ImageFile.ImageFile, "load", lambda image: decoded.append(image.size))
    monkeypatch.setattr(
        "animal3dbox.datasets.images.photos.rgb_pixels",
        lambda image, sample_id: np.zeros((1, 1, 3), dtype=np.uint8),
    )
    path = tmp_path / "photo.jpg"
    path.write_bytes(png_that_claims(10_000, MAX_PIXELS // 10_000))
    read_image(path, "s7")
    assert set(decoded) == {(10_000, 10_000)}


# Where files may lie
# --------------------------------------------------------------------------------------------------


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """images/dog/a.jpg, and a.jpg outside the root and in a sibling whose name begins like the
    root's."""
    root = tmp_path / "images"
    for folder in (root / "dog", tmp_path / "images-2", tmp_path / "outside"):
        folder.mkdir(parents=True)
        (folder / "a.jpg").touch()
    (root / "link.jpg").symlink_to(tmp_path / "outside" / "a.jpg")
    (root / "linked").symlink_to(tmp_path / "outside")
    (root / "inner.jpg").symlink_to(root / "dog" / "a.jpg")
    (root / "loop.jpg").symlink_to("loop.jpg")
    (root / "dangling.jpg").symlink_to("nowhere.jpg")
    return root


@pytest.mark.parametrize(
    ("relative", "reason"),
    [
        ("../outside/a.jpg", "leads out of"),
        ("dog/../../outside/a.jpg", "leads out of"),
        ("../images-2/a.jpg", "leads out of"),
        ("/etc/hostname", "leads out of"),
        ("link.jpg", "leads out of"),
        ("linked/a.jpg", "leads out of"),
        ("../outside/nothing.jpg", "leads out of"),  # and does not tell what there is outside
        ("missing.jpg", "there is no file 'missing.jpg'"),
        ("dangling.jpg", "there is no file"),
        ("dog", "there is no file"),
        (".", "there is no file"),
        ("dog/a.jpg/b.jpg", "there is no file"),
        ("", "names no file"),
        ("a\0.jpg", "names no file"),
        ("loop.jpg", "names no file"),
        ("loop.jpg/a.jpg", "names no file"),
        ("x" * 300, "names no file"),
        ("x/" * 3000 + "a.jpg", "names no file"),
    ],
)
def test_a_path_is_refused_unless_it_is_a_file_under_the_root(
    root: Path, relative: str, reason: str
) -> None:
    assert reason in refusal(lambda: resolve_inside(root, relative, "s7", "img_path"), "img_path")


@pytest.mark.parametrize(
    "written",
    [
        "{root}/dog/a.jpg",
        "/somebody/else/dog/a.jpg",
        "C:\\somebody\\dog\\a.jpg",
        "dog\\a.jpg",
        "photos/dog/a.jpg",
        "dog%2Fa.jpg",
        "https://example.org/set/dog/a.jpg",
        "DOG/A.JPG",
    ],
)
def test_a_path_written_elsewhere_is_found_where_one_file_answers(root: Path, written: str) -> None:
    name = written.format(root=root)
    assert resolve_inside(root, name, "s7", "img_path") == (root / "dog" / "a.jpg").resolve()
    assert str(root) not in portable_name(root, name)


def test_a_path_in_another_unicode_form_is_found(tmp_path: Path) -> None:
    composed, decomposed = "b\u00e4r.jpg", "ba\u0308r.jpg"
    (tmp_path / composed).write_bytes(b"x")
    assert resolve_inside(tmp_path, decomposed, "s7", "img_path").name == composed


def test_a_path_that_may_be_two_files_is_refused(tmp_path: Path) -> None:
    for name in ("A.jpg", "a.JPG"):
        (tmp_path / name).write_bytes(b"x")
    words = refusal(lambda: resolve_inside(tmp_path, "a.jpg", "s7", "img_path"), "img_path")
    assert "may be 'A.jpg' and 'a.JPG'" in words


def test_a_near_miss_is_named(root: Path) -> None:
    words = refusal(lambda: resolve_inside(root, "dog/b.jpg", "s7", "img_path"), "img_path")
    assert "the nearest there is 'a.jpg'" in words


@pytest.mark.parametrize("relative", ["dog/a.jpg", "./dog/a.jpg", "dog/../dog/a.jpg", "inner.jpg"])
def test_a_path_that_stays_inside_is_found(root: Path, relative: str) -> None:
    assert resolve_inside(root, relative, "s7", "img_path") == (root / "dog" / "a.jpg").resolve()


def test_the_root_itself_may_be_a_link(root: Path, tmp_path: Path) -> None:
    (tmp_path / "by_link").symlink_to(root)
    assert (
        resolve_inside(tmp_path / "by_link", "dog/a.jpg", "s7", "img_path")
        == (root / "dog" / "a.jpg").resolve()
    )

"""Pictures as their files store them, or upright: the same for every format, and for masks."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin
from turned_pictures import Pixels, save_turned, stored_pixels

from animal3dbox.datasets.images.masks import read_mask
from animal3dbox.datasets.images.photos import checked_facts, header_facts, read_photo, stored_size
from animal3dbox.errors import SampleError

UPRIGHT_HW = (40, 60)
ORIENTATIONS = range(1, 9)
FORMATS = ("PNG", "TIFF", "WEBP", "JPEG")


@pytest.fixture(scope="module")
def upright() -> Pixels:
    """A picture no two of whose eight turns are alike, in blocks that JPEG keeps."""
    corners = np.random.default_rng(3).integers(0, 256, (5, 8, 3), dtype=np.uint8)
    return np.kron(corners, np.ones((8, 8, 1), dtype=np.uint8))[:40, :60]


def near(found: Pixels, expected: Pixels, format: str) -> bool:
    limit = 40 if format == "JPEG" else 0
    difference = np.abs(found.astype(int) - expected.astype(int))
    return found.shape == expected.shape and float(np.median(difference)) <= limit / 8


def file_hw(orientation: int) -> tuple[int, int]:
    return UPRIGHT_HW if orientation < 5 else UPRIGHT_HW[::-1]


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("format", FORMATS)
def test_pixels_are_as_stored_or_upright(
    tmp_path: Path, upright: Pixels, format: str, orientation: int
) -> None:
    path = save_turned(tmp_path / "a", upright, orientation, format)
    stored = read_photo(path, "s", file_hw(orientation))
    assert near(stored.pixels, stored_pixels(upright, orientation), format)
    assert (stored.facts.orientation, stored.facts.upright) == (orientation, False)
    turned = read_photo(path, "s", UPRIGHT_HW, upright=True)
    assert near(turned.pixels, upright, format)
    assert (turned.facts.orientation, turned.facts.upright) == (orientation, orientation != 1)


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("format", FORMATS)
def test_headers_tell_the_same_without_the_pixels(
    tmp_path: Path, upright: Pixels, format: str, orientation: int
) -> None:
    path = save_turned(tmp_path / "a", upright, orientation, format)
    assert stored_size(path, "s") == file_hw(orientation)
    assert stored_size(path, "s", upright=True) == UPRIGHT_HW
    for is_upright, hw in ((False, file_hw(orientation)), (True, UPRIGHT_HW)):
        facts = read_photo(path, "s", upright=is_upright).facts
        assert header_facts(path, "a", upright=is_upright) == facts
        assert checked_facts(path, "s", hw, upright=is_upright) == facts


@pytest.mark.parametrize("options", [{}, {"compression": "tiff_lzw"}, {"compression": "jpeg"}])
def test_compressed_tiffs_lie_as_plain_ones(
    tmp_path: Path, upright: Pixels, options: dict[str, str]
) -> None:
    exif = Image.Exif()
    exif[274] = 6
    image = Image.fromarray(stored_pixels(upright, 6))
    image.save(tmp_path / "a.tif", "TIFF", exif=exif, **options)
    assert stored_size(tmp_path / "a.tif", "s") == (60, 40)
    pixels = read_photo(tmp_path / "a.tif", "s", (60, 40)).pixels
    assert near(pixels, stored_pixels(upright, 6), "JPEG")
    assert near(read_photo(tmp_path / "a.tif", "s", upright=True).pixels, upright, "JPEG")


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("mode", ["L", "P", "1", "I;16", "RGBA"])
@pytest.mark.parametrize("format", ["PNG", "TIFF"])
def test_masks_lie_as_pictures_do(tmp_path: Path, format: str, mode: str, orientation: int) -> None:
    mask = np.zeros(UPRIGHT_HW, dtype=bool)
    mask[4:20, 30:55] = True
    stored = stored_pixels(mask.view(np.uint8) * np.uint8(255), orientation)
    image = Image.fromarray(stored)
    if mode == "I;16":
        image = Image.fromarray(stored.astype(np.uint16) * 257)
    elif mode != "L":
        image = image.convert(mode)
    exif = Image.Exif()
    exif[274] = orientation
    image.save(tmp_path / "a", format, exif=exif)
    turned = read_mask(tmp_path / "a", "s", UPRIGHT_HW, upright=True)
    assert np.array_equal(turned, mask)
    as_stored = read_mask(tmp_path / "a", "s", file_hw(orientation))
    assert np.array_equal(as_stored, stored > 0)


def late_exif(path: Path) -> None:
    """Move a PNG's EXIF chunk behind its pixels, where the format allows it too."""
    data = path.read_bytes()
    at = data.index(b"eXIf") - 4
    end = at + 12 + int.from_bytes(data[at : at + 4], "big")
    rest = data[:at] + data[end:]
    path.write_bytes(rest[:-12] + data[at:end] + rest[-12:])


def test_a_png_that_tells_it_behind_its_pixels_is_turned_and_not_decoded_for_it(
    tmp_path: Path, upright: Pixels, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = save_turned(tmp_path / "a.png", upright, 6, "PNG")
    late_exif(path)
    assert near(read_photo(path, "s", UPRIGHT_HW, upright=True).pixels, upright, "PNG")
    plain = save_turned(tmp_path / "b.png", upright, 1, "PNG")
    Image.fromarray(upright).save(plain, "PNG")

    def refuse(image: Image.Image) -> None:
        raise AssertionError("pixels were decoded")

    monkeypatch.setattr(Image.Image, "load", refuse)
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", refuse)
    assert stored_size(path, "s", upright=True) == UPRIGHT_HW
    assert header_facts(path, "a").orientation == 6
    assert stored_size(plain, "s", upright=True) == UPRIGHT_HW
    assert header_facts(plain, "a").orientation == 1


def test_an_orientation_in_an_xmp_packet_counts(tmp_path: Path, upright: Pixels) -> None:
    packet = b'<x:xmpmeta><rdf:Description tiff:Orientation="6"/></x:xmpmeta>'
    image = Image.fromarray(stored_pixels(upright, 6))
    image.save(tmp_path / "a.webp", lossless=True, xmp=packet)
    assert near(read_photo(tmp_path / "a.webp", "s", upright=True).pixels, upright, "WEBP")


@pytest.mark.parametrize("number", [0, 9, 77])
def test_a_number_that_exif_does_not_have_is_upright(
    tmp_path: Path, upright: Pixels, number: int
) -> None:
    exif = Image.Exif()
    exif[274] = number
    Image.fromarray(upright).save(tmp_path / "a.png", exif=exif)
    assert np.array_equal(read_photo(tmp_path / "a.png", "s", upright=True).pixels, upright)


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_annotations_for_the_other_pixels_are_refused_with_the_remedy(
    tmp_path: Path, upright: Pixels, orientation: int, format: str
) -> None:
    path = save_turned(tmp_path / "a", upright, orientation, format)
    with pytest.raises(SampleError) as stored:
        read_photo(path, "s7", UPRIGHT_HW)
    assert str(stored.value) == (
        "s7: image: its pixels are 40 x 60, but the annotations are for 60 x 40: they were made on"
        f" the image as turned by its EXIF orientation {orientation}; turn it so by --orientation"
        " apply (apply_orientation=True)"
    )
    with pytest.raises(SampleError) as turned:
        read_photo(path, "s7", UPRIGHT_HW[::-1], upright=True)
    assert str(turned.value) == (
        f"s7: image: turned upright by its EXIF orientation {orientation}, it is 60 x 40, but the"
        " annotations are for 40 x 60, its pixels as stored: leave out --orientation apply"
        " (apply_orientation=False)"
    )
    with pytest.raises(SampleError, match=r"its pixels are 60 x 40, but .* resized or swapped"):
        read_photo(path, "s7", (41, 60), upright=True)


@pytest.mark.parametrize(
    ("orientation", "size", "is_flagged"),
    [(1, (60, 40), False), (2, (60, 40), True), (3, (60, 40), True), (4, (60, 40), True),
     (6, (60, 40), False), (6, (40, 40), True)],
)  # fmt: skip
def test_pictures_whose_size_does_not_tell_are_flagged(
    tmp_path: Path, orientation: int, size: tuple[int, int], *, is_flagged: bool
) -> None:
    picture = np.zeros((size[1], size[0], 3), dtype=np.uint8)
    path = save_turned(tmp_path / "a.png", picture, orientation)
    facts = header_facts(path, "a")
    assert facts.flags == (("not_turned",) if is_flagged else ())
    assert bool(facts.warnings) == (orientation != 1)
    applied = header_facts(path, "a", upright=True)
    assert applied.flags == ()
    assert ["turned upright" in one for one in applied.warnings] == [True] * (orientation != 1)


@pytest.mark.parametrize("orientation", [3, 6])
@pytest.mark.parametrize("format", ["PNG", "JPEG", "WEBP"])
def test_a_focal_length_is_that_of_the_sensor_however_it_was_held(
    tmp_path: Path, format: str, orientation: int
) -> None:
    exif = Image.Exif()
    exif[274] = orientation
    # 25 mm at 100 px a mm, of a sensor of 6000 x 4000 px: 2500 px of 6000, so 25 px of 60 px.
    exif[34665] = {37386: 25.0, 41486: 100.0, 41488: 4, 40962: 6000, 40963: 4000}
    stored = np.zeros((40, 60, 3), dtype=np.uint8)
    Image.fromarray(stored).save(tmp_path / "a", format, exif=exif)
    for is_upright in (False, True):
        facts = header_facts(tmp_path / "a", "a", upright=is_upright)
        assert facts.focal_px == pytest.approx(25.0), facts.warnings


def test_a_tiff_that_lies_on_its_side_was_not_cropped(tmp_path: Path) -> None:
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[274] = 6
    tags[34665] = {37386: 25.0, 41486: 100.0, 41488: 4, 40962: 6000, 40963: 4000}
    stored = np.zeros((40, 60, 3), dtype=np.uint8)
    Image.fromarray(stored).save(tmp_path / "a.tif", tiffinfo=tags)
    for is_upright in (False, True):
        facts = header_facts(tmp_path / "a.tif", "a", upright=is_upright)
        assert facts.focal_px == pytest.approx(25.0), facts.warnings

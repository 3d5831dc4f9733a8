"""Focal lengths that photographs carry in their headers."""

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from animal3dbox.datasets.images.exif import PhotoFacts
from animal3dbox.datasets.images.photos import header_facts, read_photo
from animal3dbox.errors import SampleError

Tags = dict[int, object]
F35, FOCAL = int(ExifTags.Base.FocalLengthIn35mmFilm), int(ExifTags.Base.FocalLength)
WIDTH, HEIGHT = int(ExifTags.Base.ExifImageWidth), int(ExifTags.Base.ExifImageHeight)
PLANE_X, PLANE_UNIT = (
    int(ExifTags.Base.FocalPlaneXResolution),
    int(ExifTags.Base.FocalPlaneResolutionUnit),
)


def photo(folder: Path, tags: Tags, size: tuple[int, int] = (60, 40)) -> Path:
    exif = Image.Exif()
    exif[ExifTags.IFD.Exif] = tags
    path = folder / "photo.jpg"
    Image.fromarray(np.zeros((size[1], size[0], 3), np.uint8)).save(path, exif=exif)
    return path


def test_a_35_mm_equivalent_refers_to_the_diagonal(tmp_path: Path) -> None:
    focal = header_facts(photo(tmp_path, {F35: 50}), "a").focal_px
    assert focal == pytest.approx(
        50 / math.hypot(36, 24) * math.hypot(60, 40)
    )  # 83.3 px: at 3:2 the same as 50 / 36 of the width
    assert focal == pytest.approx(50 / 36 * 60)


def test_a_focal_length_in_mm_needs_the_pixels_of_the_sensor(tmp_path: Path) -> None:
    told: Tags = {
        FOCAL: 25.0,
        PLANE_X: 100.0,
        PLANE_UNIT: 4,
        WIDTH: 6000,
        HEIGHT: 4000,
    }  # 100 px a mm: 2500 px of 6000
    assert header_facts(photo(tmp_path, told), "a").focal_px == pytest.approx(25.0)  # of 60 px
    inches: Tags = {**told, PLANE_X: 2540.0, PLANE_UNIT: 2}
    assert header_facts(photo(tmp_path, inches), "a").focal_px == pytest.approx(25.0)
    assert header_facts(photo(tmp_path, {FOCAL: 25.0}), "a").focal_px is None


def test_a_resized_photo_keeps_its_field_of_view_and_a_cropped_one_loses_it(tmp_path: Path) -> None:
    resized = header_facts(photo(tmp_path, {F35: 50, WIDTH: 6000, HEIGHT: 4000}), "a")
    assert resized.focal_px == pytest.approx(50 / 36 * 60)
    cropped = header_facts(photo(tmp_path, {F35: 50, WIDTH: 4000, HEIGHT: 4000}), "a")
    assert cropped.focal_px is None
    assert "was cropped from 4000 x 4000 to 60 x 40" in cropped.warnings[0]


@pytest.mark.parametrize("tags", [{F35: 0}, {FOCAL: 0.0, PLANE_X: 100.0}, {}])
def test_a_zero_is_exifs_unknown(tmp_path: Path, tags: Tags) -> None:
    assert header_facts(photo(tmp_path, tags), "a") == PhotoFacts()


def test_a_focal_length_that_no_camera_has_is_not_used(tmp_path: Path) -> None:
    facts = header_facts(photo(tmp_path, {F35: 60000}), "a")
    assert facts.focal_px is None
    assert "which no camera has" in facts.warnings[0]


def test_reading_the_pixels_tells_the_same(tmp_path: Path) -> None:
    path = photo(tmp_path, {F35: 28})
    assert read_photo(path, "s").facts == header_facts(path, "a")


def test_a_file_that_is_no_picture_is_refused(tmp_path: Path) -> None:
    (tmp_path / "words.jpg").write_text("words")
    with pytest.raises(SampleError, match=r"^me: image: words.jpg cannot be decoded \(it is no im"):
        header_facts(tmp_path / "words.jpg", "me")

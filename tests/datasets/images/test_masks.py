"""Masks stored as pictures.

What is the animal in a file of any mode, and when that cannot be told.
"""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from animal3dbox.datasets.images.masks import MOST_IDS, read_mask, record_mask
from animal3dbox.datasets.images.rle import encode_mask
from animal3dbox.errors import SampleError

HW = (40, 60)
ANIMAL = np.zeros(HW, dtype=bool)
ANIMAL[10:30, 10:50] = True
HEAD = np.zeros(HW, dtype=bool)
HEAD[10:30, 10:30] = True


def read(
    folder: Path, image: Image.Image, format: str = "PNG", **options: object
) -> NDArray[np.bool_]:
    image.save(folder / "mask", format, **options)
    return read_mask(folder / "mask", "s7", HW)


def refusal(folder: Path, image: Image.Image) -> str:
    with pytest.raises(SampleError) as caught:
        read(folder, image)
    assert str(caught.value).startswith("s7: mask: ")
    return str(caught.value)


def ids(head: int, body: int, kind: str = "uint8") -> Image.Image:
    return Image.fromarray(np.where(HEAD, head, np.where(ANIMAL, body, 0)).astype(kind))


@pytest.mark.parametrize("kind", ["uint8", "uint16", "int32"])
@pytest.mark.parametrize(("head", "body"), [(1, 1), (255, 255), (1, 2), (2, 1), (3, MOST_IDS)])
def test_all_above_0_is_the_animal_in_a_mask_of_two_levels_or_of_ids(
    tmp_path: Path, kind: str, head: int, body: int
) -> None:
    assert np.array_equal(
        read(tmp_path, ids(head, body, kind), "TIFF" if kind == "int32" else "PNG"), ANIMAL
    )


def test_a_mask_over_all_16_bits_is_read(tmp_path: Path) -> None:
    assert np.array_equal(read(tmp_path, ids(65535, 65535, "uint16")), ANIMAL)


def test_a_compressed_or_smoothed_mask_is_cut_in_the_middle_of_its_range(tmp_path: Path) -> None:
    white = Image.fromarray(ANIMAL.astype(np.uint8) * 255)
    for quality in (50, 75, 95):
        assert np.array_equal(read(tmp_path, white, "JPEG", quality=quality), ANIMAL)
    assert np.array_equal(
        read(tmp_path, Image.fromarray(ANIMAL.astype(np.uint8) * 250 + 2)), ANIMAL
    )  # a background that is not quite black
    coarse = white.resize((15, 10), Image.Resampling.BOX).resize(
        (60, 40), Image.Resampling.BILINEAR
    )
    assert np.array_equal(read(tmp_path, coarse), np.asarray(coarse) > 127)


@pytest.mark.parametrize(("head", "body"), [(40, 90), (100, 200), (1, 255)])
def test_ids_too_high_to_be_told_from_brightness_are_a_fault_with_a_remedy(
    tmp_path: Path, head: int, body: int
) -> None:
    said = refusal(tmp_path, ids(head, body))
    assert f"has 400 pixels of {head} beside its {body}" in said
    assert "save this animal's pixels as 255, all others as 0" in said


@pytest.mark.parametrize(("first", "edge"), [((0, 0, 0), 2), ((90, 10, 10), 2), ((0, 0, 0), 255)])
def test_a_palettes_index_0_is_no_animal_and_every_other_is(
    tmp_path: Path, first: tuple[int, ...], edge: int
) -> None:
    image = ids(1, edge)
    image.putpalette(
        [*first, 64, 0, 0, 0, 255, 0]
    )  # of index 1 a dark red, half of which is less than a half of green
    assert image.mode == "P"
    assert np.array_equal(read(tmp_path, image), ANIMAL)


def test_a_palette_whose_black_is_another_index_is_a_fault(tmp_path: Path) -> None:
    image = ids(1, 1)
    image.putpalette([255, 255, 255, 0, 0, 0])
    assert "has a palette whose black is not index 0" in refusal(tmp_path, image)


@pytest.mark.parametrize("color", [0, 255])
@pytest.mark.parametrize("mode", ["LA", "RGBA"])
def test_the_alpha_of_a_single_colour_is_the_mask(tmp_path: Path, mode: str, color: int) -> None:
    plain, alpha = Image.new("L", (60, 40), color), Image.fromarray(ANIMAL.astype(np.uint8) * 255)
    assert np.array_equal(
        read(tmp_path, Image.merge(mode, [plain] * (len(mode) - 1) + [alpha])), ANIMAL
    )


def test_colours_that_differ_are_the_mask_whatever_the_alpha(tmp_path: Path) -> None:
    white, alpha = (
        Image.fromarray(ANIMAL.astype(np.uint8) * 255),
        Image.fromarray(HEAD.astype(np.uint8) * 255),
    )
    assert np.array_equal(read(tmp_path, Image.merge("LA", [white, alpha])), ANIMAL)
    assert "has no pixel above 0" in refusal(tmp_path, Image.new("LA", (60, 40), (0, 255)))


def test_a_record_s_mask_is_decoded_from_its_runs_else_its_picture_else_there_is_none(
    tmp_path: Path,
) -> None:
    Image.fromarray(ANIMAL.astype(np.uint8) * 255).save(tmp_path / "mask.png")

    def decoded(runs: str | None, path: Path) -> list[list[bool]]:
        mask = record_mask(runs, path, sample_id="s7", image_hw=HW)
        assert mask is not None
        return list(mask.tolist())

    path = tmp_path / "mask.png"
    Image.fromarray(ANIMAL.astype(np.uint8) * 255).save(path)
    assert decoded(encode_mask(HEAD), path) == HEAD.tolist()
    assert decoded(None, path) == ANIMAL.tolist()
    assert record_mask(None, None, sample_id="s7", image_hw=HW) is None

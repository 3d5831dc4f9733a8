"""Run-length masks against numbers worked out by hand and COCO's own loop, written out slowly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from animal3dbox.datasets.images.rle import (
    RleError,
    decode_counts,
    decode_mask,
    encode_counts,
    encode_mask,
    mask_area,
    ordinary_counts,
)
from animal3dbox.errors import Animal3DBoxError

MASKS = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=30))


def slow_runs(mask: NDArray[np.bool_]) -> list[int]:
    """Run lengths by walking down each column; the first run is of zeros."""
    runs, value = [0], False
    for column in range(mask.shape[1]):
        for row in range(mask.shape[0]):
            if bool(mask[row, column]) != value:
                value = not value
                runs.append(0)
            runs[-1] += 1
    return runs


def slow_text(runs: list[int]) -> str:
    """COCO's rleToString, line by line."""
    text = ""
    for i in range(len(runs)):
        x = runs[i]
        if i > 2:
            x -= runs[i - 2]
        more = True
        while more:
            c = x & 0x1F
            x >>= 5
            more = x != -1 if c & 0x10 else x != 0
            if more:
                c |= 0x20
            text += chr(c + 48)
    return text


@pytest.mark.parametrize(
    ("text", "counts"),
    [
        ("231", [2, 3, 1]),
        ("`0", [16]),  # bit 4 would be the sign: a second group says that it is not
        ("T3", [100]),  # 100 = 3 * 32 + 4
        ("11110", [1, 1, 1, 2, 1]),  # from the fourth on differences to two before
        ("151M", [1, 5, 1, 2]),  # 2 - 5 = -3
        ("", []),
    ],
)
def test_text_stands_for_the_counts_worked_out_by_hand(text: str, counts: list[int]) -> None:
    assert decode_counts(text) == counts
    assert encode_counts(counts) == text


def test_runs_go_down_the_columns_and_begin_with_zeros() -> None:
    assert decode_mask("231", (2, 3)).astype(int).tolist() == [[0, 1, 1], [0, 1, 0]]
    assert decode_mask([2, 3, 1], (2, 3)).astype(int).tolist() == [[0, 1, 1], [0, 1, 0]]
    assert decode_mask([0, 6], (2, 3)).all()


def test_a_mask_that_begins_with_the_animal_has_a_first_run_of_zero() -> None:
    assert encode_mask(np.array([[True, False]])) == "011"


@given(MASKS)
def test_encoding_agrees_with_the_slow_reference(mask: NDArray[np.bool_]) -> None:
    assert encode_mask(mask) == slow_text(slow_runs(mask))


@given(MASKS)
def test_a_mask_comes_back_from_its_text_and_from_its_counts(mask: NDArray[np.bool_]) -> None:
    shape = (mask.shape[0], mask.shape[1])
    assert np.array_equal(decode_mask(encode_mask(mask), shape), mask)
    assert np.array_equal(decode_mask(slow_runs(mask), shape), mask)


@given(st.lists(st.integers(0, 10**9), max_size=40))
def test_counts_of_any_size_come_back_from_the_slow_reference(counts: list[int]) -> None:
    assert decode_counts(slow_text(counts)) == counts


@given(st.lists(st.integers(-10, 10**6), min_size=1, max_size=40) | st.text(max_size=12))
def test_ordinary_texts_are_read_at_once_as_one_by_one(counts: list[int] | str) -> None:
    text = counts if isinstance(counts, str) else encode_counts(counts)
    runs = ordinary_counts(text)
    assert runs is not None or isinstance(counts, str)
    if runs is not None:
        assert runs.tolist() == decode_counts(text)


@given(MASKS)
def test_the_area_of_a_mask_is_that_of_its_pixels(mask: NDArray[np.bool_]) -> None:
    shape = (mask.shape[0], mask.shape[1])
    assert mask_area(encode_mask(mask), shape) == mask_area(slow_runs(mask), shape) == mask.sum()


@given(st.text(max_size=30), st.integers(1, 9), st.integers(1, 9))
def test_any_text_is_a_mask_of_the_size_asked_for_or_an_error(
    text: str, height: int, width: int
) -> None:
    try:
        mask = decode_mask(text, (height, width))
    except RleError:
        return
    assert mask.shape == (height, width)
    assert mask.dtype == np.bool_


@pytest.mark.parametrize(
    ("counts", "reason"),
    [
        ("23", "has runs of 5 pixels in all, but the image has 2 x 3 = 6"),
        ("232", "has runs of 7 pixels"),
        ("", "has runs of 0 pixels"),
        ([], "has runs of 0 pixels"),
        ([7, -1], "has a run of -1 pixels"),
        ("7O", "has a run of -1 pixels"),
        ("23q", "has the character 'q'"),
        ("2 3", "has the character ' '"),
        ("23/", "has the character '/'"),
        ("23\x00", r"has the character '\x00'"),
        ("23é", "has the character 'é'"),
        ("23`", "ends within a number: it was cut off"),
        ("o" * 20 + "0", "more than 60 bits"),
    ],
)
def test_a_damaged_mask_is_refused_with_its_reason(counts: str | list[int], reason: str) -> None:
    with pytest.raises(RleError) as caught:
        decode_mask(counts, (2, 3))
    assert reason in str(caught.value)
    assert isinstance(caught.value, Animal3DBoxError)

"""How far masks reach: supports of known shapes, cut masks, lenses."""

import numpy as np
import pytest
from numpy.typing import NDArray

from animal3dbox.geometry.mask_supports import PIXEL_REACH, even_directions, mask_supports

DIRECTIONS = even_directions(16)


def disc(
    radius: float, center: tuple[float, float], hw: tuple[int, int] = (120, 160)
) -> np.ndarray:
    y, x = np.mgrid[:120, :160]
    inside: NDArray[np.bool_] = (x - center[0]) ** 2 + (y - center[1]) ** 2 <= radius**2
    return inside


@pytest.mark.parametrize("radius", [5.3, 20.7, 41.2])
def test_a_disc_reaches_as_far_in_every_direction(radius: float) -> None:
    supports = mask_supports(disc(radius, (70.2, 60.6)), DIRECTIONS)
    assert len(supports.heights) == 16
    reach = supports.heights - supports.directions @ np.array([70.2, 60.6])
    assert np.abs(reach - radius).max() < 0.8
    assert abs(float(np.mean(reach - radius))) < 0.25


def test_directions_in_which_the_frame_cuts_the_mask_are_left_out_one_by_one() -> None:
    supports = mask_supports(disc(30, (10, 60)), DIRECTIONS)
    assert 0 < len(supports.heights) < 16
    assert (supports.directions[:, 0] > -0.8).all()
    assert mask_supports(np.ones((20, 20), dtype=bool), DIRECTIONS).heights.size == 0


def test_supports_count_from_pixel_centres() -> None:
    mask = np.zeros((9, 9), dtype=bool)
    mask[4, 3] = True
    supports = mask_supports(mask, np.array([[1.0, 0], [0, 1.0]]))
    assert supports.heights.tolist() == [3 + PIXEL_REACH, 4 + PIXEL_REACH]


def test_a_mask_down_the_columns_in_memory_gives_the_same() -> None:
    mask = disc(20, (60, 50))
    ordered, other = (mask_supports(m, DIRECTIONS) for m in (mask, np.asfortranarray(mask)))
    assert np.array_equal(ordered.heights, other.heights)


def test_a_lens_is_taken_out_and_a_cut_mask_behind_it_tells_nothing() -> None:
    K = np.array([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]])
    bent = np.array([-0.2, 0, 0, 0.0])
    whole = mask_supports(disc(30, (110, 60)), DIRECTIONS, K, bent)
    plain = mask_supports(disc(30, (110, 60)), DIRECTIONS)
    assert whole.heights[0] > plain.heights[0] + 1  # barrel distortion drew it in
    assert mask_supports(disc(30, (10, 60)), DIRECTIONS, K, bent).heights.size == 0

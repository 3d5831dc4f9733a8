import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.polygon import clip_to_frame, clip_to_near, polygon_area, signed_area

SQUARE = torch.tensor([[0.0, 0], [2, 0], [2, 2], [0, 2]], dtype=torch.float64)


def test_a_square_of_two_has_area_four_with_the_sign_of_its_turn() -> None:
    assert float(signed_area(SQUARE)) == 4
    assert float(signed_area(SQUARE.flip(0))) == -4
    assert float(polygon_area(SQUARE.flip(0))) == 4


def test_the_frame_reaches_half_a_pixel_beyond_the_outer_pixel_centres() -> None:
    big = (SQUARE - 1) * 1000
    assert float(polygon_area(clip_to_frame(big, (3, 5)))) == 15
    assert clip_to_frame(big, (3, 5)).amin(0).tolist() == [-0.5, -0.5]
    assert clip_to_frame(big, (3, 5)).amax(0).tolist() == [4.5, 2.5]


def test_a_polygon_outside_the_frame_has_no_area() -> None:
    assert float(polygon_area(clip_to_frame(SQUARE + 100, (50, 50)))) == 0


def test_a_triangle_cut_by_the_near_plane_keeps_the_part_beyond() -> None:
    triangle = torch.tensor([[0.0, 0, 1], [0, 2, 3], [2, 0, 3]], dtype=torch.float64)
    clipped = clip_to_near(triangle, 2.0)
    assert float(clipped[:, 2].amin()) == 2
    assert {tuple(p) for p in clipped.tolist()} == {(0, 1, 2), (0, 2, 3), (2, 0, 3), (1, 0, 2)}


def test_a_polygon_before_the_near_plane_becomes_one_point_on_it() -> None:
    assert clip_to_near(torch.zeros(3, 3, dtype=torch.float64), 0.5).tolist() == [[0, 0, 0.5]] * 4


@given(st.lists(st.tuples(st.floats(-30, 90), st.floats(-30, 90)), min_size=3, max_size=3), st.integers(1, 60), st.integers(1, 60))
def test_the_clipped_area_is_that_of_the_pixels_in_it(points: list[tuple[float, float]], height: int, width: int) -> None:
    triangle = torch.tensor(points, dtype=torch.float64)
    fine = 8
    u, v = np.meshgrid((np.arange(width * fine) + 0.5) / fine - 0.5, (np.arange(height * fine) + 0.5) / fine - 0.5)
    inside, corners = np.ones(u.shape, bool), np.array(points)
    turn = np.sign(float(signed_area(triangle)))
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        inside &= turn * ((b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0])) > 0
    area = float(polygon_area(clip_to_frame(triangle, (height, width))))
    assert abs(area - inside.sum() / fine**2) <= 0.13 * (height + width) + 0.1  # at most one column of rays an edge


def test_a_batch_is_clipped_like_each_of_its_polygons() -> None:
    batch = torch.stack((SQUARE, SQUARE * 30, SQUARE + 100))
    for row, polygon in enumerate(batch):
        assert_close(polygon_area(clip_to_frame(batch, (10, 20)))[row], polygon_area(clip_to_frame(polygon, (10, 20))))


@pytest.mark.parametrize("wrong", [torch.zeros(4, 3), torch.zeros(2)])
def test_points_that_are_no_pixels_are_refused(wrong: Tensor) -> None:
    with pytest.raises(ShapeError, match="must have shape"):
        clip_to_frame(wrong, (5, 5))

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import vector
from thorough import thorough
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.polygon import (
    area_in_box,
    area_in_frame,
    clip_by_plane,
    clip_to_near,
    polygon_area,
    signed_area,
)

SQUARE = torch.tensor([[0.0, 0], [2, 0], [2, 2], [0, 2]], dtype=torch.float64)


def test_a_square_of_two_has_area_four_with_the_sign_of_its_turn() -> None:
    assert float(signed_area(SQUARE)) == 4
    assert float(signed_area(SQUARE.flip(0))) == -4
    assert float(polygon_area(SQUARE.flip(0))) == 4


def test_the_frame_reaches_half_a_pixel_beyond_the_outer_pixel_centres() -> None:
    big = (SQUARE - 1) * 1000
    assert float(area_in_frame(big, (3, 5))) == pytest.approx(15)
    half = torch.tensor([[1.0, -50], [50, -50], [50, 50], [1, 50]], dtype=torch.float64)
    assert float(area_in_frame(half, (3, 5))) == pytest.approx(3.5 * 3)


def test_a_polygon_outside_the_frame_has_no_area() -> None:
    assert float(area_in_frame(SQUARE + 100, (50, 50))) == 0


def test_a_triangle_cut_by_the_near_plane_keeps_the_part_beyond() -> None:
    triangle = torch.tensor([[0.0, 0, 1], [0, 2, 3], [2, 0, 3]], dtype=torch.float64)
    clipped = clip_to_near(triangle, 2.0)
    assert float(clipped[:, 2].amin()) == 2
    assert {tuple(p) for p in clipped.tolist()} == {(0, 1, 2), (0, 2, 3), (2, 0, 3), (1, 0, 2)}


def test_a_polygon_before_the_near_plane_becomes_one_point_on_it() -> None:
    assert clip_to_near(torch.zeros(3, 3, dtype=torch.float64), 0.5).tolist() == [[0, 0, 0.5]] * 4


@given(
    st.lists(st.tuples(st.floats(-30, 90), st.floats(-30, 90)), min_size=3, max_size=3),
    st.integers(1, 60),
    st.integers(1, 60),
)
def test_the_clipped_area_is_that_of_the_pixels_in_it(
    points: list[tuple[float, float]], height: int, width: int
) -> None:
    triangle = torch.tensor(points, dtype=torch.float64)
    fine = 8
    u, v = np.meshgrid(
        (np.arange(width * fine) + 0.5) / fine - 0.5, (np.arange(height * fine) + 0.5) / fine - 0.5
    )
    inside, corners = np.ones(u.shape, bool), np.array(points)
    turn = np.sign(float(signed_area(triangle)))
    for a, b in zip(corners, np.roll(corners, -1, 0), strict=True):
        inside &= turn * ((b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0])) > 0
    area = float(area_in_frame(triangle, (height, width)))
    assert (
        abs(area - inside.sum() / fine**2) <= 0.13 * (height + width) + 0.1
    )  # at most one column of rays an edge


def test_a_batch_has_the_areas_of_each_of_its_polygons() -> None:
    batch = torch.stack((SQUARE, SQUARE * 30, SQUARE + 100))
    for row, polygon in enumerate(batch):
        assert_close(area_in_frame(batch, (10, 20))[row], area_in_frame(polygon, (10, 20)))


@pytest.mark.parametrize("wrong", [torch.zeros(4, 3), torch.zeros(2)])
def test_points_that_are_no_pixels_are_refused(wrong: Tensor) -> None:
    with pytest.raises(ShapeError, match="must have shape"):
        area_in_frame(wrong, (5, 5))


@thorough(500)
@given(vector(-30, 60, 10), vector(-10, 50, 4))
def test_the_area_in_a_box_is_that_of_the_clipped_polygon(values: Tensor, bounds: Tensor) -> None:
    hull = cv2.convexHull(values.reshape(5, 2).numpy().astype(np.float32))[:, 0].astype(float)
    polygon = torch.from_numpy(hull if len(hull) > 2 else np.repeat(hull[:1], 3, axis=0))
    box = torch.cat((torch.minimum(bounds[:2], bounds[2:]), torch.maximum(bounds[:2], bounds[2:])))
    clipped = polygon
    for axis, sign, bound in ((0, 1, 0), (0, -1, 2), (1, 1, 1), (1, -1, 3)):
        clipped = clip_by_plane(clipped, sign * (clipped[..., axis] - box[bound]))
    assert_close(area_in_box(polygon, box), polygon_area(clipped), atol=1e-8, rtol=1e-9)


def test_areas_in_boxes_are_what_a_person_computes() -> None:
    square = torch.tensor([[0.0, 0], [4, 0], [4, 4], [0, 4]], dtype=torch.float64)
    boxes = torch.tensor(
        [[1.0, 1, 3, 2], [-5, -5, 9, 9], [3, 3, 8, 8], [5, 5, 6, 6], [0, 0, 4, 4]],
        dtype=torch.float64,
    )
    assert area_in_box(square, boxes).tolist() == [2, 16, 1, 0, 16]
    diamond = torch.tensor([[2.0, 0], [4, 2], [2, 4], [0, 2]], dtype=torch.float64)
    assert area_in_box(diamond, torch.tensor([2.0, 2, 9, 9], dtype=torch.float64)).item() == 2
    assert torch.autograd.gradcheck(
        lambda p: area_in_box(p, torch.tensor([1.15, 0.9, 3.3, 2.2], dtype=torch.float64)),
        (diamond.requires_grad_(),),
    )

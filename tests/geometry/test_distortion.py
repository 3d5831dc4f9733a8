import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import cameras, cuboids_in_front, vector
from thorough import thorough
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.camera import project, project_in_front
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.distortion import (
    distort,
    distortion_slope,
    field_of_view,
    turned_distortion,
    undistort,
)
from animal3dbox.geometry.homography import apply_homography, update_camera

F64 = torch.float64
SIZES = {4: 0.05, 5: 0.05, 8: 0.05, 12: 0.02}


@thorough(200)
@given(cuboids_in_front(), cameras(), st.sampled_from([4, 5, 8, 12]), st.data())
def test_lenses_bend_as_opencv_bends_them(
    box: Cuboid, camera: tuple[Tensor, tuple[int, int]], count: int, data: st.DataObject
) -> None:
    coefficients = data.draw(vector(-SIZES[count], SIZES[count], count))
    corners = box.corners()
    expected, _ = cv2.projectPoints(
        corners.numpy(), np.zeros(3), np.zeros(3), camera[0].numpy(), coefficients.numpy()
    )
    px, _ = project(camera[0], corners, coefficients)
    assert_close(px, torch.from_numpy(expected[:, 0]), atol=1e-6, rtol=1e-9)


@thorough(300)
@given(
    cuboids_in_front(),
    cameras(),
    st.sampled_from([4, 5, 8, 12]),
    st.floats(-3, 3),
    st.booleans(),
    st.floats(0.3, 3),
    st.data(),
)
def test_a_lens_turns_with_flips_rolls_crops_and_resizes(
    box: Cuboid,
    camera: tuple[Tensor, tuple[int, int]],
    count: int,
    angle: float,
    mirror: bool,
    zoom: float,
    data: st.DataObject,
) -> None:
    coefficients, (K, _) = data.draw(vector(-SIZES[count], SIZES[count], count)), camera
    turn = torch.tensor(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]],
        dtype=F64,
    )
    side = torch.diag(torch.tensor([-1.0 if mirror else 1.0, 1, 1], dtype=F64))
    place = torch.tensor([[zoom, 0, 13], [0, 1.1 * zoom, -7], [0, 0, 1]], dtype=F64)
    H = place @ K @ turn @ side @ torch.linalg.inv(K)
    update = update_camera(H, K)
    px, _ = project(K, box.corners(), coefficients)
    after, _ = project(
        update.K, box.corners() @ update.Q.mT, turned_distortion(coefficients, update.Q)
    )
    assert_close(after, apply_homography(H, px), atol=1e-6, rtol=1e-8)


def test_a_flip_negates_p2_and_a_vertical_one_p1() -> None:
    coefficients = torch.tensor([0.1, 0.2, 0.3, 0.4, 0.5], dtype=F64)
    assert turned_distortion(
        coefficients, torch.diag(torch.tensor([-1.0, 1, 1], dtype=F64))
    ).tolist() == [0.1, 0.2, 0.3, -0.4, 0.5]
    assert turned_distortion(
        coefficients, torch.diag(torch.tensor([1.0, -1, 1], dtype=F64))
    ).tolist() == [0.1, 0.2, -0.3, 0.4, 0.5]


def test_a_turn_of_the_optical_axis_says_to_undistort() -> None:
    yaw = torch.tensor([[0.8, 0, -0.6], [0, 1, 0], [0.6, 0, 0.8]], dtype=F64)
    with pytest.raises(ShapeError, match="undistort the image first"):
        turned_distortion(torch.zeros(5, dtype=F64), yaw)


@pytest.mark.parametrize(
    "coefficients",
    [torch.zeros(3), torch.zeros(14), torch.zeros(1, 5), torch.tensor([0, 0, 0, float("nan")])],
)
def test_other_numbers_of_coefficients_are_refused(coefficients: Tensor) -> None:
    with pytest.raises(ShapeError, match="distortion must"):
        distort(torch.zeros(1, 2), coefficients)


def test_points_behind_the_camera_never_come_back_as_seen() -> None:
    K = torch.diag(torch.tensor([100.0, 100, 1], dtype=F64))
    points = torch.tensor([[1.0, 1, 2], [1, 1, -2], [1, 1, 0], [1, 1, 0.5]], dtype=F64)
    px, in_front = project_in_front(K, points, near=0.6)
    assert in_front.tolist() == [True, False, False, False]
    assert px.tolist() == [[50, 50], [0, 0], [0, 0], [0, 0]]


@pytest.mark.parametrize("numpy", [True, False])
@pytest.mark.parametrize(
    "lens",
    [
        [-0.3, 0.1, 0.001, -0.002],
        [0.25, 0.08, -0.002, 0.003, 0.01],
        [0.4, -0.1, 0.001, 0.002, 0.02, 0.7, 0.05, 0.01],
        [-0.9, 0, 0, 0],
    ],
)
def test_what_a_lens_bends_is_straightened_again(lens: list[float], numpy: bool) -> None:
    coefficients = torch.tensor(lens, dtype=F64)
    reach = 0.95 * min(field_of_view(coefficients), 1.0)
    angle = torch.linspace(0, 6.28, 60, dtype=F64)
    points = (
        torch.stack((angle.cos(), angle.sin()), dim=-1)
        * torch.linspace(0, reach, 60, dtype=F64)[:, None]
    )
    bent = distort(points, coefficients)
    if numpy:
        back, found = (torch.from_numpy(x) for x in undistort(bent.numpy(), coefficients.numpy()))
    else:
        back, found = undistort(bent, coefficients)
    assert bool(found.all())
    assert_close(back, points, atol=1e-8, rtol=0)


def test_where_a_lens_shows_nothing_nothing_is_found() -> None:
    lens = torch.tensor([-0.9, 0, 0, 0], dtype=F64)
    edge = float(distort(torch.tensor([field_of_view(lens), 0.0], dtype=F64), lens)[0])
    _, found = undistort(
        torch.tensor([[0.99 * edge, 0], [1.01 * edge, 0], [0, 5 * edge]], dtype=F64), lens
    )
    assert found.tolist() == [True, False, False]


def test_the_slope_of_a_lens_is_that_of_finite_differences() -> None:
    lens = torch.tensor(
        [-0.2, 0.05, 0.003, -0.001, 0.01, 0.05, 0.01, 0.02, 0.01, -0.002, 0.008, 0.003], dtype=F64
    )
    points, step = (
        torch.tensor([[0.0, 0], [0.3, -0.2], [-0.7, 0.5]], dtype=F64),
        1e-6 * torch.eye(2, dtype=F64),
    )
    numeric = torch.stack(
        [(distort(points + s, lens) - distort(points - s, lens)) / 2e-6 for s in step], dim=-1
    )
    assert_close(distortion_slope(points, lens), numeric, atol=1e-8, rtol=0)

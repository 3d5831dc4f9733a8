import math
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import cameras, cuboids_in_front, rotations, vector
from thorough import thorough
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.camera import (
    PinholeCamera,
    intrinsics,
    look_at,
    project,
    project_in_front,
)
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.homography import (
    apply_homography,
    handedness,
    oriented_homography,
    rq,
    update_camera,
)
from animal3dbox.geometry.rigid_transforms import (
    axis_angle_from_rotation,
    invert_rigid,
    nearest_rotation,
    rigid,
    rotation_angle,
    rotation_from_axis_angle,
    transform_points,
)

F64 = torch.float64


def test_the_middle_of_an_image_is_half_a_pixel_short_of_half_its_size() -> None:
    assert intrinsics(500.0, (480, 640)).tolist() == [[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]]


def test_a_point_projects_where_a_person_computes_it() -> None:
    camera = PinholeCamera(
        intrinsics(100.0, (11, 21), skew=10.0),
        rigid(torch.eye(3, dtype=F64), torch.tensor([0.0, 0, 2], dtype=F64)),
        (11, 21),
    )
    px, depth = camera.project(torch.tensor([[1.0, -1, 0]], dtype=F64))
    assert px.tolist() == [[10 + 50 - 5, 5 - 50]]
    assert depth.tolist() == [2]


@pytest.mark.parametrize("function", [project, project_in_front])
@pytest.mark.parametrize("points", [1, 3, 8])
def test_points_and_a_camera_that_are_exchanged_are_an_error_that_says_so(
    function: Any, points: int
) -> None:
    K = intrinsics(100.0, (11, 21))
    points_cam = torch.rand(points, 3, dtype=F64) + 1
    with pytest.raises(ShapeError, match=r"are exchanged, .* comes first"):
        function(points_cam, K)
    with pytest.raises(ShapeError, match="exchanged"):
        function(points_cam.expand(2, points, 3), K.expand(2, 3, 3))
    function(K, points_cam)  # the right way round


def test_three_points_may_look_like_a_camera_if_the_camera_is_one() -> None:
    K = intrinsics(100.0, (11, 21))
    assert project(K, K)[1].tolist() == [10.0, 5.0, 1.0]


@pytest.mark.parametrize(
    ("K", "points_cam", "name"),
    [((3, 4), (8, 3), "K"), ((3, 3), (8, 4), "points_cam"), ((3, 3), (3,), "points_cam")],
)
def test_other_shapes_than_a_camera_and_points_are_named(
    K: tuple[int, ...], points_cam: tuple[int, ...], name: str
) -> None:
    with pytest.raises(ShapeError, match=f"^{name} must have shape"):
        project(torch.ones(K), torch.ones(points_cam))


def test_the_camera_center_projects_nowhere_and_is_where_it_was_put() -> None:
    eye = torch.tensor([1.0, 2, 3], dtype=F64)
    T = look_at(eye, torch.zeros(3, dtype=F64), torch.tensor([0.0, 0, 1], dtype=F64))
    camera = PinholeCamera(intrinsics(100.0, (10, 10)), T, (10, 10))
    assert_close(camera.center_world, eye)
    px, _ = camera.project(torch.tensor([[0.0, 0, 0], [0, 0, 0.1]], dtype=F64))
    assert_close(px[0], torch.tensor([4.5, 4.5], dtype=F64))
    assert px[1, 1] < 4.5  # up in the world is up in the picture: less v


def test_a_camera_sees_what_lies_in_front_of_it_and_inside_its_frame() -> None:
    T = rigid(torch.eye(3, dtype=F64), torch.tensor([0.0, 0, 2], dtype=F64))
    camera = PinholeCamera(intrinsics(100.0, (11, 21)), T, (11, 21))
    points = torch.tensor([[0.0, 0, 0], [0.21, 0, 0], [0.2101, 0, 0], [0, 0, -3]], dtype=F64)
    # u = 10 + 50 x: the frame ends at 20.5; the last point is behind the camera
    assert camera.sees(points).tolist() == [True, True, False, False]


def test_a_cameras_rotation_translation_and_place_are_those_it_was_given() -> None:
    R = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=F64)
    camera = PinholeCamera(
        intrinsics(100.0, (11, 21)), rigid(R, torch.tensor([1.0, 2, 3], dtype=F64)), (11, 21)
    )
    assert camera.R_cam_world.tolist() == R.tolist()
    assert camera.t_cam_world.tolist() == [1, 2, 3]
    assert camera.center_world.tolist() == [-2, 1, -3]


def test_the_camera_of_a_crop_at_half_the_size_shows_a_point_half_as_far_from_the_corner() -> None:
    camera = PinholeCamera(
        intrinsics(100.0, (11, 21)),
        rigid(torch.eye(3, dtype=F64), torch.tensor([0.0, 0, 2], dtype=F64)),
        (11, 21),
    )
    # Crop at pixel (4, 1), then halve: u' = (u - 4) / 2, v' = (v - 1) / 2
    H = torch.tensor([[0.5, 0, -2], [0, 0.5, -0.5], [0, 0, 1]], dtype=F64)
    smaller = camera.resized(H, (5, 8))
    assert smaller.K.tolist() == [[50, 0, 3], [0, 50, 2], [0, 0, 1]]
    assert smaller.image_hw == (5, 8)
    point = torch.tensor([[0.1, -0.04, 0]], dtype=F64)
    assert_close(camera.project(point)[0], torch.tensor([[15.0, 3.0]], dtype=F64))
    assert_close(smaller.project(point)[0], torch.tensor([[5.5, 1.0]], dtype=F64))


@thorough(1000)
@given(rotations(), vector(-5, 5), vector(-5, 5, 9))
def test_a_transform_and_its_inverse_undo_each_other(R: Tensor, t: Tensor, values: Tensor) -> None:
    T, points = rigid(R, t), values.reshape(3, 3)
    assert_close(
        transform_points(invert_rigid(T), transform_points(T, points)), points, atol=1e-12, rtol=0
    )


@thorough(1000)
@given(vector(-1, 1).filter(lambda v: float(v.norm()) > 0.01), st.floats(0, math.pi))
def test_rotation_angles_are_exact_at_both_ends(axis: Tensor, angle: float) -> None:
    R = rotation_from_axis_angle(axis / axis.norm() * angle)
    assert abs(float(rotation_angle(R, torch.eye(3, dtype=F64))) - angle) < 1e-13 + 1e-7 * (
        math.pi - angle < 1e-6
    )


@pytest.mark.parametrize("angle", [1e-12, 1e-9, 1e-5])
def test_tiny_rotations_are_not_lost(angle: float) -> None:
    R = rotation_from_axis_angle(torch.tensor([0.0, angle, 0.0], dtype=F64))
    assert_close(
        rotation_angle(R, torch.eye(3, dtype=F64)),
        torch.tensor(angle, dtype=F64),
        rtol=1e-6,
        atol=0,
    )


def test_the_gradient_of_a_rotation_exists_at_zero() -> None:
    zero = torch.zeros(3, dtype=F64, requires_grad=True)
    assert torch.autograd.gradcheck(rotation_from_axis_angle, zero)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-5, 0.5, 2.0, 3.0, math.pi - 1e-9, math.pi])
def test_axis_angle_vectors_come_back_from_their_rotations_also_near_zero_and_near_half_a_turn(
    angle: float,
) -> None:
    axes = torch.cat(
        (
            torch.eye(3, dtype=F64),
            torch.randn(50, 3, generator=torch.Generator().manual_seed(0), dtype=F64),
        )
    )
    vectors = torch.nn.functional.normalize(axes, dim=-1) * angle
    back = axis_angle_from_rotation(rotation_from_axis_angle(vectors))
    assert_close(
        rotation_from_axis_angle(back), rotation_from_axis_angle(vectors), rtol=0, atol=1e-14
    )
    assert_close(back.norm(dim=-1), vectors.norm(dim=-1), rtol=0, atol=1e-14)
    if angle < 3.1:
        assert_close(back, vectors, rtol=0, atol=1e-14)


def test_the_nearest_rotation_to_a_mirror_is_a_rotation() -> None:
    R = nearest_rotation(torch.diag(torch.tensor([1.0, 2.0, -0.5], dtype=F64)))
    assert_close(R, torch.eye(3, dtype=F64))


@thorough(1000)
@given(vector(-2, 2, 9).filter(lambda v: abs(float(torch.linalg.det(v.reshape(3, 3)))) > 1e-3))
def test_rq_gives_back_its_matrix_from_a_triangle_and_a_rotation(values: Tensor) -> None:
    A = values.reshape(3, 3)
    U, Q = rq(A)
    assert_close(U @ Q, A, atol=1e-9, rtol=0)
    assert_close(Q @ Q.mT, torch.eye(3, dtype=F64), atol=1e-12, rtol=0)
    assert float(U.diagonal().amin()) > 0
    assert float(torch.tril(U, -1).abs().amax()) == 0
    assert float(torch.linalg.det(Q)) * float(torch.linalg.det(A)) > 0


@thorough(1000)
@given(vector(-2, 2, 9).filter(lambda v: abs(float(torch.linalg.det(v.reshape(3, 3)))) > 1e-3))
def test_one_matrix_is_decomposed_in_plain_numbers_as_in_a_batch(values: Tensor) -> None:
    A = values.reshape(3, 3).numpy()
    for one, batch in zip(rq(A), rq(A[None]), strict=True):
        assert one.dtype == batch.dtype
        assert_close(torch.from_numpy(one), torch.from_numpy(batch[0]), atol=1e-11, rtol=0)
    assert abs(float(handedness(A)) - float(handedness(A[None])[0])) <= 1e-14


@thorough(1000)
@given(cuboids_in_front(), cameras(), vector(-0.3, 0.3, 9), st.booleans())
def test_the_updated_camera_sees_the_mapped_picture(
    box: Cuboid, camera: tuple[Tensor, tuple[int, int]], wobble: Tensor, mirror: bool
) -> None:
    K, (_, width) = camera
    scale = torch.tensor([[1.0, 1, 100], [1, 1, 100], [1e-4, 1e-4, 1]], dtype=F64)
    H = torch.eye(3, dtype=F64) + wobble.reshape(3, 3) * scale
    if mirror:
        H = H @ torch.tensor([[-1.0, 0, width - 1], [0, 1, 0], [0, 0, 1]], dtype=F64)
    corners_px, depth = project(K, box.corners())
    H = oriented_homography(H, corners_px.mean(0))
    w = corners_px @ H[2, :2] + H[2, 2]
    if float(torch.linalg.det(H).abs()) < 1e-3 or float(w.amin()) < 0.05:
        return
    update = update_camera(H, K)
    px, new_depth = project(update.K, box.corners() @ update.Q.mT)
    assert_close(px, apply_homography(H, corners_px), atol=1e-6, rtol=1e-9)
    assert_close(new_depth, w * depth / update.k, atol=1e-9, rtol=1e-9)
    assert (float(torch.linalg.det(update.Q)) < 0) == (float(torch.linalg.det(H)) < 0)


def test_a_horizontal_flip_moves_the_principal_point_to_w_minus_one_minus_cx() -> None:
    K = torch.tensor([[500.0, 0, 300], [0, 510, 200], [0, 0, 1]], dtype=F64)
    flip = torch.tensor([[-1.0, 0, 639], [0, 1, 0], [0, 0, 1]], dtype=F64)
    assert_close(
        update_camera(flip, K).K,
        torch.tensor([[500.0, 0, 339], [0, 510, 200], [0, 0, 1]], dtype=F64),
    )


def test_a_map_that_flattens_the_image_is_refused() -> None:
    with pytest.raises(ShapeError, match="H_out_in must be invertible"):
        update_camera(torch.diag(torch.tensor([1.0, 0.0, 1.0], dtype=F64)), torch.eye(3, dtype=F64))


@pytest.mark.parametrize(
    ("K", "says"),
    [
        (torch.eye(2), "shape"),
        (torch.diag(torch.tensor([-1.0, 1, 1])), "positive focal"),
        (torch.diag(torch.tensor([1.0, 1, 2])), "upper triangular"),
        (torch.full((3, 3), torch.nan), "finite"),
    ],
)
def test_impossible_intrinsics_are_refused(K: Tensor, says: str) -> None:
    with pytest.raises(ShapeError, match=says):
        PinholeCamera(K, torch.eye(4), (10, 10))


@thorough(300)
@given(rotations(), vector(-5, 5), cameras(), st.booleans())
def test_a_mirrored_world_is_seen_by_a_proper_camera(
    R: Tensor, t: Tensor, camera: tuple[Tensor, tuple[int, int]], mirror: bool
) -> None:
    K, (_, width) = camera
    H = (
        torch.tensor([[-1.0, 0, width - 1], [0, 1, 0], [0, 0, 1]], dtype=F64)
        if mirror
        else torch.tensor([[2.0, 0, 5], [0, 2, 3], [0, 0, 1]], dtype=F64)
    )
    update = update_camera(H, K, R, t)
    assert update.R is not None
    assert update.t is not None
    assert bool(update.mirrored) is mirror
    assert_close(torch.linalg.det(update.R), torch.tensor(1.0, dtype=F64))
    points_world = torch.tensor([[1.0, 2, 3], [-1, 0.5, 2]], dtype=F64)
    mirrored_world = points_world * torch.tensor([1.0, -1 if mirror else 1, 1], dtype=F64)
    assert_close(
        mirrored_world @ update.R.mT + update.t,
        (points_world @ R.mT + t) @ update.Q.mT,
        atol=1e-9,
        rtol=0,
    )


def test_lists_are_no_points_and_no_camera() -> None:
    K, points = torch.eye(3), torch.ones(2, 3)
    calls: list[Any] = [project, project_in_front]
    for call in calls:
        with pytest.raises(ShapeError, match="points_cam must be a tensor or an array, got a list"):
            call(K, points.tolist())
        with pytest.raises(ShapeError, match="K must be a tensor or an array, got a list"):
            call(K.tolist(), points)

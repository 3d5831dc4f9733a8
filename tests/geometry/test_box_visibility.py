"""Faces against a ray-cast reference that shares no code with the package."""

import numpy as np
import torch
from hypothesis import given
from rays import face_hit_by_rays, faces_entered
from strategies import cameras, cuboids_anywhere, cuboids_in_front
from thorough import thorough
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.geometry.box_visibility import corners_in_front, face_visibility, near_depth
from animal3dbox.geometry.cuboid import OPPOSITE_FACES, Cuboid

Camera = tuple[Tensor, tuple[int, int]]


def hull_area(points: np.ndarray) -> float:
    """Area of a convex hull by gift wrapping."""
    start = current = int(np.lexsort((points[:, 1], points[:, 0]))[0])
    ring = []
    while True:
        ring.append(points[current])
        best = (current + 1) % len(points)
        for other in range(len(points)):
            a, b = points[best] - points[current], points[other] - points[current]
            turn = a[0] * b[1] - a[1] * b[0]
            if turn < 0 or (turn == 0 and (b @ b) > (a @ a)):
                best = other
        current = best
        if current == start or len(ring) > len(points):
            break
    x, y = np.array(ring).T
    return float(0.5 * abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))


@thorough(1000)
@given(cuboids_in_front(), cameras())
def test_the_visible_faces_tile_the_hull_of_the_projected_corners(
    box: Cuboid, camera: Camera
) -> None:
    K, image_hw = camera
    seen = face_visibility(box, K, image_hw)
    corners = box.corners() @ K.mT
    hull = hull_area((corners[:, :2] / corners[:, 2:]).numpy())
    assert abs(float(seen.area.sum()) - hull) <= 1e-6 * hull


@thorough(1000)
@given(cuboids_anywhere(), cameras())
def test_shares_add_to_one_and_opposite_faces_are_never_both_seen(
    box: Cuboid, camera: Camera
) -> None:
    seen = face_visibility(box, *camera)
    total = float(seen.share.sum())
    assert abs(total - 1) < 1e-12 if float(seen.area.sum()) > 0 else total == 0
    assert not (seen.visible & seen.visible[list(OPPOSITE_FACES)]).any()
    assert ((seen.area > 0) <= seen.visible).all()
    assert 0 <= float(seen.truncation) <= 1


@thorough(1000)
@given(cuboids_in_front())
def test_visible_faces_are_those_that_rays_enter_by(box: Cuboid) -> None:
    center, rotation, size = (x.numpy() for x in (box.center, box.rotation, box.size))
    seen = face_visibility(
        box, torch.diag(torch.tensor([500.0, 500.0, 1.0], dtype=torch.float64)), (100, 100)
    ).visible.numpy()
    # a grid of points on every face: some ray enters by each visible face, none by a hidden one
    entered = faces_entered(center, rotation, size)
    clear = (
        np.abs((rotation.T @ -center) / (size / 2)).min()
        and np.abs(np.abs(rotation.T @ -center) - size / 2).min() > 1e-9
    )
    if clear:  # the camera is not in the very plane of a face
        assert entered == np.flatnonzero(seen).tolist()


def test_a_box_seen_head_on_shows_its_front_alone_with_a_checkable_area() -> None:
    # the nose points at the camera: forward = -z, left = +x (its left is on the right of the
    # picture), up = -y
    rotation = torch.tensor([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]], dtype=torch.float64)
    box = Cuboid(
        torch.tensor([0.0, 0, 5], dtype=torch.float64),
        rotation,
        torch.tensor([2.0, 1, 1], dtype=torch.float64),
    )
    K = torch.tensor([[100.0, 0, 49.5], [0, 100, 49.5], [0, 0, 1]], dtype=torch.float64)
    seen = face_visibility(box, K, (100, 100))
    assert seen.visible.tolist() == [True, False, False, False, False, False]
    assert_close(
        seen.area[0], torch.tensor(25.0**2, dtype=torch.float64)
    )  # 1 x 1 at depth 4 is 25 x 25 px
    assert float(seen.truncation) == 0


def test_half_a_box_outside_the_frame_is_half_truncated() -> None:
    box = Cuboid(
        torch.tensor([0.0, 0, 5.5], dtype=torch.float64),
        torch.eye(3, dtype=torch.float64),
        torch.ones(3, dtype=torch.float64),
    )
    K = torch.tensor(
        [[100.0, 0, -0.5], [0, 100, 49.5], [0, 0, 1]], dtype=torch.float64
    )  # its middle is the left edge
    assert_close(
        face_visibility(box, K, (100, 100)).truncation, torch.tensor(0.5, dtype=torch.float64)
    )


def test_from_inside_a_box_no_face_is_seen() -> None:
    box = Cuboid(
        torch.zeros(3, dtype=torch.float64),
        torch.eye(3, dtype=torch.float64),
        torch.ones(3, dtype=torch.float64),
    )
    seen = face_visibility(box, torch.eye(3, dtype=torch.float64), (10, 10))
    assert not seen.visible.any()
    assert float(seen.share.abs().sum()) == float(seen.share_in_image.sum()) == 0
    assert (
        float(seen.truncation) > 0.9
    )  # it fills all of the view, most of which is outside the frame


def test_a_box_behind_the_camera_has_no_area() -> None:
    box = Cuboid(
        torch.tensor([0.0, 0, -5], dtype=torch.float64),
        torch.eye(3, dtype=torch.float64),
        torch.ones(3, dtype=torch.float64),
    )
    seen = face_visibility(box, torch.eye(3, dtype=torch.float64), (10, 10))
    assert float(seen.area.sum()) == 0
    assert not corners_in_front(box).any()


@thorough(100)
@given(cuboids_anywhere())
def test_shares_in_the_image_are_those_of_rays_through_it_even_around_the_camera(
    box: Cuboid,
) -> None:
    K, (height, width) = (
        torch.tensor([[60.0, 0, 31.5], [0, 50, 23.5], [0, 0, 1]], dtype=torch.float64),
        (48, 64),
    )
    seen = face_visibility(box, K, (height, width))
    fine = 4  # rays per pixel and axis
    u, v = np.meshgrid(
        (np.arange(width * fine) + 0.5) / fine - 0.5, (np.arange(height * fine) + 0.5) / fine - 0.5
    )
    rays = np.stack((u.ravel(), v.ravel(), np.ones(u.size)), 1) @ np.linalg.inv(K.numpy()).T
    hit = face_hit_by_rays(box.center.numpy(), box.rotation.numpy(), box.size.numpy(), rays)
    counts = np.bincount(hit[hit >= 0], minlength=6)
    nearest = float(
        (box.to_box(torch.zeros(1, 3, dtype=torch.float64)).abs() - box.size / 2).amax()
    )
    if counts.sum() > 5000 and nearest > float(
        near_depth(box)
    ):  # closer than the near plane the two differ by design
        assert np.abs(counts / counts.sum() - seen.share_in_image.numpy()).max() < 0.01

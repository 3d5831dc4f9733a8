"""Rotations as six numbers and against the line of sight, and their inverses."""

import torch
from detections import F64
from hypothesis import given
from strategies import vector
from thorough import thorough
from torch.testing import assert_close

from animal3dbox.geometry import look_at, rotation_angle, rotation_from_axis_angle
from animal3dbox.training.detector_targets import (
    allocentric_from_egocentric,
    egocentric_from_allocentric,
    rotation_from_6d,
    rotation_to_6d,
)
from animal3dbox.training.detector_targets.rotations import ray_rotation


def rotation_of(axis_angle: torch.Tensor) -> torch.Tensor:
    return rotation_from_axis_angle(axis_angle)


@thorough(200)
@given(vector(-3, 3, 3))
def test_six_numbers_give_the_rotation_back(axis_angle: torch.Tensor) -> None:
    R = rotation_of(axis_angle)
    assert_close(rotation_from_6d(rotation_to_6d(R)), R, atol=1e-14, rtol=0)
    assert rotation_to_6d(R).tolist() == [*R[:, 0].tolist(), *R[:, 1].tolist()]


@thorough(200)
@given(vector(-5, 5, 6))
def test_any_six_numbers_give_a_rotation_whose_forward_is_the_first_three(
    numbers: torch.Tensor,
) -> None:
    numbers = numbers + torch.tensor([6.0, 0, 0, 0, 6, 0], dtype=F64)
    R = rotation_from_6d(numbers)
    assert_close(R @ R.mT, torch.eye(3, dtype=F64), atol=1e-12, rtol=0)
    assert float(torch.linalg.det(R)) > 0
    assert_close(R[:, 0], numbers[:3] / numbers[:3].norm(), atol=1e-12, rtol=0)
    assert float(R[:, 1] @ numbers[3:]) > 0


@thorough(200)
@given(vector(-2, 2, 3), vector(-3, 3, 3))
def test_allocentric_and_egocentric_are_inverse(
    center: torch.Tensor, axis_angle: torch.Tensor
) -> None:
    center = center + torch.tensor([0.0, 0, 2.1], dtype=F64)
    R = rotation_of(axis_angle)
    back = egocentric_from_allocentric(allocentric_from_egocentric(R, center), center)
    assert_close(back, R, atol=1e-13, rtol=0)


@thorough(100)
@given(vector(-3, 3, 3))
def test_the_ray_s_rotation_turns_the_optical_axis_into_the_ray_by_the_least_angle(
    ray: torch.Tensor,
) -> None:
    ray = ray + torch.tensor([0.0, 0, 3.1], dtype=F64)
    R = ray_rotation(ray)
    assert_close(R[:, 2], ray / ray.norm(), atol=1e-14, rtol=0)
    axis = torch.tensor([0.0, 0, 1], dtype=F64)
    angle = torch.acos((ray / ray.norm()) @ axis)
    assert_close(rotation_angle(R, torch.eye(3, dtype=F64)), angle, atol=1e-7, rtol=0)


def test_an_animal_that_is_carried_round_the_camera_keeps_its_allocentric_rotation() -> None:
    up = torch.tensor([0.0, -1, 0], dtype=F64)
    origin = torch.zeros(3, dtype=F64)
    R_side = rotation_of(torch.tensor([0.2, -0.4, 1.0], dtype=F64))
    rotations = []
    for ray in ([0.0, 0, 1], [1.0, 0, 1], [-2.0, 0, 1]):
        # the camera that looks along the ray, level with the first one
        R_cam_ray = look_at(origin, torch.tensor(ray, dtype=F64), up)[:3, :3].mT
        rotations.append(
            allocentric_from_egocentric(R_cam_ray @ R_side, torch.tensor(ray, dtype=F64))
        )
    assert_close(rotations[1], rotations[0], atol=1e-12, rtol=0)
    assert_close(rotations[2], rotations[0], atol=1e-12, rtol=0)


def test_derivatives_of_six_numbers_are_right() -> None:
    numbers = torch.tensor([[0.3, -1.0, 0.4, 0.9, 0.2, -0.5]], dtype=F64, requires_grad=True)
    assert torch.autograd.gradcheck(rotation_from_6d, (numbers,))

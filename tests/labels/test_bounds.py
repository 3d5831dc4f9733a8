import pytest
import torch
from hypothesis import given
from strategies import rotations, vector
from thorough import thorough
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.labels.bounds import tight_cuboid

F64 = torch.float64


@thorough(1000)
@given(vector(-5, 5, 30), rotations())
def test_no_vertex_lies_outside_its_box_and_each_face_touches_one(
    values: Tensor, R_box: Tensor
) -> None:
    vertices = values.reshape(10, 3)
    for margin in (None, 1e-5):
        box = tight_cuboid(vertices, R_box, margin)
        assert bool(box.contains(vertices).all())
        slack = box.size / 2 - box.to_box(vertices).abs().amax(0)
        assert float(slack.amax()) <= (1e-5 if margin else 1e-6 * float(box.diagonal)) + 1e-9


@pytest.mark.parametrize("spread", [0.0, 1e-12, 1e-3])
@thorough(200)
@given(vector(-5, 5), rotations())
def test_a_body_almost_without_extent_still_lies_in_its_box(
    spread: float, at: Tensor, R_box: Tensor
) -> None:
    vertices = at + spread * torch.linspace(-1, 1, 11, dtype=F64)[:, None]
    assert bool(tight_cuboid(vertices, R_box).contains(vertices).all())


def test_a_box_about_known_points_has_the_middle_of_their_bounds_as_its_centre() -> None:
    vertices = torch.tensor(
        [[0.0, 0, 0], [4, 0, 0], [0, 2, 0], [0, 0, 1], [0, 0, 1], [0, 0, 1]], dtype=F64
    )  # mean is not the middle
    box = tight_cuboid(vertices, torch.eye(3, dtype=F64), margin=0.0)
    assert_close(box.center, torch.tensor([2.0, 1, 0.5], dtype=F64))
    assert_close(box.size, torch.tensor([4.0, 2, 1], dtype=F64))


def test_the_papers_margin_is_absolute_and_on_every_side() -> None:
    box = tight_cuboid(
        torch.tensor([[0.0, 0, 0], [1, 1, 1]], dtype=F64), torch.eye(3, dtype=F64), margin=1e-5
    )
    assert_close(box.size, torch.full((3,), 1 + 2e-5, dtype=F64), atol=1e-15, rtol=0)


def test_the_centre_is_the_middle_of_the_bounds_and_not_the_mean_of_the_points() -> None:
    turn = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=F64)
    in_box = torch.tensor([[-1.0, -2, 0], [3, 2, 1], [3, 2, 1]], dtype=F64)
    box = tight_cuboid(in_box @ turn.mT + torch.tensor([10.0, 0, 0], dtype=F64), turn, 0.0)
    assert_close(box.center, torch.tensor([10.0, 1.0, 0.5], dtype=F64))
    assert_close(box.size, torch.tensor([4.0, 4.0, 1.0], dtype=F64))


def test_a_body_smaller_than_its_square_can_be_still_lies_in_its_box() -> None:
    vertices = torch.zeros(10, 3, dtype=F64)
    vertices[9, 2] = 4e-172
    assert bool(tight_cuboid(vertices, torch.eye(3, dtype=F64)).contains(vertices).all())


def test_a_box_holds_its_body_also_if_its_axes_are_rotations_to_single_precision_only() -> None:
    R_box = rotation_from_axis_angle(torch.tensor([0.3, 0.4, 0.5], dtype=F64)).float()
    for far in (0.0, 1e3, 1e6):
        vertices = far + torch.randn(200, 3, generator=torch.Generator().manual_seed(0), dtype=F64)
        assert bool(tight_cuboid(vertices, R_box, margin=1e-5).contains(vertices).all())

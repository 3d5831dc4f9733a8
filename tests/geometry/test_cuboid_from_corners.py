import pytest
import torch
from hypothesis import given
from strategies import cuboids_anywhere
from thorough import thorough
from torch.testing import assert_close

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.cuboid import CORNER_SIGNS, MIRRORED_CORNERS, Cuboid
from animal3dbox.geometry.cuboid_from_corners import OTHER_ORDERS, corners_to_cuboid

F64 = torch.float64
# A box of 4 x 2 x 1 that stands on the ground ahead of the origin, its nose along +y
AHEAD = torch.tensor(
    [
        [1.0, 3.0, 0.0],
        [1.0, 7.0, 0.0],
        [-1.0, 7.0, 0.0],
        [-1.0, 3.0, 0.0],
        [1.0, 3.0, 1.0],
        [1.0, 7.0, 1.0],
        [-1.0, 7.0, 1.0],
        [-1.0, 3.0, 1.0],
    ],
    dtype=F64,
)


def test_a_box_comes_back_from_corners_typed_by_hand() -> None:
    box = corners_to_cuboid(AHEAD)
    assert box.center.tolist() == [0.0, 5.0, 0.5]
    assert box.size.tolist() == [4.0, 2.0, 1.0]
    assert box.rotation.T.tolist() == [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]  # forward, left, up


@thorough(1000)
@given(cuboids_anywhere())
def test_a_box_comes_back_from_its_corners(box: Cuboid) -> None:
    back = corners_to_cuboid(box.corners())
    assert_close(back.center, box.center, atol=1e-12, rtol=0)
    assert_close(back.rotation, box.rotation, atol=1e-12, rtol=0)
    assert_close(back.size, box.size, atol=1e-12, rtol=0)


def test_batches_keep_their_shape_and_type() -> None:
    boxes = corners_to_cuboid(AHEAD.float().expand(2, 5, 8, 3))
    assert boxes.center.shape == (2, 5, 3)
    assert boxes.rotation.dtype == torch.float32
    assert corners_to_cuboid(AHEAD[None][:0]).center.shape == (0, 3)


def test_gradients_are_those_of_finite_differences() -> None:
    corners = AHEAD.clone().requires_grad_()

    def fields(corners: torch.Tensor) -> tuple[torch.Tensor, ...]:
        box = corners_to_cuboid(corners, tolerance=1e-2)
        return box.center, box.rotation, box.size

    assert torch.autograd.gradcheck(fields, corners, eps=1e-5, atol=1e-6)


def test_corners_off_a_box_are_refused_with_how_far_they_are_off() -> None:
    corners = AHEAD.clone()
    corners[6, 2] += 0.5
    with pytest.raises(
        ShapeError, match=r"off by 0\.0\d+ of its box's diagonal \(tolerance 0\.0001"
    ):
        corners_to_cuboid(corners)
    # The mean of four heights, of which one is 1.5
    assert float(corners_to_cuboid(corners, tolerance=0.1).size[2]) == pytest.approx(
        1.125, rel=0.01
    )


@pytest.mark.parametrize("name", OTHER_ORDERS)
def test_corners_in_another_librarys_order_are_refused_with_the_way_to_reorder_them(
    name: str,
) -> None:
    corners = AHEAD[[CORNER_SIGNS.index(signs) for signs in OTHER_ORDERS[name]]]
    with pytest.raises(ShapeError, match="in the order of") as raised:
        corners_to_cuboid(corners)
    _, _, advice = str(raised.value).partition(f"{name} (then pass corners[..., [")
    order = [int(k) for k in advice.partition("]")[0].split(",")]
    assert torch.equal(corners[order], AHEAD)


def test_corners_in_a_mirrored_order_are_refused() -> None:
    with pytest.raises(ShapeError, match="must be boxes in the order of CORNER_SIGNS"):
        corners_to_cuboid(AHEAD[list(MIRRORED_CORNERS)])


def test_omni3d_corners_fit_but_mean_other_axes_until_they_are_reordered() -> None:
    omni3d = AHEAD[[4, 5, 1, 0, 7, 6, 2, 3]]
    assert corners_to_cuboid(omni3d).size.tolist() == [4.0, 1.0, 2.0]
    assert corners_to_cuboid(omni3d[[3, 2, 6, 7, 0, 1, 5, 4]]).size.tolist() == [4.0, 2.0, 1.0]


def test_a_flat_box_has_axes_but_one_without_width_has_none() -> None:
    flat = AHEAD.clone()
    flat[:, 2] = 0
    assert corners_to_cuboid(flat).size.tolist() == [4.0, 2.0, 0.0]
    for axis, name in ((0, "width"), (1, "length")):
        narrow = AHEAD.clone()
        narrow[:, axis] = 0
        with pytest.raises(ShapeError, match=f"without {name}"):
            corners_to_cuboid(narrow)


def test_seven_corners_and_nan_are_refused() -> None:
    with pytest.raises(ShapeError, match="corners must have shape"):
        corners_to_cuboid(AHEAD[:7])
    with pytest.raises(ShapeError, match="corners must be finite"):
        corners_to_cuboid(AHEAD * float("nan"))

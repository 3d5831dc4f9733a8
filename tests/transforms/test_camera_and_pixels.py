"""Masks, depth, boxes, lenses and cameras under transforms, against numbers and the law."""

import numpy as np
import pytest
import torch
from pictures import HW, picture
from scenes import F64, scene
from torch.testing import assert_close

from animal3dbox.errors import SampleError
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.transforms import (
    Compose,
    PerspectiveCrop,
    RandomAffine,
    RandomErasing,
    RandomHorizontalFlip,
    RandomPerspective,
    RandomRotation,
    RandomVirtualCamera,
    Resize,
    Transform,
    inverse,
)


def test_masks_and_their_boxes_follow_the_pixels() -> None:
    target = scene(2)
    masks = torch.zeros(2, *HW, dtype=torch.uint8)
    masks[0, 20:50, 30:70] = 1
    boxes = target["boxes"].clone()
    boxes[0] = torch.tensor([29.5, 19.5, 69.5, 49.5])
    _, after = Compose([RandomHorizontalFlip(1), Resize((60, 80))])(
        picture(), {**target, "masks": masks, "boxes": boxes}
    )
    expected = torch.zeros(60, 80, dtype=torch.uint8)
    expected[10:25, 45:65] = 1
    assert torch.equal(after["masks"][0], expected)
    assert after["boxes"][0].tolist() == [44.5, 9.5, 64.5, 24.5]
    assert int(after["masks"][1].sum()) == 0
    amodal = torch.tensor(
        [[10.0, 10, 100, 100], [0, 0, 0, 0]], dtype=F64
    )  # was not made from the mask: mapped as it is
    _, after = Compose([RandomHorizontalFlip(1), Resize((60, 80))])(
        picture(), {"masks": masks, "boxes": amodal}
    )
    assert after["boxes"][0].tolist() == [29.25, 4.75, 74.25, 49.75]


def test_painting_over_does_not_shrink_the_box_however_the_picture_moves_later() -> None:
    masks = torch.zeros(1, *HW, dtype=torch.uint8)
    masks[0, 20:100, 20:140] = 1
    target = {"masks": masks, "boxes": torch.tensor([[19.5, 19.5, 139.5, 99.5]], dtype=F64)}
    hide = RandomErasing(1, scale=(0.5, 0.5), ratio=(1.0, 1.0))
    _, after = Compose([hide, Resize((60, 80))])(picture(), target, key=(0,))
    assert after["boxes"][0].tolist() == [9.5, 9.5, 69.5, 49.5]
    assert 0 < float(after["occlusion"][0]) < 1


@pytest.mark.parametrize(
    "transform",
    [
        RandomVirtualCamera((4, 4), (3, 3), (10, 10), (1.1, 1.1)),
        RandomPerspective(0.2, p=1, allow_skew=True),
    ],
)
def test_depth_follows_the_law_at_every_pixel(transform: Transform) -> None:
    """A slanted plane: its depth in the new camera is known in closed form."""
    K = torch.tensor([[150.0, 0, 85], [0, 140, 55], [0, 0, 1]], dtype=F64)
    normal = torch.tensor([0.2, -0.1, 1.0], dtype=F64)
    y, x = torch.meshgrid(
        torch.arange(HW[0], dtype=F64), torch.arange(HW[1], dtype=F64), indexing="ij"
    )
    rays = torch.stack((x, y, torch.ones_like(x)), dim=-1) @ torch.linalg.inv(K).mT
    depth = 4 / (rays @ normal)  # normal . X = 4
    _, after = Compose([transform])(picture(), {"K": K, "depth": depth}, key=(0, 1))
    H, K_new = after["H_out_in"], after["K"]
    Q = torch.linalg.inv(K_new) @ H @ K
    Q = Q / Q[2].norm()
    rays = torch.stack((x, y, torch.ones_like(x)), dim=-1) @ torch.linalg.inv(K_new).mT
    expected = 4 / (rays @ (Q @ normal))
    known = after["depth"] > 0
    assert float(known.double().mean()) > 0.5
    assert (
        float(((after["depth"] - expected).abs() / expected)[known].max()) < 5e-3
    )  # half a pixel of the slope


def test_a_lens_is_carried_or_the_error_says_to_undistort() -> None:
    target = {"K": scene()["K"], "distortion": torch.tensor([0.1, 0.01, 0.02, 0.03], dtype=F64)}
    _, after = Compose([RandomHorizontalFlip(1), Resize(50)])(picture(), target)
    assert_close(after["distortion"], torch.tensor([0.1, 0.01, 0.02, -0.03], dtype=F64))
    with pytest.raises(SampleError, match=r"distortion: .*undistort the image first"):
        Compose([RandomVirtualCamera((3, 3))])(picture(), target)


def test_the_side_of_the_camera_is_kept_when_the_old_middle_falls_behind_it() -> None:
    """From the review.

    Labels took -H when the middle of the old picture was no longer in front of the new camera.
    """
    K = torch.tensor([[200.0, 0, 100], [0, 200, 60], [0, 0, 1]], dtype=F64)
    center, eye = torch.tensor([[3.8, 0, 1.0]], dtype=F64), torch.eye(3, dtype=F64)[None]
    target = {"K": K, "center": center, "rotation": eye, "size": torch.full((1, 3), 0.2, dtype=F64)}
    image = picture(0, (120, 1200))
    for compose in (
        Compose([PerspectiveCrop(64)]),
        Compose([RandomVirtualCamera((75, 75), 0.0, 0.0)]),
        Compose([RandomVirtualCamera((40, 40), 0.0, 0.0)] * 2),
    ):
        _, after = compose(image, target)
        assert after["mirrored"] is False
        assert float(after["center"][0, 2]) > 0
        back = inverse({name: after[name] for name in target}, after["H_out_in"], (120, 1200))
        for name, value in target.items():
            assert_close(back[name], value, atol=1e-9, rtol=1e-9)


def test_a_box_beyond_the_horizon_has_no_area() -> None:
    target = {
        "K": torch.tensor([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]], dtype=F64),
        "boxes": torch.tensor([[0.0, 40, 20, 80]], dtype=F64),
    }
    _, after = Compose([RandomVirtualCamera((80, 80), 0.0, 0.0)])(picture(), target)
    x_least, y_least, x_most, y_most = after["boxes"][0].tolist()
    assert (x_most - x_least) * (y_most - y_least) == 0


def test_faces_without_cuboids_are_scaled_or_left_out_but_never_stale() -> None:
    target = {
        name: scene()[name]
        for name in ("K", "face_area", "face_share", "face_share_in_image", "face_visible")
    }
    _, after = Compose([Resize((60, 80))])(picture(), target)
    assert_close(after["face_area"], target["face_area"] / 4)
    assert "face_share_in_image" not in after
    _, after = Compose([RandomVirtualCamera((5, 5))])(picture(), target)
    assert "face_share" not in after
    assert "face_area" not in after


def test_cuboids_beyond_a_lens_s_field_of_view_are_refused() -> None:
    target = scene(1)
    narrow = torch.tensor([-0.4, 0.0, 0.0, 0.0], dtype=F64)  # folds at 42 degrees off the axis
    wide = {
        "K": target["K"],
        "center": target["center"] + torch.tensor([7.0, 0, 0]),
        "rotation": target["rotation"],
        "size": target["size"],
    }
    with pytest.raises(
        SampleError, match="distortion: animal 0 reaches beyond the lens's field of view"
    ):
        Compose([Resize(50)])(picture(), {**wide, "distortion": narrow})
    Compose([Resize(50)])(
        picture(), {**{name: target[name] for name in wide}, "distortion": narrow}
    )


def test_strong_zooms_of_large_pictures_are_no_singular_maps() -> None:
    _, after = Compose([RandomAffine(0, scale=(0.005, 0.005))])(
        np.zeros((1000, 6000), dtype=np.uint8), {"K": scene()["K"]}
    )
    assert float(after["K"][0, 0]) == pytest.approx(0.005 * float(scene()["K"][0, 0]))


def test_a_quarter_turn_maps_boxes_exactly() -> None:
    square = torch.tensor([[200.0, 0, 80], [0, 200, 60], [0, 0, 1]], dtype=F64)
    box = Cuboid(
        torch.tensor([[0.0, 0, 5]], dtype=F64),
        torch.eye(3, dtype=F64)[None],
        torch.ones(1, 3, dtype=F64),
    )
    cuboid = {"center": box.center, "rotation": box.rotation, "size": box.size}
    target = {"K": square, "boxes": torch.tensor([[30.0, 20, 80, 90]], dtype=F64), **cuboid}
    _, after = Compose([RandomRotation((90, 90))])(picture(), target)
    assert_close(
        after["boxes"], torch.tensor([[49.0, 10, 119, 60]], dtype=F64)
    )  # x' = 139 - y, y' = x - 20

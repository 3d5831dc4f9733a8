"""Crops against the camera law of transforms, and their pixels against the maps they state."""

from typing import Any

import pytest
import torch
from detections import F64
from scenes import scene
from torch.testing import assert_close

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry import Cuboid, apply_homography, project
from animal3dbox.training.detector_targets import BoxCoder, crop_boxes
from animal3dbox.transforms import transform_target

HW = (120, 160)
Batch = tuple[torch.Tensor, list[dict[str, Any]]]


def batch() -> Batch:
    """Ramps in x, in y and in both, and three scenes, one of them empty."""
    rows, columns = torch.meshgrid(torch.arange(120.0), torch.arange(160.0), indexing="ij")
    ramps = torch.stack((columns, rows, 0.5 * columns - 0.25 * rows)).double()
    return ramps.expand(3, 3, 120, 160), [scene(2, seed=1), scene(0), scene(3, seed=2)]


def test_crops_name_their_images_and_animals_in_order() -> None:
    crops = crop_boxes(*batch(), (32, 48))
    assert crops.pixels.shape == (5, 3, 32, 48)
    assert crops.image.tolist() == [0, 0, 2, 2, 2]
    assert crops.animal.tolist() == [0, 1, 0, 1, 2]


def test_each_crop_s_camera_and_box_are_those_of_the_law_for_its_map() -> None:
    images, targets = batch()
    crops = crop_boxes(images, targets, (32, 48))
    for k in range(5):
        target = targets[int(crops.image[k])]
        names = ("boxes", "K", "center", "rotation", "size", "corners_3d", "corners_2d")
        by_law = transform_target(
            {name: target[name] for name in names}, crops.H_out_in[k], HW, (32, 48)
        )
        animal = int(crops.animal[k])
        assert_close(crops.K[k], by_law["K"], atol=1e-9, rtol=0)
        assert_close(by_law["center"], target["center"], atol=1e-9, rtol=0)  # the frame stays
        corners_px, _ = project(crops.K[k], target["corners_3d"][animal])
        assert_close(corners_px, by_law["corners_2d"][animal], atol=1e-8, rtol=0)


def test_a_crop_is_filled_by_its_box_and_margin_without_changing_its_shape() -> None:
    targets = [{"boxes": torch.tensor([[20.0, 30, 60, 50]]), "K": torch.eye(3)}]  # 40 x 20 px
    crops = crop_boxes(torch.zeros(1, 3, 120, 160), targets, (100, 100), margin=0.125)
    # 40 px and 5 px on either side fill 100 px: scale 2; the middle (40, 40) goes to (49.5, 49.5)
    assert crops.boxes.tolist() == [[9.5, 29.5, 89.5, 69.5]]
    assert crops.H_out_in[0].tolist() == [[2.0, 0, -30.5], [0, 2, -30.5], [0, 0, 1]]


@pytest.mark.parametrize("size", [(24, 24), (64, 96), (240, 240)], ids=str)
def test_pixels_are_those_of_the_image_where_the_map_says(size: tuple[int, int]) -> None:
    images, targets = batch()
    crops = crop_boxes(images, targets, size)
    height, width = size
    rows, columns = torch.meshgrid(
        torch.arange(height, dtype=F64), torch.arange(width, dtype=F64), indexing="ij"
    )
    px_out = torch.stack((columns, rows), dim=-1).reshape(-1, 2)
    checked = 0
    for k in range(5):
        x, y = apply_homography(torch.linalg.inv(crops.H_out_in[k]), px_out).unbind(-1)
        # a pixel's footprint must lie within the ramp
        reach = 0.5 / float(crops.H_out_in[k, 0, 0]) + 0.5
        inside = (x > reach) & (x < 159 - reach) & (y > reach) & (y < 119 - reach)
        expected = torch.stack((x, y, 0.5 * x - 0.25 * y))
        pixels = crops.pixels[k].reshape(3, -1)
        assert_close(pixels[:, inside], expected[:, inside], atol=1e-9, rtol=0)
        checked += int(inside.sum())
    assert checked > 2 * height * width


def test_pixels_that_shrink_are_averaged() -> None:
    stripes = (torch.arange(64) % 4 == 0) * 200.0  # a pixel in four, none of them in the middle
    target = {"boxes": torch.tensor([[-0.5, -0.5, 63.5, 63.5]]), "K": torch.eye(3)}
    crops = crop_boxes(stripes.expand(1, 1, 64, 64), [target], (16, 16), margin=0.0)
    assert_close(crops.pixels, torch.full((1, 1, 16, 16), 50.0), atol=1e-4, rtol=0)


def test_bytes_stay_bytes_and_beyond_the_image_there_is_black() -> None:
    target = {"boxes": torch.tensor([[-10.5, -0.5, 9.5, 19.5]]), "K": torch.eye(3)}
    white = torch.full((1, 3, 40, 40), 255, dtype=torch.uint8)
    crops = crop_boxes(white, [target], (20, 20), margin=0.0)
    assert crops.pixels.dtype == torch.uint8
    assert (crops.pixels[..., :10] == 0).all()
    assert (crops.pixels[..., 11:] == 255).all()


def test_images_of_many_sizes_and_no_animals_at_all_are_taken() -> None:
    targets = [scene(1), scene(0)]
    images = [torch.zeros(3, 120, 160), torch.zeros(3, 50, 40)]
    assert crop_boxes(images, targets, (8, 8)).pixels.shape == (1, 3, 8, 8)
    assert crop_boxes(images[1:], targets[1:], (8, 8)).pixels.shape == (0, 3, 8, 8)


def test_a_detector_on_crops_decodes_into_the_camera_frame_of_the_image() -> None:
    images, targets = batch()
    crops = crop_boxes(images, targets, (64, 64))
    coder = BoxCoder(virtual_focal_px=200.0)
    of_crops = {
        name: torch.cat([target[name] for target in targets])
        for name in ("center", "rotation", "size")
    }
    encoded = coder.encode({**of_crops, "boxes": crops.boxes, "K": crops.K})
    decoded = coder.decode(encoded, boxes=crops.boxes, K=crops.K)
    for name, value in of_crops.items():
        assert_close(decoded[name], value, atol=1e-9, rtol=1e-9)
    Cuboid(decoded["center"], decoded["rotation"], decoded["size"])


def test_pixels_carry_derivatives_to_the_images() -> None:
    image = torch.rand(1, 3, 30, 30, requires_grad=True)
    target = {"boxes": torch.tensor([[5.0, 5, 15, 15]]), "K": torch.eye(3)}
    crop_boxes(image, [target], (8, 8)).pixels.sum().backward()  # type: ignore[no-untyped-call]
    assert image.grad is not None
    assert float(image.grad[..., 10, 10].sum()) > 0
    assert not image.grad[..., 25, 25].any()


def test_what_cannot_be_cut_is_named() -> None:
    image = torch.zeros(1, 3, 9, 9)
    flat = {"boxes": torch.tensor([[1.0, 1, 5, 5], [2, 2, 2, 5]]), "K": torch.eye(3)}
    with pytest.raises(SampleError, match="image 0 of the batch#1: boxes: has no area"):
        crop_boxes(image, [flat], (8, 8))
    with pytest.raises(SampleError, match=r"a\.jpg: K: is missing"):
        crop_boxes(image, [{"boxes": flat["boxes"], "image_id": "a.jpg"}], (8, 8))
    with pytest.raises(ConfigError, match="1 images for 0 targets"):
        crop_boxes(image, [], (8, 8))
    with pytest.raises(ConfigError, match="margin must not be negative"):
        crop_boxes(image, [flat], (8, 8), margin=-0.1)

"""Users of torchvision v2: their pixel origin, their tensor classes, images alone, grey levels."""

from typing import Any

import kornia.augmentation as kornia
import numpy as np
import pytest
import torch
from scenes import scene
from torch import Tensor

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.transforms import (
    CameraAugmentationSequential,
    ColorJitter,
    Compose,
    KorniaTransform,
    Normalize,
    RandomHorizontalFlip,
    RandomVirtualCamera,
    Resize,
)

HW = (120, 160)
IMAGE = np.zeros((*HW, 3), np.uint8)
WHOLE = torch.tensor([[0.0, 0.0, 160.0, 120.0]])
FLIP = RandomHorizontalFlip(p=1)


def moved(target: dict[str, Any], by: float) -> dict[str, Any]:
    """The target with pixels counted from another origin, by hand."""
    out = dict(target)
    for name in ("boxes", "corners_2d"):
        out[name] = target[name] + by
    out["keypoints"] = target["keypoints"] + torch.tensor([by, by, 0])
    out["K"] = target["K"].clone()
    out["K"][:2, 2] += by
    return out


def test_torchvisions_whole_image_box_stays_whole() -> None:
    _, flipped = Compose([FLIP], pixel_origin="edge")(IMAGE, {"boxes": WHOLE})
    assert flipped["boxes"].tolist() == WHOLE.tolist()
    _, halved = Compose([Resize((60, 80))], pixel_origin="edge")(IMAGE, {"boxes": WHOLE})
    assert halved["boxes"].tolist() == [[0, 0, 80, 60]]
    assert halved["H_out_in"].tolist() == [[0.5, 0, 0], [0, 0.5, 0], [0, 0, 1]]


def test_a_far_side_of_exactly_W_is_an_error_that_names_the_option() -> None:
    for box in ([3.0, 5, 160, 50], [3.0, 5, 50, 120]):
        with pytest.raises(SampleError, match='pixel_origin="edge"'):
            FLIP(IMAGE, {"boxes": torch.tensor([box])})
    beyond = torch.tensor([[3.0, 5, 160, 50], [3, 5, 170, 50]])
    assert FLIP(IMAGE, {"boxes": beyond})[1]["boxes"][:, 0].tolist() == [-0.5, -0.5]


@pytest.mark.parametrize("seed", range(5))
def test_edge_targets_are_center_targets_half_a_pixel_on(seed: int) -> None:
    members = [FLIP, RandomVirtualCamera(5, 5, 10), Resize((60, 100))]
    target = scene(2, HW, seed)
    _, center = Compose(members)(IMAGE, target, key=(0, seed))
    _, edge = Compose(members, pixel_origin="edge")(IMAGE, moved(target, 0.5), key=(0, seed))
    for name, value in moved(center, 0.5).items():
        if isinstance(value, Tensor) and name != "H_out_in":
            torch.testing.assert_close(edge[name], value, rtol=0, atol=1e-9)


def test_an_unknown_origin_and_a_lost_one_are_refused() -> None:
    with pytest.raises(ConfigError, match="pixel_origin"):
        Compose([FLIP], pixel_origin="corner")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="pixel_origin"):
        Compose([Compose([FLIP], pixel_origin="edge")])


class Boxes(Tensor):
    """A tensor class with attributes, as torchvision's BoundingBoxes."""

    format: str
    canvas_size: tuple[int, int]


class Picture(Tensor):
    """A tensor class without attributes, as torchvision's Image."""


def boxes_of(format: str) -> Boxes:
    boxes = torch.tensor([[3.0, 5, 50, 50]]).as_subclass(Boxes)
    boxes.format, boxes.canvas_size = format, HW
    return boxes


def test_tensor_classes_come_back_as_what_they_were() -> None:
    image = torch.zeros(3, *HW).as_subclass(Picture)
    resized, target = Resize((60, 80))(image, {"boxes": boxes_of("XYXY")})
    assert type(resized) is Picture
    assert type(target["boxes"]) is Boxes
    assert (target["boxes"].format, target["boxes"].canvas_size) == ("XYXY", (60, 80))
    with pytest.raises(SampleError, match="convert them to XYXY"):
        FLIP(image, {"boxes": boxes_of("XYWH")})


def test_an_image_alone_comes_back_alone() -> None:
    image = np.arange(120 * 160 * 3, dtype=np.uint8).reshape(*HW, 3)
    assert np.array_equal(FLIP(image), image[:, ::-1])
    assert Compose([FLIP])(torch.zeros(3, *HW)).shape == (3, *HW)


@pytest.mark.parametrize(
    "colours",
    [
        ColorJitter(brightness=(1.1, 1.1)),
        Normalize(),
        KorniaTransform(kornia.RandomBrightness((1.1, 1.1), p=1.0)),
        KorniaTransform(kornia.Normalize(0.5, 0.2)),
    ],
)
def test_colours_refuse_floats_that_are_not_0_to_1(colours: Any) -> None:
    image = torch.rand(3, 12, 16)
    colours(image, {})
    colours(image.clamp(max=0.9) + 0.1009, {})  # an overshoot that rounding explains
    for wrong in (image * 255, (image - 0.5) / 0.2):
        with pytest.raises(SampleError, match="need 0 to 1"):
            colours(wrong, {"image_id": "a.jpg"})
        with pytest.raises(SampleError, match="need 0 to 1"):
            Compose([colours]).batch((wrong[None], [{}]))
        assert torch.equal(FLIP(wrong, {})[0], wrong.flip(-1))


def kornias_boxes() -> list[Tensor]:
    """Boxes of two pictures, two and one."""
    return [torch.tensor([[10.0, 5, 30, 25], [20, 12, 40, 40]]), torch.tensor([[25.0, 5, 33, 25]])]


def corners_of_boxes(boxes: Tensor) -> Tensor:
    return boxes[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 4, 2)


@pytest.mark.parametrize(
    "op", [kornia.RandomHorizontalFlip(p=1.0), kornia.RandomRotation((20.0, 20.0), p=1.0)]
)
def test_kornias_boxes_and_lists_of_boxes_are_those_of_kornia_in_the_frame(op: Any) -> None:
    images, boxes = torch.rand(2, 3, 60, 80), kornias_boxes()
    for key, given in (("bbox_xyxy", boxes), ("bbox", [corners_of_boxes(b) for b in boxes])):
        ours = CameraAugmentationSequential(op, data_keys=["input", key])
        theirs = kornia.AugmentationSequential(op, data_keys=["input", key])
        mapped, expected = ours(images, given)[1], theirs(images, given)[1]
        assert isinstance(mapped, list)
        for own, other in zip(mapped, expected, strict=True):
            points = other.reshape(len(other), -1, 2)
            inside = torch.stack(
                (points[..., 0].clamp(-0.5, 79.5), points[..., 1].clamp(-0.5, 59.5)), -1
            )
            torch.testing.assert_close(own, inside.reshape(other.shape), rtol=0, atol=1e-4)


def test_the_inverse_of_a_kornia_pipeline_takes_all_back() -> None:
    aug = CameraAugmentationSequential(
        kornia.RandomHorizontalFlip(p=1.0),
        kornia.RandomVerticalFlip(p=1.0),
        data_keys=["input", "K", "corners_3d", "bbox_xyxy"],
    )
    target = scene(2, (60, 80), 3, torch.float32)
    images, boxes = torch.rand(1, 3, 60, 80), kornias_boxes()[0][None]
    given = (images, target["K"][None], target["corners_3d"][None], boxes)
    with pytest.raises(ConfigError, match="needs a call before it"):
        aug.inverse(*given)
    augmented = aug(*given)
    assert not torch.allclose(augmented[3], boxes)
    for value, before in zip(aug.inverse(*augmented), given, strict=True):
        torch.testing.assert_close(value, before, rtol=0, atol=1e-4)
    with pytest.raises(ConfigError, match="the last call gave"):
        aug.inverse(images[..., :40], *given[1:])

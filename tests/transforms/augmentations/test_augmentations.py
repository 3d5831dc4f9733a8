"""Single augmentations against what a person computes, and the options that they refuse."""

from typing import Any

import numpy as np
import pytest
import torch
from pictures import HW, picture
from scenes import scene

from animal3dbox.errors import ConfigError, ShapeError
from animal3dbox.transforms import (
    ColorJitter,
    Compose,
    Normalize,
    PadTo,
    RandomAffine,
    RandomErasing,
    RandomGaussianBlur,
    RandomGrayscale,
    RandomHorizontalFlip,
    RandomPerspective,
    RandomResizedCrop,
    RandomVirtualCamera,
    Resize,
)


def test_erasing_marks_what_it_hides() -> None:
    target = scene(1)
    masks = torch.zeros(1, *HW, dtype=torch.uint8)
    masks[0, 10:110, 20:140] = 1
    erase = RandomErasing(1, scale=(0.25, 0.25), ratio=(1.0, 1.0), value=(1.0, 0.5, 0.0))
    image, after = Compose([erase])(
        picture(), {**target, "masks": masks, "depth": torch.ones(HW)}, key=(0,)
    )
    painted = (image[0] == 255) & (image[1] == 128) & (image[2] == 0)
    assert int(painted.sum()) == 69 * 69
    assert torch.equal(after["masks"][0], masks[0] * ~painted)
    assert torch.equal(after["depth"] == 0, painted)
    hidden = float((masks[0].bool() & painted).sum()) / float(masks.sum())
    assert float(after["occlusion"][0]) == pytest.approx(hidden)
    for before, now in zip(target["keypoints"][0], after["keypoints"][0], strict=True):
        u, v = (round(value) for value in before[:2].tolist())
        assert float(now[2]) == (0.0 if painted[v, u] else 1.0)
    _, twice = Compose([erase])(image, after, key=(1,))
    assert float(twice["occlusion"][0]) >= float(after["occlusion"][0])


def test_without_masks_the_hidden_part_of_the_cuboid_counts() -> None:
    target = {name: scene(1)[name] for name in ("K", "corners_3d")}
    everything = RandomErasing(1, scale=(1.0, 1.0), ratio=(160 / 120, 160 / 120))
    _, after = Compose([everything])(picture(), target)
    assert float(after["occlusion"][0]) == pytest.approx(1)


def test_colours_change_as_a_person_computes() -> None:
    grey = np.full((4, 5, 3), (100, 150, 200), dtype=np.uint8)
    bright, _ = Compose([ColorJitter(brightness=(1.2, 1.2))])(grey, {})
    assert bright[0, 0].tolist() == [120, 180, 240]
    flat, _ = Compose([ColorJitter(contrast=(0.0, 0.0))])(grey, {})
    assert set(np.unique(flat)) <= {127, 128}
    mono, _ = Compose([RandomGrayscale(1)])(grey, {})
    assert mono[0, 0].tolist() == [round(0.299 * 100 + 0.587 * 150 + 0.114 * 200)] * 3
    half, _ = Compose([ColorJitter(hue=(0.5, 0.5))])(grey, {})
    twice, _ = Compose([ColorJitter(hue=(0.5, 0.5))])(half, {})
    assert np.abs(twice.astype(int) - grey).max() <= 1
    assert np.abs(half.astype(int) - grey).max() > 20
    scaled, _ = Compose([Normalize((0.5, 0.5, 0.5), (0.25, 0.25, 0.25))])(grey, {})
    assert np.allclose(scaled[0, 0], (np.array([100, 150, 200]) / 255 - 0.5) / 0.25, atol=1e-6)
    assert scaled.dtype == np.float32


def test_blur_keeps_brightness_and_spreads_a_point_by_its_sigma() -> None:
    point = np.zeros((41, 41, 3), dtype=np.float32)
    point[20, 20] = 1
    compose = Compose([RandomGaussianBlur((2, 2), p=1)])
    batch, _ = compose.batch((torch.from_numpy(point).permute(2, 0, 1)[None], [{}]))
    for image in (compose(point, {})[0], batch[0].permute(1, 2, 0)):
        weight = np.asarray(image)[..., 0].astype(float)
        assert weight.sum() == pytest.approx(1, abs=1e-4)
        y, _ = np.mgrid[-20:21, -20:21]
        assert (weight * y**2).sum() == pytest.approx(4, rel=0.05)  # cut at three sigma


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: RandomHorizontalFlip(p=1.5), "p must lie in"),
        (lambda: RandomHorizontalFlip(mirror="ignore"), "mirror must be"),
        (lambda: Resize(0), "size must be"),
        (lambda: Resize((3, 4, 5)), "size must be"),  # type: ignore[arg-type]
        (lambda: RandomResizedCrop(5, scale=(0.5, 2)), "scale must lie"),
        (lambda: RandomResizedCrop(5, scale=(0.8, 0.2)), "scale must be"),
        (lambda: RandomAffine((3, -3)), "degrees must be"),
        (lambda: RandomAffine(3, scale=(0, 1)), "scale must be"),
        (lambda: RandomVirtualCamera(95), "yaw must lie"),
        (lambda: RandomVirtualCamera(zoom=1.2), r"zoom must be a \(low, high\) pair"),  # type: ignore[arg-type]
        (lambda: RandomAffine(3, scale=1.2), "scale must be a"),  # type: ignore[arg-type]
        (lambda: RandomAffine("3"), "degrees must be"),  # type: ignore[arg-type]
        (lambda: RandomPerspective(), "allow_skew=True .*RandomVirtualCamera"),
        (lambda: ColorJitter(brightness=(-1, 1)), "brightness must be"),
        (lambda: Normalize((0, 0), (1, 0)), "std > 0"),
        (lambda: PadTo(5, "left"), "position must be"),
        (lambda: RandomErasing(value="noise"), "value must be"),
        (lambda: Compose([Resize(5)], interpolation="area"), "interpolation must be one of"),
        (
            lambda: Compose([RandomHorizontalFlip()], mirror="forbid"),
            "may mirror: RandomHorizontalFlip",
        ),
        (lambda: Compose([len]), "is no transform"),
        (lambda: Compose([Normalize(), ColorJitter(0.1)])(picture(), {}), "put Normalize last"),
        (lambda: Compose([PadTo(50)])(picture(), {}), "cannot hold an image of"),
        (lambda: Compose([RandomVirtualCamera()])(picture(), {}), "needs its intrinsics K"),
        (lambda: Compose([Resize(5)], seed=-1)(picture(), {}), "whole numbers >= 0"),
        (lambda: Compose([Resize(5)]).batch((picture()[None], [])), "1 images, 0 targets"),
        (lambda: Compose([Resize(5)], keypoint_mirror=[0, 0]), "permutation"),
    ],
)
def test_options_that_cannot_be_are_refused(make: Any, says: str) -> None:
    with pytest.raises((ConfigError, ShapeError), match=says):
        make()


def test_crops_do_not_count_animals_that_are_not_in_the_picture() -> None:
    whole = scene(2, seed=4)
    center = whole["center"].clone()
    center[1] = torch.tensor([0.0, 0, -5])
    target = {
        "K": whole["K"],
        "center": center,
        "rotation": whole["rotation"],
        "size": whole["size"],
    }
    crop = Compose([RandomResizedCrop(64, (0.05, 0.3), keep_part=0.9, min_visible=None)])
    alone = {
        "K": target["K"],
        **{name: target[name][:1] for name in ("center", "rotation", "size")},
    }
    for index in range(20):
        assert (
            crop.sample_params(HW, target, (index,)).H_out_in.tolist()
            == crop.sample_params(HW, alone, (index,)).H_out_in.tolist()
        )


def test_a_forbidden_mirror_never_happens() -> None:
    compose = Compose([RandomHorizontalFlip(1, mirror="forbid")], mirror="forbid")
    image, after = compose(picture(), scene())
    assert after["mirrored"] is False
    assert torch.equal(image, picture())

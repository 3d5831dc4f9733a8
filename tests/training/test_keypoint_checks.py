"""Keypoints that were mirrored, or not moved, without their animal.

And good ones, of which nothing may be said.
"""

from dataclasses import replace
from typing import Any

import pytest
import torch

from animal3dbox.datasets import Skipped, SyntheticDataset, SyntheticSet
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.training.checks import check_targets
from animal3dbox.training.findings import TargetReport
from animal3dbox.transforms import (
    Compose,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomVirtualCamera,
)

H, W = 240, 320
IMAGE = torch.zeros(3, H, W)


def animal(
    points: list[list[float]],
    box: tuple[float, float, float, float],
    part: tuple[int, int, int, int] | None = None,
) -> dict[str, Any]:
    """An animal with a box, the same as its cuboid's picture, marked keypoints, and perhaps a mask
    of one rectangle (x1, y1, x2, y2)."""
    x1, y1, x2, y2 = box
    target: dict[str, Any] = {
        "image_id": "a",
        "boxes": torch.tensor([box]),
        "corners_2d": torch.tensor([[[x1, y1], [x2, y1], [x2, y2], [x1, y2]] * 2]),
        "corner_in_front": torch.ones(1, 8, dtype=torch.bool),
        "keypoints": torch.tensor([[[x, y, 1.0] for x, y in points]]),
    }
    if part is not None:
        left, top, right, bottom = part
        target["masks"] = torch.zeros(1, H, W, dtype=torch.uint8)
        target["masks"][:, top:bottom, left:right] = 1
    return target


def mirrored(target: dict[str, Any], axis: int) -> dict[str, Any]:
    keypoints = target["keypoints"].clone()
    keypoints[..., axis] = (W, H)[axis] - 1 - keypoints[..., axis]
    return {**target, "keypoints": keypoints}


def report_of(target: dict[str, Any], step: int = 2) -> TargetReport:
    """What is found at a step; the second looks at no mask's keypoints."""
    return check_targets([target], [IMAGE], step=step, on_fault="count")


ASIDE = animal([[20.0 + 10 * k, 30.0 + 5 * k] for k in range(8)], (10.0, 20.0, 110.0, 90.0))
CENTRED = animal(
    [[90.0 + 10 * k, 60.0 + k] for k in range(6)], (80.0, 50.0, 239.0, 189.0), (80, 50, 159, 119)
)
CENTRED["masks"][:, 188, 238] = 1  # the tip of its tail: its box is that of its mask


@pytest.mark.parametrize(("axis", "name"), [(0, "left to right"), (1, "top to bottom")])
def test_keypoints_mirrored_alone_are_found_by_the_box_of_an_animal_aside(
    axis: int, name: str
) -> None:
    assert report_of(ASIDE).counts == {}
    report = report_of(mirrored(ASIDE, axis))
    assert report.counts == {"keypoints_on_animal": 1}
    assert (
        f"a#0: keypoints: 0 of 8 marked ones lie on their animal, but 8 if mirrored {name}: a"
        " transform must move" in str(report.examples[0][1])
    )


@pytest.mark.parametrize("axis", [0, 1])
def test_keypoints_mirrored_alone_are_found_by_the_mask_of_an_animal_in_the_middle(
    axis: int,
) -> None:
    wrong = mirrored(CENTRED, axis)
    for step in (0, 1):
        assert report_of(CENTRED, step).counts == {}
        assert report_of(wrong, step).counts == {"keypoints_on_animal": 1}
    assert report_of(wrong, 2).counts == {}  # both boxes are the middle's


def test_three_keypoints_and_few_outliers_say_nothing() -> None:
    few = mirrored({**ASIDE, "keypoints": ASIDE["keypoints"][:, :3]}, 0)
    assert report_of(few).counts == {}
    some = {**ASIDE, "keypoints": ASIDE["keypoints"].clone()}
    some["keypoints"][0, :2] = mirrored(ASIDE, 0)["keypoints"][0, :2]
    assert report_of(some).counts == {}
    hidden = mirrored(ASIDE, 0)
    hidden["keypoints"][..., 2] = 0
    assert report_of(hidden).counts == {}


def test_keypoints_of_the_picture_before_a_crop_are_found_without_images_too() -> None:
    moved = {**ASIDE, "keypoints": ASIDE["keypoints"] + torch.tensor([110.0, 65.0, 0.0])}
    report = check_targets([moved], on_fault="count")
    assert report.counts == {"keypoints_on_animal": 1}
    assert "8 of 8 marked ones lie off their animal's box" in str(report.examples[0][1])


def test_a_box_that_reaches_behind_the_camera_is_not_asked() -> None:
    assert (
        report_of(
            {**mirrored(ASIDE, 0), "corner_in_front": torch.zeros(1, 8, dtype=torch.bool)}
        ).counts
        == {}
    )


@pytest.mark.parametrize("faults", [FaultConfig(), FaultConfig(noise_px=2, outliers=0.1)])
def test_generated_animals_raise_nothing_and_most_mirrored_ones_are_found(
    faults: FaultConfig,
) -> None:
    augment = Compose(
        [
            RandomHorizontalFlip(),
            RandomVirtualCamera(5, 5, 10),
            RandomResizedCrop((200, 260), scale=(0.4, 1.0)),
        ],
        seed=4,
    )
    world = SyntheticSet(6, 12, replace(WorldConfig(), image_hw=(H, W)), faults, hidden="marked")
    asked = caught = 0
    for transform in (None, augment):
        dataset = SyntheticDataset(world, transform=transform)
        for index in range(12):
            sample = dataset[index]
            assert not isinstance(sample, Skipped)
            image, target = sample
            steps = range(
                1, 2 * len(target["keypoints"]), 2
            )  # in which the mask of each animal has its turn
            good = (check_targets([target], [image], step=step, on_fault="count") for step in steps)
            assert all(report.counts["keypoints_on_animal"] == 0 for report in good)
            keypoints = target["keypoints"].clone()
            keypoints[..., 0] = image.shape[2] - 1 - keypoints[..., 0]
            asked += int(((target["keypoints"][..., 2] > 0).sum(1) >= 4).sum())
            reports = [
                check_targets(
                    [{**target, "keypoints": keypoints}], [image], step=step, on_fault="count"
                )
                for step in steps
            ]
            caught += len(
                {
                    error.sample_id
                    for report in reports
                    for check, error in report.examples
                    if check == "keypoints_on_animal"
                }
            )
    assert caught >= 0.6 * asked > 10

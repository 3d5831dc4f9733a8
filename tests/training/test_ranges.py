"""Bare cuboids, masks, classes and ranges: what check_targets and audit say of other people's."""

from typing import Any

import pytest
import torch
from scenes import training_target
from training_batches import HW, good_batch, images_of

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.cuboid import corners_of
from animal3dbox.training import TargetRanges, audit, check_targets, learn_ranges

BARE = ("K", "center", "rotation", "size", "corners_3d", "boxes", "labels", "image_id")
SIZES = [HW] * 4


def bare_batch() -> list[dict[str, Any]]:
    return [{name: target[name] for name in BARE} for target in good_batch()]


def test_right_bare_cuboids_raise_nothing_and_boxes_of_another_place_do() -> None:
    batch = bare_batch()
    assert check_targets(batch, SIZES).faults == 0
    batch[1]["boxes"] = batch[1]["boxes"] / torch.tensor([HW[1], HW[0]] * 2)  # normalised
    report = check_targets(batch, SIZES, on_fault="count")
    assert report.counts == {"boxes_on_cuboid": 2}
    batch = bare_batch()
    batch[1]["K"] = torch.diag(torch.tensor([0.25, 0.25, 1.0])) @ batch[1]["K"]
    assert check_targets(batch, SIZES, on_fault="count").counts["boxes_on_cuboid"] > 0


def test_normalised_boxes_are_caught_on_a_cuboid_that_covers_the_images_corner() -> None:
    batch = bare_batch()
    for target in batch:
        target["size"] = target["size"] * 20
        target["corners_3d"] = corners_of(target["center"], target["rotation"], target["size"])
        target["center"] = target["center"] + torch.tensor([0.0, 0, 30])
        target["corners_3d"] = target["corners_3d"] + torch.tensor([0.0, 0, 30])
        target["boxes"] = torch.tensor([[20.0, 20, 200, 200]] * 2)
    assert check_targets(batch, SIZES).faults == 0
    for target in batch:
        target["boxes"] = torch.tensor([[0.3, 0.2, 0.9, 0.8]] * 2)
    report = check_targets(batch, SIZES, on_fault="count")
    assert report.counts["boxes_on_cuboid"] == 8


def test_labels_stay_below_the_classes() -> None:
    batch = bare_batch()  # labels 0 and 1
    assert check_targets(batch, classes=2).faults == 0
    assert check_targets(batch, classes=1, on_fault="count").counts == {"labels": 4}
    with pytest.raises(ConfigError, match="classes"):
        check_targets(batch, classes=0)


def test_without_a_step_every_mask_is_read_and_with_one_a_single_mask() -> None:
    batch = good_batch()
    for target in batch:
        target["masks"] = 1 - target["masks"]
    assert check_targets(batch, images_of(batch), on_fault="count").counts["masks"] == 8
    assert check_targets(batch, images_of(batch), on_fault="count", step=2).counts["masks"] == 1


def test_a_mask_of_a_part_of_its_animal_is_caught() -> None:
    batch = good_batch()
    middle = int(batch[2]["boxes"][0, 0::2].mean())
    batch[2]["masks"][0, :, middle:] = 0
    report = check_targets(batch, images_of(batch), on_fault="count")
    assert report.counts == {"masks": 1}
    assert "from its box's edge" in str(report)


def test_stated_ranges_are_faults_and_learned_ones_warnings() -> None:
    batch = bare_batch()
    low, high = learn_ranges([training_target(2, HW, n) for n in range(20)], [HW] * 20).learned[
        "length"
    ]
    assert low < 0.4 < 1.2 < high  # the scenes' lengths are 0.3 to 1.3
    ranges = TargetRanges(learned={"length": (low, high)}, stated={"depth": (1.0, 20.0)})
    assert check_targets(batch, SIZES, ranges=ranges).warnings == {}
    for name in ("center", "size", "corners_3d"):
        batch[3][name] = batch[3][name] * 1000  # millimetres
    report = check_targets(batch, SIZES, ranges=ranges, on_fault="count")
    assert (report.counts, report.warnings) == ({"range": 2}, {"unusual": 2})


def test_exchanged_names_of_keypoints_are_unusual_where_places_were_learned() -> None:
    learned = [training_target(2, HW, n) for n in range(100, 160)]
    ranges = learn_ranges(learned, [HW] * 60)
    batch = good_batch()
    assert check_targets(batch, images_of(batch), ranges=ranges).warnings["unusual"] == 0
    batch[0]["keypoints"] = batch[0]["keypoints"][:, batch[0]["keypoint_mirror"]]
    report = check_targets(batch, images_of(batch), ranges=ranges)
    assert report.warnings["unusual"] >= 1
    assert "keypoints better exchanged" in str(report)


def test_a_range_that_cannot_be_is_refused() -> None:
    with pytest.raises(ConfigError, match="no measure of a target is named 'legnth'"):
        TargetRanges(stated={"legnth": (0, 1)})
    with pytest.raises(ConfigError, match="length"):
        TargetRanges(stated={"length": (2, 1)})


def test_an_audit_counts_over_a_dataset_and_leaves_out_what_is_no_sample() -> None:
    batch = good_batch()
    batch[3]["labels"] = batch[3]["labels"] + 1
    samples: list[Any] = [(torch.zeros(3, *HW), target) for target in batch]
    report = audit([*samples, "skipped"], classes=2, at_once=3)
    assert (report.targets, report.animals, report.counts) == (4, 8, {"labels": 1})
    assert report.labels == {0: 3, 1: 4, 2: 1}
    low, high = report.spans["depth"]
    depths = torch.cat([target["center"][:, 2] for target in batch])
    assert (low, high) == pytest.approx((float(depths.min()), float(depths.max())))
    with pytest.raises(ConfigError, match="at_once"):
        audit(samples, at_once=0)


def test_sizes_of_a_class_are_held_against_those_of_its_own() -> None:
    learned = [training_target(2, HW, n) for n in range(60)]
    for target in learned:  # animals of class 1 are ten times as large
        for name in ("size", "center", "corners_3d"):
            target[name][1] *= 10
    ranges = learn_ranges(learned, [HW] * 60)
    small, large = ranges.learned_by_class[0]["length"], ranges.learned_by_class[1]["length"]
    assert large[0] == pytest.approx(10 * small[0], rel=0.5)
    batch = bare_batch()
    batch[2]["size"] = batch[2]["size"] * torch.tensor([[1.0], [10.0]])
    of_class_1 = TargetRanges(learned_by_class={1: {"length": large}})
    report = check_targets(
        [{"size": t["size"], "labels": t["labels"]} for t in batch], ranges=of_class_1
    )
    assert report.warnings == {"unusual": 3}
    assert "length of class 1" in str(report)
    stated = TargetRanges(stated_by_class={0: {"depth": (1e3, 2e3)}})
    assert check_targets(batch[:2], ranges=stated, on_fault="count").counts == {"range": 2}
    with pytest.raises(ConfigError, match="no measure of a target is named 'legnth'"):
        TargetRanges(stated_by_class={3: {"legnth": (0, 1)}})
    for label in ("cat", True, -1, 0.5):
        with pytest.raises(ConfigError, match="go by the class's number in a target's labels"):
            TargetRanges(stated_by_class={label: {"length": (0, 1)}})  # type: ignore[dict-item]


def test_labels_that_count_from_one_are_told_so() -> None:
    batch = bare_batch()  # labels 0 and 1
    for target in batch:
        target["labels"] = target["labels"] + 1
    with pytest.raises(SampleError, match="these labels are 1 to 2: if they count from 1"):
        check_targets(batch, classes=2)
    batch[0]["labels"] = torch.tensor([0, 2])
    with pytest.raises(SampleError, match="got 2 \\[labels\\]"):
        check_targets(batch, classes=2)

"""Where 2D boxes lie in their cuboids: a learned reach, and usual mistakes that are undone."""

from typing import Any

import numpy as np
import pytest
from scenes import training_target
from target_faults import KINDS, Batch
from training_batches import HW

from animal3dbox.training import check_targets, learn_ranges
from animal3dbox.training.box_places import (
    MISTAKES,
    box_place_measures,
    edge_ratios,
    learned_reach,
)
from animal3dbox.training.packed import Packed
from animal3dbox.training.packing import pack

BARE = ("K", "center", "rotation", "size", "boxes", "labels", "image_id")
PLANTED = {
    "boxes better as x, y, w, h": "boxes xywh",
    "boxes better as cx, cy, w, h": "boxes cx, cy, w, h",
    "boxes better mirrored": "boxes mirrored, nothing else",
    "K better with cx and cy exchanged": "cx, cy exchanged",
    "center better as the bottom's": "centre as KITTI's bottom, all made from it",
    "rotation better transposed": "rotation transposed, all made from it",
}


def bare(seed: int) -> dict[str, Any]:
    """An image's animals, whose boxes are those of their projected cuboids, cut to the frame."""
    target = {name: value for name, value in training_target(2, HW, seed).items() if name in BARE}
    target["boxes"] = target["boxes"].clone()
    target["boxes"][:, 0::2] = target["boxes"][:, 0::2].clamp(-0.5, HW[1] - 0.5)
    target["boxes"][:, 1::2] = target["boxes"][:, 1::2].clamp(-0.5, HW[0] - 0.5)
    return target


def packed_of(targets: list[dict[str, Any]]) -> Packed:
    packed = pack(targets, range(len(targets)), [HW] * len(targets), None)
    assert packed is not None
    return packed


def test_a_box_round_its_cuboid_reaches_as_far_as_the_cuboid() -> None:
    packed = packed_of([bare(seed) for seed in range(20)])
    assert packed.outline is not None
    outline = np.concatenate(packed.outline, 1)
    same = np.abs(outline - packed.floats["boxes"]) < 1e-3
    ratio, direction = edge_ratios(packed)
    assert same.mean() > 0.8
    np.testing.assert_allclose(ratio[same], 1, atol=1e-4)
    np.testing.assert_allclose(np.abs(direction).sum(-1), 1)


@pytest.mark.parametrize("measure", MISTAKES)
def test_a_usual_mistake_makes_the_boxes_lie_better_once_it_is_undone(measure: str) -> None:
    right = [bare(seed) for seed in range(100, 160)]
    reach = learned_reach([packed_of(right)])
    assert reach is not None
    np.testing.assert_array_less(box_place_measures(packed_of(right), reach)[measure], 1.0)
    spoiled = []
    for seed in range(20):
        batch = Batch([bare(seed), bare(seed + 1)], [HW, HW], 0)
        batch.target["corners_3d"] = batch.target["center"]  # made anew by some plants
        assert KINDS[PLANTED[measure]](batch)
        batch.target.pop("corners_3d")
        spoiled.append(batch.target)
    better = box_place_measures(packed_of(spoiled), reach)[measure]
    assert (better > 5).mean() > 0.5


def test_boxes_of_another_form_are_unusual_with_the_cause_in_words() -> None:
    ranges = learn_ranges([bare(seed) for seed in range(100, 200)], [HW] * 100)
    batch = Batch([bare(3)], [HW], 0)
    assert check_targets(batch.targets, [HW], ranges=ranges).warnings == {}
    assert KINDS["boxes cx, cy, w, h"](batch)
    report = check_targets(batch.targets, [HW], ranges=ranges, on_fault="count")
    assert "boxes better as cx, cy, w, h" in str(report)


def test_few_boxes_teach_no_reach() -> None:
    assert learned_reach([packed_of([bare(seed) for seed in range(5)])]) is None
    assert learned_reach([]) is None

"""AP3D against counts by hand, and against a slow, plain count of the same definition."""

from typing import Any

import numpy as np
import pytest
import torch
from detections import F64, animals, detected, turned

from animal3dbox.training.metrics import BoxMetrics

HERE, ASIDE, FAR_ASIDE, NOWHERE = (0.0, 0, 8), (4.0, 0, 8), (8.0, 0, 8), (0.0, 50, 8)


def measured(
    predictions: list[dict[str, Any]], targets: list[dict[str, Any]], **options: Any
) -> dict[str, Any]:
    metrics = BoxMetrics(**{"resamples": 0, "relative": False, **options})
    metrics.update(predictions, targets)
    return metrics.compute()


def test_a_false_alarm_between_two_hits_costs_the_upper_half_of_the_recalls_a_third() -> None:
    prediction = detected(animals(HERE, NOWHERE, ASIDE), 0.9, 0.8, 0.7)
    result = measured([prediction], [animals(HERE, ASIDE)])
    # recalls 0 to 0.50, 51 of them, have precision 1; the other 50 have 2 hits of 3
    assert result["ap_3d"] == pytest.approx((51 + 50 * 2 / 3) / 101, abs=1e-12)
    assert (result["truths"], result["predictions"], result["pairs"]) == (2, 3, 2)


def test_a_truth_that_is_missed_leaves_the_recalls_beyond_at_0() -> None:
    result = measured([detected(animals(HERE), 0.9)], [animals(HERE, ASIDE)])
    assert result["ap_3d_50"] == pytest.approx(51 / 101, abs=1e-12)


def test_the_second_box_on_one_animal_is_a_false_alarm() -> None:
    twice = detected(animals(HERE, HERE, ASIDE), 0.9, 0.8, 0.7)
    result = measured([twice], [animals(HERE, ASIDE)])
    assert result["ap_3d"] == pytest.approx((51 + 50 * 2 / 3) / 101, abs=1e-12)


def test_ap_at_a_threshold_asks_for_that_overlap() -> None:
    # 1 m ahead of 2 m: half of each box is common, 1 of 3 halves: IoU 1 / 3
    result = measured([detected(animals((1.0, 0, 8)), 0.9)], [animals(HERE)])
    assert (result["ap_3d_15"], result["ap_3d_25"], result["ap_3d_50"]) == (1.0, 1.0, 0.0)
    assert result["ap_3d"] == pytest.approx(6 / 10)  # 0.05 to 0.30 of 0.05 to 0.50


def test_classes_count_alike_whatever_their_numbers_and_boxes_of_another_class_do_not_hit() -> None:
    target = {**animals(HERE, ASIDE, FAR_ASIDE), "labels": torch.tensor([0, 0, 1])}
    prediction = detected(target, 0.9, 0.8, 0.7, labels=torch.tensor([0, 0, 0]))
    result = measured([prediction], [target], classes=["cat", "dog"])
    assert (result["ap_3d_class_cat"], result["ap_3d_class_dog"], result["ap_3d"]) == (1, 0, 0.5)
    agnostic = measured([prediction], [target], class_agnostic=True)
    assert agnostic["ap_3d"] == 1.0
    assert "ap_3d_class_0" not in agnostic


def test_only_the_best_detections_of_an_image_count() -> None:
    prediction = detected(animals(HERE, ASIDE), 0.1, 0.9)
    assert measured([prediction], [animals(HERE, ASIDE)], max_detections=1)["ap_3d"] == (
        pytest.approx(51 / 101)
    )


def test_a_crowd_takes_any_number_of_boxes_and_counts_neither_way() -> None:
    target = {**animals(HERE, ASIDE), "iscrowd": torch.tensor([0, 1])}
    prediction = detected(animals(ASIDE, ASIDE, HERE), 0.9, 0.8, 0.7)
    result = measured([prediction], [target])
    assert (result["ap_3d"], result["truths"]) == (1.0, 1)


def test_depths_count_the_animals_of_their_range_and_no_false_alarm_of_another() -> None:
    near, medium, far = (0.0, 0, 9.5), (0.0, 0, 20), (0.0, 0, 40)
    prediction = detected(animals(near, (5.0, 0, 9), medium, (9.0, 0, 60)), 0.5, 0.9, 0.8, 0.7)
    result = measured([prediction], [animals(near, medium, far)])
    assert result["ap_3d_near"] == pytest.approx(0.5)  # a false alarm before the only hit
    assert result["ap_3d_medium"] == 1.0
    assert result["ap_3d_far"] == 0.0


def test_a_hit_across_a_limit_of_depth_belongs_to_the_range_of_its_truth() -> None:
    result = measured([detected(animals((0.0, 0, 9.9)), 0.9)], [animals((0.0, 0, 10))])
    assert (result["ap_3d_near"], result["ap_3d_medium"]) == (None, 1.0)


def test_depths_are_unknown_unless_lengths_are_metres() -> None:
    target = {name: value for name, value in animals(HERE).items() if name != "scale_known"}
    assert measured([detected(target, 0.9)], [target])["ap_3d_near"] is None
    assert measured([detected(target, 0.9)], [target], metric=True)["ap_3d_near"] == 1.0
    told = {**target, "scale_known": torch.tensor([False])}
    assert measured([detected(target, 0.9)], [told], metric=True)["ap_3d_near"] is None


def test_images_of_unknown_scale_raise_no_false_alarms_by_depth() -> None:
    unknown = {**animals(HERE), "scale_known": torch.tensor([False])}
    predictions = [detected(animals(ASIDE), 0.9), detected(animals(HERE), 0.1)]
    result = measured(predictions, [unknown, animals(HERE)])
    assert result["ap_3d_near"] == 1.0
    assert measured(predictions, [animals(), animals(HERE)])["ap_3d_near"] == 0.5


def test_a_heading_off_by_40_degrees_is_a_hit_within_45_and_not_within_30() -> None:
    off = detected(animals(HERE), 0.9, rotation=turned(40)[None])
    result = measured([off], [animals(HERE)])
    assert (result["ap_3d_25"], result["ap_3d_h30"]) == (1.0, 0.0)
    # two rectangles 2 x 1, one turned by 40 degrees: IoU 0.547 (Monte Carlo, below), all hits
    assert result["ap_3d_h45"] == 1.0


def test_the_iou_of_boxes_turned_by_40_degrees_is_above_one_half() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.2, 1.2, (200_000, 2))
    cosine, sine = np.cos(np.radians(40)), np.sin(np.radians(40))
    turned_points = points @ np.array([[cosine, -sine], [sine, cosine]])
    inside = [(np.abs(p) <= (1.0, 0.5)).all(1) for p in (points, turned_points)]
    assert 0.52 < (inside[0] & inside[1]).sum() / (inside[0] | inside[1]).sum() < 0.58


def test_a_box_that_looks_the_wrong_way_does_not_take_the_animal_of_one_that_looks_right() -> None:
    wrong_first = detected(
        animals(HERE, HERE), 0.9, 0.8, rotation=torch.stack((turned(180), turned(0)))
    )
    result = measured([wrong_first], [animals(HERE)])
    assert (result["ap_3d"], result["ap_3d_h30"]) == (1.0, pytest.approx(0.5))


def test_rel_ap3d_finds_the_one_scale_of_all_images() -> None:
    targets = [animals((0.3, 0, 6)), animals((-1.0, 0.2, 9), (3.0, 0, 7))]
    half = [
        detected(t, *[0.9] * len(t["center"]), center=t["center"] / 2, size=t["size"] / 2)
        for t in targets
    ]
    result = measured(half, targets, relative=True)
    assert (result["rel_ap_3d"], result["rel_scale"], result["ap_3d"]) == (1.0, 2.0, 0.0)
    other = [half[0], detected(targets[1], 0.8, 0.7)]
    assert measured(other, targets, relative=True)["rel_ap_3d"] < 1  # one scale does not do
    assert measured(half, targets)["rel_ap_3d"] is None


@pytest.mark.parametrize("seed", range(6))
def test_ap_is_that_of_a_plain_count(seed: int) -> None:
    rng = np.random.default_rng(seed)
    targets, predictions = zip(*(random_image(rng) for _ in range(12)), strict=True)
    result = measured(list(predictions), list(targets))
    expected = [plain_ap(predictions, targets, k / 20) for k in range(1, 11)]
    assert 0.02 < np.mean(expected) < 0.98
    assert result["ap_3d"] == pytest.approx(np.mean(expected), abs=1e-12)
    assert result["ap_3d_25"] == pytest.approx(expected[4], abs=1e-12)


def random_image(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, Any]]:
    """Upright boxes of two classes, and detections about some of them; some images are empty."""
    count, false_alarms = int(rng.integers(0, 5)), int(rng.integers(0, 4))
    centers = rng.uniform((-3, -1, 6), (3, 1, 9), (count, 3))
    target = animals(*centers.tolist())
    target["labels"] = torch.from_numpy(rng.integers(0, 2, count))
    target["iscrowd"] = torch.from_numpy(rng.random(count) < 0.15)
    which = rng.integers(0, count, 2 * count) if count else np.zeros(0, int)
    center = np.concatenate(
        (
            centers[which] + rng.normal(0, 0.3, (len(which), 3)),
            rng.uniform((-3, -1, 6), (3, 1, 9), (false_alarms, 3)),
        )
    )
    total = len(center)
    found = animals(*center.tolist())
    found["size"] = torch.from_numpy(np.array([2.0, 1, 1]) * rng.uniform(0.7, 1.4, (total, 3)))
    labels = np.concatenate((target["labels"].numpy()[which], rng.integers(0, 2, false_alarms)))
    scores = rng.permutation(100)[:total] / 100
    return target, detected(found, *scores, labels=torch.from_numpy(labels))


def upright_iou(a: dict[str, Any], i: int, b: dict[str, Any], j: int) -> float:
    """The IoU of two boxes whose axes are the camera's, from their bounds."""
    low, high = [], []
    for boxes, k in ((a, i), (b, j)):
        length, width, height = boxes["size"][k].tolist()
        half = torch.tensor([length, height, width], dtype=F64) / 2  # the camera's x, y, z
        low.append(boxes["center"][k] - half)
        high.append(boxes["center"][k] + half)
    common = (torch.minimum(*high) - torch.maximum(*low)).clamp(min=0).prod()
    union = a["size"][i].prod() + b["size"][j].prod() - common
    return float(common / union)


def plain_ap(predictions: Any, targets: Any, threshold: float) -> float:
    """The mean AP of the classes, one prediction after the other, in plain Python."""
    values = []
    for label in (0, 1):
        found, total = [], 0
        for prediction, target in zip(predictions, targets, strict=True):
            truths = [j for j, c in enumerate(target["labels"].tolist()) if c == label]
            total += sum(not target["iscrowd"][j] for j in truths)
            mine = [i for i, c in enumerate(prediction["labels"].tolist()) if c == label]
            free = set(truths)
            for i in sorted(mine, key=lambda i: -float(prediction["scores"][i])):
                overlaps = {j: upright_iou(prediction, i, target, j) for j in free}
                hits = {j: iou for j, iou in overlaps.items() if iou >= threshold}
                firm = {j: iou for j, iou in hits.items() if not target["iscrowd"][j]}
                if firm:
                    free.remove(max(firm, key=lambda j: firm[j]))
                if firm or not hits:
                    found.append((-float(prediction["scores"][i]), bool(firm)))
        if total:
            values.append(area_under(sorted(found, key=lambda one: one[0]), total))
    return float(np.mean(values))


def area_under(found: list[tuple[float, bool]], total: int) -> float:
    """The mean over 101 recalls of the best precision at that recall or beyond."""
    points, hits = [], 0
    for number, (_, hit) in enumerate(found, start=1):
        hits += hit
        points.append((hits, hits / number))
    best = [
        max([p for h, p in points if h / total >= recall], default=0.0)
        for recall in np.linspace(0, 1, 101)
    ]
    return float(np.mean(best))


def test_a_box_takes_an_animal_before_a_crowd_that_it_overlaps_more() -> None:
    target = {**animals((0.3, 0, 8), HERE), "iscrowd": torch.tensor([0, 1])}
    result = measured([detected(animals(HERE), 0.9)], [target])
    assert (result["ap_3d"], result["pairs"]) == (1.0, 1)


def test_boxes_beyond_the_best_of_an_image_are_no_false_alarms() -> None:
    crowded = detected(animals(HERE, NOWHERE), 0.9, 0.8)
    images = [(crowded, animals(HERE)), (detected(animals(HERE), 0.1), animals(HERE))]
    predictions, targets = [list(side) for side in zip(*images, strict=True)]
    assert measured(predictions, targets, max_detections=1)["ap_3d"] == 1.0
    assert measured(predictions, targets)["ap_3d"] == pytest.approx((51 + 50 * 2 / 3) / 101)


def test_a_degenerate_box_does_not_hit_an_animal_about_the_camera() -> None:
    target = animals((0.0, 0, 0.1), size=(1, 1, 1))
    broken = detected(target, 0.9, size=torch.zeros(1, 3))
    assert measured([broken], [target])["ap_3d"] == 0.0

"""Errors of heading, flank, faces, corners, sizes and distance against values by hand."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from detections import F64, HEAD_FOR_TAIL, animals, detected, turned
from scenes import scene

from animal3dbox.errors import SampleError
from animal3dbox.training.metrics import BoxMetrics
from animal3dbox.training.metrics.weighted_statistics import Median

HERE, ASIDE = (0.0, 0, 8), (4.0, 0, 8)


def measured(prediction: dict[str, Any], target: dict[str, Any], **options: Any) -> dict[str, Any]:
    metrics = BoxMetrics(**{"relative": False, **options})
    metrics.update([prediction], [target])
    return metrics.compute()


PRECISIONS = ("ap_3d", "ap_3d_15", "ap_3d_25", "ap_3d_50", "ap_3d_h30", "ap_3d_h45", "ap_3d_near")
ACCURACIES = ("flank_accuracy", "face_f1", "face_auc", "rel_ap_3d")
ERRORS = (
    *("heading_error_deg", "flip_rate", "corner_error", "nhd", "face_share_error"),
    *("length_error", "width_error", "height_error", "distance_error", "distance_error_m"),
)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("derived", [False, True], ids=["fields", "from the cuboid"])
def test_truth_as_prediction_gives_exactly_1_and_0(seed: int, derived: bool) -> None:
    targets = [
        {**scene(4, seed=10 * seed + n, dtype=torch.float32), "scale_known": torch.ones(4)}
        for n in range(6)
    ]
    if derived:
        named = ("face_visible", "face_share", "flank")
        targets = [{k: v for k, v in t.items() if k not in named} for t in targets]
    metrics = BoxMetrics(relative=True)
    metrics.update([{**t, "scores": torch.rand(4)} for t in targets], targets)
    result = metrics.compute()
    for name in (*PRECISIONS, *ACCURACIES):
        assert result[name] == 1.0, name
    for name in ERRORS:
        assert result[name] == 0.0, name
    for name in (*PRECISIONS, *ACCURACIES, *ERRORS):
        assert (result[f"{name}_low"], result[f"{name}_high"]) == (result[name], result[name])


@pytest.mark.parametrize("seed", range(5))
def test_head_for_tail_keeps_ap3d_and_nhd_and_loses_all_that_knows_a_front(seed: int) -> None:
    target = scene(4, seed=seed)
    boxes = {name: target[name] for name in ("center", "size", "labels")}
    rotation = target["rotation"] * HEAD_FOR_TAIL
    result = measured({**boxes, "rotation": rotation, "scores": torch.rand(4)}, target)
    assert (result["ap_3d"], result["ap_3d_50"]) == (1.0, 1.0)
    assert result["nhd"] == pytest.approx(0, abs=1e-12)
    assert (result["ap_3d_h30"], result["ap_3d_h45"]) == (0.0, 0.0)
    assert (result["heading_error_deg"], result["flip_rate"]) == (180.0, 1.0)
    assert result["corner_error"] > 0.5
    assert result["face_share_error"] > 0
    for name in ("front", "back", "left", "right"):
        assert result[f"face_f1_{name}"] in (0.0, None)


def test_the_heading_error_is_the_angle_between_the_forward_axes() -> None:
    target = animals(HERE, ASIDE)
    prediction = detected(target, 0.9, 0.8, rotation=torch.stack((turned(20), turned(-120))))
    result = measured(prediction, target)
    assert result["heading_error_deg"] == pytest.approx((20 + 120) / 2, abs=1e-9)
    assert result["flip_rate"] == 0.5


def test_the_median_of_headings_is_that_of_every_pair_as_often_as_its_image_is_drawn() -> None:
    rng = np.random.default_rng(0)
    for pairs in (1, 2, 5, 8):
        values, image = rng.uniform(0, 180, pairs), rng.integers(0, 4, pairs)
        values[rng.random(pairs) < 0.2] = np.nan
        weights = rng.integers(0, 3, (50, 4))
        medians = Median(values, image)(weights)
        for times, median in zip(weights, medians, strict=True):
            drawn = np.repeat(values, times[image])
            known = drawn[~np.isnan(drawn)]
            if len(known):
                assert median == pytest.approx(np.median(known), abs=1e-12)
            else:
                assert np.isnan(median)


def test_one_flipped_animal_of_three_does_not_move_the_median() -> None:
    target = animals(HERE, ASIDE, HERE)
    rotation = torch.stack((turned(10), turned(20), turned(180)))
    result = measured(detected(target, 0.9, 0.8, 0.7, rotation=rotation), target)
    assert result["heading_median_deg"] == pytest.approx(20, abs=1e-9)
    assert result["heading_error_deg"] == pytest.approx(70, abs=1e-9)


def test_a_roll_about_the_own_forward_axis_is_no_heading_error() -> None:
    target = animals(HERE, size=(2, 1, 1))
    upside_down = target["rotation"] * torch.tensor([1.0, -1, -1], dtype=F64)
    result = measured(detected(target, 0.9, rotation=upside_down), target)
    assert (result["heading_error_deg"], result["ap_3d_h30"]) == (0.0, 1.0)
    assert result["corner_error"] > 0.4


def test_flanks_count_where_the_camera_stands_aside() -> None:
    # The second faces the camera but for 10 degrees, |sin azimuth| = 0.17: it is not asked
    target = animals(HERE, (0.0, 0, 12))
    target["rotation"] = torch.stack((turned(0), turned(-80)))
    prediction = detected(target, 0.9, 0.8)
    result = measured(prediction, target)
    assert (result["flank_accuracy"], result["flank_count"], result["pairs"]) == (1.0, 1, 2)
    says_left = measured({**prediction, "flank": torch.tensor([1, 2])}, target)
    assert says_left["flank_accuracy"] == 0.0  # it faces right and shows its right flank
    undecided = measured(prediction, {**target, "flank": torch.tensor([0, 0])})
    assert (undecided["flank_accuracy"], undecided["flank_count"]) == (None, 0)


@pytest.mark.parametrize(("degrees", "count"), [(-69, 1), (-70, 0), (-90, 0), (-110, 0), (-111, 1)])
def test_the_limit_of_a_flank_is_a_sine_of_the_azimuth_of_035(degrees: float, count: int) -> None:
    # turned by -90 it faces the camera: azimuth 0; arcsin 0.35 = 20.49 degrees
    target = animals(HERE, degrees=degrees)
    assert measured(detected(target, 0.9), target)["flank_count"] == count


def test_corner_error_and_nhd_of_a_shift_are_its_part_of_the_oriented_diagonal() -> None:
    target = animals(HERE, size=(2, 1, 2), degrees=33)  # diagonal 3
    ahead = target["center"] + 0.3 * target["rotation"][:, :, 0]
    result = measured(detected(target, 0.9, center=ahead), target)
    assert result["corner_error"] == pytest.approx(0.1, abs=1e-12)
    assert result["nhd"] == pytest.approx(0.1, abs=1e-12)


def test_a_quarter_turn_of_a_square_box_has_corner_errors_and_no_nhd() -> None:
    target = animals(HERE, size=(2, 2, 1))  # diagonal 3
    result = measured(detected(target, 0.9, rotation=turned(90)[None]), target)
    assert result["nhd"] == pytest.approx(0, abs=1e-12)
    assert result["corner_error"] == pytest.approx(2 / 3, abs=1e-12)  # each corner to its neighbour


def test_sizes_and_distances_are_told_as_parts_of_the_truth_and_in_metres_where_known() -> None:
    target = animals((0.0, 3, 4))  # 5 m away
    prediction = detected(target, 0.9, center=target["center"] * 1.02)
    prediction["size"] = target["size"] * torch.tensor([1.1, 0.9, 1.0], dtype=F64)
    result = measured(prediction, target)
    assert result["length_error"] == pytest.approx(0.1)
    assert result["width_error"] == pytest.approx(0.1)
    assert result["height_error"] == 0.0
    assert result["distance_error"] == pytest.approx(0.02)
    assert result["distance_error_m"] == pytest.approx(0.1)
    no_metres = {**target, "scale_known": torch.tensor([False])}
    assert measured(prediction, no_metres)["distance_error_m"] is None


def faces(*names: str) -> torch.Tensor:
    order = ("front", "back", "left", "right", "top", "bottom")
    return torch.tensor([[name in names for name in order]])


def test_f1_of_a_face_counts_hits_twice_over_all_that_was_said_and_seen() -> None:
    target = animals(HERE, ASIDE, (8.0, 0, 8))
    target["face_visible"] = torch.cat((faces("right", "top"), faces("right"), faces("front")))
    prediction = detected(target, 0.9, 0.8, 0.7)
    prediction["face_visible"] = torch.cat((faces("right"), faces("front"), faces("front", "top")))
    result = measured(prediction, target)
    assert result["face_f1_right"] == pytest.approx(2 / 3)  # 1 hit, 1 missed
    assert result["face_f1_front"] == pytest.approx(2 / 3)  # 1 hit, 1 false alarm
    assert result["face_f1_top"] == 0.0
    assert result["face_f1_bottom"] is None  # neither seen nor said to be
    assert result["face_f1"] == pytest.approx((2 / 3 + 2 / 3 + 0) / 3)


def test_auc_of_a_face_is_how_often_one_seen_scores_above_one_hidden() -> None:
    target = animals(HERE, ASIDE, (8.0, 0, 8), (12.0, 0, 8))
    seen = torch.zeros(4, 6, dtype=torch.bool)
    seen[:2, 2] = True
    scores = torch.zeros(4, 6, dtype=F64)
    scores[:, 2] = torch.tensor([0.9, 0.4, 0.4, 0.1])  # 3 of 4 right, 1 tie
    result = measured(
        detected(target, 0.9, 0.8, 0.7, 0.6, face_visible=scores), {**target, "face_visible": seen}
    )
    assert result["face_auc_left"] == pytest.approx(3.5 / 4)
    assert result["face_auc_right"] is None  # hidden on all: there is nothing to tell apart
    assert result["face_f1_left"] == pytest.approx(2 / 3)  # 0.4 says hidden


def test_faces_and_shares_that_a_detector_does_not_name_are_those_of_its_cuboid() -> None:
    # Straight ahead the camera sees only the right side of an animal that faces right
    target = animals(HERE)
    result = measured(detected(target, 0.9), target)
    assert (result["face_f1_right"], result["face_f1_left"]) == (1.0, None)
    assert result["face_share_error"] == 0.0
    wrong = detected(target, 0.9, rotation=turned(180)[None])
    assert measured(wrong, target)["face_share_error"] == pytest.approx(1.0)
    without_camera = {name: value for name, value in target.items() if name != "K"}
    assert measured(detected(target, 0.9), without_camera)["face_share_error"] is None


def test_the_share_error_is_the_part_of_the_area_on_wrong_faces() -> None:
    target = {**animals(HERE), "face_share": torch.tensor([[0.2, 0, 0, 0.5, 0.3, 0]])}
    share = torch.tensor([[0.1, 0, 0, 0.7, 0.2, 0]])
    result = measured(detected(target, 0.9, face_share=share), target)
    assert result["face_share_error"] == pytest.approx(0.2, abs=1e-7)


def test_a_front_that_is_not_known_has_no_heading_faces_or_flank_and_its_box_still_hits() -> None:
    target = animals(HERE)
    folded = detected(target, 0.9, heading_known=torch.tensor([False]))
    for prediction, truth, options in (
        (folded, target, {}),
        (detected(target, 0.9), {**target, "heading_known": torch.tensor([False])}, {}),
        (detected(target, 0.9), target, {"heading_known": False}),
    ):
        result = measured(prediction, truth, **options)
        assert (result["ap_3d"], result["nhd"]) == (1.0, 0.0)
        for name in (
            *("ap_3d_h30", "heading_error_deg", "flip_rate", "flank_accuracy"),
            *("corner_error", "face_f1", "face_auc", "face_share_error"),
        ):
            assert result[name] is None, name
        assert result["heading_count"] == 0


def test_ap3d_h_leaves_out_truths_without_a_front_and_what_hits_them() -> None:
    target = {**animals(HERE, ASIDE), "heading_known": torch.tensor([True, False])}
    prediction = detected(target, 0.5, 0.9, rotation=torch.stack((turned(0), turned(180))))
    assert measured(prediction, target)["ap_3d_h30"] == 1.0
    missed = detected(animals(HERE), 0.9)
    assert measured(missed, target)["ap_3d_h30"] == 1.0
    assert measured(missed, target)["ap_3d"] < 1.0


def test_pairs_by_boxes_measure_headings_where_no_cuboid_overlaps() -> None:
    target = {**animals(HERE), "boxes": torch.tensor([[10.0, 10, 30, 30]])}
    far = detected(target, 0.9, center=target["center"] * 3, rotation=turned(30)[None])
    far["boxes"] = torch.tensor([[10.0, 10, 30, 25]])  # IoU 0.75
    assert measured(far, target)["heading_error_deg"] is None
    result = measured(far, target, pair_by="boxes")
    assert result["heading_error_deg"] == pytest.approx(30)
    assert (result["ap_3d"], result["pairs"]) == (0.0, 1)
    assert measured(far, target, pair_by="boxes", pair_iou=0.8)["pairs"] == 0
    no_boxes = {name: value for name, value in far.items() if name != "boxes"}
    with pytest.raises(SampleError, match="prediction boxes: is missing, and pair_by='boxes'"):
        measured(no_boxes, target, pair_by="boxes")


@pytest.mark.parametrize(
    "wrong",
    [
        {"size": [2.0, 0.0, 1.0]},
        {"size": [2.0, -1.0, 1.0]},
        {"size": [math.nan, 1.0, 1.0]},
        {"size": [math.inf, 1.0, 1.0]},
        {"center": [0.0, math.nan, 8.0]},
        {"rotation": [[0.0, 0, 0], [0, 0, 0], [0, 0, 0]]},
        {"rotation": [[1.0, 0, 0], [0, 1, 0], [0, 0, -1]]},
        {"rotation": [[2.0, 0, 0], [0, 2, 0], [0, 0, 2]]},
    ],
    ids=str,
)
def test_a_degenerate_prediction_hits_nothing_and_spoils_no_other(wrong: dict[str, Any]) -> None:
    target = animals(HERE, ASIDE)
    prediction = detected(target, 0.9, 0.8)
    for name, value in wrong.items():
        prediction[name] = prediction[name].clone()
        prediction[name][0] = torch.tensor(value, dtype=F64)
    result = measured(prediction, target, relative=True)
    assert (result["degenerate_predictions"], result["pairs"]) == (1, 1)
    # a false alarm, then a hit: 51 recalls with precision 1 / 2
    assert result["ap_3d"] == pytest.approx(51 / 101 / 2)


def test_an_animal_about_the_camera_has_no_relative_distance_error() -> None:
    target = animals((0.0, 0, 0), size=(1, 1, 1))
    off = detected(target, 0.9, center=torch.tensor([[0.1, 0, 0]], dtype=F64))
    result = measured(off, target)
    assert result["distance_error"] is None
    assert result["distance_error_m"] == pytest.approx(0.1)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_rotations_of_half_precision_are_boxes(dtype: torch.dtype) -> None:
    target = scene(3)
    prediction = {
        **{name: target[name] for name in ("center", "size", "labels")},
        "rotation": target["rotation"].to(dtype),
        "scores": torch.rand(3, dtype=dtype, requires_grad=True),
    }
    result = measured(prediction, target)
    assert (result["degenerate_predictions"], result["ap_3d"]) == (0, 1.0)
    assert 0 < result["heading_error_deg"] < 1


@pytest.mark.parametrize("scale", [1e-200, 1e-9, 1e9, 1e150])
def test_sizes_beyond_all_bounds_are_no_exception(scale: float) -> None:
    target = animals(HERE)
    result = measured(detected(target, 0.9, size=target["size"] * scale), target)
    assert result["ap_3d"] == 0.0

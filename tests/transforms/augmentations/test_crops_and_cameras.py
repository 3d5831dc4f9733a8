"""Crops and virtual cameras: where they look, and which animals they keep."""

import pytest
import torch
from mapped_targets import final_hw, mapped
from scenes import scene
from torch.testing import assert_close

from animal3dbox.geometry.homography import apply_homography
from animal3dbox.transforms import (
    Compose,
    PerspectiveCrop,
    RandomResizedCrop,
    RandomRotation,
    RandomVirtualCamera,
)

F64 = torch.float64


def test_a_camera_that_turns_right_moves_the_picture_left_and_up_moves_it_down() -> None:
    target = scene(1)
    middle = target["corners_2d"].mean((0, 1))
    for options, axis, sign in (
        ({"yaw": (3, 3), "pitch": 0.0}, 0, -1),
        ({"yaw": 0.0, "pitch": (3, 3)}, 1, 1),
    ):
        after, _ = mapped(Compose([RandomVirtualCamera(roll=0.0, **options)]), target, (120, 160))  # type: ignore[arg-type]
        assert sign * float(after["corners_2d"].mean((0, 1))[axis] - middle[axis]) > 5


def test_a_turned_picture_turns_clockwise_and_stays_free_of_skew_for_unequal_focal_lengths() -> (
    None
):
    target = scene(1)
    after, plan = mapped(Compose([RandomRotation((90, 90))]), target, (120, 160))
    right_of_the_middle = apply_homography(
        torch.from_numpy(plan.H_out_in), torch.tensor([[100.0, 59.5]], dtype=F64)
    )[0]
    assert abs(float(right_of_the_middle[0]) - 79.5) < 1e-9
    assert float(right_of_the_middle[1]) > 59.5  # v points down
    assert float(after["K"][0, 1]) == pytest.approx(0, abs=1e-9)
    assert_close(after["K"].diagonal(), target["K"].diagonal(), atol=1e-9, rtol=0)


def test_a_perspective_crop_looks_at_the_box_and_fills_the_picture() -> None:
    target = scene(1, seed=3)
    after, _ = mapped(Compose([PerspectiveCrop((100, 200), margin=(0.1, 0.1))]), target, (120, 160))
    assert_close(after["center"][0, :2], torch.zeros(2, dtype=F64), atol=1e-9, rtol=0)
    px = after["corners_2d"][0] - torch.tensor([99.5, 49.5], dtype=F64)
    assert float((px.abs() / torch.tensor([100.0, 50.0], dtype=F64)).amax()) == pytest.approx(0.9)
    assert float(after["truncation"]) == pytest.approx(0, abs=1e-12)
    assert_close(after["K"][:2, 2], torch.tensor([99.5, 49.5], dtype=F64))


def test_a_perspective_crop_of_several_keeps_the_one_it_looks_at_and_those_that_are_seen() -> None:
    target = scene(8, seed=5)
    crop = PerspectiveCrop(64, min_visible=0.9)
    for index in range(20):
        after, plan = mapped(Compose([crop]), target, (120, 160), (0, index))
        assert plan.keep is not None
        assert 1 <= len(plan.keep) < 8
        assert after["labels"].tolist() == list(plan.keep)
        assert [record["number"] for record in after["meta"]["quality"]] == list(plan.keep)
        looked_at = int(after["center"][:, :2].norm(dim=-1).argmin())
        assert float(after["truncation"][looked_at]) == pytest.approx(0, abs=1e-12)
        assert (
            float(
                torch.cat(
                    (
                        after["truncation"][:looked_at],
                        after["truncation"][looked_at + 1 :],
                        torch.zeros(1, dtype=F64),
                    )
                ).amax()
            )
            <= 0.1 + 1e-9
        )


def test_a_perspective_crop_without_animals_fits_the_picture() -> None:
    after, plan = mapped(Compose([PerspectiveCrop(60)]), scene(0), (120, 160))
    assert final_hw(plan) == (60, 60)
    assert float(after["K"][0, 0]) == pytest.approx(1.3 * 160 * 60 / 160)


def test_random_crops_keep_the_asked_part_of_an_animal_and_drop_the_rest() -> None:
    target = scene(6, seed=1)
    dropped = 0
    for index in range(100):
        after, plan = mapped(
            Compose([RandomResizedCrop(64, (0.05, 0.3), keep_part=0.8, min_visible=0.5)]),
            target,
            (120, 160),
            (0, index),
        )
        keep = tuple(range(6)) if plan.keep is None else plan.keep
        before = target["truncation"][list(keep)]
        part = (1 - after["truncation"]) / (1 - before)
        assert float(part.amax()) >= 0.8 - 1e-9
        assert float(part.amin()) >= 0.5 - 1e-9
        dropped += 6 - len(keep)
    assert dropped > 50


def test_a_crop_keeps_the_aspect_unless_asked_otherwise() -> None:
    target = scene(1)
    square = target["K"][0, 0] / target["K"][1, 1]
    for index in range(20):
        after, _ = mapped(Compose([RandomResizedCrop((50, 90))]), target, (120, 160), (0, index))
        assert float(after["K"][0, 0] / after["K"][1, 1]) == pytest.approx(float(square))
    ratios = []
    for index in range(20):
        after, _ = mapped(
            Compose([RandomResizedCrop((50, 90), ratio=(0.5, 2))]), target, (120, 160), (0, index)
        )
        ratios.append(float(after["K"][0, 0] / after["K"][1, 1] / square))
    assert max(ratios) > 1.2
    assert min(ratios) < 0.8

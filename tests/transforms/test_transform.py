"""Transforms on their own, transforms of one's own, and the picture that they draw from."""

from typing import Any

import numpy as np
import pytest
import torch
from pictures import HW, picture, same
from scenes import scene
from torch.testing import assert_close

from animal3dbox.target_schema import FIELDS
from animal3dbox.transforms import (
    CenterCrop,
    ColorJitter,
    Compose,
    LetterBox,
    PerspectiveCrop,
    RandomErasing,
    RandomHorizontalFlip,
    RandomPerspective,
    RandomRotation,
    RandomVerticalFlip,
    Resize,
    Transform,
)
from animal3dbox.transforms.camera_law.maps import shifting
from animal3dbox.transforms.camera_law.target_dict import read_target
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.steps import Step, Warp


class RandomShift(Transform):
    """A transform of the user's own."""

    geometric = True

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        return (Warp(shifting(int(rng.integers(1, 9)), 0), context.image_hw),)


@pytest.mark.parametrize(
    "transform",
    [
        RandomHorizontalFlip(0.5),
        RandomRotation(20),
        RandomPerspective(0.3, allow_skew=True),
        PerspectiveCrop(64, min_visible=0.9),
        RandomErasing(1),
        ColorJitter(0.3),
        RandomShift(p=0.5),
    ],
)
def test_a_transform_on_its_own_is_a_pipeline_of_one(transform: Transform) -> None:
    for index in range(4):
        image, target = transform(picture(), scene(3), key=(0, index))
        expected, after = Compose([transform])(picture(), scene(3), key=(0, index))
        assert torch.equal(image, expected)
        assert same(target, after)


def test_a_transform_of_one_s_own_moves_camera_and_boxes_with_the_pixels() -> None:
    image, target = RandomShift()(picture(), scene(), key=(0, 0))
    shift = int(target["H_out_in"][0, 2])
    assert 1 <= shift <= 8
    assert torch.equal(image[:, :, shift:], picture()[:, :, :-shift])
    assert_close(target["K"][0, 2], scene()["K"][0, 2] + shift)
    assert_close(target["corners_2d"][..., 0], scene()["corners_2d"][..., 0] + shift)


@pytest.mark.parametrize(
    "transform",
    [
        RandomHorizontalFlip(1),
        RandomVerticalFlip(1),
        Resize((50, 90)),
        CenterCrop(40),
        LetterBox(99),
    ],
)
def test_the_fast_intrinsics_of_axis_keeping_maps_are_those_of_the_camera_law(
    transform: Transform,
) -> None:
    context = DrawContext.of(HW, read_target(scene(), HW))
    for step in (*transform.steps(np.random.default_rng(0), context),):
        context = context.after(step)
    assert context.camera is not None
    assert context.K is not None
    assert np.allclose(context.K, context.camera.K, rtol=1e-12, atol=1e-9)


def test_vertices_follow_a_mirror_without_a_camera() -> None:
    vertices = scene()["vertices"]
    _, after = RandomHorizontalFlip(1)(picture(), {"vertices": vertices})
    assert_close(after["vertices"], vertices * torch.tensor([1.0, -1, 1], dtype=torch.float64))


def test_a_map_of_pixels_loses_no_field_of_the_schema() -> None:
    count = 2
    values: dict[str, Any] = scene(count)
    values |= {
        "masks": torch.ones(count, *HW, dtype=torch.uint8),
        "scale_known": torch.tensor([True, False]),
        "scale_m_per_unit": torch.tensor([0.5, 1.0]),
        "distortion": torch.zeros(4, dtype=torch.float64),
        "H_out_in": torch.eye(3, dtype=torch.float64),
        "depth": torch.ones(HW),
        "occlusion": torch.zeros(count),
        "scores": torch.ones(count),
        "heading_known": torch.ones(count, dtype=torch.bool),
        "iscrowd": torch.zeros(count, dtype=torch.int64),
        "track_ids": torch.arange(count),
    }
    assert {field.name for field in FIELDS} <= set(values)
    _, after = Compose([RandomHorizontalFlip(1), Resize((60, 80))])(picture(), values)
    assert set(values) <= set(after)
    for field in FIELDS:
        if field.under_map == "unmoved":
            assert torch.equal(after[field.name], values[field.name]), field.name


def test_a_mirror_exchanges_the_flanks_and_nothing_else_does() -> None:
    target = {"flank": torch.tensor([0, 1, 2]), "flank_confidence": torch.tensor([0.6, 0.99, 0.98])}
    _, mirrored = RandomHorizontalFlip(1)(picture(), target)
    assert mirrored["flank"].tolist() == [0, 2, 1]
    assert mirrored["flank"].dtype == torch.int64
    assert torch.equal(mirrored["flank_confidence"], target["flank_confidence"])
    _, twice = RandomHorizontalFlip(1)(picture(), mirrored)
    assert twice["flank"].tolist() == [0, 1, 2]
    _, resized = Resize((60, 80))(picture(), target)
    assert resized["flank"].tolist() == [0, 1, 2]

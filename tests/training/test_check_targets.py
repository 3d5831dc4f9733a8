"""Sanity checks of targets: what is right raises nothing, and errors name what is wrong."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from scenes import scenes
from thorough import thorough
from torch import Tensor
from training_batches import HW, good_batch, images_of

from animal3dbox.datasets import SyntheticDataset, SyntheticSet, collate
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.geometry.cuboid import MIRRORED_CORNERS, MIRRORED_FACES
from animal3dbox.geometry.frame import in_frame
from animal3dbox.training.checks import check_targets
from animal3dbox.training.findings import EXAMPLES
from animal3dbox.training.frames import outside_frame
from animal3dbox.transforms import (
    Compose,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomVirtualCamera,
)


@pytest.mark.parametrize("animals", [0, 1, 3])
@pytest.mark.parametrize("masks", [False, True])
def test_good_targets_raise_nothing(animals: int, masks: bool) -> None:
    batch = good_batch(animals, 5, masks)
    for step in range(6):
        report = check_targets((images_of(batch), batch), step=step)
        assert (report.faults, report.targets, report.animals) == (0, 5, 5 * animals)
    assert check_targets([]).targets == 0


@thorough(150)
@given(scenes())
def test_random_scenes_in_float32_raise_nothing(
    made: tuple[dict[str, Any], tuple[int, int]],
) -> None:
    target, image_hw = made
    target = {
        k: v.float() if isinstance(v, Tensor) and v.is_floating_point() else v
        for k, v in target.items()
        if k not in ("boxes", "keypoints")
    }
    check_targets([target], [torch.zeros(3, *image_hw)])


@thorough(150)
@given(scenes(anywhere=True))
def test_random_scenes_round_the_camera_raise_nothing(
    made: tuple[dict[str, Any], tuple[int, int]],
) -> None:
    target, image_hw = made
    target = {
        k: v.float() if isinstance(v, Tensor) and v.is_floating_point() else v
        for k, v in target.items()
        if k not in ("boxes", "keypoints")
    }
    check_targets([target], [torch.zeros(3, *image_hw)])


def test_what_a_dataset_gives_raises_nothing_nor_when_augmented() -> None:
    augment = Compose(
        [RandomHorizontalFlip(), RandomVirtualCamera(5, 5, 10), RandomResizedCrop(128)], seed=4
    )
    world = SyntheticSet(4, 6, replace(WorldConfig(), image_hw=HW))
    for transform in (None, augment):
        dataset = SyntheticDataset(world, transform=transform)
        batch = collate([dataset[index] for index in range(6)])
        for step in range(4):
            assert check_targets(batch, step=step).animals >= 6


@pytest.mark.parametrize("seed", range(8))
def test_transformed_targets_raise_nothing(seed: int) -> None:
    augment = Compose(
        [
            RandomHorizontalFlip(),
            RandomVirtualCamera(3, 3, 8),
            RandomResizedCrop((200, 260), scale=(0.6, 1.0)),
        ],
        seed=seed,
    )
    pairs = [
        augment(torch.zeros(3, *HW, dtype=torch.uint8), target, key=(0, n))
        for n, target in enumerate(good_batch(size=6, seed=10 * seed))
    ]
    report = check_targets(([image for image, _ in pairs], [target for _, target in pairs]))
    assert report.faults == 0
    assert any(target["mirrored"] for _, target in pairs)


def test_a_stale_crop_is_caught_by_what_the_frame_cuts() -> None:
    batch = good_batch(masks=False)
    report = check_targets(batch, [torch.zeros(3, 120, 160) for _ in batch], on_fault="count")
    assert {"truncation", "share_in_image", "boxes_in_frame", "keypoints"} <= set(report.counts)
    padded = torch.zeros(4, 3, 400, 400)
    assert check_targets((padded, batch), [HW] * 4).faults == 0


def test_an_error_names_image_animal_field_and_remedy() -> None:
    batch = good_batch()
    batch[1]["face_visible"] = batch[1]["face_visible"][:, list(MIRRORED_FACES)]
    with pytest.raises(
        SampleError,
        match=r"^scene1\.jpg#\d: face_visible: is wrong for left, right.*exchange left and right",
    ):
        check_targets(batch)


def test_an_error_names_its_animal_as_the_book_keeping_does() -> None:
    batch = good_batch()
    batch[1]["labels"] = torch.tensor([0, -1])
    batch[1]["meta"] = {"sample_ids": ["herd/7", "herd/8"]}
    with pytest.raises(SampleError, match=r"^herd/8: labels: must count from 0"):
        check_targets(batch)


def test_a_distance_is_compared_with_the_center_alone() -> None:
    lone = [{"center": torch.tensor([[3.0, 0, 4]]), "distance": torch.tensor([5.0])}]
    assert check_targets(lone).faults == 0
    lone[0]["distance"] = torch.tensor([5.001])
    assert check_targets(lone, on_fault="count").counts == {"distance": 1}


def test_points_outside_frames_of_many_sizes_are_those_that_are_not_in_frame() -> None:
    rng = np.random.default_rng(0)
    px = rng.integers(-3, 12, (200, 2)).astype(np.float64) / 2
    sizes = rng.integers(1, 6, (200, 2))
    outside = outside_frame(px, sizes[:, ::-1].astype(np.float64) - 0.5)
    expected = [
        not in_frame(point, (int(height), int(width)))
        for point, (height, width) in zip(px, sizes, strict=True)
    ]
    assert outside.tolist() == expected
    assert 0 < outside.sum() < 200


def test_a_mirror_flag_that_contradicts_the_map_is_caught() -> None:
    batch = good_batch()
    for target in batch:
        target |= {"H_out_in": torch.eye(3), "mirrored": False}
    assert check_targets(batch).faults == 0
    batch[1]["mirrored"] = True
    assert check_targets(batch, on_fault="count").counts["mirrored"] == 1
    batch[1]["H_out_in"] = torch.zeros(3, 3)
    assert check_targets(batch, on_fault="count").counts["H_out_in"] == 1


def test_a_principal_point_outside_the_image_is_a_warning_only() -> None:
    batch = [{"K": torch.tensor([[300.0, 0, 500], [0, 300, 100], [0, 0, 1]]), "image_id": "a"}]
    report = check_targets(batch, images_of(batch))
    assert (report.faults, report.warnings["principal_point"]) == (0, 1)
    assert "warning: 1 x principal_point" in str(report)


def test_an_animal_whose_cuboid_left_the_picture_with_it_is_counted_and_no_warning() -> None:
    target = {"rotation": torch.eye(3).repeat(2, 1, 1), "size": torch.full((2, 3), 4.0)}
    batch = [target]
    target["K"] = torch.tensor([[100.0, 0, 160], [0, 100, 120], [0, 0, 1]])
    target["center"] = torch.tensor([[30.0, 0, 10], [0, 0, 10]])  # at x = 460 px, and in view
    target["boxes"] = torch.tensor([[319.5, 100, 319.5, 140], [140, 100, 180, 140]])
    report = check_targets(batch, images_of(batch))
    assert (report.faults, report.warnings, report.left_picture) == (0, {}, 1)
    assert "1 animals left the picture" in str(report)
    target["boxes"][1] = torch.tensor([319.5, 100, 319.5, 140])  # while its cuboid is in view
    report = check_targets(batch, images_of(batch), on_fault="count")
    assert report.warnings == {"empty_box": 1}


def test_an_empty_box_without_a_cuboid_is_a_warning_only() -> None:
    batch = [
        {
            "boxes": torch.tensor([[-0.5, 10, -0.5, 20], [30, 239.5, 60, 239.5], [5, 5, 9, 9]]),
            "image_id": "a",
        }
    ]
    report = check_targets(batch, images_of(batch))
    assert (report.faults, report.warnings) == (0, {"empty_box": 2})
    batch[0]["boxes"][0] += 5  # type: ignore[index]
    assert check_targets(batch, images_of(batch), on_fault="count").counts == {"boxes": 1}


def test_any_subset_of_the_fields_is_checked() -> None:
    batch = good_batch()
    for name in batch[0]:
        assert (
            check_targets([{name: target[name]} for target in batch], images_of(batch)).faults == 0
        )
    mixed = [
        {name: value for name, value in target.items() if number % 2 or name != "rotation"}
        for number, target in enumerate(batch)
    ]
    assert check_targets(mixed, images_of(batch)).faults == 0
    mixed[2]["corners_3d"] = mixed[2]["corners_3d"][
        :, list(MIRRORED_CORNERS)
    ]  # without a rotation: by the corners alone
    assert check_targets(mixed, images_of(batch), on_fault="count").counts["corner_order"] == 2


def test_lenses_are_taken_into_account() -> None:
    from scenes import target_of

    from animal3dbox.geometry.camera import intrinsics
    from animal3dbox.geometry.cuboid import Cuboid

    box = Cuboid(
        torch.tensor([[0.3, 0.2, 6.0]], dtype=torch.float64),
        torch.eye(3, dtype=torch.float64)[None],
        torch.ones(1, 3, dtype=torch.float64),
    )
    K = intrinsics(300.0, HW)
    bent = target_of(
        box, K, HW, torch.float32, torch.tensor([-0.2, 0.05, 0.001, -0.002], dtype=torch.float64)
    )
    keys = ("corners_3d", "corners_2d", "K", "distortion")
    assert check_targets([{name: bent[name] for name in keys}]).faults == 0
    assert (
        check_targets([{name: bent[name] for name in keys[:3]}], on_fault="count").counts[
            "projection"
        ]
        == 1
    )


@pytest.mark.parametrize("lens_first", [False, True])
def test_pictures_with_and_without_a_lens_can_be_one_batch(lens_first: bool) -> None:
    from scenes import target_of

    from animal3dbox.geometry.camera import intrinsics
    from animal3dbox.geometry.cuboid import Cuboid

    box = Cuboid(
        torch.tensor([[0.3, 0.2, 6.0]], dtype=torch.float64),
        torch.eye(3, dtype=torch.float64)[None],
        torch.ones(1, 3, dtype=torch.float64),
    )
    keys, lens = (
        ("corners_3d", "corners_2d", "K", "distortion"),
        torch.tensor([-0.2, 0.05, 0.001, -0.002], dtype=torch.float64),
    )
    both = [
        target_of(box, intrinsics(300.0, HW), HW, torch.float32, bend)
        for bend in ((lens, None) if lens_first else (None, lens))
    ]
    assert (
        check_targets(
            [{name: target[name] for name in keys if name in target} for target in both],
            on_fault="count",
        ).faults
        == 0
    )


def test_a_mirror_is_looked_for_in_every_target_that_names_one() -> None:
    batch = good_batch()
    batch = [{**target, "H_out_in": torch.diag(torch.tensor([-1.0, 1.0, 1.0]))} for target in batch]
    batch[1]["mirrored"] = False
    assert check_targets(batch, on_fault="count").counts["mirrored"] == 1


def test_a_batch_of_which_everything_was_left_out_is_no_fault() -> None:
    assert check_targets((torch.zeros(0), [])).faults == check_targets(([], [])).faults == 0


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("keypoints", torch.zeros(2, 5, 2), "keypoints: must have"),
        ("meta", {"quality": None}, "meta: quality: must be a list"),
        ("meta", {"sample_ids": ["a"]}, "meta: sample_ids: has 1 entries, but other fields are"),
        ("meta", None, "meta: must be a dict"),
        ("distance", torch.zeros(2, 1), "distance: must have shape"),
    ],
)
def test_fields_of_another_form_are_named(field: str, value: Any, says: str) -> None:
    with pytest.raises(SampleError, match=says):
        check_targets([{**good_batch(masks=False)[0], field: value}])


def test_arrays_shared_rotations_and_gradients_are_taken() -> None:
    batch = [
        {
            name: value.numpy() if isinstance(value, Tensor) else value
            for name, value in target.items()
        }
        for target in good_batch()
    ]
    assert check_targets(batch, np.zeros((4, 3, *HW))).faults == 0
    shared = [{**target, "R": target["R"][0], "t": target["t"][0]} for target in good_batch()]
    assert check_targets(shared).faults == 0
    shared[3]["R"] = shared[3]["R"] * -1
    assert check_targets(shared, on_fault="count").counts["handedness"] == 1
    learned = good_batch()
    learned[0]["center"].requires_grad_()
    assert check_targets(learned).faults == 0


def test_counting_keeps_first_examples_adds_up_and_travels_between_processes() -> None:
    batch = good_batch(size=6)
    for target in batch:
        target["labels"] = target["labels"] - 5
    report = check_targets(batch, on_fault="count")
    assert report.counts["labels"] == 12
    assert len(report.examples) == EXAMPLES
    both = pickle.loads(pickle.dumps(report)) + report
    assert (both.targets, both.counts["labels"], len(both.examples)) == (12, 24, EXAMPLES)
    assert str(both).startswith("12 targets, 24 animals: 24 faults\n  24 x labels\n")


@pytest.mark.parametrize("arrays", [False, True])
@pytest.mark.parametrize("fewer", [0, 2])
def test_targets_of_one_batch_may_differ_in_their_number_of_keypoints(
    fewer: int, arrays: bool
) -> None:
    batch = good_batch()
    batch[fewer]["keypoints"] = batch[fewer]["keypoints"][:, :3]
    if arrays:
        batch = [{**target, "keypoints": target["keypoints"].numpy()} for target in batch]
    assert check_targets((images_of(batch), batch), on_fault="count").counts == {}
    batch[1]["keypoints"][0, 4, 2] = -1.0
    batch[fewer]["keypoints"][1, 2, 0] = 900.0
    report = check_targets((images_of(batch), batch), on_fault="count")
    assert report.counts == {"keypoints": 2}
    assert {error.sample_id for _, error in report.examples} == {
        "scene1.jpg#0",
        f"scene{fewer}.jpg#1",
    }


def test_targets_that_cannot_be_one_batch_say_why() -> None:
    batch = good_batch()
    batch[2]["keypoints"] = batch[2]["keypoints"][:, :3].numpy()
    report = check_targets(batch, on_fault="count")
    assert report.counts == {"batch": 1}
    assert "is an array of 3 dimensions, but a tensor on cpu of 3 dimensions in the first" in str(
        report.examples[0][1]
    )


def test_steps_can_be_skipped_and_wrong_options_are_refused() -> None:
    batch = good_batch()
    batch[0]["labels"] = batch[0]["labels"] - 9
    assert check_targets(batch, every=4, step=3).targets == 0
    with pytest.raises(SampleError):
        check_targets(batch, every=4, step=4)
    for wrong in (
        {"on_fault": "ignore"},
        {"every": 0},
        {"every": 2},
        {"images": torch.zeros(2, 3, 8, 8)},
    ):
        with pytest.raises(ConfigError):
            check_targets(batch, **wrong)
    for nothing in (None, {"labels": torch.zeros(1)}, [1, 2, 3]):
        with pytest.raises(ConfigError, match="a batch is"):
            check_targets(nothing)

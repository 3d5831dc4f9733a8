"""Pipelines: randomness, replay, inverse, batches, fusing."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import kornia.augmentation as kornia
import numpy as np
import pytest
import torch
from pictures import HW, picture, same
from scenes import F64, KEYPOINT_MIRROR, scene
from torch import Tensor
from torch.testing import assert_close

from animal3dbox import transforms
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.transforms import (
    CenterCrop,
    ColorJitter,
    Compose,
    LetterBox,
    Normalize,
    PadTo,
    RandomAffine,
    RandomErasing,
    RandomGaussianBlur,
    RandomGaussianNoise,
    RandomGrayscale,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomRotation,
    RandomVirtualCamera,
    Resize,
    inverse,
    transform_target,
)
from animal3dbox.transforms.steps import Keep, Pass, Plan

MANY = [
    RandomHorizontalFlip(),
    RandomAffine(10, (0.05, 0.05), (0.9, 1.1)),
    RandomVirtualCamera(3, 3, 3, p=0.5),
    RandomResizedCrop(96, min_visible=None),
    ColorJitter(0.2, 0.2, 0.2, 0.1, p=0.7),
    RandomGaussianBlur((0.5, 1.5), p=0.5),
    RandomGaussianNoise((0.01, 0.03), p=0.5),
    RandomErasing(0.5, value="random"),
]


def test_a_sample_depends_on_its_key_and_seed_alone() -> None:
    compose = Compose(MANY, seed=3)
    image, target = picture(), scene()
    first, one = compose(image, target, key=(1, 7))
    torch.manual_seed(0)
    compose(image, target, key=(1, 8))
    keyed_target = {**target, "meta": {**target["meta"], "sample_key": (1, 7)}}
    again, other = pickle.loads(pickle.dumps(compose))(image, keyed_target)
    assert torch.equal(first, again)
    assert other.pop("meta") == {**one.pop("meta"), "sample_key": (1, 7)}
    assert same(one, other)
    for seed, key in ((4, (1, 7)), (3, (2, 7)), (3, (1, 8)), (3, (7, 1))):
        changed, _ = Compose(MANY, seed=seed)(image, target, key=key)
        assert changed.shape != first.shape or not torch.equal(changed, first)


def test_without_a_key_torch_s_generator_decides_and_workers_differ() -> None:
    compose = Compose([RandomRotation((-180, 180))])
    torch.manual_seed(5)
    _, one = compose(picture(), scene())
    _, two = compose(picture(), scene())
    torch.manual_seed(5)
    _, again = compose(picture(), scene())
    assert torch.equal(one["H_out_in"], again["H_out_in"])
    assert not torch.equal(one["H_out_in"], two["H_out_in"])


@pytest.mark.parametrize("size", [1, 3, 8])
def test_a_batch_gives_what_its_samples_give_whatever_its_size(size: int) -> None:
    compose = Compose(MANY)
    images, targets = (
        torch.stack([picture(n) for n in range(8)]),
        [scene(n % 3, seed=n) for n in range(8)],
    )
    keys = [(0, n) for n in range(8)]
    for start in range(0, 8, size):
        some = slice(start, start + size)
        out, after = compose.batch((images[some], targets[some]), keys=keys[some])
        for row, index in enumerate(range(start, min(start + size, 8))):
            image, target = compose(images[index], targets[index], key=keys[index])
            assert same(after[row], target)
            difference = (out[row].int() - image.int()).abs()
            assert (
                float((difference > 1).double().mean()) < 0.01
            )  # where borders and clipping meet blur and gain
            assert int(difference.max()) <= 3


def test_a_batch_of_images_of_many_sizes_comes_back_as_a_list_or_stacked() -> None:
    images, targets = [picture(0), picture(1, (60, 200))], [scene(), scene(image_hw=(60, 200))]
    stacked, _ = Compose([LetterBox(64)]).batch((images, targets))
    assert isinstance(stacked, Tensor)
    assert stacked.shape == (2, 3, 64, 64)
    listed, after = Compose([Resize(64)]).batch((images, targets))
    assert [tuple(image.shape) for image in listed] == [(3, 64, 85), (3, 64, 213)]
    assert len(after) == 2
    assert Compose([Resize(64)]).batch(([], [])) == ([], [])


def test_batches_are_differentiable_in_the_images() -> None:
    image = torch.rand(1, 3, 20, 24, dtype=F64, requires_grad=True)
    compose = Compose(
        [
            RandomVirtualCamera(5, 5, 5),
            ColorJitter(0.1, 0.1, 0.1),
            RandomGaussianBlur((1, 1), p=1),
            Normalize(),
        ],
        fill=114.0,
    )
    target = {"K": torch.tensor([[30.0, 0, 12], [0, 30, 10], [0, 0, 1]], dtype=F64)}

    def run(x: Tensor) -> Tensor:
        return compose.batch((x, [target]), keys=[(0, 0)])[0]  # type: ignore[return-value]

    (gradient,) = torch.autograd.grad(run(image * 0.5 + 0.25).sum(), image)
    assert float(gradient.abs().sum()) > 0
    assert torch.autograd.gradcheck(
        lambda x: run(x * 0.2 + 0.4), (torch.rand(1, 3, 6, 7, dtype=F64, requires_grad=True),)
    )
    single, _ = compose(image[0], target, key=(0, 0))
    assert single.requires_grad


def test_a_plan_replays_on_another_picture() -> None:
    compose = Compose([*MANY, Normalize()])
    image, target = picture(), scene()
    plan = compose.sample_params(HW, target, key=(0, 5))
    first, one = compose(image, target, key=(0, 5))
    again, other = compose.apply(image, target, pickle.loads(pickle.dumps(plan)))
    assert torch.equal(first, again)
    assert same(one, other)
    with pytest.raises(ConfigError, match=r"drawn for an image of \(120, 160\)"):
        compose.apply(picture(0, (60, 60)), {}, plan)
    with pytest.raises(SampleError, match="keeps animals"):
        compose.apply(image, scene(1), Plan(HW, (Keep((0, 2)),)))


def test_a_target_follows_pixels_that_another_library_moved() -> None:
    target = {**scene(2), "masks": torch.ones(2, *HW, dtype=torch.uint8)}
    compose = Compose([RandomHorizontalFlip(1), RandomAffine(20, scale=(0.8, 1.2)), Resize(77)])
    plan = compose.sample_params(HW, target, key=(0, 2))
    _, expected = compose.apply(picture(), target, plan)
    hw = tuple(expected["masks"].shape[1:])
    for sign in (1, -1):  # the same map
        moved = transform_target(target, sign * plan.H_out_in, HW, (hw[0], hw[1]))
        assert same(moved, expected)
    for H, says in (
        (np.diag([1.0, 0, 1]), "invertible"),
        (np.eye(2), r"\(3, 3\)"),
        (np.full((3, 3), np.nan), "finite"),
    ):
        with pytest.raises(SampleError, match=f"scene: H_out_in: .*{says}"):
            transform_target(target, H, HW, HW)
    with pytest.raises(SampleError, match="masks: cannot go back"):
        inverse(target, np.eye(3), HW)


def test_every_public_name_can_be_had() -> None:
    for name in transforms.__all__:
        assert getattr(transforms, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'RandomNothing'"):
        transforms.RandomNothing  # noqa: B018


def test_predictions_go_back_to_the_picture_that_was_augmented() -> None:
    target = scene(3)
    image, after = Compose(
        [
            RandomHorizontalFlip(1),
            RandomAffine(20, scale=(0.8, 1.2)),
            RandomVirtualCamera(5, 5, 5),
            Resize(77),
        ]
    )(picture(), target, key=(0, 2))
    predicted = {
        name: after[name]
        for name in (
            "K",
            "corners_3d",
            "center",
            "rotation",
            "size",
            "corners_2d",
            "boxes",
            "keypoints",
            "face_share",
        )
    }
    back = inverse(
        predicted, after["H_out_in"], image_hw=HW, keypoint_mirror=KEYPOINT_MIRROR.tolist()
    )
    for name in ("K", "corners_3d", "center", "rotation", "corners_2d", "face_share"):
        assert_close(back[name], target[name], atol=1e-6, rtol=1e-7)
    assert_close(back["keypoints"][..., :2], target["keypoints"][..., :2], atol=1e-6, rtol=1e-7)
    assert "H_out_in" not in back
    assert image.shape[1] == 77


def test_neighbouring_maps_and_colours_become_one_reading_of_the_pixels() -> None:
    compose = Compose(
        [
            RandomHorizontalFlip(1),
            ColorJitter(0.3),
            RandomAffine(5),
            RandomResizedCrop(64),
            RandomGrayscale(1),
            Normalize(),
        ]
    )
    assert len(compose.sample_params(HW, scene()).stages()) == 1
    split = (
        Compose([RandomAffine(5), RandomGaussianBlur((1, 1), p=1), Resize(30), RandomRotation(5)])
        .sample_params(HW, scene())
        .stages()
    )
    assert [isinstance(stage, Pass) for stage in split] == [True, False, True]


def test_a_dropped_animal_that_a_later_map_shows_again_has_its_label() -> None:
    """From the review.

    Maps are fused, so what a crop cut off is there again when a later map makes room for it.
    """
    target = {name: scene(6, seed=1)[name] for name in ("K", "corners_3d", "labels")}
    cropped = Compose([CenterCrop(40, min_visible=0.9)]).sample_params(HW, target)
    assert cropped.keep is not None
    assert len(cropped.keep) < 6
    again = Compose([CenterCrop(40, min_visible=0.9), PadTo(HW)])
    _, after = again(picture(), target)
    assert after["labels"].tolist() == list(range(6))
    _, after = Compose([CenterCrop(40, min_visible=0.9), RandomRotation((5, 5))])(picture(), target)
    assert after["labels"].tolist() == list(cropped.keep)


def test_the_sample_key_of_the_book_keeping_decides_unless_a_key_is_given() -> None:
    compose = Compose([RandomRotation((-180, 180))])

    def turn(target: dict[str, Any], key: tuple[int, ...] | None = None) -> list[list[float]]:
        H: list[list[float]] = compose(picture(), target, key=key)[1]["H_out_in"].tolist()
        return H

    named = {**scene(), "meta": {"sample_key": (1, 7)}}
    assert turn(named) == turn(named) == turn(scene(), (1, 7))
    assert turn(named, (1, 8)) == turn(scene(), (1, 8)) != turn(named)


def test_a_pipeline_in_a_pipeline_keeps_its_options_or_says_that_they_would_be_lost() -> None:
    inner = Compose([RandomRotation((10, 10))], fill=114.0)
    with pytest.raises(ConfigError, match="its fill would be lost"):
        Compose([inner, Resize(50)])
    one, _ = Compose([inner, Resize(50)], fill=114.0)(picture(), {})
    other, _ = Compose([RandomRotation((10, 10)), Resize(50)], fill=114.0)(picture(), {})
    assert torch.equal(one, other)


def test_threads_that_share_a_pipeline_draw_what_one_alone_draws() -> None:
    compose = Compose(
        [
            kornia.RandomAffine(20.0, p=0.5),
            kornia.RandomHue((-0.2, 0.2), p=0.5),
            RandomHorizontalFlip(),
        ]
    )
    image = picture()
    alone = [compose(image, {}, key=(0, index))[0] for index in range(40)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda index: compose(image, {}, key=(0, index))[0], range(40)))
    assert all(torch.equal(a, b) for a, b in zip(alone, together, strict=True))


@pytest.mark.parametrize("in_torch", [True, False])
def test_a_box_that_ends_before_it_begins_is_refused(in_torch: bool) -> None:
    xywh = [[5.0, 5, 20, 20], [60.0, 10, 15, 30]]
    boxes: Any = torch.tensor(xywh) if in_torch else np.array(xywh)
    flip = Compose([RandomHorizontalFlip(1.0)])
    image = np.zeros((60, 80, 3), np.uint8)
    for transform in (flip, Compose([RandomHorizontalFlip(1.0)], pixel_origin="edge")):
        with pytest.raises(SampleError, match=r"xyxy .* animal 1's is .* if it is x, y, width"):
            transform(image, {"boxes": boxes, "image_id": "zoo.jpg"})
    with pytest.raises(SampleError, match=r"zoo\.jpg"):
        flip(image, {"boxes": boxes[1:], "image_id": "zoo.jpg"})
    with pytest.raises(SampleError, match="xyxy"):
        RandomHorizontalFlip(1.0)(image, {"boxes": boxes})
    with pytest.raises(SampleError, match="xyxy"):
        flip.batch((torch.zeros(1, 3, 60, 80), [{"boxes": boxes}]))
    boxes[1] = boxes[1, [0, 1, 0, 3]]  # an empty one stays what it is
    assert flip(image, {"boxes": boxes})[1]["boxes"][1].tolist() == [19, 10, 19, 30]

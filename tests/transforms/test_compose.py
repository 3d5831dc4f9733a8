"""Pipelines: forms of images, randomness, replay, inverse, batches, local operations."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import kornia.augmentation as kornia
import numpy as np
import pytest
import torch
from opencv_version import LEVELS
from scenes import F64, KEYPOINT_MIRROR, scene
from torch import Tensor
from torch.testing import assert_close

from animal3dbox import transforms
from animal3dbox.errors import ConfigError, SampleError, ShapeError
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.transforms import (
    CenterCrop,
    ColorJitter,
    Compose,
    LetterBox,
    Normalize,
    PadTo,
    PerspectiveCrop,
    RandomAffine,
    RandomErasing,
    RandomGaussianBlur,
    RandomGaussianNoise,
    RandomGrayscale,
    RandomHorizontalFlip,
    RandomPerspective,
    RandomResizedCrop,
    RandomRotation,
    RandomVirtualCamera,
    Resize,
    Transform,
    inverse,
    transform_target,
)
from animal3dbox.transforms.steps import Keep, Pass, Plan

HW = (120, 160)
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


def picture(seed: int = 0, hw: tuple[int, int] = HW) -> Tensor:
    noise = np.random.default_rng(seed).random((*hw, 3)) * 255
    return (
        torch.from_numpy(cv2.GaussianBlur(noise, (0, 0), 1.0).astype(np.uint8))
        .permute(2, 0, 1)
        .contiguous()
    )


def same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    assert one.keys() == other.keys()
    return all(
        (
            torch.equal(one[name], other[name])
            if isinstance(one[name], Tensor)
            else one[name] == other[name]
        )
        for name in one
    )


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


@pytest.mark.parametrize("dtype", ["uint8", "float32", "float64"])
@pytest.mark.parametrize("layout", ["chw", "hwc", "hw"])
@pytest.mark.parametrize("tensor", [True, False])
def test_images_leave_in_the_form_in_which_they_came(dtype: str, layout: str, tensor: bool) -> None:
    base = picture().numpy()
    array = base[0] if layout == "hw" else base if layout == "chw" else base.transpose(1, 2, 0)
    array = array if dtype == "uint8" else (array / 255).astype(dtype)
    image: Any = torch.from_numpy(np.ascontiguousarray(array)) if tensor else array
    kept = array.copy()
    out, _ = Compose([RandomRotation((7, 7)), Resize((60, 70)), RandomGaussianNoise(p=1)])(
        image, {}, key=(0,)
    )
    assert type(out) is type(image)
    assert out.dtype == image.dtype
    assert tuple(out.shape) == {"chw": (3, 60, 70), "hwc": (60, 70, 3), "hw": (60, 70)}[layout]
    assert (np.asarray(image) == kept).all()  # the image that came in is as it was
    reference, _ = Compose([RandomRotation((7, 7)), Resize((60, 70))])(picture(), {}, key=(0,))
    plain, _ = Compose([RandomRotation((7, 7)), Resize((60, 70))])(image, {}, key=(0,))
    values = np.asarray(plain, dtype=float) * (1 if dtype == "uint8" else 255)
    values = values if layout != "hwc" else values.transpose(2, 0, 1)
    difference = np.abs(
        values - (np.asarray(reference[0] if layout == "hw" else reference, dtype=float))
    )
    assert difference.max() <= 1.001


def test_targets_leave_in_the_form_in_which_they_came_and_the_old_one_is_untouched() -> None:
    target = {
        name: value.numpy() if isinstance(value, Tensor) else value
        for name, value in scene(2, dtype=torch.float32).items()
    }
    kept = {name: np.copy(value) for name, value in target.items() if isinstance(value, np.ndarray)}
    _, after = Compose([RandomHorizontalFlip(1), Resize(50)])(picture(), target)
    for name, value in kept.items():
        assert (target[name] == value).all()
        assert isinstance(after[name], np.ndarray)
        assert after[name].dtype == value.dtype
    assert isinstance(after["H_out_in"], np.ndarray)
    assert after["H_out_in"].dtype == np.float32
    assert after["image_id"] == "scene"


def test_bare_cuboids_and_bare_images_are_enough() -> None:
    full = scene()
    compose = Compose(
        [
            RandomHorizontalFlip(1),
            RandomAffine(9),
            RandomVirtualCamera(2, 2, 2),
            RandomResizedCrop(64),
        ]
    )
    for names in (("K", "corners_3d"), ("K", "center", "rotation", "size"), ("K",)):
        _, after = compose(picture(), {name: full[name] for name in names})
        assert set(after) == {*names, "H_out_in", "mirrored"}
    image, after = Compose([RandomHorizontalFlip(1), RandomAffine(9)])(
        picture(), {"corners_2d": full["corners_2d"], "labels": torch.arange(2)}
    )
    assert set(after) == {"corners_2d", "labels", "H_out_in", "mirrored"}
    assert image.shape == (3, *HW)


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


def test_flips_and_whole_pixel_crops_are_lossless() -> None:
    image = picture()
    flipped, _ = Compose([RandomHorizontalFlip(1)])(image, {})
    assert torch.equal(flipped, image.flip(-1))
    cropped, _ = Compose([CenterCrop((60, 50))])(image, {})
    assert torch.equal(cropped, image[:, 30:90, 55:105])
    padded, _ = Compose([PadTo((130, 170))], fill=(10, 20, 30))(image, {})
    assert torch.equal(padded[:, 5:125, 5:165], image)
    assert padded[:, 0, 0].tolist() == [10, 20, 30]


def test_strong_shrinking_averages_instead_of_aliasing() -> None:
    checks = ((np.indices((240, 320)).sum(axis=0) % 2) * 255).astype(np.uint8)
    for compose in (Compose([Resize(40)]), Compose([RandomRotation((20, 20)), Resize(40)])):
        small, _ = compose(checks, {})
        inside = np.asarray(small)[8:-8, 8:-8]
        assert inside.min() > 120
        assert inside.max() < 136


def test_nothing_is_read_from_beyond_the_horizon() -> None:
    target = {"K": torch.tensor([[80.0, 0, 79.5], [0, 80, 59.5], [0, 0, 1]], dtype=F64)}
    compose = Compose([RandomVirtualCamera((80, 80), 0.0, 0.0)], fill=7.0)
    white = torch.full((3, *HW), 200, dtype=torch.uint8)
    turned, _ = compose(white, target)
    batched, _ = compose.batch((white[None], [target]))
    for image in (turned, batched[0]):
        assert isinstance(image, Tensor)
        assert set(image.flatten().tolist()) >= {7, 200}
        assert set(image[:, :, 80:].flatten().tolist()) == {
            7
        }  # the picture ends 45 degrees to the right of where it looked


def test_masks_and_their_boxes_follow_the_pixels() -> None:
    target = scene(2)
    masks = torch.zeros(2, *HW, dtype=torch.uint8)
    masks[0, 20:50, 30:70] = 1
    boxes = target["boxes"].clone()
    boxes[0] = torch.tensor([29.5, 19.5, 69.5, 49.5])
    _, after = Compose([RandomHorizontalFlip(1), Resize((60, 80))])(
        picture(), {**target, "masks": masks, "boxes": boxes}
    )
    expected = torch.zeros(60, 80, dtype=torch.uint8)
    expected[10:25, 45:65] = 1
    assert torch.equal(after["masks"][0], expected)
    assert after["boxes"][0].tolist() == [44.5, 9.5, 64.5, 24.5]
    assert int(after["masks"][1].sum()) == 0
    amodal = torch.tensor(
        [[10.0, 10, 100, 100], [0, 0, 0, 0]], dtype=F64
    )  # was not made from the mask: mapped as it is
    _, after = Compose([RandomHorizontalFlip(1), Resize((60, 80))])(
        picture(), {"masks": masks, "boxes": amodal}
    )
    assert after["boxes"][0].tolist() == [29.25, 4.75, 74.25, 49.75]


def test_painting_over_does_not_shrink_the_box_however_the_picture_moves_later() -> None:
    masks = torch.zeros(1, *HW, dtype=torch.uint8)
    masks[0, 20:100, 20:140] = 1
    target = {"masks": masks, "boxes": torch.tensor([[19.5, 19.5, 139.5, 99.5]], dtype=F64)}
    hide = RandomErasing(1, scale=(0.5, 0.5), ratio=(1.0, 1.0))
    _, after = Compose([hide, Resize((60, 80))])(picture(), target, key=(0,))
    assert after["boxes"][0].tolist() == [9.5, 9.5, 69.5, 49.5]
    assert 0 < float(after["occlusion"][0]) < 1


@pytest.mark.parametrize(
    "transform",
    [
        RandomVirtualCamera((4, 4), (3, 3), (10, 10), (1.1, 1.1)),
        RandomPerspective(0.2, p=1, allow_skew=True),
    ],
)
def test_depth_follows_the_law_at_every_pixel(transform: Transform) -> None:
    """A slanted plane: its depth in the new camera is known in closed form."""
    K = torch.tensor([[150.0, 0, 85], [0, 140, 55], [0, 0, 1]], dtype=F64)
    normal = torch.tensor([0.2, -0.1, 1.0], dtype=F64)
    y, x = torch.meshgrid(
        torch.arange(HW[0], dtype=F64), torch.arange(HW[1], dtype=F64), indexing="ij"
    )
    rays = torch.stack((x, y, torch.ones_like(x)), dim=-1) @ torch.linalg.inv(K).mT
    depth = 4 / (rays @ normal)  # normal . X = 4
    _, after = Compose([transform])(picture(), {"K": K, "depth": depth}, key=(0, 1))
    H, K_new = after["H_out_in"], after["K"]
    Q = torch.linalg.inv(K_new) @ H @ K
    Q = Q / Q[2].norm()
    rays = torch.stack((x, y, torch.ones_like(x)), dim=-1) @ torch.linalg.inv(K_new).mT
    expected = 4 / (rays @ (Q @ normal))
    known = after["depth"] > 0
    assert float(known.double().mean()) > 0.5
    assert (
        float(((after["depth"] - expected).abs() / expected)[known].max()) < 5e-3
    )  # half a pixel of the slope


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
    for image in (Compose([RandomGaussianBlur((2, 2), p=1)])(point, {})[0], Compose([RandomGaussianBlur((2, 2), p=1)]).batch((torch.from_numpy(point).permute(2, 0, 1)[None], [{}]))[0][0].permute(1, 2, 0)):  # fmt: skip
        weight = np.asarray(image)[..., 0].astype(float)
        assert weight.sum() == pytest.approx(1, abs=1e-4)
        y, _ = np.mgrid[-20:21, -20:21]
        assert (weight * y**2).sum() == pytest.approx(4, rel=0.05)  # cut at three sigma


@pytest.mark.parametrize(
    ("image", "says"),
    [
        ([[1]], "tensor or a numpy array"),
        (np.zeros((5, 6, 7)), "shape"),
        (np.zeros((5, 6, 3), dtype=np.int32), "uint8"),
        (torch.zeros(3, 0, 5), "empty"),
        (torch.zeros(2, 3, 4, 5), "shape"),
    ],
)
def test_unusable_images_are_refused(image: Any, says: str) -> None:
    with pytest.raises(ShapeError, match=f"image must .*{says}"):
        Compose([Resize(5)])(image, {})


def singular(target: dict[str, Any]) -> dict[str, Any]:
    return {**target, "H_out_in": torch.zeros(2, 3, dtype=F64)}


@pytest.mark.parametrize(
    ("change", "field", "says"),
    [
        ({"K": torch.eye(4, dtype=F64)}, "K", r"shape \(3, 3\)"),
        ({"K": torch.eye(3, dtype=F64)[None]}, "K", r"shape \(3, 3\)"),
        ({"K": torch.diag(torch.tensor([-1.0, 1, 1], dtype=F64))}, "K", "positive focal"),
        ({"K": torch.full((3, 3), float("nan"))}, "K", "NaN"),
        ({"K": torch.eye(3, dtype=torch.int64)}, "K", "floating point"),
        ({"K": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "K", "tensor or an array"),
        ({"H_out_in": torch.zeros(2, 3, dtype=F64)}, "H_out_in", "shape"),
        ({"corners_3d": torch.zeros(2, 7, 3, dtype=F64)}, "corners_3d", "shape"),
        ({"R": torch.zeros(2, 4, 4, dtype=F64)}, "R", "shape"),
        ({"t": torch.zeros(3, 3, dtype=F64)}, "", "disagree on the number of animals"),
        ({"labels": torch.zeros(5)}, "", "disagree on the number of animals|floating"),
        ({"meta": {"quality": [{}]}}, "meta: quality", "1 records for 2 animals"),
        ({"meta": {"sample_ids": "scene#0"}}, "meta: sample_ids", "one record an animal, got str"),
        ({"meta": {"scale_source": ()}}, "meta: scale_source", "0 records for 2 animals"),
        ({"meta": [1, 2]}, "meta", "must be a dict"),
        ({"masks": torch.zeros(2, 60, 80, dtype=torch.uint8)}, "masks", "stale"),
        ({"depth": torch.zeros(60, 80)}, "depth", "stale"),
        ({"distortion": torch.zeros(3, dtype=F64)}, "distortion", "OpenCV's order"),
        ({"intrinsics": torch.eye(3)}, "intrinsics", "could hold a camera"),
        ({"P2": np.zeros((3, 4))}, "P2", "could hold a camera"),
        ({"calib": {"P2": np.zeros((3, 4))}}, "calib", "could hold a camera"),
        ({"cam2img": [torch.eye(3)]}, "cam2img", "could hold a camera"),
        ({"area": torch.ones(2)}, "area", "unknown field"),
        ({"P2": [[1.0, 0, 0, 0]]}, "P2", "could hold a camera"),
        (
            {"annotations": [{"bbox": [1.0, 2.0, 3.0, 4.0]}, {}]},
            "annotations",
            "could hold a camera",
        ),
        ({"intrinsics": {"fx": 500.0}}, "intrinsics", "could hold a camera"),
        ({"camera": object()}, "camera", "could hold a camera"),
        ({"masks": torch.zeros(2, *HW, dtype=torch.float16)}, "masks", "convert it to uint8"),
        ({"keypoint_mirror": torch.tensor([0, 1, 2])}, "keypoint_mirror", "permutation of 0 to 4"),
        (
            {"keypoint_mirror": torch.tensor([1, 2, 0, 3, 4])},
            "keypoint_mirror",
            "swap keypoints in pairs",
        ),
        ({"corners_2d": torch.zeros(2, 8, 2, dtype=F64)}, "K", "stale"),
        ({"size": torch.ones(2, 3, dtype=F64) * 9}, "corners_3d", "corner order"),
    ],
)
def test_bad_targets_name_the_sample_the_field_and_the_remedy(
    change: dict[str, Any], field: str, says: str
) -> None:
    with pytest.raises(SampleError, match=says) as caught:
        Compose([RandomHorizontalFlip(1)])(picture(), {**scene(), **change})
    assert caught.value.sample_id == "scene"
    assert str(caught.value).startswith(f"scene: {field}")


def test_cuboids_without_intrinsics_and_mirrored_keypoints_without_names_are_refused() -> None:
    target = scene()
    with pytest.raises(SampleError, match=r"scene: corners_3d: .*intrinsics K"):
        Compose([Resize(50)])(
            picture(), {name: value for name, value in target.items() if name != "K"}
        )
    bare = {name: value for name, value in target.items() if name != "keypoint_mirror"}
    with pytest.raises(SampleError, match=r"scene: keypoints: .*keypoint_mirror"):
        Compose([RandomHorizontalFlip(1)])(picture(), bare)
    _, after = Compose([RandomHorizontalFlip(1)], keypoint_mirror=KEYPOINT_MIRROR.tolist())(
        picture(), bare
    )
    assert_close(after["keypoints"][:, 0, 0], 159 - target["keypoints"][:, 1, 0])


def test_a_lens_is_carried_or_the_error_says_to_undistort() -> None:
    target = {"K": scene()["K"], "distortion": torch.tensor([0.1, 0.01, 0.02, 0.03], dtype=F64)}
    _, after = Compose([RandomHorizontalFlip(1), Resize(50)])(picture(), target)
    assert_close(after["distortion"], torch.tensor([0.1, 0.01, 0.02, -0.03], dtype=F64))
    with pytest.raises(SampleError, match=r"distortion: .*undistort the image first"):
        Compose([RandomVirtualCamera((3, 3))])(picture(), target)


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


def test_the_side_of_the_camera_is_kept_when_the_old_middle_falls_behind_it() -> None:
    """From the review.

    Labels took -H when the middle of the old picture was no longer in front of the new camera.
    """
    K = torch.tensor([[200.0, 0, 100], [0, 200, 60], [0, 0, 1]], dtype=F64)
    center, eye = torch.tensor([[3.8, 0, 1.0]], dtype=F64), torch.eye(3, dtype=F64)[None]
    target = {"K": K, "center": center, "rotation": eye, "size": torch.full((1, 3), 0.2, dtype=F64)}
    image = picture(0, (120, 1200))
    for compose in (
        Compose([PerspectiveCrop(64)]),
        Compose([RandomVirtualCamera((75, 75), 0.0, 0.0)]),
        Compose([RandomVirtualCamera((40, 40), 0.0, 0.0)] * 2),
    ):
        _, after = compose(image, target)
        assert after["mirrored"] is False
        assert float(after["center"][0, 2]) > 0
        back = inverse({name: after[name] for name in target}, after["H_out_in"], (120, 1200))
        for name, value in target.items():
            assert_close(back[name], value, atol=1e-9, rtol=1e-9)


def test_what_is_added_to_a_target_is_a_float_whatever_comes_first() -> None:
    _, after = Compose([RandomRotation((10, 10))])(
        picture(), {"labels": torch.tensor([1]), "boxes": torch.ones(1, 4)}
    )
    assert after["H_out_in"].dtype == torch.float32
    masks = np.ones((1, *HW), dtype=np.uint8)
    _, after = Compose([RandomErasing(1, scale=(0.3, 0.3))])(picture(), {"masks": masks})
    assert after["occlusion"].dtype == np.float32
    assert 0 < after["occlusion"][0] < 1


def test_a_box_beyond_the_horizon_has_no_area() -> None:
    target = {
        "K": torch.tensor([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]], dtype=F64),
        "boxes": torch.tensor([[0.0, 40, 20, 80]], dtype=F64),
    }
    _, after = Compose([RandomVirtualCamera((80, 80), 0.0, 0.0)])(picture(), target)
    x_least, y_least, x_most, y_most = after["boxes"][0].tolist()
    assert (x_most - x_least) * (y_most - y_least) == 0


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


def test_faces_without_cuboids_are_scaled_or_left_out_but_never_stale() -> None:
    target = {
        name: scene()[name]
        for name in ("K", "face_area", "face_share", "face_share_in_image", "face_visible")
    }
    _, after = Compose([Resize((60, 80))])(picture(), target)
    assert_close(after["face_area"], target["face_area"] / 4)
    assert "face_share_in_image" not in after
    _, after = Compose([RandomVirtualCamera((5, 5))])(picture(), target)
    assert "face_share" not in after
    assert "face_area" not in after


def test_cuboids_beyond_a_lens_s_field_of_view_are_refused() -> None:
    target = scene(1)
    narrow = torch.tensor([-0.4, 0.0, 0.0, 0.0], dtype=F64)  # folds at 42 degrees off the axis
    wide = {
        "K": target["K"],
        "center": target["center"] + torch.tensor([7.0, 0, 0]),
        "rotation": target["rotation"],
        "size": target["size"],
    }
    with pytest.raises(
        SampleError, match="distortion: animal 0 reaches beyond the lens's field of view"
    ):
        Compose([Resize(50)])(picture(), {**wide, "distortion": narrow})
    Compose([Resize(50)])(
        picture(), {**{name: target[name] for name in wide}, "distortion": narrow}
    )


def test_strong_zooms_of_large_pictures_are_no_singular_maps() -> None:
    _, after = Compose([RandomAffine(0, scale=(0.005, 0.005))])(
        np.zeros((1000, 6000), dtype=np.uint8), {"K": scene()["K"]}
    )
    assert float(after["K"][0, 0]) == pytest.approx(0.005 * float(scene()["K"][0, 0]))


def test_rgba_and_grey_images_go_through_both_executors_alike() -> None:
    for channels in (1, 4):
        image = torch.cat((picture(), picture(1)))[:channels]
        compose = Compose(
            [RandomRotation((20, 20))], fill=(9.0, 9.0, 9.0) if channels == 4 else 9.0
        )
        one, _ = compose(image, {})
        batched, _ = compose.batch((image[None], [{}]))
        assert int((batched[0].int() - one.int()).abs().max()) <= LEVELS
    with pytest.raises(ShapeError, match="image has 1 channels, but RandomErasing's value has 3"):
        Compose([RandomErasing(1, value=(0.0, 0.5, 1.0))])(image[:1], {})


def test_floats_outside_their_range_are_treated_alike_by_both_executors() -> None:
    image = torch.randn(3, 30, 40)
    compose = Compose([RandomGaussianBlur((1, 1), p=1), RandomErasing(1)])
    one, _ = compose(image, {}, key=(0,))
    batched, _ = compose.batch((image[None], [{}]), keys=[(0,)])
    assert_close(batched[0], one, atol=1e-5, rtol=0)
    assert float(one.min()) < 0


def test_a_quarter_turn_maps_boxes_exactly() -> None:
    square = torch.tensor([[200.0, 0, 80], [0, 200, 60], [0, 0, 1]], dtype=F64)
    box = Cuboid(
        torch.tensor([[0.0, 0, 5]], dtype=F64),
        torch.eye(3, dtype=F64)[None],
        torch.ones(1, 3, dtype=F64),
    )
    cuboid = {"center": box.center, "rotation": box.rotation, "size": box.size}
    target = {"K": square, "boxes": torch.tensor([[30.0, 20, 80, 90]], dtype=F64), **cuboid}
    _, after = Compose([RandomRotation((90, 90))])(picture(), target)
    assert_close(
        after["boxes"], torch.tensor([[49.0, 10, 119, 60]], dtype=F64)
    )  # x' = 139 - y, y' = x - 20


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


def test_the_user_says_which_fields_of_his_own_follow_dropped_animals() -> None:
    target = {
        **scene(6, seed=1),
        "herd": list("abcdef"),
        "orig_size": torch.tensor([1, 2, 3, 4, 5, 6]),
        "site": "north",
        "scores": torch.rand(6),
    }
    crop = [CenterCrop(40, min_visible=0.9)]
    with pytest.raises(SampleError, match=r"scene: herd: has 6 entries.*per_animal=\['herd'\]"):
        Compose(crop)(picture(), target)
    _, after = Compose(crop, per_animal=["herd"], per_image=["orig_size"])(picture(), target)
    kept = after["labels"].tolist()
    assert after["herd"] == [list("abcdef")[index] for index in kept]
    assert torch.equal(after["scores"], target["scores"][kept])
    assert after["orig_size"].tolist() == [1, 2, 3, 4, 5, 6]
    assert after["site"] == "north"
    with pytest.raises(SampleError, match="herd: holds 2 records for 6 animals"):
        Compose(crop, per_animal=["herd"])(picture(), {**target, "herd": ["a", "b"]})


def test_book_keeping_is_passed_on_and_follows_dropped_animals() -> None:
    meta = {
        "sample_key": (0, 3),
        "sample_ids": [f"herd.jpg#{n}" for n in range(6)],
        "quality": [{"sd": 0.5 * n} for n in range(6)],
        "scale_source": ("species",) * 6,
        "K_source": "exif",
        "lens": {"coefficients": [0.25, 0.5]},
    }
    target = {**scene(6, seed=1), "meta": meta}
    before = pickle.loads(pickle.dumps(target))
    compose = Compose([CenterCrop(40, min_visible=0.9)])
    _, after = compose(picture(), target)
    rows = after["labels"].tolist()
    assert 0 < len(rows) < 6
    assert after["meta"] == {
        **meta,
        "sample_ids": [f"herd.jpg#{n}" for n in rows],
        "quality": [{"sd": 0.5 * n} for n in rows],
        "scale_source": ("species",) * len(rows),
    }
    assert target["meta"] is meta
    assert same({"meta": meta}, {"meta": before["meta"]})
    _, unmoved = Compose([])(picture(), target)
    assert unmoved["meta"] == meta
    assert unmoved["meta"] is not meta


def test_the_sample_key_of_the_book_keeping_decides_unless_a_key_is_given() -> None:
    compose = Compose([RandomRotation((-180, 180))])

    def turn(target: dict[str, Any], key: tuple[int, ...] | None = None) -> list[list[float]]:
        H: list[list[float]] = compose(picture(), target, key=key)[1]["H_out_in"].tolist()
        return H

    named = {**scene(), "meta": {"sample_key": (1, 7)}}
    assert turn(named) == turn(named) == turn(scene(), (1, 7))
    assert turn(named, (1, 8)) == turn(scene(), (1, 8)) != turn(named)


@pytest.mark.parametrize(
    "pipeline",
    [[], [RandomHorizontalFlip(0)], [CenterCrop(HW)], [Resize(HW)], [RandomRotation((5, 5))]],
)
@pytest.mark.parametrize("array", [True, False])
def test_writing_to_what_came_out_changes_nothing_of_what_came_in(
    pipeline: list[Transform], array: bool
) -> None:
    target: dict[str, Any] = {**scene(2), "masks": torch.ones(2, *HW, dtype=torch.uint8)}
    image: Any = picture().permute(1, 2, 0).contiguous().numpy() if array else picture()
    if array:
        target = {
            name: value.numpy() if isinstance(value, Tensor) else value
            for name, value in target.items()
        }
    kept, image_kept = pickle.loads(pickle.dumps(target)), pickle.loads(pickle.dumps(image))
    made, after = Compose(pipeline)(image, target)
    made[:] = 0
    for value in after.values():
        if isinstance(value, Tensor | np.ndarray):
            value[...] = 0
    assert (np.asarray(image) == np.asarray(image_kept)).all()
    for name, value in kept.items():
        assert np.array_equal(np.asarray(target[name]), np.asarray(value)), name


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


def test_a_forbidden_mirror_never_happens() -> None:
    compose = Compose([RandomHorizontalFlip(1, mirror="forbid")], mirror="forbid")
    image, after = compose(picture(), scene())
    assert after["mirrored"] is False
    assert torch.equal(image, picture())

"""CameraAugmentationSequential against kornia's own AugmentationSequential under the same seed, and
the law for cameras and cuboids."""

from collections.abc import Callable
from typing import Any

import kornia.augmentation as kornia
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from kornia_cases import ramps
from scenes import scene
from thorough import thorough
from torch import Tensor
from torch.testing import assert_close

from animal3dbox.errors import ConfigError, SampleError, ShapeError
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import MIRRORED_CORNERS
from animal3dbox.geometry.homography import apply_homography
from animal3dbox.transforms import CameraAugmentationSequential
from animal3dbox.transforms.camera_law.law import parameter_corners
from animal3dbox.transforms.rendering.torch_executor import warp

HW = (120, 160)
CAMERA = ["K", "R", "t", "corners_3d", "center", "rotation", "size", "corners_2d"]
Make = Callable[[], list[Any]]
PIPELINES: dict[str, Make] = {
    "flip, affine, resized crop": lambda: [
        kornia.RandomHorizontalFlip(),
        kornia.RandomAffine(8.0, (0.05, 0.05), (0.9, 1.2), p=0.7),
        kornia.RandomResizedCrop((100, 90), (0.5, 1.0)),
    ],
    "crop, rotation, resize": lambda: [
        kornia.RandomCrop((100, 130)),
        kornia.RandomRotation(8.0, p=1.0),
        kornia.Resize((140, 150)),
    ],
    "pad, perspective, vertical flip": lambda: [
        kornia.PadTo((130, 170)),
        kornia.RandomPerspective(0.2, p=1.0),
        kornia.RandomVerticalFlip(),
    ],
    "normalisation in between": lambda: [
        kornia.RandomShear(5.0, p=1.0),
        kornia.Normalize(torch.tensor([0.1, 0.2, 0.3]), torch.tensor([0.5, 0.6, 0.7])),
        kornia.RandomRotation(8.0, p=1.0),
    ],
    "colours in between": lambda: [
        kornia.RandomHorizontalFlip(),
        kornia.RandomBrightness((0.95, 1.0), p=1.0),
        kornia.RandomRotation(8.0, p=1.0),
        kornia.RandomGrayscale(p=0.5),
        kornia.CenterCrop((90, 100)),
    ],
    "one of the batch at a time": lambda: [
        kornia.RandomRotation(8.0, p=0.3),
        kornia.RandomTranslate((-0.1, 0.1), p=0.3),
    ],
}


def batch(count: int = 3, dtype: torch.dtype = torch.float32) -> dict[str, Tensor]:
    """Ramps with cameras and cuboids; a dict by data key."""
    scenes = [scene(image_hw=HW, seed=seed, dtype=dtype) for seed in range(count)]
    for target in scenes:
        target["K"][1, 1] = target["K"][0, 0]
        target["corners_2d"] = project(target["K"], target["corners_3d"])[0]
    values = {name: torch.stack([target[name] for target in scenes]) for name in CAMERA}
    return {"image": ramps(HW).to(dtype).expand(count, -1, -1, -1).clone(), **values}


def seeded(seed: int, call: Callable[[], Any]) -> Any:
    torch.manual_seed(seed)
    return call()


@pytest.mark.parametrize("name", PIPELINES)
@pytest.mark.parametrize("seed", range(4))
def test_geometry_and_draws_equal_kornias(name: str, seed: int) -> None:
    theirs, ours = (
        kornia.AugmentationSequential(*PIPELINES[name]()),
        CameraAugmentationSequential(*PIPELINES[name](), allow_skew=True),
    )
    image = batch()["image"]
    expected = seeded(seed, lambda: theirs(image))
    state = torch.random.get_rng_state()
    result = seeded(seed, lambda: ours(image))
    assert torch.equal(torch.random.get_rng_state(), state)
    assert ours.transform_matrix is not None
    matrix = theirs.transform_matrix
    assert matrix is not None
    assert_close(
        ours.transform_matrix / ours.transform_matrix[:, 2:, 2:],
        matrix / matrix[:, 2:, 2:],
        atol=2e-3,
        rtol=1e-4,
    )
    assert result.shape == expected.shape
    back = torch.linalg.inv(ours.transform_matrix.double())
    y, x = torch.meshgrid(
        torch.arange(result.shape[2]).double(),
        torch.arange(result.shape[3]).double(),
        indexing="ij",
    )
    came_from = apply_homography(back, torch.stack((x, y), dim=-1).reshape(1, -1, 2)).reshape(
        3, *x.shape, 2
    )
    inside = ((came_from > 15) & (came_from < torch.tensor([HW[1], HW[0]]) - 16)).all(-1)
    margins = [int(0.2 * side) for side in x.shape]
    (
        inside[:, : margins[0]],
        inside[:, -margins[0] :],
        inside[..., : margins[1]],
        inside[..., -margins[1] :],
    ) = (
        False,
        False,
        False,
        False,
    )
    assert int(inside.sum()) > 1000
    difference = (result - expected).abs().amax(1)[inside]
    assert (
        float(difference.max()) < 1e-3 / 256 * (2 if "normalisation" in name else 1) * 4
    )  # 0.004 px, Normalize stretches colours by 2


def test_an_existing_pipeline_is_taken_as_it_is_with_its_options() -> None:
    theirs, existing = (
        kornia.AugmentationSequential(
            *PIPELINES["flip, affine, resized crop"](), random_apply=2, same_on_batch=True
        )
        for _ in range(2)
    )
    ours = CameraAugmentationSequential(existing)
    image = batch()["image"]
    for seed in range(5):
        seeded(seed, lambda: theirs(image))
        seeded(seed, lambda: ours(image))
        assert ours.transform_matrix is not None
        assert_close(ours.transform_matrix, theirs.transform_matrix, atol=1e-3, rtol=1e-4)
    assert ours.pipeline is existing
    with pytest.raises(ConfigError, match="set them there"):
        CameraAugmentationSequential(existing, random_apply=1)


@thorough(60)
@given(st.sampled_from(sorted(PIPELINES)), st.integers(0, 10**6))
def test_cuboids_stay_where_the_pixels_go(name: str, seed: int) -> None:
    values = batch(2, torch.float64)
    aug = CameraAugmentationSequential(*PIPELINES[name](), data_keys=list(values), allow_skew=True)
    after = dict(zip(values, seeded(seed, lambda: aug(*values.values())), strict=True))
    H = aug.transform_matrix
    assert H is not None
    for row in range(2):
        mirrored = bool(torch.linalg.det(H[row]) < 0)
        order = list(MIRRORED_CORNERS) if mirrored else list(range(8))
        expected = apply_homography(H[row], values["corners_2d"][row])[:, order]
        assert_close(
            project(after["K"][row], after["corners_3d"][row])[0], expected, atol=1e-6, rtol=0
        )
        assert_close(after["corners_2d"][row], expected, atol=1e-6, rtol=0)
        boxes = parameter_corners(
            {name: after[name][row] for name in ("center", "rotation", "size")}
        )
        assert_close(boxes, after["corners_3d"][row])
        assert_close(torch.linalg.det(after["rotation"][row]), torch.ones(2, dtype=torch.float64))
        assert_close(torch.linalg.det(after["R"][row]), torch.ones(2, dtype=torch.float64))
        assert (torch.diagonal(after["K"][row]) > 0).all()


def test_blobs_at_corners_are_found_at_the_new_corners() -> None:
    values = batch(4)
    y, x = torch.meshgrid(torch.arange(HW[0]).float(), torch.arange(HW[1]).float(), indexing="ij")
    point = torch.stack([corners.reshape(-1, 2)[3] for corners in values["corners_2d"]])
    blobs = torch.exp(
        -((x - point[:, 0, None, None]) ** 2 + (y - point[:, 1, None, None]) ** 2) / 18
    )[:, None]
    aug = CameraAugmentationSequential(
        *PIPELINES["flip, affine, resized crop"](), data_keys=["input", "K", "corners_3d"]
    )
    found = 0
    for seed in range(10):
        image, K, corners = seeded(seed, lambda: aug(blobs, values["K"], values["corners_3d"]))
        assert aug.transform_matrix is not None
        rows, columns = torch.meshgrid(
            torch.arange(image.shape[2]).float(),
            torch.arange(image.shape[3]).float(),
            indexing="ij",
        )
        for row in range(4):
            index = MIRRORED_CORNERS[3] if torch.linalg.det(aug.transform_matrix[row]) < 0 else 3
            expected = project(K[row], corners[row])[0][0, index]
            if not (
                20 < expected[0] < image.shape[3] - 20 and 20 < expected[1] < image.shape[2] - 20
            ):
                continue
            weight = image[row, 0] / image[row, 0].sum()
            assert abs(float((weight * columns).sum() - expected[0])) < 0.1
            assert abs(float((weight * rows).sum() - expected[1])) < 0.1
            found += 1
    assert found > 10


def test_masks_keypoints_and_boxes_go_where_kornia_puts_them() -> None:
    def make() -> list[Any]:
        return [
            kornia.RandomRotation(8.0, p=1.0),
            kornia.Resize((180, 200)),
            kornia.RandomErasing(p=1.0),
            kornia.CenterCrop((170, 190)),
        ]

    keys = ["input", "mask", "keypoints", "bbox_xyxy"]
    mask = torch.zeros(3, 1, *HW, dtype=torch.int64)
    mask[..., 40:80, 50:110] = 7
    points, boxes = (
        torch.rand(3, 5, 2) * 60 + 40,
        torch.tensor([[[50.0, 40, 110, 80]]]).expand(3, 1, 4).clone(),
    )
    values = (batch()["image"], mask, points, boxes)
    theirs = seeded(0, lambda: kornia.AugmentationSequential(*make(), data_keys=keys)(*values))
    ours = seeded(0, lambda: CameraAugmentationSequential(*make(), data_keys=keys)(*values))
    assert ours[1].dtype == torch.int64
    assert set(ours[1].unique().tolist()) == {0, 7}
    assert float((ours[1] != theirs[1]).float().mean()) < 0.005  # kornia reads nearest pixels twice
    assert_close(ours[2], theirs[2], atol=1e-3, rtol=0)
    assert_close(ours[3], theirs[3], atol=1e-3, rtol=0)
    flat = seeded(
        0,
        lambda: CameraAugmentationSequential(*make(), data_keys=["input", "mask"])(
            values[0], mask[:, 0]
        ),
    )
    assert torch.equal(flat[1], ours[1][:, 0])


def test_neighbouring_maps_are_one_reading_of_the_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    readings: list[int] = []

    def counted(*args: Any, **options: Any) -> Tensor:
        readings.append(1)
        return warp(*args, **options)

    monkeypatch.setattr("animal3dbox.transforms.kornia_bridge.fusion.warp", counted)
    flip, turn, crop = (
        kornia.RandomHorizontalFlip(p=1.0),
        kornia.RandomRotation(8.0, p=1.0),
        kornia.CenterCrop((90, 100)),
    )
    for ops, expected in (
        ([flip, turn, crop], 1),
        ([flip, kornia.Normalize(0.5, 0.5), turn, kornia.RandomGrayscale(p=1.0), crop], 1),
        ([flip, kornia.RandomEqualize(p=1.0), turn, crop], 2),
        ([kornia.RandomEqualize(p=1.0), kornia.RandomRotation(8.0, p=0.0)], 0),
        ([kornia.CenterCrop(HW)], 0),
    ):
        readings.clear()
        CameraAugmentationSequential(*ops)(batch()["image"])
        assert len(readings) == expected


def test_the_dict_form_keeps_names_and_refuses_those_it_does_not_know() -> None:
    values = batch()
    aug = CameraAugmentationSequential(*PIPELINES["flip, affine, resized crop"](), data_keys=None)
    after = seeded(1, lambda: aug(values))
    assert list(after) == list(values)
    assert after["image"].shape == (3, 3, 100, 90)
    assert not torch.equal(after["K"], values["K"])
    for name in ("intrinsics", "K_left", "cam", "depth"):
        with pytest.raises(ConfigError, match="would be left stale"):
            aug({**values, name: values["K"]})
        with pytest.raises(ConfigError, match="unknown data key"):
            CameraAugmentationSequential(kornia.RandomRotation(3.0), data_keys=["input", name])


def test_params_replay_what_was_drawn() -> None:
    values = batch()
    aug = CameraAugmentationSequential(
        *PIPELINES["flip, affine, resized crop"](), data_keys=["input", "K"]
    )
    first = aug(values["image"], values["K"])
    again = aug(values["image"], values["K"], params=aug._params)
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))


def test_wrong_arguments_get_a_clear_error() -> None:
    values = batch()
    aug = CameraAugmentationSequential(kornia.RandomRotation(3.0), data_keys=["input", "K"])
    for image in (
        values["image"][0],
        values["image"].half(),
        (values["image"] * 255).byte(),
        values["image"][:0],
    ):
        with pytest.raises(ShapeError, match="input must be images"):
            aug(image, values["K"])
    with pytest.raises(ShapeError, match="B = 3"):
        aug(values["image"], values["K"][:2])
    with pytest.raises(ConfigError, match="name each argument once"):
        aug(values["image"])
    with pytest.raises(ConfigError, match="name each argument once"):
        aug(values["image"], values["image"], data_keys=["input", "image"])
    with pytest.raises(ShapeError, match="mask must be"):
        aug(values["image"], values["image"][..., :5], data_keys=["input", "mask"])
    with pytest.raises(SampleError, match="needs the intrinsics"):
        aug(values["image"], values["center"], data_keys=["input", "center"])
    stale = values["K"].clone()
    stale[1, 0, 2] += 3
    with pytest.raises(SampleError, match="picture 1 of the batch: K: is stale"):
        aug(
            values["image"],
            stale,
            values["corners_3d"],
            values["corners_2d"],
            data_keys=["input", "K", "corners_3d", "corners_2d"],
        )


def test_pipelines_that_cannot_say_what_they_do_are_refused() -> None:
    for op in (
        kornia.RandomElasticTransform(),
        kornia.RandomThinPlateSpline(),
        kornia.RandomMixUpV2(),
        kornia.ImageSequential(kornia.RandomRotation(3.0)),
        torch.nn.Identity(),
        kornia.RandomMotionBlur(9, 30.0, 0.8),
    ):
        with pytest.raises(ConfigError):
            CameraAugmentationSequential(kornia.RandomRotation(3.0), op)


def test_mirrors_need_the_other_side_of_each_keypoint_or_are_forbidden() -> None:
    image, points = batch()["image"], torch.rand(3, 4, 2) * 50 + 30
    flip = kornia.RandomHorizontalFlip(p=1.0)
    with pytest.raises(ConfigError, match="give keypoint_mirror"):
        CameraAugmentationSequential(flip, data_keys=["input", "keypoints"])(image, points)
    _, mapped = CameraAugmentationSequential(
        flip, data_keys=["input", "keypoints"], keypoint_mirror=[1, 0, 2, 3]
    )(image, points)
    assert_close(mapped[:, [1, 0, 2, 3], 0], HW[1] - 1 - points[..., 0])
    with pytest.raises(ConfigError, match="RandomHorizontalFlip"):
        CameraAugmentationSequential(flip, mirror="forbid")


def test_skew_is_refused_unless_allowed() -> None:
    values = batch()
    ops = [kornia.RandomShear((9.0, 10.0), p=1.0)]
    with pytest.raises(SampleError, match="skew"):
        CameraAugmentationSequential(*ops, data_keys=["input", "K"])(values["image"], values["K"])
    _, K = CameraAugmentationSequential(*ops, data_keys=["input", "K"], allow_skew=True)(
        values["image"], values["K"]
    )
    assert (K[:, 0, 1].abs() > 1).all()


def test_gradients_reach_the_images_and_dtypes_stay() -> None:
    values = batch(2, torch.float64)
    image = values["image"].requires_grad_()
    aug = CameraAugmentationSequential(
        *PIPELINES["flip, affine, resized crop"](), data_keys=["input", "K"]
    )
    result, K = aug(image, values["K"].float())
    result.sum().backward()
    assert image.grad is not None
    assert float(image.grad.abs().sum()) > 0
    assert (result.dtype, K.dtype) == (torch.float64, torch.float32)


def test_the_fill_lies_outside_the_picture_and_the_scale_of_a_map_does_not_matter() -> None:
    image = batch(1)["image"]
    filled = CameraAugmentationSequential(kornia.PadTo((130, 170)), fill=0.25)(image)
    assert_close(
        filled[..., 120:, :], torch.full_like(filled[..., 120:, :], 0.25), atol=1e-5, rtol=0
    )
    assert_close(filled[..., :120, :160], image, atol=1e-5, rtol=0)
    H = torch.tensor([[[0.9, 0.1, 3], [-0.1, 0.9, 5], [0, 0, 1]]], dtype=torch.float64).numpy()
    assert_close(
        warp(image, 2 * H, HW, interpolation="bilinear", fill=(0.0,)),
        warp(image, H, HW, interpolation="bilinear", fill=(0.0,)),
        atol=1e-6,
        rtol=0,
    )

"""The pixel contract: what the matrices say is where the pixels are.

For every transform, both executors, every interpolation.
"""

from typing import Any

import cv2
import numpy as np
import pytest
import torch
from opencv_version import LEVELS, RAMP_PX
from scenes import F64, target_of
from torch import Tensor

from animal3dbox.geometry.camera import intrinsics
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.homography import apply_homography
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle
from animal3dbox.transforms import (
    CenterCrop,
    Compose,
    LetterBox,
    PadTo,
    PerspectiveCrop,
    RandomAffine,
    RandomHorizontalFlip,
    RandomPerspective,
    RandomResizedCrop,
    RandomRotation,
    RandomVerticalFlip,
    RandomVirtualCamera,
    Resize,
    Transform,
)

HW = (240, 320)
TRANSFORMS: list[Transform] = [
    RandomHorizontalFlip(p=1),
    RandomVerticalFlip(p=1),
    RandomAffine(25, (0.1, 0.1), (0.8, 1.3)),
    RandomAffine(10, shear=15),
    RandomRotation((90, 90)),
    RandomRotation((33, 33)),
    RandomResizedCrop((200, 260), (0.5, 0.9), keep_part=0.9, min_visible=None),
    RandomResizedCrop((150, 150), ratio=(0.7, 1.4), min_visible=None),
    CenterCrop((201, 260)),
    Resize((311, 200)),
    Resize(141),
    Resize((96, 128)),
    Resize((480, 640)),
    LetterBox((300, 301)),
    PadTo((300, 400)),
    PadTo((257, 333), "top_left"),
    RandomVirtualCamera(6, 6, 15, (0.9, 1.2)),
    PerspectiveCrop((240, 240)),
    RandomPerspective(0.2, p=1, allow_skew=True),
]
CHAIN = [
    RandomHorizontalFlip(p=1),
    RandomAffine(20, (0.05, 0.05), (0.8, 1.2)),
    RandomVirtualCamera(4, 4, 10),
    RandomResizedCrop(224, (0.6, 1)),
]
PIPELINES = [*([transform] for transform in TRANSFORMS), CHAIN]
NAMES = [repr(pipeline[0]) if len(pipeline) == 1 else "chain" for pipeline in PIPELINES]


def box_target(dtype: torch.dtype = F64) -> dict[str, Any]:
    """One box whose corners are far apart in the picture; off-centre principal point, fx != fy."""
    K = intrinsics((330.0, 300.0), HW)
    K[0, 2] += 21.3
    K[1, 2] -= 17.8
    turn = rotation_from_axis_angle(torch.tensor([[1.2, 0.5, -0.4]], dtype=F64))
    return target_of(
        Cuboid(
            torch.tensor([[-0.15, 0.1, 3.0]], dtype=F64),
            turn,
            torch.tensor([[1.3, 1.0, 1.1]], dtype=F64),
        ),
        K,
        HW,
        dtype,
    )


def blobs(points_px: Tensor, sigma: float = 6.0) -> np.ndarray:
    """White Gaussians at pixels (M, 2), drawn by their formula, (H, W) in [0, 1]."""
    y, x = np.mgrid[: HW[0], : HW[1]]
    picture = np.zeros(HW)
    for u, v in points_px.tolist():
        picture = np.maximum(picture, np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * sigma**2)))
    return picture


def found(picture: np.ndarray, near: tuple[float, float], reach: int) -> np.ndarray | None:
    """The centre of the brightness round a pixel; None if the window leaves the picture."""
    u, v = (round(value) for value in near)
    if min(u, v) < reach or u + reach >= picture.shape[1] or v + reach >= picture.shape[0]:
        return None
    window = picture[v - reach : v + reach + 1, u - reach : u + reach + 1]
    y, x = np.mgrid[v - reach : v + reach + 1, u - reach : u + reach + 1]
    weight = np.clip(window - 0.02, 0, None)
    center: np.ndarray = np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()
    return center


def run(
    pipeline: list[Any],
    picture: np.ndarray,
    target: dict[str, Any],
    interpolation: str,
    executor: str,
    kind: str,
) -> tuple[np.ndarray, dict[str, Any]]:
    """The augmented picture as (H, W, C) in [0, 1] and its target."""
    compose = Compose(pipeline, interpolation=interpolation, allow_skew=True)
    image = torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))
    image = (image * 255).round().to(torch.uint8) if kind == "uint8" else image.float()
    if executor == "torch":
        images, targets = compose.batch(
            (image[None].expand(2, -1, -1, -1), [target, target]), keys=[(0, 3), (0, 3)]
        )
        result, after = images[1], targets[1]
    else:
        result, after = compose(image, target, key=(0, 3))
    return result.permute(1, 2, 0).double().numpy() / (255 if kind == "uint8" else 1), after


@pytest.mark.parametrize("executor", ["opencv", "torch"])
@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic", "nearest"])
@pytest.mark.parametrize("pipeline", PIPELINES, ids=NAMES)
def test_blobs_at_projected_corners_are_found_at_the_updated_corners(
    pipeline: list[Any], interpolation: str, executor: str
) -> None:
    target = box_target()
    # One blob a picture: neighbours would pull at each other's centres.
    misses = []
    for number in range(8) if interpolation == "nearest" else range(0, 8, 3):
        picture = np.repeat(
            blobs(target["corners_2d"][0, number : number + 1])[..., None], 3, axis=2
        )
        result, after = run(pipeline, picture, target, interpolation, executor, "uint8")
        order = [3, 2, 1, 0, 7, 6, 5, 4] if after["mirrored"] else list(range(8))
        expected = after["corners_2d"][0, order.index(number)].tolist()
        zoom = abs(float(np.linalg.det(after["H_out_in"].numpy()))) ** 0.5
        center = found(
            result[..., 0], (expected[0], expected[1]), int(np.ceil(20 * max(1.0, zoom)))
        )
        if center is not None:
            misses.append(center - expected)
    assert misses
    if (
        interpolation == "nearest"
    ):  # whole rows and columns are read up to half a pixel off, which a single blob shows
        assert np.abs(misses).max() < 0.5 * max(1.0, zoom)
        misses = [np.mean(misses, axis=0)]
    assert np.abs(misses).max() < 0.1, f"off by {misses} px"


def where_read(H_out_in: Tensor, image_hw: tuple[int, int]) -> np.ndarray:
    """The pixel (x, y) of the picture that each pixel of the result shows, (H, W, 2)."""
    v, u = np.mgrid[: image_hw[0], : image_hw[1]]
    made = torch.from_numpy(np.stack((u, v), axis=-1).reshape(-1, 2).astype(float))
    read: np.ndarray = (
        apply_homography(torch.linalg.inv(H_out_in), made).reshape(*image_hw, 2).numpy()
    )
    return read


@pytest.mark.parametrize("executor", ["opencv", "torch"])
@pytest.mark.parametrize("pipeline", PIPELINES, ids=NAMES)
def test_ramps_are_read_where_the_matrix_says(pipeline: list[Any], executor: str) -> None:
    y, x = np.mgrid[: HW[0], : HW[1]]
    picture = np.stack((x / HW[1], y / HW[0], np.ones(HW)), axis=2)
    result, after = run(pipeline, picture, box_target(), "bilinear", executor, "float")
    read = where_read(after["H_out_in"], (result.shape[0], result.shape[1]))
    edge = 6
    inside = ((read > edge) & (read < np.array(HW[::-1]) - 1 - edge)).all(-1)
    assert inside.mean() > 0.2
    got = result[..., :2] * np.array(HW[::-1])
    assert np.abs(got - read)[inside].max() < RAMP_PX


@pytest.mark.parametrize("kind", ["uint8", "float"])
@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic", "nearest"])
@pytest.mark.parametrize("pipeline", PIPELINES, ids=NAMES)
def test_both_executors_agree_within_a_grey_level_away_from_borders(
    pipeline: list[Any], interpolation: str, kind: str
) -> None:
    noise = np.random.default_rng(0).random((*HW, 3))
    picture = (
        noise if interpolation == "nearest" else np.asarray(cv2.GaussianBlur(noise, (0, 0), 0.7))
    )
    one, after = run(pipeline, picture, box_target(), interpolation, "opencv", kind)
    other, again = run(pipeline, picture, box_target(), interpolation, "torch", kind)
    assert after["H_out_in"].tolist() == again["H_out_in"].tolist()
    read = where_read(after["H_out_in"], (one.shape[0], one.shape[1]))
    inside = ((read > 3) & (read < (HW[1] - 4, HW[0] - 4))).all(-1)
    difference = np.abs(one - other)[inside] * 255
    if interpolation == "nearest":  # where a pixel's edge is hit, float32 decides
        assert (difference > 1).mean() < 2e-3
    else:
        assert difference.max() <= LEVELS + 1e-3

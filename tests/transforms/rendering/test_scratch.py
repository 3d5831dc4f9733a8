"""Scratch memory never shows: neither the last picture's pixels, nor the next one's."""

from typing import Any

import cv2
import numpy as np
import pytest
import torch

from animal3dbox.transforms import Compose, Normalize, RandomAffine
from animal3dbox.transforms.rendering.opencv_executor import FLAGS, warp
from animal3dbox.transforms.rendering.sampling import plan_reading
from animal3dbox.transforms.rendering.scratch import MOST_BYTES, SCRATCH

HW, SIZE = (60, 80), (48, 40)


def a_map(rng: np.random.Generator, perspective: float) -> np.ndarray:
    """A turn, zoom and shift, near the picture or beside it, with some perspective."""
    angle, zoom = rng.uniform(-3, 3), np.exp(rng.uniform(-0.6, 1.5))
    a, b = zoom * np.cos(angle), zoom * np.sin(angle)
    H = np.array([[a, -b, 0], [b, a, 0], [*rng.uniform(-perspective, perspective, 2), 1]])
    middle = H @ [40, 30, 1]
    H[:2, 2] = (20, 24) * middle[2:] - middle[:2] + rng.normal(0, 20, 2)
    return H


@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic", "nearest"])
@pytest.mark.parametrize("perspective", [0, 2e-3, 2e-2])
def test_only_what_is_copied_to_four_channels_is_read(
    interpolation: str, perspective: float
) -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (*HW, 3), dtype=np.uint8)
    compared = 0
    for _ in range(60):
        H = a_map(rng, perspective)
        reading = plan_reading(H, HW, SIZE, interpolation)
        if reading.shrink_xy != (1, 1) or reading.horizon:
            continue
        SCRATCH.array("source", (*HW, 4), image.dtype)[:] = 255 - image[..., [0, 1, 2, 2]]
        here = warp(image, H, SIZE, interpolation=interpolation, fill=(7.0,))
        opencv_warp: Any = cv2.warpAffine if reading.affine else cv2.warpPerspective
        whole = opencv_warp(
            cv2.cvtColor(image, cv2.COLOR_RGB2RGBA),
            reading.H_in_out[:2] if reading.affine else reading.H_in_out,
            SIZE[::-1],
            flags=FLAGS[interpolation] | cv2.WARP_INVERSE_MAP,
            borderValue=(7, 7, 7, 7),
        )[..., :3]
        assert (here == whole).all()
        compared += 1
    assert compared >= 20


def test_the_next_picture_leaves_the_last_result_alone() -> None:
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (2, *HW, 3), dtype=np.uint8)
    H = a_map(rng, 2e-3)
    first = warp(images[0], H, SIZE, interpolation="bilinear", fill=(0.0,))
    before = first.copy()
    warp(images[1], H, SIZE, interpolation="bilinear", fill=(0.0,))
    assert (first == before).all()


@pytest.mark.parametrize("steps", [(), (Normalize(),)])
@pytest.mark.parametrize("form", ["planes", "channels_last", "array"])
def test_the_next_sample_leaves_the_last_one_alone(form: str, steps: tuple[Normalize, ...]) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (2, *HW, 3), dtype=np.uint8)
    images: Any = pixels if form == "array" else torch.from_numpy(pixels).permute(0, 3, 1, 2)
    augment = Compose([RandomAffine(10), *steps], channels_last=form == "channels_last")
    first = augment(images[0], key=(0, 0))
    before = np.array(first.tolist())
    augment(images[1], key=(0, 0))
    assert np.array_equal(first.tolist(), before)


def test_large_pictures_keep_no_memory() -> None:
    shape = (MOST_BYTES + 1,)
    large = SCRATCH.array("large", shape, np.dtype(np.uint8))
    assert not np.shares_memory(large, SCRATCH.array("large", shape, np.dtype(np.uint8)))

"""Pictures for transforms, and the comparison of targets."""

from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

HW = (120, 160)


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

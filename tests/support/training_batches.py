"""Batches of targets of made-up scenes, as a training loop gets them."""

from typing import Any

import torch
from scenes import training_target
from torch import Tensor

HW = (240, 320)
Batch = list[dict[str, Any]]


def good_batch(animals: int = 2, size: int = 4, masks: bool = True, seed: int = 0) -> Batch:
    return [training_target(animals, HW, seed + n, masks=masks) for n in range(size)]


def images_of(batch: Batch) -> Tensor:
    return torch.zeros(len(batch), 3, *HW)

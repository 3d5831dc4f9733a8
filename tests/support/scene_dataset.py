"""A Dataset of made-up scenes, importable by spawned workers."""

from typing import Any

import cv2
import kornia.augmentation as kornia
import torch
from scenes import scene
from torch import Tensor
from torch.utils.data import Dataset

from animal3dbox.transforms import (
    ColorJitter,
    Compose,
    RandomErasing,
    RandomGaussianNoise,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomVirtualCamera,
)


class Scenes(Dataset[tuple[Tensor, dict[str, Any]]]):
    """Six scenes under a pipeline, keyed by epoch and index."""

    def __init__(self, epoch: int) -> None:
        self.epoch = epoch
        self.augment = Compose(
            [
                RandomHorizontalFlip(),
                RandomVirtualCamera(5, 5, 10),
                RandomResizedCrop(64, min_visible=None),
                ColorJitter(0.2),
                kornia.RandomHue((-0.1, 0.1), p=0.5),
                RandomGaussianNoise(p=0.5),
                RandomErasing(0.5),
            ],
            seed=5,
        )

    def __len__(self) -> int:
        return 6

    def __getitem__(self, index: int) -> tuple[Tensor, dict[str, Any]]:
        torch.set_num_threads(1)
        cv2.setNumThreads(1)
        image = torch.randint(
            0, 256, (3, 120, 160), dtype=torch.uint8, generator=torch.Generator().manual_seed(index)
        )
        return self.augment(image, scene(index % 3, seed=index), key=(self.epoch, index))

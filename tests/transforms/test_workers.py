"""Pipelines inside DataLoader workers: the same samples however many there are and however they are started."""

from typing import Any

import cv2
import kornia.augmentation as kornia
import pytest
import torch
from scenes import scene
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

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
        image = torch.randint(0, 256, (3, 120, 160), dtype=torch.uint8, generator=torch.Generator().manual_seed(index))
        return self.augment(image, scene(index % 3, seed=index), key=(self.epoch, index))


def samples(epoch: int, **options: Any) -> list[tuple[Tensor, dict[str, Any]]]:
    torch.manual_seed(int(torch.randint(1000, ()).item()))  # nothing may depend on it
    return list(DataLoader(Scenes(epoch), batch_size=None, **options))


def same(one: list[tuple[Tensor, dict[str, Any]]], other: list[tuple[Tensor, dict[str, Any]]]) -> bool:
    return all(
        torch.equal(a[0], b[0]) and all(torch.equal(a[1][name], b[1][name]) for name in a[1] if isinstance(a[1][name], Tensor))
        for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_samples_do_not_depend_on_the_workers_or_how_they_start(start: str) -> None:
    alone = samples(0, num_workers=0)
    assert same(alone, samples(0, num_workers=2, multiprocessing_context=start))
    assert not same(alone, samples(1, num_workers=0))

"""Pipelines inside DataLoader workers.

The same samples however many there are and however they are started.
"""

from typing import Any

import pytest
import torch
from scene_dataset import Scenes
from torch import Tensor
from torch.utils.data import DataLoader


def samples(epoch: int, **options: Any) -> list[tuple[Tensor, dict[str, Any]]]:
    torch.manual_seed(int(torch.randint(1000, ()).item()))  # nothing may depend on it
    return list(DataLoader(Scenes(epoch), batch_size=None, **options))


def same(
    one: list[tuple[Tensor, dict[str, Any]]], other: list[tuple[Tensor, dict[str, Any]]]
) -> bool:
    return all(
        torch.equal(a[0], b[0])
        and all(
            torch.equal(a[1][name], b[1][name]) for name in a[1] if isinstance(a[1][name], Tensor)
        )
        for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_samples_do_not_depend_on_the_workers_or_how_they_start(start: str) -> None:
    alone = samples(0, num_workers=0)
    assert same(alone, samples(0, num_workers=2, multiprocessing_context=start))
    assert not same(alone, samples(1, num_workers=0))

"""EpochSampler over Subset and ConcatDataset, and its state in a checkpoint."""

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loading import augmented, in_bytes, one_by_one
from torch.utils.data import ConcatDataset, DataLoader, Dataset, Subset, TensorDataset

from animal3dbox.datasets import LabelDataset, collate
from animal3dbox.errors import ConfigError
from animal3dbox.training import EpochSampler

Wrap = Callable[[LabelDataset], Dataset[Any]]
WRAPPERS: dict[str, tuple[Wrap, list[int]]] = {
    "subset": (lambda inner: Subset(inner, [6, 1, 3, 4]), [6, 1, 3, 4]),
    "subset of a subset": (lambda inner: Subset(Subset(inner, [7, 5, 2, 0]), [3, 1]), [0, 5]),
    "concatenation of subsets": (
        lambda inner: ConcatDataset([Subset(inner, [2, 7]), Subset(inner, [4])]),
        [2, 7, 4],
    ),
    "subset of a concatenation": (
        lambda inner: Subset(ConcatDataset([inner, Subset(inner, [5, 0])]), [8, 1, 9]),
        [5, 1, 0],
    ),
}
"""Each with the indices of its samples in the Dataset inside."""


def drawn(loader: Any) -> list[Any]:
    """The samples of an iteration, as bytes."""
    return [in_bytes(sample) for sample in one_by_one(loader)]


@pytest.mark.parametrize("name", WRAPPERS)
@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.process)])
def test_wrapped_datasets_give_the_samples_of_each_epoch(
    animals: Path, name: str, workers: int
) -> None:
    wrap, inside = WRAPPERS[name]
    plain, inner = augmented(animals), augmented(animals)
    wrapped = wrap(inner)
    sampler = EpochSampler(wrapped, seed=2)  # type: ignore[arg-type]
    loader = DataLoader(
        wrapped,
        batch_size=2,
        sampler=sampler,
        collate_fn=collate,
        num_workers=workers,
        persistent_workers=workers > 0,
    )
    orders = []
    for epoch in (4, 0, 5):
        sampler.set_epoch(epoch)
        orders.append(list(sampler))
        assert drawn(loader) == [in_bytes(plain[epoch, inside[place]]) for place in orders[-1]]
    assert len({tuple(order) for order in orders}) > 1 or len(inside) < 3


def test_a_dataset_without_epochs_may_be_wrapped() -> None:
    numbers: Any = Subset(TensorDataset(), [])
    assert list(EpochSampler(numbers)) == []
    assert sorted(EpochSampler(Subset(range(9), [3, 4]))) == [0, 1]  # type: ignore[arg-type]


def test_processes_that_share_a_dataset_have_epochs_of_their_own(animals: Path) -> None:
    inner = augmented(animals)
    of_ranks = [copy.copy(inner) for _ in range(2)]  # they share its epoch's memory
    samplers = [
        EpochSampler(Subset(one, [0, 1]), rank=rank, world_size=2)
        for rank, one in enumerate(of_ranks)
    ]
    for epoch, sampler in enumerate(samplers):
        sampler.set_epoch(epoch + 3)
        list(sampler)
    assert [one.epoch for one in (*of_ranks, inner)] == [3, 4, 0]


@pytest.mark.parametrize("name", [*WRAPPERS, "not wrapped"])
def test_a_checkpoint_in_the_middle_of_an_epoch_is_resumed_exactly(
    animals: Path, name: str
) -> None:
    wrap = WRAPPERS[name][0] if name in WRAPPERS else (lambda inner: inner)
    wrapped: Any = wrap(augmented(animals))
    sampler = EpochSampler(wrapped, seed=2)
    loader = DataLoader(wrapped, sampler=sampler, collate_fn=collate)
    sampler.set_epoch(6)
    whole = drawn(loader)
    state = json.loads(json.dumps(sampler.state_dict(done=1)))
    fresh: Any = wrap(augmented(animals))
    resumed = EpochSampler(fresh, seed=2)
    resumed.load_state_dict(state)
    assert len(resumed) == len(whole) - 1
    assert drawn(DataLoader(fresh, sampler=resumed, collate_fn=collate)) == whole[1:]
    later = resumed.state_dict(done=len(whole))
    resumed.load_state_dict(later)
    assert list(resumed) == []  # the epoch is over
    resumed.set_epoch(7)
    sampler.set_epoch(7)
    assert list(resumed) == list(sampler)


def test_one_state_serves_every_rank() -> None:
    samplers = [EpochSampler(range(11), seed=3, rank=rank, world_size=3) for rank in range(3)]
    for sampler in samplers:
        sampler.set_epoch(2)
    wholes = [list(sampler) for sampler in samplers]
    state = samplers[0].state_dict(done=2)
    assert all(sampler.state_dict(done=2) == state for sampler in samplers)
    for sampler, whole in zip(samplers, wholes, strict=True):
        sampler.load_state_dict(state)
        assert list(sampler) == whole[2:]


def test_how_much_is_done_must_be_said_while_an_epoch_is_under_way() -> None:
    sampler = EpochSampler(range(5))
    sampler.set_epoch(1, start=2)
    assert sampler.state_dict()["start"] == 2
    iterator = iter(sampler)
    next(iterator)
    with pytest.raises(ConfigError, match="say how many samples"):
        sampler.state_dict()
    for done in (-1, 6):
        with pytest.raises(ConfigError, match="done must lie in 0 to 5"):
            sampler.state_dict(done)
    assert sampler.state_dict(done=3)["start"] == 3


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("size", EpochSampler(range(6))),
        ("seed", EpochSampler(range(5), seed=1)),
        ("shuffle", EpochSampler(range(5), shuffle=False)),
        ("world_size", EpochSampler(range(5), world_size=2)),
        ("drop_last", EpochSampler(range(5), drop_last=True)),
    ],
)
def test_the_state_of_another_order_is_refused(name: str, other: EpochSampler) -> None:
    with pytest.raises(ConfigError, match=f"with {name} .*samples would be others"):
        EpochSampler(range(5)).load_state_dict(other.state_dict())


def test_places_in_an_epoch_are_whole_numbers() -> None:
    sampler = EpochSampler(range(5))
    for number in (2.5, None, "2", True):
        with pytest.raises(ConfigError, match="start must be a whole number"):
            sampler.set_epoch(0, start=number)  # type: ignore[arg-type]
        with pytest.raises(ConfigError, match="epoch must be a whole number"):
            sampler.set_epoch(number)  # type: ignore[arg-type]
        for name in ("epoch", "start"):
            with pytest.raises(ConfigError, match=f"{name} must be a whole number"):
                sampler.load_state_dict({**sampler.state_dict(), name: number})
        if number is not None:
            with pytest.raises(ConfigError, match="done must be a whole number"):
                sampler.state_dict(done=number)  # type: ignore[arg-type]
    without_start = sampler.state_dict()
    del without_start["start"]
    with pytest.raises(ConfigError, match="start must be a whole number, got None"):
        sampler.load_state_dict(without_start)
    assert sampler.state_dict(done=np.int64(2))["start"] == 2  # type: ignore[arg-type]

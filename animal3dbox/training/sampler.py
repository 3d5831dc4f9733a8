"""The order in which an epoch takes its samples: the same in every run, and from any point on."""

from collections.abc import Iterator, Sized
from typing import Any

import numpy as np
from torch.utils.data import ConcatDataset, Sampler, Subset

from animal3dbox.errors import ConfigError


class EpochSampler(Sampler[Any]):
    """The order of an epoch as pairs (epoch, index), which LabelDataset takes as they are.

    The epoch travels with the index, so that persistent workers need no other way to learn of it.
    torch's Subset and ConcatDataset, nested in any way, take no pairs: of these there are plain
    indices, and each Dataset inside that has a set_epoch is told the epoch when an iteration
    begins, through its shared memory. With several processes it gets an epoch of its own in each,
    so that none runs ahead of another. Order and indices are a function of (seed, epoch, rank,
    world_size) alone.

    Args:
        dataset: what is loaded from: a Dataset that takes (epoch, index), as LabelDataset does, or
            a Subset or ConcatDataset of any.
        shuffle: whether an epoch is shuffled.
        seed: of the shuffling.
        rank: of this process among world_size; each takes its own part.
        world_size: processes that train together.
        drop_last: leave out the samples that do not divide among the processes; else the first are
            taken twice.

    Example:
        >>> sampler = EpochSampler(range(4), seed=0)
        >>> sampler.set_epoch(3, start=2)  # as after a crash in the middle of epoch 3
        >>> len(sampler), sorted(index for _, index in sampler)
        (2, [0, 3])
        >>> again = EpochSampler(range(4), seed=0)
        >>> again.load_state_dict(sampler.state_dict(done=3))
        >>> list(again)
        [(3, 3)]
    """

    def __init__(
        self,
        dataset: Sized,
        *,
        shuffle: bool = True,
        seed: int = 0,
        rank: int = 0,
        world_size: int = 1,
        drop_last: bool = False,
    ) -> None:
        if world_size < 1 or not 0 <= rank < world_size:
            raise ConfigError(
                f"rank must lie in 0 to world_size - 1, got rank {rank} of {world_size}"
            )
        if seed < 0:
            raise ConfigError(f"seed must not be negative, got {seed}")
        self.size, self.shuffle, self.seed = len(dataset), shuffle, seed
        self.rank, self.world_size, self.drop_last = rank, world_size, drop_last
        self.epoch, self.start, self._is_under_way = 0, 0, False
        self._is_wrapped = isinstance(dataset, Subset | ConcatDataset)
        self._inner = list(_with_epochs(dataset)) if self._is_wrapped else []
        if world_size > 1:
            for inner in self._inner:
                if hasattr(inner, "own_epoch"):
                    inner.own_epoch()

    def set_epoch(self, epoch: int, start: int = 0) -> None:
        """Choose the epoch that the next iteration takes.

        Args:
            epoch: its number, from 0.
            start: samples of this process that have been trained on already, as after a crash:
                batches done x batch size. Count the batches that the training loop has finished,
                not those that workers have loaded ahead.

        Raises:
            ConfigError: out of range, or no whole number.

        """
        _check_whole(epoch=epoch, start=start)
        if epoch < 0 or not 0 <= start <= self.samples:
            raise ConfigError(
                f"epoch must not be negative and start lie in 0 to {self.samples}, got epoch"
                f" {epoch}, start {start}"
            )
        self.epoch, self.start, self._is_under_way = epoch, start, False

    def state_dict(self, done: int | None = None) -> dict[str, Any]:
        """What a checkpoint needs to go on at this point: the same for every rank.

        Args:
            done: samples of this process that the training loop has finished in this epoch, those
                of before a resumption too: batches done x batch size. The sampler does not know it:
                workers are given samples ahead. It may be left out before the epoch's iteration
                has begun.

        Returns:
            Plain numbers.

        Raises:
            ConfigError: out of range, no whole number, or left out while an epoch is under way.

        """
        if done is None and self._is_under_way:
            raise ConfigError(
                "an epoch is under way: say how many samples of this process are done,"
                " state_dict(done=batches_done * batch_size), since workers load ahead"
            )
        start = self.start if done is None else done
        _check_whole(done=start)
        if not 0 <= start <= self.samples:
            raise ConfigError(f"done must lie in 0 to {self.samples}, got {start}")
        return {"epoch": self.epoch, "start": start, **self._order()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on where a state_dict was taken: the next iteration takes the rest of its epoch.

        Raises:
            ConfigError: the state is of another order: of another seed or number of samples or
                processes; or its epoch or start is missing, no whole number or out of range.

        """
        for name, value in self._order().items():
            if state.get(name) != value:
                raise ConfigError(
                    f"the state is of a sampler with {name} {state.get(name)!r}, this one has"
                    f" {value!r}: its samples would be others"
                )
        place = {name: state.get(name) for name in ("epoch", "start")}
        _check_whole(**place)
        self.set_epoch(state["epoch"], state["start"])

    def _order(self) -> dict[str, Any]:
        """What the order of an epoch depends on, the rank aside."""
        return {
            "size": self.size,
            "shuffle": self.shuffle,
            "seed": self.seed,
            "world_size": self.world_size,
            "drop_last": self.drop_last,
        }

    @property
    def samples(self) -> int:
        """Samples of a whole epoch for this process."""
        return self.size // self.world_size if self.drop_last else -(-self.size // self.world_size)

    def __len__(self) -> int:
        """Samples that the next iteration takes."""
        return self.samples - self.start

    def __iter__(self) -> Iterator[Any]:
        self._is_under_way = True
        for inner in self._inner:
            inner.set_epoch(self.epoch)
        order = (
            np.random.default_rng([self.seed, self.epoch]).permutation(self.size)
            if self.shuffle
            else np.arange(self.size)
        )
        whole = np.resize(order, self.samples * self.world_size) if self.size else order
        for index in whole[self.rank :: self.world_size][self.start :].tolist():
            yield index if self._is_wrapped else (self.epoch, index)


def _check_whole(**numbers: Any) -> None:
    """Raise a ConfigError that names the first of some numbers that is no whole one."""
    for name, number in numbers.items():
        if isinstance(number, bool) or not isinstance(number, int | np.integer):
            raise ConfigError(f"{name} must be a whole number, got {number!r}")


def _with_epochs(dataset: Any) -> Iterator[Any]:
    """The Datasets inside Subsets and ConcatDatasets that can be told the epoch."""
    if isinstance(dataset, Subset):
        yield from _with_epochs(dataset.dataset)
    elif isinstance(dataset, ConcatDataset):
        for part in dataset.datasets:
            yield from _with_epochs(part)
    elif hasattr(dataset, "set_epoch"):
        yield dataset

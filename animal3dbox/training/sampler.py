"""The order in which an epoch takes its samples: the same in every run, and from any point on."""

from collections.abc import Iterator, Sized

import numpy as np
from torch.utils.data import Sampler

from animal3dbox.errors import ConfigError


class EpochSampler(Sampler[tuple[int, int]]):
    """The order of an epoch as pairs (epoch, index), which LabelDataset takes as they are.

    The epoch travels with the index, so that persistent workers need no other way to learn of it.
    Order and pairs are a function of (seed, epoch, rank, world_size) alone.

    Args:
        dataset: anything with a length; what it is loaded from must take (epoch, index), as
            LabelDataset does and torch's Subset does not.
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
        self.epoch, self.start = 0, 0

    def set_epoch(self, epoch: int, start: int = 0) -> None:
        """Choose the epoch that the next iteration takes.

        Args:
            epoch: its number, from 0.
            start: samples of this process that have been trained on already, as after a crash:
                batches done x batch size. Count the batches that the training loop has finished,
                not those that workers have loaded ahead.

        Raises:
            ConfigError: out of range.

        """
        if epoch < 0 or not 0 <= start <= self.samples:
            raise ConfigError(
                f"epoch must not be negative and start lie in 0 to {self.samples}, got epoch"
                f" {epoch}, start {start}"
            )
        self.epoch, self.start = epoch, start

    @property
    def samples(self) -> int:
        """Samples of a whole epoch for this process."""
        return self.size // self.world_size if self.drop_last else -(-self.size // self.world_size)

    def __len__(self) -> int:
        """Samples that the next iteration takes."""
        return self.samples - self.start

    def __iter__(self) -> Iterator[tuple[int, int]]:
        order = (
            np.random.default_rng([self.seed, self.epoch]).permutation(self.size)
            if self.shuffle
            else np.arange(self.size)
        )
        whole = np.resize(order, self.samples * self.world_size) if self.size else order
        for index in whole[self.rank :: self.world_size][self.start :].tolist():
            yield self.epoch, index

"""Products with a model's large constants, as arrays.

Each row of one is the same in any company, in any process.

Neither library's matrix product will do. NumPy shares a large one among threads of its own, which
make it a hundred times slower where a loader's workers have every core busy. torch's depends on
what its user has set (autocast, the precision of float32 products), and both round a row
differently by how many others there are. torch's weighted sums of a table's rows (embedding_bag) do
neither: each sum is one thread's, in order. They are fast in float32 only, and for rows of some
length.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import torch
from scipy.sparse import csr_array
from torch.nn.functional import embedding_bag

from animal3dbox.geometry.arrays import transposed

SPARSE_BELOW = 0.3
"""Share of a row that is not zero up to which float64 is faster as a sparse matrix."""
BLOCK = 64
"""Numbers of a row that are kept, or left out, together."""


class RowTable(Protocol):
    """Rows (K, C, V) that weighted sums are taken of."""

    def sums(self, weights: np.ndarray) -> np.ndarray:
        """The sums (N, C, V) of the rows with weights (N, K), in the rows' type."""
        ...


def row_table(rows: np.ndarray, at_once: int) -> RowTable:
    """The table of rows (K, C, V) that is fastest for their type, and for so many sums at once."""
    return BlockTable.of(rows, at_once) if rows.dtype == np.float32 else SplitTable.of(rows)


@dataclass(frozen=True)
class SplitTable:
    """Rows of any type; those that are mostly zero apart from the others.

    Attributes:
        full: (F, C V) of the rows.
        few: (C V, S) the other rows, as columns.
        is_few: (K,) which these are.
        shape: C and V.
    """

    full: np.ndarray
    few: csr_array
    is_few: np.ndarray
    shape: tuple[int, ...]

    @classmethod
    def of(cls, rows: np.ndarray) -> "SplitTable":
        """From whole rows (K, C, V)."""
        flat = rows.reshape(len(rows), -1)
        is_few = np.count_nonzero(flat, axis=1) < SPARSE_BELOW * flat.shape[1]
        return cls(flat[~is_few], csr_array(flat[is_few].T), is_few, rows.shape[1:])

    def sums(self, weights: np.ndarray) -> np.ndarray:
        """As RowTable says."""
        few = transposed(self.few @ weights[:, self.is_few].T) if self.is_few.any() else None
        if few is not None and self.is_few.all():
            return few.reshape(len(weights), *self.shape)
        sums = np.empty((len(weights), self.full.shape[1]), self.full.dtype)
        for row, into in zip(np.ascontiguousarray(weights[:, ~self.is_few]), sums, strict=True):
            np.einsum("k,km->m", row, self.full, out=into)
        if few is not None:
            sums += few
        return sums.reshape(len(weights), *self.shape)


@dataclass(frozen=True)
class BlockTable:
    """Rows of float32, cut into blocks of which those without any number are left out.

    Attributes:
        blocks: (B, BLOCK), by their place in the rows, and of one place by their row.
        rows: (B,) each block's row.
        starts: (P,) the first block of each place; the places of each of the C end with one that is
            filled up with zeros.
        shape: C and V.
        at_once: sums taken in one call; what says where they are is kept for so many.
    """

    blocks: np.ndarray
    rows: np.ndarray
    starts: np.ndarray
    shape: tuple[int, int]
    at_once: int

    @classmethod
    def of(cls, rows: np.ndarray, at_once: int) -> "BlockTable":
        """From whole rows (K, C, V)."""
        count, parts, length = rows.shape
        filled = np.pad(rows, ((0, 0), (0, 0), (0, -length % BLOCK)))
        blocks = filled.reshape(count, -1, BLOCK).swapaxes(0, 1)
        kept = blocks.any(2)
        counts = kept.sum(1)
        return cls(
            blocks[kept],
            np.argwhere(kept)[:, 1],
            np.cumsum(counts) - counts,
            (parts, length),
            at_once,
        )

    def sums(self, weights: np.ndarray) -> np.ndarray:
        """As RowTable says."""
        count, (parts, length) = len(weights), self.shape
        factors = weights.astype(np.float32, copy=False).take(
            self.rows, 1, mode="wrap"
        )  # faster: no row is out of bounds
        pieces = [np.empty((0, BLOCK), np.float32)]
        for k in range(0, count, self.at_once):
            some = factors[k : k + self.at_once]
            pieces.append(
                _weighted_sums(
                    self.blocks,
                    self._ids[: some.size],
                    self._starts[: len(some) * len(self.starts)],
                    some.reshape(-1),
                )
            )
        sums = pieces[1] if len(pieces) == 2 else np.concatenate(pieces)
        return sums.reshape(count, parts, len(self.starts) // parts * BLOCK)[..., :length]

    @cached_property
    def _ids(self) -> np.ndarray:
        """All blocks, at_once times."""
        return np.tile(np.arange(len(self.blocks), dtype=np.int32), self.at_once)

    @cached_property
    def _starts(self) -> np.ndarray:
        return (
            (self.starts + len(self.blocks) * np.arange(self.at_once)[:, None])
            .astype(np.int32)
            .reshape(-1)
        )


def _weighted_sums(
    table: np.ndarray, ids: np.ndarray, starts: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Sums (N, M) of a table's rows (K, M), float32: the n-th of the rows ids[starts[n]], ...

    Up to the next start, each times its weight.
    """
    rows, values, offsets, factors = (
        torch.from_numpy(part) for part in (ids, table, starts, weights)
    )
    return embedding_bag(rows, values, offsets, mode="sum", per_sample_weights=factors).numpy()

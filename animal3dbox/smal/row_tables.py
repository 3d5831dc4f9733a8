"""Weighted sums of a model's large constants: tables of rows, most of whose numbers are zero.

A sum has the same bits whatever other sums it is taken with, in any process. Their time is the
better part of benchmarks/lbs.py.

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
"""The share of a row's numbers other than zero up to which float64 is faster as a sparse matrix."""
BLOCK = 64
"""How many numbers of a row are stored, or left out, together."""


class RowTable(Protocol):
    """A table of rows (K, C, V) of which weighted sums are taken."""

    def sums(self, weights: np.ndarray) -> np.ndarray:
        """The sums (N, C, V) of the rows with weights (N, K), in the rows' type."""
        ...


def row_table(rows: np.ndarray, at_once: int) -> RowTable:
    """The table of rows (K, C, V) that is fastest for their type, and for so many sums at once."""
    return BlockTable.of(rows, at_once) if rows.dtype == np.float32 else SplitTable.of(rows)


@dataclass(frozen=True)
class SplitTable:
    """Rows of any type, of which those that are mostly zero are stored as a sparse matrix.

    Attributes:
        full: (F, C V) the rows with many numbers.
        sparse: (C V, S) the other rows, as columns.
        is_sparse: (K,) which rows these are.
        shape: C and V.
    """

    full: np.ndarray
    sparse: csr_array
    is_sparse: np.ndarray
    shape: tuple[int, ...]

    @classmethod
    def of(cls, rows: np.ndarray) -> "SplitTable":
        """The table of rows (K, C, V)."""
        flat = rows.reshape(len(rows), -1)
        is_sparse = np.count_nonzero(flat, axis=1) < SPARSE_BELOW * flat.shape[1]
        return cls(flat[~is_sparse], csr_array(flat[is_sparse].T), is_sparse, rows.shape[1:])

    def sums(self, weights: np.ndarray) -> np.ndarray:
        """The sums (N, C, V) of the rows with weights (N, K)."""
        sparse = None
        if self.is_sparse.any():
            sparse = transposed(self.sparse @ weights[:, self.is_sparse].T)
            if self.is_sparse.all():
                return sparse.reshape(len(weights), *self.shape)
        sums = np.empty((len(weights), self.full.shape[1]), self.full.dtype)
        full_weights = np.ascontiguousarray(weights[:, ~self.is_sparse])
        for row, into in zip(full_weights, sums, strict=True):
            np.einsum("k,km->m", row, self.full, out=into)
        if sparse is not None:
            sums += sparse
        return sums.reshape(len(weights), *self.shape)


@dataclass(frozen=True)
class BlockTable:
    """Rows of float32, cut into blocks of which those that are all zero are left out.

    Attributes:
        blocks: (B, BLOCK), by their place in the rows, and of one place by their row.
        rows: (B,) each block's row.
        starts: (P,) the first block of each place; the places of each of the C end with one that is
            filled up with zeros.
        shape: C and V.
        at_once: how many sums are taken in one call; the indices are prepared for so many.
    """

    blocks: np.ndarray
    rows: np.ndarray
    starts: np.ndarray
    shape: tuple[int, int]
    at_once: int

    @classmethod
    def of(cls, rows: np.ndarray, at_once: int) -> "BlockTable":
        """The table of rows (K, C, V), prepared for so many sums in a call."""
        count, parts, length = rows.shape
        filled = np.pad(rows, ((0, 0), (0, 0), (0, -length % BLOCK)))
        blocks = filled.reshape(count, -1, BLOCK).swapaxes(0, 1)
        stored = blocks.any(2)
        counts = stored.sum(1)
        return cls(
            blocks[stored],
            np.argwhere(stored)[:, 1],
            np.cumsum(counts) - counts,
            (parts, length),
            at_once,
        )

    def sums(self, weights: np.ndarray) -> np.ndarray:
        """The sums (N, C, V) of the rows with weights (N, K)."""
        count, (parts, length) = len(weights), self.shape
        # mode="wrap" is faster, and no row is out of bounds
        factors = weights.astype(np.float32, copy=False).take(self.rows, 1, mode="wrap")
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
        """The indices of all blocks, at_once times over."""
        return np.tile(np.arange(len(self.blocks), dtype=np.int32), self.at_once)

    @cached_property
    def _starts(self) -> np.ndarray:
        """The first block of each place, at_once times over, as indices into _ids."""
        starts = self.starts + len(self.blocks) * np.arange(self.at_once)[:, None]
        return starts.astype(np.int32).reshape(-1)


def _weighted_sums(
    table: np.ndarray, ids: np.ndarray, starts: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Weighted sums (N, M) of a table's rows (K, M), float32.

    The n-th is of the rows ids[starts[n]] up to the one before ids[starts[n + 1]], each times its
    weight.
    """
    rows, values, offsets, factors = (
        torch.from_numpy(part) for part in (ids, table, starts, weights)
    )
    return embedding_bag(rows, values, offsets, mode="sum", per_sample_weights=factors).numpy()

import numpy as np
import pytest
import torch
from numpy.typing import DTypeLike

from animal3dbox.smal.row_tables import BLOCK, BlockTable, SplitTable, row_table

SHAPES = [(1, 1, 1), (7, 3, BLOCK), (7, 3, BLOCK + 1), (40, 2, 3 * BLOCK - 1)]


def rows_of(shape: tuple[int, int, int], dtype: DTypeLike) -> np.ndarray:
    """Rows of which some are whole, some a few numbers in one place, one nothing."""
    rng = np.random.default_rng(sum(shape))
    rows = rng.standard_normal(shape).astype(dtype)
    for k in range(0, shape[0], 3):
        kept = slice(k, k + shape[2] // 5 + 1)
        rows[k] = np.where(np.isin(np.arange(shape[2]), np.arange(shape[2])[kept]), rows[k], 0)
    if len(rows) > 2:
        rows[2] = 0
    return rows


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("count", [0, 1, 5, 9])  # 9: more than at once
def test_sums_are_the_matrix_product(
    shape: tuple[int, int, int], dtype: DTypeLike, count: int
) -> None:
    rows = rows_of(shape, dtype)
    weights = np.random.default_rng(count).standard_normal((count, len(rows)))
    sums = row_table(rows, 4).sums(weights)
    assert sums.dtype == dtype
    assert sums.shape == (count, *shape[1:])
    np.testing.assert_allclose(
        sums,
        np.tensordot(weights, rows.astype(np.float64), 1),
        atol=1e-5 if dtype == np.float32 else 1e-12,
    )


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_sum_does_not_depend_on_its_company_or_on_torchs_settings(
    dtype: DTypeLike, threads: int
) -> None:
    rows = rows_of((40, 3, 500), dtype)
    weights = np.random.default_rng(0).standard_normal((13, 40))
    table = row_table(rows, 4)
    together, before, precision = (
        table.sums(weights),
        torch.get_num_threads(),
        torch.get_float32_matmul_precision(),
    )
    try:
        torch.set_num_threads(threads)
        torch.set_float32_matmul_precision("medium")
        with torch.autocast("cpu"):
            apart = [
                row_table(rows, 12).sums(weights[k : k + n])
                for n in (1, 2, 5)
                for k in range(0, 13, n)
            ]
    finally:
        torch.set_num_threads(before)
        torch.set_float32_matmul_precision(precision)
    np.testing.assert_array_equal(np.concatenate(apart), np.concatenate([together] * 3))


def test_what_is_zero_is_not_kept() -> None:
    rows = np.zeros((5, 3, 4 * BLOCK), np.float32)
    rows[1, 2, 2 * BLOCK + 7] = 1
    rows[4, 0] = 1
    assert len(BlockTable.of(rows, 1).blocks) == 5
    assert SplitTable.of(rows).sparse.shape == (rows[0].size, 4)


def test_rows_without_any_number_have_sums_of_zero() -> None:
    for dtype in (np.float32, np.float64):
        assert not row_table(np.zeros((2, 3, 9), dtype), 3).sums(np.ones((4, 2))).any()

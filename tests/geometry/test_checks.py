import numpy as np
import pytest
import torch

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.checks import check_finite


@pytest.mark.parametrize("count", [3, 1000])
@pytest.mark.parametrize(
    "bad", [[np.nan], [np.inf], [-np.inf], [np.inf, -np.inf], [np.nan, np.inf]]
)
def test_every_number_that_is_not_finite_is_found_and_counted(count: int, bad: list[float]) -> None:
    values = np.zeros(count)
    values[-len(bad) :] = bad
    for array in (values, torch.from_numpy(values), values.astype(np.float32)):
        with pytest.raises(
            ShapeError, match=f"x must be finite, but {len(bad)} of its {count} values"
        ):
            check_finite("x", array)


@pytest.mark.parametrize("count", [0, 3, 1000])
def test_finite_numbers_pass_however_large(count: int) -> None:
    for array in (
        np.full(count, 1e308),
        torch.full((count,), -3e38),
        np.zeros(count, np.int64),
        np.ones(count, np.bool_),
    ):
        check_finite("x", array)

"""Batches that worker processes make: their errors are those of the process that asked."""

import pytest
from torch.utils.data import Dataset

from animal3dbox.cli.worker_batches import worker_batches
from animal3dbox.errors import DatasetFormatError


class ChangedFile(Dataset[int]):
    """A dataset whose second batch meets a file that was changed."""

    def __len__(self) -> int:
        return 2

    def __getitem__(self, place: int) -> int:
        if place:
            raise DatasetFormatError("a.json: has been changed: open the dataset anew")
        return place


@pytest.mark.parametrize("workers", [0, 1])
def test_an_error_of_a_worker_is_one_line(workers: int) -> None:
    with (
        pytest.raises(DatasetFormatError) as caught,
        worker_batches(ChangedFile(), workers, "--resume") as batches,
    ):
        list(batches)
    assert str(caught.value) == "a.json: has been changed: open the dataset anew"

"""Batches of targets: where their tensors are moved to."""

import copy

import pytest
import torch

from animal3dbox.datasets import Skipped
from animal3dbox.datasets.batches import Targets
from animal3dbox.errors import ConfigError


def _batch() -> Targets:
    target = {
        "size": torch.ones(2, 3),
        "labels": torch.tensor([0, 1]),
        "face_visible": torch.zeros(2, 6, dtype=torch.bool),
        "masks": torch.zeros(2, 4, 5, dtype=torch.uint8),
        "image_id": "a.jpg",
        "meta": {"sample_ids": ["a", "b"], "draws": [torch.ones(1), "flip"], "sample_key": (0, 3)},
    }
    return Targets(
        [target, {"size": torch.zeros(0, 3), "image_id": "b.jpg"}], [Skipped(7, "c", ())]
    )


def test_every_tensor_of_a_batch_moves_and_nothing_else_changes() -> None:
    batch = _batch()
    moved = batch.to("meta", non_blocking=True)
    assert type(moved) is Targets
    assert moved.skipped == batch.skipped
    first, second = moved
    names = ("size", "labels", "face_visible", "masks")
    assert {first[name].device.type for name in names} == {"meta"}
    assert second["size"].device.type == first["meta"]["draws"][0].device.type == "meta"
    assert first["image_id"] == "a.jpg"
    assert first["meta"]["sample_ids"] == ["a", "b"]
    assert first["meta"]["draws"][1] == "flip"
    assert first["meta"]["sample_key"] == (0, 3)
    assert batch[0]["size"].device.type == "cpu"  # the batch itself stays where it was


def test_a_dtype_is_for_numbers_with_a_point_alone() -> None:
    moved = _batch().to(dtype=torch.float64)
    kinds = [moved[0][name].dtype for name in ("size", "labels", "face_visible", "masks")]
    assert kinds == [torch.float64, torch.int64, torch.bool, torch.uint8]
    assert moved[1]["size"].dtype == torch.float64


def test_what_is_there_already_is_not_copied() -> None:
    batch = _batch()
    moved = batch.to("cpu")
    assert moved[0]["size"] is batch[0]["size"]
    assert moved[0] is not batch[0]
    assert copy.deepcopy(moved)[0]["image_id"] == "a.jpg"


def test_a_type_may_stand_first_and_must_be_of_floating_point() -> None:
    batch = _batch()
    for moved in (batch.to(torch.float16), batch.to("cpu", torch.float16)):
        kinds = {one.dtype for one in moved[0].values() if isinstance(one, torch.Tensor)}
        assert torch.float16 in kinds
        assert torch.float32 not in kinds
    for wrong in (torch.int32, torch.bool, torch.complex64):
        with pytest.raises(ConfigError, match=f"floating point, .* got {wrong}"):
            batch.to(dtype=wrong)
        with pytest.raises(ConfigError, match="floating point"):
            batch.to(wrong)
    with pytest.raises(ConfigError, match="dtype is given twice"):
        batch.to(torch.float16, torch.float32)

"""A sample whose label is in the cache.

What is not read for it, and that its fields are its own.
"""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from loading import in_bytes
from small_animals import model_of, small_dataset

from animal3dbox.datasets import LabelDataset
from animal3dbox.datasets.batches import Targets
from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.labelling.file_source import FileSource
from animal3dbox.datasets.labelling.label_codec import packed_outcome, unpacked_outcome
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.storage.codec import Codec
from animal3dbox.datasets.storage.packed import PackedList
from animal3dbox.labels.types import CuboidLabel, Rejection


def labels_of(dataset: LabelDataset) -> list[Any]:
    """Targets as bytes."""
    return [in_bytes(dataset[i][1]) for i in range(len(dataset))]  # type: ignore[index]


def test_records_stay_packed_where_labels_are_in_the_cache(
    animals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = labels_of(small_dataset(animals, cache=tmp_path))
    dataset = small_dataset(animals, cache=tmp_path)

    def refused(*_: object, **__: object) -> None:
        raise AssertionError("a record was unpacked")

    monkeypatch.setattr(PackedList, "unpacked", refused)
    assert labels_of(dataset) == before


def test_the_index_says_what_records_say(animals: Path) -> None:
    source = small_dataset(animals).source
    for index in range(len(source)):
        sample = source.sample(index)
        assert len(sample.animals) == len(sample.records) == source.animals(index)
        for number, (entry, record) in enumerate(zip(sample.animals, sample.records, strict=True)):
            assert (entry.sample_id, entry.category, entry.image_hw) == (
                record.sample_id,
                record.category,
                record.image_hw,
            )
            assert record.image_id == sample.image_id
            assert str(record.image_path) == sample.image_path
            assert entry.vocabulary is record.vocabulary  # type: ignore[union-attr]
            assert np.array_equal(sample.mask(number), record.mask)  # type: ignore[union-attr,arg-type]


def test_parameters_that_are_replaced_while_they_are_used_get_new_labels(
    animals: Path, tmp_path: Path
) -> None:
    read = read_dataset(animals, options=ReadOptions(model=model_of(animals)))
    assert isinstance(read.bodies, ParametersBody)
    parameters = dict(read.bodies.parameters)
    dataset = LabelDataset(
        FileSource(read.records, ParametersBody(read.bodies.model, parameters)),
        stored_cameras="exact",
        cache=tmp_path,
    )
    before = dataset[0][1]["size"]  # type: ignore[index]
    for name, one in parameters.items():
        parameters[name] = replace(one, betas=one.betas + 0.5)
    fresh = LabelDataset(
        FileSource(read.records, ParametersBody(read.bodies.model, parameters)),
        stored_cameras="exact",
    )[0][1]["size"]  # type: ignore[index]
    assert not torch.equal(fresh, before)
    assert torch.equal(dataset[0][1]["size"], fresh)  # type: ignore[index]


@pytest.mark.parametrize("sent", [False, True])
def test_writing_into_a_field_changes_no_other(animals: Path, tmp_path: Path, sent: bool) -> None:
    small_dataset(animals, cache=tmp_path)[0]
    dataset = small_dataset(animals, cache=tmp_path)
    for index in range(len(dataset)):
        target: dict[str, Any] = dataset[index][1]  # type: ignore[index]
        if sent:
            (target,) = pickle.loads(pickle.dumps(Targets([target])))
        tensors = {name: value for name, value in target.items() if isinstance(value, torch.Tensor)}
        for name, value in tensors.items():
            others = {other: kept.clone() for other, kept in tensors.items() if other != name}
            value.copy_(~value if value.dtype == torch.bool else value + 1)
            assert all(torch.equal(tensors[other], kept) for other, kept in others.items()), name


def test_tensors_that_cannot_travel_as_numbers_travel_as_they_are() -> None:
    odd = {
        "sparse": torch.eye(2).to_sparse(),
        "learnt": torch.ones(2, requires_grad=True),
        "turned": torch.arange(6.0).reshape(2, 3).T,
    }
    back = pickle.loads(pickle.dumps(Targets([odd, odd])))[1]
    assert back["sparse"].is_sparse
    assert back["learnt"].requires_grad
    assert torch.equal(back["turned"], odd["turned"])


@pytest.mark.parametrize(
    "array",
    [np.zeros((3, 0)), np.zeros((0, 3), np.float32), np.array(2, np.int32), np.arange(9.0)[::2]],
)
def test_packed_arrays_come_back_writable_and_in_their_shape(array: np.ndarray) -> None:
    back = Codec().unpack(Codec().pack({"it": array}))["it"]
    assert (back.dtype, back.shape) == (array.dtype, array.shape)
    assert back.flags.writeable
    assert np.array_equal(back, array)


def test_outcomes_come_back_as_they_were_stored(animals: Path, tmp_path: Path) -> None:
    rejection = Rejection(None, "pose", "none was found")
    assert unpacked_outcome(packed_outcome(rejection)) == rejection
    dataset = small_dataset(animals)
    sample = dataset.source.sample(0)
    request = dataset._store.request(sample, 0, dataset.source.facts(sample))
    (label,), cases = dataset._store.labels([request])
    assert isinstance(label, CuboidLabel)
    assert cases == []
    bent = replace(
        label,
        lens=np.array([0.1, 0.0, 0.0, 0.2]),
        scale_m_per_unit=0.5,
        scale_source="x",
        quality=replace(label.quality, warnings=("a", "b")),
    )
    for whole in (label, bent, replace(label, keypoints_2d=None)):
        back = unpacked_outcome(packed_outcome(whole))
        assert isinstance(back, CuboidLabel)
        for name in ("quality", "sample_id", "image_hw", "scale_m_per_unit", "scale_source"):
            assert getattr(back, name) == getattr(whole, name)
        for name in ("row", "keypoints_2d", "lens"):
            stored, original = getattr(back, name), getattr(whole, name)
            assert (stored is None) == (original is None)
            assert stored is None or np.array_equal(stored, original)

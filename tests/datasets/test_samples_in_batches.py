"""A batch asked for at once: the samples of one by one, to the last bit, whoever else is in it."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from loading import in_bytes
from small_animals import model_of, small_dataset, spoiled
from torch.utils.data import DataLoader, Subset

from animal3dbox.datasets import (
    LabelDataset,
    LabelFilter,
    Skipped,
    SyntheticDataset,
    SyntheticSet,
    collate,
)
from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.images.masks import record_mask
from animal3dbox.datasets.labelling import image_samples
from animal3dbox.datasets.labelling.file_source import FileSource
from animal3dbox.datasets.labelling.skipped import Target
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels import bounds, drafts
from animal3dbox.labels.body import Body


def told(sample: Any) -> Any:
    """A sample to compare, or why it was skipped."""
    return sample.cases if isinstance(sample, Skipped) else in_bytes(sample)


def with_faults(animals: Path, folder: Path) -> Path:
    """The small dataset with a picture cut short, a mask gone and a camera that shows nothing."""
    root = shutil.copytree(animals, folder / "set")
    shutil.copy(animals.parent / f"{animals.name}-model.pkl", folder / "set-model.pkl")
    pictures = sorted(path for path in root.rglob("*.jpg"))
    pictures[1].write_bytes(pictures[1].read_bytes()[:200])

    def spoil(entries: list[dict[str, Any]]) -> None:
        entries[0]["pose"] = entries[0]["pose"][:7]

    spoiled(root, spoil)
    return root


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"stored_cameras": "hypothesis"},
        {"partial": "skip"},
        {"filters": LabelFilter(max_truncation=0.05)},
        {"cache": True},
    ],
)
def test_a_batch_holds_what_its_samples_are_one_by_one(
    animals: Path, tmp_path: Path, options: dict[str, Any]
) -> None:
    root = with_faults(animals, tmp_path)
    if "cache" in options:
        options = {"cache": tmp_path / "cache"}
    alone = small_dataset(root, on_bad="skip", **options)
    expected = [told(alone[i]) for i in range(len(alone))]
    together = small_dataset(
        root,
        on_bad="skip",
        **{**options, **({"cache": tmp_path / "other"} if options.get("cache") else {})},
    )
    for indices in ([*range(len(together))], [2, 0], [5, 5, 1, -1, 3]):
        assert [told(sample) for sample in together.__getitems__(indices)] == [
            expected[i] for i in indices
        ]
    assert any(
        isinstance(sample, Skipped) for sample in together.__getitems__([*range(len(together))])
    )
    assert (
        sorted(case.sample_id for case in alone.report().of("fault"))[:2]
        == sorted({case.sample_id for case in together.report().of("fault")})[:2]
    )


def test_synthetic_samples_are_the_same_in_batches() -> None:
    dataset = SyntheticDataset(SyntheticSet(2, 4), stored_cameras="exact")
    assert [told(sample) for sample in dataset.__getitems__([3, 1])] == [
        told(dataset[3]),
        told(dataset[1]),
    ]


def test_known_cameras_of_a_batch_are_labelled_in_one_go(
    animals: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[int] = []

    def counted(bodies: Any, *rest: Any) -> Any:
        sizes.append(len(bodies))
        return bounds.tight_boxes(bodies, *rest)

    monkeypatch.setattr(drafts, "tight_boxes", counted)
    dataset = small_dataset(animals)
    loader: Any = DataLoader(dataset, batch_size=4, collate_fn=collate)
    targets = [target for _, batch in loader for target in batch]
    assert sizes == [
        sum(len(target["meta"]["sample_ids"]) for target in targets[k : k + 4])
        for k in range(0, len(targets), 4)
    ]
    sizes.clear()
    next(iter(DataLoader(Subset(dataset, [0, 2]), batch_size=2, collate_fn=collate)))
    assert len(sizes) == 1


def test_a_faulty_sample_of_a_batch_is_the_same_error_as_alone(
    animals: Path, tmp_path: Path
) -> None:
    dataset = small_dataset(
        with_faults(animals, tmp_path), on_bad="skip"
    )  # which takes entries that cannot be read
    skipped = [isinstance(dataset[i], Skipped) for i in range(len(dataset))]
    bad, good = skipped.index(True), skipped.index(False)
    dataset.on_bad = "error"
    errors = []
    for ask in (lambda: dataset[bad], lambda: dataset.__getitems__([good, bad, good])):
        with pytest.raises(SampleError) as caught:
            ask()
        errors.append((caught.value.sample_id, caught.value.field, caught.value.problem))
    assert errors[0] == errors[1]


def test_a_subclass_that_changes_samples_changes_those_of_batches(animals: Path) -> None:
    class Named(LabelDataset):
        def __getitem__(self, index: Any) -> Any:
            image, target = super().__getitem__(index)  # type: ignore[misc]
            return image, {**target, "site": "north"}

    loader: Any = DataLoader(
        Named(small_dataset(animals).source, stored_cameras="exact"),
        batch_size=4,
        collate_fn=collate,
    )
    targets: list[Target] = [target for _, batch in loader for target in batch]
    assert targets
    assert all(target["site"] == "north" for target in targets)


def test_an_index_that_is_none_is_an_error_before_anything_is_read(animals: Path) -> None:
    dataset = small_dataset(animals)
    with pytest.raises(IndexError, match="index 99 of"):
        dataset.__getitems__([0, 99])
    with pytest.raises(TypeError, match="whole number"):
        dataset.__getitems__(["0"])  # type: ignore[list-item]
    assert dataset.__getitems__([]) == []


class Twice(ParametersBody):
    """Bodies twice as large."""

    def body(self, record: AnimalRecord) -> Body:
        body = super().bodies([record])[0]
        return replace(body, vertices=2 * body.vertices, landmarks=2 * body.landmarks)


def test_bodies_of_ones_own_are_asked_for_theirs(animals: Path) -> None:
    read = read_dataset(animals, options=ReadOptions(model=model_of(animals)))
    assert isinstance(read.bodies, ParametersBody)
    sizes = [
        LabelDataset(FileSource(read.records, source), stored_cameras="exact")[0][1]["size"]  # type: ignore[index]
        for source in (read.bodies, Twice(read.bodies.model, read.bodies.parameters))
    ]
    assert torch.allclose(2 * sizes[0], sizes[1])


def test_what_is_no_source_of_bodies_is_refused_by_what_it_lacks(animals: Path) -> None:
    read = read_dataset(animals, options=ReadOptions(model=model_of(animals)))
    with pytest.raises(
        ConfigError,
        match="object is no source of bodies: it lacks fingerprint, lasting, content, body",
    ):
        FileSource(read.records, object())  # type: ignore[arg-type]


def test_records_may_hold_numpys_numbers_and_words(animals: Path) -> None:
    read = read_dataset(animals, options=ReadOptions(model=model_of(animals)))
    odd = [
        replace(
            one,
            image_hw=tuple(np.array(one.image_hw)),
            category=np.str_(one.category),
            image_id=np.str_(one.image_id),
        )
        for one in read.records.records
    ]
    records = (read.records, replace(read.records, records=tuple(odd)))
    plain, other = (
        LabelDataset(FileSource(kept, read.bodies), stored_cameras="exact") for kept in records
    )
    assert told(other[0]) == told(plain[0])


@pytest.mark.parametrize("before", [True, False])
def test_a_mask_that_is_replaced_while_it_is_read_leaves_no_wrong_label(
    animals: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: bool
) -> None:
    root = shutil.copytree(animals, tmp_path / "set")
    shutil.copy(model_of(animals), tmp_path / "set-model.pkl")
    dataset = small_dataset(root, cache=tmp_path / "cache")
    path = Path(dataset.source.sample(0).animals[0].mask_path)
    old, moved = (
        path.read_bytes(),
        np.roll(np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)), 9, axis=1),
    )
    new = cv2.imencode(".png", moved)[1].tobytes()

    def replaced(*arguments: Any, **options: Any) -> Any:
        if before:
            path.write_bytes(new)
        mask = record_mask(*arguments, **options)
        path.write_bytes(new)
        return mask

    monkeypatch.setattr(image_samples, "record_mask", replaced)
    dataset[0]
    monkeypatch.undo()
    for content in (new, old):
        path.write_bytes(content)
        assert told(small_dataset(root, cache=tmp_path / "cache")[0]) == told(
            small_dataset(root)[0]
        )


def test_what_is_wrong_with_the_cache_is_told_even_if_a_sample_of_the_batch_raises(
    animals: Path, tmp_path: Path
) -> None:
    root = with_faults(animals, tmp_path)
    dataset = small_dataset(root, on_bad="skip", cache=tmp_path / "cache")
    samples = dataset.__getitems__([*range(len(dataset))])
    (segment,) = (tmp_path / "cache").rglob("*.labels")
    content = bytearray(segment.read_bytes())
    content[len(content) // 2] ^= 255
    segment.write_bytes(content)
    again = small_dataset(root, on_bad="skip", cache=tmp_path / "cache")
    again.on_bad = "error"
    with pytest.raises(SampleError):
        again.__getitems__([*range(len(samples))])
    assert again.report().of("cache")

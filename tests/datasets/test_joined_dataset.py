"""Several Datasets as one: whose classes are which, and that all that takes a Dataset takes it."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from loading import augmented, in_bytes, one_by_one
from small_animals import small_dataset
from torch.utils.data import DataLoader, Subset

from animal3dbox.datasets import (
    FileSource,
    JoinedDataset,
    LabelDataset,
    Skipped,
    collate,
    preset_body,
    read_omni3d,
    write_omni3d,
)
from animal3dbox.datasets.records import RecordSet
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.datasets.synthetic_dataset import SyntheticDataset
from animal3dbox.errors import ConfigError
from animal3dbox.training import EpochSampler, audit

SAME = {"lion": "cat", "zebra": "horse"}


def drawn(images: int = 3, **options: Any) -> SyntheticDataset:
    return SyntheticDataset(images, seed=9, image_hw=(120, 160), **options)


def joined(folder: Path, **options: Any) -> JoinedDataset:
    return JoinedDataset({"zoo": small_dataset(folder), "drawn": drawn()}, **options)


def used(sample: Any) -> Any:
    assert not isinstance(sample, Skipped)
    return sample


def test_classes_of_one_name_are_one_and_labels_follow_them(animals: Path) -> None:
    both = joined(animals, same=SAME)
    zoo, made = both.datasets
    assert len(both) == len(zoo) + len(made)
    assert len(set(both.classes)) == len(both.classes)
    assert not {"lion", "zebra"} & set(both.classes)
    renamed = 0
    for index in range(len(both)):
        inner, place = (zoo, index) if index < len(zoo) else (made, index - len(zoo))
        image, target = used(both[index])
        same_image, alone = used(inner[place])
        assert torch.equal(image, same_image)
        names = [inner.classes[label] for label in alone["labels"].tolist()]
        assert [both.classes[label] for label in target["labels"].tolist()] == [
            SAME.get(name, name) for name in names
        ]
        assert target["labels"].dtype == torch.int64
        assert target["meta"]["source"] == ("zoo" if inner is zoo else "drawn")
        assert target["meta"]["sample_key"] == (0, index)
        assert both.image_id(index) == target["image_id"] == inner.image_id(place)
        renamed += target["labels"].tolist() != alone["labels"].tolist()
    assert renamed > 0
    assert in_bytes(both[-1]) == in_bytes(both[len(both) - 1])
    with pytest.raises(IndexError, match="index 11 of 11 images"):
        both[11]


def test_the_order_of_classes_can_be_given(animals: Path) -> None:
    plain = joined(animals, same=SAME)
    classes = ("unicorn", *reversed(plain.classes))
    ordered = joined(animals, same=SAME, classes=classes)
    assert ordered.classes == classes
    label = int(used(plain[0])[1]["labels"][0])
    assert classes[int(used(ordered[0])[1]["labels"][0])] == plain.classes[label]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"same": {"unicorn": "horse"}}, "unicorn.*which no Dataset has"),
        ({"classes": ("cat",)}, "classes must differ and hold"),
    ],
)
def test_names_that_lead_nowhere_are_refused(
    animals: Path, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        joined(animals, **options)


@pytest.mark.parametrize("datasets", [{}, [drawn()]])
def test_datasets_without_names_are_refused(datasets: Any) -> None:
    with pytest.raises(ConfigError, match="by the names of their sources"):
        JoinedDataset(datasets)


def test_a_batch_holds_what_its_samples_are_one_by_one(animals: Path) -> None:
    both = JoinedDataset({"zoo": augmented(animals), "drawn": drawn()})
    indices: list[Any] = [(2, 9), (2, 0), (5, 10), (2, 3), (1, 8)]
    batch = [in_bytes(sample) for sample in both.__getitems__(indices)]
    assert batch == [in_bytes(both[index]) for index in indices]
    assert batch[1] != in_bytes(both[4, 0])  # another epoch's draws


def test_an_epoch_sampler_and_workers_take_it(animals: Path) -> None:
    both = JoinedDataset({"zoo": augmented(animals), "drawn": drawn()})
    for dataset in (both, Subset(both, [10, 1, 4])):
        sampler = EpochSampler(dataset, seed=1)
        sampler.set_epoch(3)
        loader = DataLoader(dataset, batch_size=2, sampler=sampler, collate_fn=collate)
        keys = [target["meta"]["sample_key"] for _, target in one_by_one(loader)]
        assert {epoch for epoch, _ in keys} == {3}
        assert {place for _, place in keys} == ({*range(11)} if dataset is both else {10, 1, 4})
    again = pickle.loads(pickle.dumps(both))  # our own
    assert in_bytes(again[3, 0]) == in_bytes(both[3, 0])


def test_each_keeps_its_own_cache(animals: Path, tmp_path: Path) -> None:
    def cached(reuse: bool) -> JoinedDataset:
        return JoinedDataset(
            {
                "zoo": small_dataset(animals, cache=tmp_path / "zoo", reuse=reuse),
                "drawn": drawn(cache=tmp_path / "drawn", reuse=reuse),
            }
        )

    assert cached(reuse=True).warm(range(11)) == ()
    assert len({path.parent.parent for path in tmp_path.rglob("*.labels")}) == 2
    plain, stored = joined(animals), cached(reuse=True)
    assert [in_bytes(stored[i]) for i in range(11)] == [in_bytes(plain[i]) for i in range(11)]


def test_checks_find_nothing_in_it_and_what_is_left_out_is_told(animals: Path) -> None:
    report = audit(joined(animals, same=SAME))
    assert (report.targets, report.faults) == (11, 0)
    records = SyntheticSet(seed=0, images=1).records().records
    blind = [replace(record, keypoints_2d=record.keypoints_2d * 0) for record in records]
    bad = LabelDataset(
        FileSource(RecordSet("bad", tuple(blind), ()), preset_body("dog")), on_bad="skip"
    )
    both = JoinedDataset({"drawn": drawn(), "bad": bad})
    skipped = both[3]
    assert isinstance(skipped, Skipped)
    assert skipped.index == 3
    assert both.report().cases == bad.report().cases != ()


def test_it_is_exported_with_names_that_differ(animals: Path, tmp_path: Path) -> None:
    twice = JoinedDataset({"one": small_dataset(animals), "two": small_dataset(animals)}, same=SAME)
    cuboids = twice.cuboids()
    assert len({record.sample_id for record in cuboids.records}) == len(cuboids.records)
    assert len(cuboids.images) == 16
    write_omni3d(cuboids, tmp_path / "omni3d.json", scale_free=True)
    read = read_omni3d(tmp_path / "omni3d.json", metric="no")
    assert len(read.records) == len(cuboids.records) >= 16
    assert {record.category for record in read.records} <= set(twice.classes)
    for record, target in zip(
        (one for one in cuboids.records if one.sample_id.startswith("two/")),
        (used(twice[8 + index])[1] for index in range(1)),
        strict=False,
    ):
        assert torch.equal(torch.from_numpy(record.center).float(), target["center"][0])
    with pytest.raises(ConfigError, match="zoo has a transform"):
        JoinedDataset({"zoo": augmented(animals)}).cuboids()


def test_a_class_that_is_renamed_is_no_other_s_new_name(animals: Path) -> None:
    with pytest.raises(ConfigError, match="'lion' 'cat', which it calls 'horse'"):
        joined(animals, same={"lion": "cat", "cat": "horse"})
    with pytest.raises(ConfigError, match="give each name the one"):
        joined(animals, same={"lion": "cat", "cat": "lion"})
    assert (
        joined(animals, same={**SAME, "cat": "cat"}).classes == joined(animals, same=SAME).classes
    )


def test_a_subset_cannot_be_joined_but_taken_of_what_is_joined(animals: Path) -> None:
    with pytest.raises(ConfigError, match=r"few is a Subset, .* Subset of the result"):
        JoinedDataset({"few": Subset(drawn(), [0])})  # type: ignore[dict-item]
    part = Subset(joined(animals), [1])
    assert used(part[0])[1]["meta"]["source"] == "zoo"

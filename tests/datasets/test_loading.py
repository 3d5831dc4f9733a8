"""The Dataset under DataLoader: workers, epochs, processes, memory."""

import copy
import multiprocessing
import os
import pickle
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from loading import augmented, in_bytes, loaded, memory_told, one_by_one, rank
from small_animals import model_of, small_dataset
from torch.utils.data import DataLoader

from animal3dbox.datasets import LabelDataset, Skipped, collate, collate_stacked
from animal3dbox.datasets.batches import Targets
from animal3dbox.datasets.bodies.sources import ParametersBody
from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.labelling.file_source import FileSource
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.records import RecordSet
from animal3dbox.errors import SampleError
from animal3dbox.training.sampler import EpochSampler

SUPPORT = Path(__file__).parents[1] / "support"


@pytest.fixture(scope="module")
def expected(animals: Path) -> list[Any]:
    """What the main process gets."""
    dataset = augmented(animals)
    return [in_bytes(dataset[i]) for i in range(len(dataset))]


# The same bytes
# --------------------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:This DataLoader will create 4 worker processes")
@pytest.mark.parametrize("workers", [0, 1, 2, 4])
def test_any_number_of_workers_gives_the_same_bytes(
    animals: Path, expected: list[Any], workers: int
) -> None:
    assert loaded(augmented(animals), workers, "fork") == expected


@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_any_way_to_start_workers_gives_the_same_bytes(
    animals: Path, expected: list[Any], context: str
) -> None:
    dataset = augmented(animals)
    assert loaded(dataset, 2, context) == expected
    assert [
        in_bytes(dataset[i]) for i in range(len(dataset))
    ] == expected  # what was sent to workers can still be read here


def test_threads_in_the_main_process_do_not_change_a_byte(
    animals: Path, expected: list[Any]
) -> None:
    torch.set_num_threads(2)
    try:
        dataset = augmented(animals)
        assert [in_bytes(dataset[i]) for i in range(len(dataset))] == expected
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(1)


def test_a_cache_does_not_change_a_byte(animals: Path, expected: list[Any], tmp_path: Path) -> None:
    for _ in range(2):
        assert loaded(augmented(animals, cache=tmp_path / "cache"), 2, "fork") == expected


@pytest.mark.parametrize("copied_first", [False, True])
@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_persistent_workers_learn_of_the_next_epoch(
    animals: Path, context: str, copied_first: bool
) -> None:
    dataset, plain = augmented(animals), augmented(animals)
    dataset = copy.deepcopy(dataset) if copied_first else dataset
    loader = DataLoader(
        dataset,
        batch_size=4,
        collate_fn=collate,
        num_workers=2,
        persistent_workers=True,
        multiprocessing_context=context,
    )
    for epoch in range(3):
        dataset.set_epoch(epoch)
        assert [in_bytes(sample) for sample in one_by_one(loader)] == [
            in_bytes(plain[epoch, i]) for i in range(len(dataset))
        ]


def test_forked_workers_do_not_hang_after_threads_in_the_parent(animals: Path) -> None:
    known = {**os.environ, "PYTHONPATH": str(SUPPORT)}
    done = subprocess.run(
        [sys.executable, str(SUPPORT / "loading.py"), str(animals)],
        capture_output=True,
        text=True,
        timeout=120,
        env=known,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["loaded", "8", "threads", "2", "2"]


# Orders
# --------------------------------------------------------------------------------------------------


def test_an_epoch_can_be_resumed_in_its_middle(animals: Path) -> None:
    dataset = augmented(animals)
    sampler = EpochSampler(dataset, seed=3)
    sampler.set_epoch(5)
    loader = DataLoader(dataset, batch_size=2, sampler=sampler, collate_fn=collate)
    whole = [in_bytes(sample) for sample in one_by_one(loader)]
    sampler.set_epoch(5, start=4)
    assert len(loader) == 2
    assert [in_bytes(sample) for sample in one_by_one(loader)] == whole[4:]


def test_every_rank_takes_its_own_part_of_a_shuffled_epoch() -> None:
    parts = [list(EpochSampler(range(10), seed=1, rank=r, world_size=3)) for r in range(3)]
    assert [len(part) for part in parts] == [4, 4, 4]
    assert {index for part in parts for _, index in part} == set(range(10))
    even = [
        list(EpochSampler(range(10), seed=1, rank=r, world_size=3, drop_last=True))
        for r in range(3)
    ]
    assert len({index for part in even for _, index in part}) == 9
    assert list(EpochSampler(range(4), shuffle=False)) == [(0, 0), (0, 1), (0, 2), (0, 3)]
    assert list(EpochSampler(range(50), seed=1)) != list(EpochSampler(range(50), seed=2))
    assert list(EpochSampler([])) == []


def test_two_ranks_train_on_one_dataset_with_one_cache(animals: Path, tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    ranks = [
        context.Process(target=rank, args=(number, 2, str(animals), str(tmp_path)))
        for number in range(2)
    ]
    for process in ranks:
        process.start()
    for process in ranks:
        process.join(timeout=180)
        assert process.exitcode == 0
    results = [
        pickle.loads((tmp_path / f"rank{number}.pickle").read_bytes())  # our own
        for number in range(2)
    ]
    plain = augmented(animals)
    right = {
        (epoch, plain.image_id(i)): in_bytes(plain[epoch, i])
        for epoch in range(2)
        for i in range(len(plain))
    }
    for name in ("distributed", "epochs"):
        samples = [sample for found, _ in results for sample in found[name]]
        assert len(samples) == 2 * len(plain)
        assert {
            (target["meta"]["sample_key"][0], target["image_id"]) for _, target in samples
        } == set(right)
        assert all(
            sample == right[sample[1]["meta"]["sample_key"][0], sample[1]["image_id"]]
            for sample in samples
        )
    gathered = results[0][1]
    assert sorted(image for part in gathered for image in part) == sorted(
        2 * [plain.image_id(i) for i in range(len(plain))]
    )


# Errors
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("workers", [0, 2])
def test_an_error_keeps_its_sample_and_field_on_the_way_from_a_worker(
    copied: Path, workers: int
) -> None:
    dataset = small_dataset(copied)
    image = dataset.image_id(4)
    (copied / image).write_bytes(b"no picture")
    with pytest.raises(SampleError) as caught:
        loaded(dataset, workers, "fork")
    assert (caught.value.sample_id, caught.value.field) == (image, "image")
    assert str(caught.value).startswith(f"{image}: image: ")
    assert "replace the file" in caught.value.problem
    if workers:
        assert any("DataLoader worker" in note for note in caught.value.__notes__)


def test_an_odd_name_survives_the_way_too() -> None:
    error = SampleError('a: b\n"c": d', "K: R", "is wrong: \u00e9")
    error.note_for_parent()
    again = SampleError(
        "Caught SampleError in DataLoader worker process 0.\nOriginal Traceback\n"
        + "\n".join(error.__notes__)
    )
    assert (again.sample_id, again.field, again.problem) == (
        error.sample_id,
        error.field,
        error.problem,
    )
    plain = SampleError("Caught something else")
    assert (plain.sample_id, plain.field, plain.problem) == (
        None,
        "unknown",
        "Caught something else",
    )
    same = pickle.loads(pickle.dumps(error))
    assert (same.sample_id, same.field, same.problem) == (
        error.sample_id,
        error.field,
        error.problem,
    )


def test_skipped_samples_leave_smaller_batches_and_a_report(copied: Path) -> None:
    dataset = small_dataset(copied, on_bad="skip")
    images = [dataset.image_id(i) for i in (0, 1, 5)]
    for image in images:
        (copied / image).unlink()
    batches = list(
        DataLoader(
            dataset, batch_size=2, collate_fn=collate, num_workers=2, multiprocessing_context="fork"
        )
    )
    assert [len(targets) for _, targets in batches] == [0, 2, 1, 2]
    assert [skipped.image_id for _, targets in batches for skipped in targets.skipped] == images
    assert sorted(case.sample_id for case in dataset.report().cases) == sorted(images)


# Batches
# --------------------------------------------------------------------------------------------------


def test_stacking_needs_one_size_and_says_which_image_differs(animals: Path) -> None:
    dataset = small_dataset(animals)
    (one, target), (two, other) = dataset[0], dataset[1]  # type: ignore[misc]
    images, targets = collate_stacked([(one, target), Skipped(7, "x", ()), (two, other)])
    assert images.shape[0] == len(targets) == 2
    assert [skipped.index for skipped in targets.skipped] == [7]
    with pytest.raises(SampleError, match=r"image: is .*give a transform that resizes"):
        collate_stacked([(one, target), (two[:, :50], other)])
    assert collate_stacked([Skipped(7, "x", ())])[0].shape == (0,)


def test_what_stacking_refuses_in_a_worker_keeps_its_sample_and_field(copied: Path) -> None:
    dataset = small_dataset(
        copied,
        transform=lambda image, target: (image[:, : 60 + target["meta"]["sample_key"][1]], target),
    )
    loader = DataLoader(
        dataset,
        batch_size=2,
        collate_fn=collate_stacked,
        num_workers=1,
        multiprocessing_context="fork",
    )
    with pytest.raises(SampleError) as raised:
        next(iter(loader))
    assert (raised.value.sample_id, raised.value.field) == (dataset.image_id(1), "image")


class Boxes(torch.Tensor):
    """A tensor of a kind of its own, as torchvision's tv_tensors are."""


@pytest.mark.parametrize("workers", [0, 1])
@pytest.mark.parametrize("kind", [Boxes, torch.bfloat16])
def test_tensors_of_other_kinds_cross_processes_as_they_are(
    animals: Path, kind: Any, workers: int
) -> None:
    def turned(image: torch.Tensor, target: dict[str, Any]) -> tuple[torch.Tensor, dict[str, Any]]:
        boxes = target["boxes"].as_subclass(Boxes) if kind is Boxes else target["boxes"].to(kind)
        return image, {**target, "boxes": boxes}

    loader = DataLoader(
        small_dataset(animals, transform=turned),
        collate_fn=collate,
        num_workers=workers,
        multiprocessing_context="fork" if workers else None,
    )
    boxes = next(iter(loader))[1][0]["boxes"]
    assert kind in (type(boxes), boxes.dtype)


def test_a_batch_crosses_processes_without_a_shared_file_a_tensor(animals: Path) -> None:
    _, targets = collate([small_dataset(animals)[i] for i in range(4)])
    assert in_bytes(list(pickle.loads(pickle.dumps(targets)))) == in_bytes(list(targets))
    odd = Targets(
        [
            {
                "none": torch.zeros(0, 8, 3),
                "one": torch.tensor(True),
                "half": torch.ones(3, dtype=torch.bfloat16),
                "word": "x",
            }
        ]
    )
    back = pickle.loads(pickle.dumps(odd))[0]
    assert back["none"].shape == (0, 8, 3)
    assert (bool(back["one"]), back["half"].dtype, back["word"]) == (True, torch.bfloat16, "x")
    back["one"] &= False  # its memory may be written


# Memory
# --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def many(animals: Path) -> LabelDataset:
    """20,000 records of 20,000 images, as far as the annotations go."""
    read = read_dataset(animals, options=ReadOptions(model=model_of(animals)))
    assert isinstance(read.bodies, ParametersBody)
    records, parameters = [], {}
    for i in range(20_000):
        record = read.records.records[i % len(read.records.records)]
        name = f"images/train/beasts/{i:06d}.jpg"
        records.append(type(record)(**{**record.__dict__, "sample_id": name, "image_id": name}))
        parameters[name] = read.bodies.parameters[record.sample_id]
    bodies = ParametersBody(read.bodies.model, parameters).packed()
    return LabelDataset(FileSource(RecordSet("animal3d", tuple(records), ()), bodies))


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_a_worker_grows_by_a_few_mb_at_first_and_by_nothing_over_20_000_records(
    many: LabelDataset, context: str
) -> None:
    # In a process of its own: forked from one that has run thousands of tests, a worker copies the
    # pages of their leftovers wherever it makes an object among them.
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        told = pool.submit(memory_told, many, context).result()
    for process in np.unique(told[:, 0]):
        memory = told[told[:, 0] == process][:, 2]
        assert len(memory) > 10
        # The first passes of the collector copy pages once; records must not copy any.
        settled = memory[len(memory) // 3]
        assert settled - memory[0] <= 1e7, (settled - memory[0]) / 1e6
        assert memory[-1] - settled <= 5e5, (memory[-1] - settled) / 1e6

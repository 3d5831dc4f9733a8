"""A hundred faults of named classes: none is silent, none loses a good label."""

import errno
import gc
import json
import multiprocessing
import os
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from loading import in_bytes
from planted_epoch import planted_epoch, told_apart
from planted_file_faults import ENTRY_FAULTS, FILE_FAULTS, plant
from small_animals import small_dataset
from torch.utils.data import DataLoader

from animal3dbox.datasets import LabelDataset, Skipped, collate
from animal3dbox.datasets.labelling import cache as cache_module
from animal3dbox.datasets.labelling.load_report import CaseFileError, LoadReport
from animal3dbox.datasets.storage import segments as segment_files
from animal3dbox.errors import DatasetFormatError, SampleError

FORK = multiprocessing.get_context("fork")


def targets_of(dataset: LabelDataset) -> dict[str, Any]:
    """Image -> its target's labels as bytes; images that were skipped are left out."""
    contents = {}
    for i in range(len(dataset)):
        sample = dataset[i]
        if isinstance(sample, Skipped):
            continue
        target = sample[1]
        meta = {name: value for name, value in target["meta"].items() if name != "sample_key"}
        contents[target["image_id"]] = in_bytes({**target, "meta": meta})
    return contents


@pytest.fixture(scope="module")
def right(animals: Path) -> dict[str, Any]:
    """The labels without any fault."""
    return targets_of(small_dataset(animals))


@pytest.fixture(scope="module")
def filled(animals: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that holds them all, in one segment."""
    cache = tmp_path_factory.mktemp("filled") / "cache"
    targets_of(small_dataset(animals, cache=cache))
    return cache


@pytest.fixture
def cache(filled: Path, tmp_path: Path) -> Path:
    """A copy of the full cache."""
    shutil.copytree(filled, tmp_path / "cache")
    return tmp_path / "cache"


def segments(cache: Path) -> list[Path]:
    return sorted(cache.rglob(f"*{segment_files.SUFFIX}"))


def aged(path: Path) -> None:
    """Make a file look as if nobody had written to it for a minute."""
    os.utime(path, (time.time() - 60, time.time() - 60))


def cache_cases(report: LoadReport) -> list[str]:
    return [case.problem for case in report.of("cache")]


# The cache
# --------------------------------------------------------------------------------------------------


def fill_and_die(animals: Path, cache: Path, entry: int, part: float) -> None:
    """Fill a cache until some entry, write only a part of that, and be killed."""
    dataset = small_dataset(animals, cache=cache)
    write, count = os.write, 0

    def fatal(descriptor: int, data: bytes) -> int:
        nonlocal count
        count += data.startswith(segment_files.MAGIC)
        if count > entry and data.startswith(segment_files.MAGIC):
            write(descriptor, data[: int(part * len(data))])
            os.kill(os.getpid(), signal.SIGKILL)
        return write(descriptor, data)

    os.write = fatal  # type: ignore[assignment]
    targets_of(dataset)


@pytest.mark.parametrize(
    ("entry", "part"),
    [
        (0, 0.0),
        (0, 0.01),
        (0, 0.5),
        (1, 0.02),
        (2, 0.9),
        (3, 0.999),
        (4, 0.3),
        (5, 0.0),
        (6, 0.7),
        (7, 0.1),
    ],
)
def test_kill_9_within_a_cache_write_costs_no_other_label(
    animals: Path, right: dict[str, Any], tmp_path: Path, entry: int, part: float
) -> None:
    child = FORK.Process(target=fill_and_die, args=(animals, tmp_path / "cache", entry, part))
    child.start()
    child.join()
    assert child.exitcode == -signal.SIGKILL
    (segment,) = segments(tmp_path / "cache")
    aged(segment)
    dataset = small_dataset(animals, cache=tmp_path / "cache")
    assert targets_of(dataset) == right
    assert [problem.partition(" ")[2][:20] for problem in cache_cases(dataset.report())] == (
        ["ends within an entry"] if part else []
    )
    assert (
        len(segments(tmp_path / "cache")) == 2
    )  # what was missing, and nothing else, is stored in a file of the new process
    assert segments_hold(tmp_path / "cache") == segments_hold_when_whole(right)


def segments_hold(cache: Path) -> int:
    """Sound entries in all segments."""
    return sum(
        len(list(segment_files.SegmentReader(path).new_entries())) for path in segments(cache)
    )


def segments_hold_when_whole(right: dict[str, Any]) -> int:
    return sum(len(target["meta"]["quality"]) for target in right.values())


@pytest.mark.parametrize("seed", range(15))
def test_a_cache_file_that_was_cut_is_told_and_made_whole(
    animals: Path, right: dict[str, Any], cache: Path, seed: int
) -> None:
    (segment,) = segments(cache)
    size = segment.stat().st_size
    os.truncate(segment, int(np.random.default_rng(seed).integers(1, size)))
    aged(segment)
    dataset = small_dataset(animals, cache=cache)
    assert targets_of(dataset) == right
    assert any("ends within an entry" in problem for problem in cache_cases(dataset.report()))


@pytest.mark.parametrize("seed", range(25))
def test_a_flipped_bit_in_the_cache_is_told_and_never_becomes_a_label(
    animals: Path, right: dict[str, Any], cache: Path, seed: int
) -> None:
    (segment,) = segments(cache)
    data = bytearray(segment.read_bytes())
    place = (
        int(np.random.default_rng(seed).integers(len(data))) if seed > 7 else seed * 4
    )  # the first ones in the first header
    data[place] ^= 1 << (seed % 8)
    segment.write_bytes(data)
    aged(segment)
    dataset = small_dataset(animals, cache=cache)
    assert targets_of(dataset) == right
    assert cache_cases(dataset.report())


def test_a_bit_that_flips_while_the_cache_is_open_is_told_too(
    animals: Path, right: dict[str, Any], cache: Path
) -> None:
    dataset = small_dataset(animals, cache=cache)
    assert targets_of(dataset) == right
    (segment,) = segments(cache)
    with segment.open("r+b") as file:
        file.seek(200)
        file.write(b"\xff\x00\xff")
    assert targets_of(dataset) == right
    assert any(
        "was damaged and is made anew" in problem for problem in cache_cases(dataset.report())
    )


def test_more_segments_than_are_open_at_once_are_all_read(
    animals: Path, right: dict[str, Any], cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (whole,) = segments(cache)
    data, starts = (
        whole.read_bytes(),
        [offset for _, offset in segment_files.SegmentReader(whole).new_entries()],
    )
    for start, stop in zip(starts, [*starts[1:], len(data)], strict=True):
        (whole.parent / f"{start}{segment_files.SUFFIX}").write_bytes(data[start:stop])
    whole.unlink()
    monkeypatch.setattr(cache_module, "MAPPED", 2)
    dataset = small_dataset(animals, cache=cache)
    assert targets_of(dataset) == right
    assert targets_of(dataset) == right
    assert segments_hold(cache) == segments_hold_when_whole(right)  # nothing was made anew
    assert (
        sum(
            "labels" in line
            for line in Path("/proc/self/maps").read_text().splitlines()
            if str(cache) in line
        )
        <= 2
    )


def fill(animals: Path, cache: Path, backwards: bool) -> None:
    dataset = small_dataset(animals, cache=cache)
    for i in sorted(range(len(dataset)), reverse=backwards):
        dataset[i]


@pytest.mark.parametrize("trial", range(5))
def test_processes_that_fill_one_cache_at_once_do_not_disturb_each_other(
    animals: Path, right: dict[str, Any], tmp_path: Path, trial: int
) -> None:
    processes = [
        FORK.Process(target=fill, args=(animals, tmp_path / "cache", bool(k % 2)))
        for k in range(2 + trial % 2)
    ]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    dataset = small_dataset(animals, cache=tmp_path / "cache")
    before = segments_hold(tmp_path / "cache")
    assert targets_of(dataset) == right
    assert cache_cases(dataset.report()) == []
    assert segments_hold(tmp_path / "cache") == before


def full_disk(kind: str, after: int) -> Callable[[int, bytes], int]:
    """An os.write for which the disk fills up after some entries."""
    write, count = os.write, 0

    def limited(descriptor: int, data: bytes) -> int:
        nonlocal count
        if data.startswith(segment_files.MAGIC):
            count += 1
            if count > after:
                if kind == "short":
                    return write(descriptor, data[: len(data) // 2])
                raise OSError(
                    errno.ENOSPC if kind == "full" else errno.EDQUOT, os.strerror(errno.ENOSPC)
                )
        return write(descriptor, data)

    return limited


@pytest.mark.parametrize("kind", ["full", "short", "quota"])
@pytest.mark.parametrize("after", [0, 1, 3, 6])
def test_a_full_disk_costs_no_label_and_is_told(
    animals: Path,
    right: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    after: int,
) -> None:
    dataset = small_dataset(animals, cache=tmp_path / "cache")
    monkeypatch.setattr(os, "write", full_disk(kind, after))
    assert targets_of(dataset) == right
    monkeypatch.undo()
    told = cache_cases(dataset.report())
    assert len(told) == segments_hold_when_whole(right) - after
    assert all("could not be stored" in problem for problem in told)
    assert segments_hold(tmp_path / "cache") == after
    again = small_dataset(animals, cache=tmp_path / "cache")
    assert targets_of(again) == right
    assert cache_cases(again.report()) == []


def test_a_case_that_cannot_be_written_down_stops_loading(
    copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = small_dataset(copied, on_bad="skip")
    (copied / dataset.image_id(0)).unlink()

    def full(descriptor: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(CaseFileError, match="could not be written"):
        dataset[0]


def test_a_cache_of_another_config_is_not_read(animals: Path, cache: Path) -> None:
    dataset = small_dataset(animals, cache=cache, stored_cameras="hypothesis")
    dataset[0]
    assert len(list(cache.iterdir())) == 2


@pytest.mark.parametrize("gone", ["folder", "file"])
def test_a_cache_that_is_removed_while_it_is_used_costs_no_label_and_is_told(
    animals: Path, right: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gone: str
) -> None:
    monkeypatch.setattr("animal3dbox.datasets.labelling.cache.REFRESH_S", 0.0)
    dataset = small_dataset(animals, cache=tmp_path / "cache")
    dataset[0]
    (
        shutil.rmtree(tmp_path / "cache")
        if gone == "folder"
        else segments(tmp_path / "cache")[0].unlink()
    )
    assert targets_of(dataset) == right
    assert any("cannot be read" in case for case in cache_cases(dataset.report()))
    assert segments_hold(tmp_path / "cache") == segments_hold_when_whole(
        right
    )  # what came after went to a file that can be found


def test_a_folder_called_like_a_cache_file_is_told(
    animals: Path, right: dict[str, Any], tmp_path: Path
) -> None:
    dataset = small_dataset(animals, cache=tmp_path / "cache")
    (next((tmp_path / "cache").iterdir()) / f"x{segment_files.SUFFIX}").mkdir()
    assert targets_of(dataset) == right
    assert any("cannot be read" in case for case in cache_cases(dataset.report()))


def test_a_dataset_that_is_given_up_closes_its_cache_file(animals: Path, tmp_path: Path) -> None:
    dataset = small_dataset(animals, cache=tmp_path / "cache")
    dataset[0]
    assert opened_under(tmp_path)
    del dataset
    gc.collect()
    assert not opened_under(tmp_path)


def opened_under(folder: Path) -> list[Path]:
    """Files of a folder that this process has open."""
    links = [link.readlink() for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]
    return [path for path in links if path.is_relative_to(folder)]


# Files
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [0, 3])
@pytest.mark.parametrize("fault", FILE_FAULTS)
@pytest.mark.parametrize("cached", [False, True])
def test_a_spoiled_file_is_named_and_its_neighbours_keep_their_labels(
    copied: Path, cache: Path, right: dict[str, Any], fault: str, number: int, cached: bool
) -> None:
    options: dict[str, Any] = {"on_bad": "skip", **({"cache": cache} if cached else {})}
    before = small_dataset(copied, **options)  # read while all was well
    image, field = plant(copied, "train.json", number, fault)
    if (
        fault == "mask vanished"
    ):  # when the annotations are read, the rendered mask stands in for it
        assert any(
            "the rendered one is used" in note for note in small_dataset(copied).source.notes
        )
        targets = [small_dataset(copied)[i][1] for i in range(8)]  # type: ignore[index]
        sources = {
            quality["mask_source"] for target in targets for quality in target["meta"]["quality"]
        }
        assert sources == {"dataset", "rendered"}
    for dataset in (
        (before,) if fault == "mask vanished" else (before, small_dataset(copied, **options))
    ):
        found = targets_of(dataset)
        cases = dataset.report().of("fault")
        assert {case.sample_id.partition("#")[0] for case in cases} == {image}
        assert {case.field for case in cases} <= {
            field,
            field.removesuffix("_path").replace("img", "image"),
        }
        assert {name: target for name, target in found.items() if name != image} == {
            n: t for n, t in right.items() if n != image
        }
    if fault == "mask vanished":
        return
    with pytest.raises(SampleError) as caught:
        targets_of(small_dataset(copied))
    assert (caught.value.sample_id or "").partition("#")[0] == image


@pytest.mark.parametrize("fault", ENTRY_FAULTS)
def test_a_spoiled_entry_is_named_and_its_neighbours_keep_their_labels(
    copied: Path, right: dict[str, Any], fault: str
) -> None:
    image, field = plant(copied, "train.json", 2, fault)
    dataset = small_dataset(copied, on_bad="skip")
    found = targets_of(dataset)
    (case,) = dataset.report().of("fault")
    assert case.field == field
    assert (
        json.loads((copied / "train.json").read_text())["data"][2]["img_path"] in case.sample_id
        or image in case.sample_id
    )
    assert {name: target for name, target in found.items() if name != image} == {
        n: t for n, t in right.items() if n != image
    }


@pytest.mark.parametrize("cut", [0.0, 0.2, 0.5, 0.9, 0.999])
def test_annotations_cut_off_are_refused_as_a_whole(copied: Path, cut: float) -> None:
    data = (copied / "train.json").read_bytes()
    (copied / "train.json").write_bytes(data[: int(cut * len(data))])
    with pytest.raises(DatasetFormatError, match=r"train\.json"):
        small_dataset(copied, on_bad="skip")


# Workers
# --------------------------------------------------------------------------------------------------


class Deadly(LabelDataset):
    """A dataset whose worker dies at some image, the first time."""

    fatal: int
    marker: Path

    def __getitem__(self, index: Any) -> Any:
        if index == self.fatal and not self.marker.exists():
            self.marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__getitem__(index)


def load_until_death(animals: Path, folder: Path, fatal: int) -> None:
    """Load with a worker that is killed; leaves with 0 only if nothing was told.

    In a process of its own: torch raises its error from a signal's handler, wherever the process is
    just then, and more than once.
    """
    list(
        DataLoader(
            deadly(animals, folder, fatal),
            batch_size=1,
            collate_fn=collate,
            num_workers=1,
            multiprocessing_context="fork",
        )
    )
    os._exit(0)


def deadly(animals: Path, folder: Path, fatal: int) -> Deadly:
    dataset = Deadly(small_dataset(animals).source, stored_cameras="exact", cache=folder / "cache")
    dataset.fatal, dataset.marker = fatal, folder / "died"
    return dataset


@pytest.mark.parametrize("fatal", [1, 3, 4, 6])
def test_a_worker_that_is_killed_stops_the_epoch_and_its_labels_stay(
    animals: Path, right: dict[str, Any], tmp_path: Path, fatal: int
) -> None:
    child = FORK.Process(target=load_until_death, args=(animals, tmp_path, fatal))
    child.start()
    child.join()
    assert child.exitcode not in (0, None)
    assert (tmp_path / "died").exists()
    dataset = deadly(animals, tmp_path, fatal)
    assert segments_hold(tmp_path / "cache") == sum(dataset.source.animals(i) for i in range(fatal))
    assert targets_of(dataset) == right
    assert cache_cases(dataset.report()) == []


def test_an_epoch_with_planted_faults_ends_and_names_every_one(tmp_path: Path) -> None:
    planted, report, loaded = planted_epoch(tmp_path, 300)
    assert len(planted) == 15
    assert told_apart(planted, report) == ([], [])
    assert report.counts.keys() == {"fault"}
    assert 285 <= loaded <= 285 + len(planted)  # of a spoiled animal's image the others stay

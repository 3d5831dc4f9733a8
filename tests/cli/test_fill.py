"""Filling a label cache offline, and labels in metres from the command line."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image
from small_animals import model_of, small_dataset

from animal3dbox.cli.main import main
from animal3dbox.datasets import Animal3DDataset, KnownScale, LabelFilter, Skipped
from animal3dbox.datasets.labelling.cache import LabelCache


def run(capsys: pytest.CaptureFixture[str], *arguments: Any) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments])
    printed = capsys.readouterr()
    return int(end.value.code or 0), printed.out, printed.err


def entries(cache: Path) -> int:
    (folder,) = cache.iterdir()
    return len(LabelCache(cache, bytes.fromhex(folder.name)))


def test_shards_fill_the_cache_of_a_dataset_with_the_same_options(
    animals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cache = tmp_path / "cache"
    for shard in ("1/2", "2/2"):
        code, out, _ = run(
            capsys,
            "label",
            animals,
            "--model",
            model_of(animals),
            "--stored-camera",
            "exact",
            "--cache",
            cache,
            "--shard",
            shard,
            "--json",
        )
        assert code == 0, out
    dataset = small_dataset(animals, cache=cache)
    animals_in_all = sum(dataset.source.animals(i) for i in range(len(dataset)))
    assert entries(cache) == animals_in_all
    samples = [dataset[i] for i in range(len(dataset))]
    assert not any(isinstance(sample, Skipped) for sample in samples)
    assert len(list(cache.iterdir())) == 1  # the Dataset's key is the command's
    assert entries(cache) == animals_in_all  # and it had nothing to make


def test_resuming_makes_only_what_is_missing(
    animals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = (
        "label",
        animals,
        "--model",
        model_of(animals),
        "--stored-camera",
        "exact",
        "--cache",
        tmp_path / "cache",
    )
    run(capsys, *common, "--shard", "1/2")
    half = entries(tmp_path / "cache")
    run(capsys, *common, "--resume")
    whole = entries(tmp_path / "cache")
    run(capsys, *common, "--resume", "--workers", "1")
    assert half < whole == entries(tmp_path / "cache")
    run(capsys, *common)
    assert entries(tmp_path / "cache") == 2 * whole  # without --resume all are made anew


def test_what_cannot_be_labelled_is_told_and_ends_with_code_4(
    copied: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mask = small_dataset(copied).source.sample(2).records[0].mask_path  # type: ignore[union-attr]
    assert mask is not None
    mask.write_bytes(b"no png")
    code, out, _ = run(
        capsys,
        "label",
        copied,
        "--model",
        model_of(copied),
        "--stored-camera",
        "exact",
        "--cache",
        tmp_path / "cache",
    )
    assert code == 4
    assert small_dataset(copied).image_id(2) in out
    assert "mask: " in out


def test_images_that_cannot_be_used_are_told_before_an_epoch_meets_them(
    copied: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dataset = small_dataset(copied)
    faulty = dataset.source.sample(1), dataset.source.sample(2)
    junk, resized = (sample.records[0].image_path for sample in faulty)
    assert isinstance(junk, Path)
    assert isinstance(resized, Path)
    junk.write_bytes(b"junk")
    Image.new("RGB", (8, 9)).save(resized)
    code, out, _ = run(
        capsys,
        "label",
        copied,
        "--model",
        model_of(copied),
        "--stored-camera",
        "exact",
        "--cache",
        tmp_path / "cache",
        "--json",
    )
    report = json.loads(out)
    assert code == 4
    assert {(case["sample_id"], case["field"]) for case in report["cases"]} == {
        (head.sample_id, "image") for one in faulty for head in one.animals
    }
    assert (
        report["stored"]
        == report["animals"] - sum(len(one.animals) for one in faulty)
        == entries(tmp_path / "cache")
    )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--cache", "C", "--out", "O"), "not both"),
        ((), "give --out for labels"),
        (("--out", "O", "--shard", "1/2"), "--shard is for filling"),
        (("--cache", "C", "--shard", "3/2"), "--shard must be i/n"),
        (("--cache", "C", "--shard", "two"), "--shard must be i/n"),
        (("--out", "O", "--species-scale", "--altitude-m", "3"), "give one of --metres-per-unit"),
        (("--out", "O", "--metres-per-unit", "0"), "metres per unit must be positive"),
    ],
)
def test_options_that_contradict_each_other_are_refused(
    animals: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    says: str,
) -> None:
    here = tuple(str(tmp_path / word) if word in ("C", "O") else word for word in options)
    code, _, err = run(capsys, "label", animals, *here)
    assert code == 2
    assert says in err


def test_labels_in_metres_say_so(
    animals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = tmp_path / "one"
    (one).mkdir()
    content = json.loads((animals / "train.json").read_text())
    content["data"] = content["data"][:1]
    (one / "train.json").write_text(json.dumps(content))
    run(
        capsys,
        "label",
        one,
        "--images",
        animals,
        "--model",
        model_of(animals),
        "--metres-per-unit",
        "0.5",
        "--stored-camera",
        "exact",
        "--out",
        tmp_path / "o",
    )
    (row,) = json.loads((tmp_path / "o" / "labels.json").read_text())["animals"]
    assert (row["scale_m_per_unit"], row["scale_source"]) == (0.5, "user")
    dataset = Animal3DDataset(
        one, model_of(animals), images=animals, stored_cameras="exact", scale=KnownScale(0.5)
    )
    sample = dataset[0]
    assert not isinstance(sample, Skipped)
    assert sample[1]["center"][0].tolist() == pytest.approx(row["center"], rel=1e-6)


def test_labels_made_together_are_those_made_one_by_one(
    animals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(
        capsys,
        "label",
        animals,
        "--model",
        model_of(animals),
        "--stored-camera",
        "exact",
        "--cache",
        tmp_path / "cache",
    )
    stored, fresh = small_dataset(animals, cache=tmp_path / "cache"), small_dataset(animals)
    entries_before = entries(tmp_path / "cache")
    for index in range(len(fresh)):
        for name, value in fresh[index][1].items():  # type: ignore[index]
            other = stored[index][1][name]  # type: ignore[index]
            if isinstance(value, torch.Tensor):
                assert torch.allclose(value.double(), other.double(), rtol=1e-6, atol=1e-6), name
    assert entries(tmp_path / "cache") == entries_before


def test_the_masks_overlap_is_stored_for_datasets_whose_filters_ask_for_it(
    animals: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    common = (
        "label",
        animals,
        "--model",
        model_of(animals),
        "--stored-camera",
        "exact",
        "--cache",
        tmp_path / "cache",
    )
    run(capsys, *common, "--mask-iou")
    entries_before = entries(tmp_path / "cache")
    dataset = small_dataset(
        animals, cache=tmp_path / "cache", filters=LabelFilter(min_mask_iou=0.1)
    )
    assert not isinstance(dataset[0], Skipped)
    assert entries(tmp_path / "cache") == entries_before

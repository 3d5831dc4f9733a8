"""Datasets have the habits of torchvision's, and name the right word where they differ."""

from pathlib import Path
from typing import Any

import pytest
from small_animals import model_of
from torch.utils.data import DataLoader

from animal3dbox.datasets import (
    Animal3DDataset,
    AnnotatedDataset,
    CocoKeypointsDataset,
    SyntheticDataset,
    SyntheticSet,
    collate,
)
from animal3dbox.errors import ConfigError, ShapeError


def test_the_splits_of_a_folder_are_its_files(animals: Path) -> None:
    sizes = {
        split: len(Animal3DDataset(animals, model_of(animals), split=split))
        for split in ("train", "test", "all")
        if split == "all" or (animals / f"{split}.json").is_file()
    }
    whole = sizes.pop("all")
    assert sizes
    assert sum(sizes.values()) == whole


@pytest.mark.parametrize(
    ("split", "problem"),
    [("val", "split must be train, test, all, got 'val'"), ("test", "there is no such file")],
)
def test_a_split_that_is_not_there_is_told(
    animals: Path, tmp_path: Path, split: Any, problem: str
) -> None:
    (tmp_path / "train.json").write_bytes((animals / "train.json").read_bytes())
    with pytest.raises(ConfigError, match=problem):
        Animal3DDataset(tmp_path, model_of(animals), split=split)


def test_a_split_of_one_file_is_refused(animals: Path) -> None:
    with pytest.raises(ConfigError, match="give the annotation file of the split that you want"):
        AnnotatedDataset(animals / "train.json", split="train")


@pytest.mark.parametrize(
    ("option", "word"),
    [
        ("transforms", "transform="),
        ("target_transform", "transform="),
        ("pose", "stored_cameras="),
        ("split", "it has cache, calibration, classes"),
        ("image_wh", "nearest: image_hw"),
        ("shuffle", "it has .* image_hw, images"),
    ],
)
def test_a_word_of_other_libraries_is_refused_with_ours(option: str, word: str) -> None:
    with pytest.raises(TypeError, match=f"SyntheticDataset has no {option}=.*{word}"):
        SyntheticDataset(1, **{option: 1})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("option", "word"),
    [
        ("path", "write root=, the dataset's folder"),
        ("train", "write split=, 'train'"),
        ("download", "nothing is downloaded"),
        ("stored_camera", "nearest: stored_cameras"),
    ],
)
def test_a_word_for_files_is_refused_with_ours(animals: Path, option: str, word: str) -> None:
    with pytest.raises(TypeError, match=f"Animal3DDataset has no {option}=.*{word}"):
        Animal3DDataset(animals, model_of(animals), **{option: 1})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("24", 0, None), "images must be a number of scenes"),
        ((1, "a", None), "seed a number"),
        ((1, 0, 120), r"image_hw must be \(height, width\)"),
    ],
)
def test_a_synthetic_dataset_of_no_numbers_is_refused_at_once(
    arguments: tuple[Any, ...], problem: str
) -> None:
    images, seed, image_hw = arguments
    with pytest.raises((ConfigError, ShapeError), match=problem):
        SyntheticDataset(images, seed=seed, image_hw=image_hw)


def test_the_size_of_pictures_may_be_a_list() -> None:
    image, _ = SyntheticDataset(1, image_hw=[60, 80])[0]  # type: ignore[arg-type,misc]
    assert tuple(image.shape) == (3, 60, 80)


def test_a_class_is_not_taken_for_its_letters() -> None:
    with pytest.raises(ConfigError, match=r"classes must be several names, got 'dog'"):
        SyntheticDataset(1, classes="dog")


def test_a_split_of_coco_is_a_file_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"images": [], "annotations": [], "categories": []}')
    with pytest.raises(ConfigError, match="give the annotation file of the split that you want"):
        CocoKeypointsDataset(tmp_path / "a.json", split="train")  # type: ignore[call-arg]


def test_a_synthetic_dataset_is_made_of_a_number_or_of_a_set() -> None:
    dataset = SyntheticDataset(3, seed=5, image_hw=(60, 80))
    assert len(dataset) == 3
    image, _ = dataset[0]  # type: ignore[misc]
    assert tuple(image.shape) == (3, 60, 80)
    assert dataset.image_id(0) == "5-000000"
    with pytest.raises(ConfigError, match="are the SyntheticSet's own"):
        SyntheticDataset(SyntheticSet(0, 1), seed=3)


def test_a_dataset_says_what_it_is(animals: Path) -> None:
    lines = repr(Animal3DDataset(animals, model_of(animals), split="train")).splitlines()
    assert lines[0] == "Dataset Animal3DDataset"
    assert lines[1].startswith("    Number of images: ")
    assert f"    Root location: {animals}" in lines
    assert "    Split: train" in lines
    assert "    Method: default, stored cameras hypothesis" in lines


def test_torchs_own_collate_is_refused_with_the_word_for_ours() -> None:
    dataset = SyntheticDataset(2, image_hw=(60, 80))
    with pytest.raises(TypeError, match=r"collate_fn=dataset\.collate_fn"):
        next(iter(DataLoader(dataset, batch_size=2)))
    assert dataset.collate_fn is collate
    images, targets = next(iter(DataLoader(dataset, batch_size=2, collate_fn=dataset.collate_fn)))
    assert len(images) == len(targets) == 2


def test_a_sample_is_a_pair() -> None:
    sample = SyntheticDataset(1, image_hw=(60, 80))[0]
    assert isinstance(sample, tuple)
    image, target = sample
    assert target["meta"]["sample_key"] == (0, 0)
    assert sample[0] is image

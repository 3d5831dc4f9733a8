"""A focal length that the user knows.

It goes before the dataset's, the picture's and the guess, but not before a camera of the image's
own.
"""

import json
from pathlib import Path

import pytest
import torch
from coco_dataset import coco_content, write_coco
from commands import ran
from mesh_folder_dataset import write_mesh_folder
from PIL import ExifTags, Image
from small_animals import model_of, small_dataset

from animal3dbox.datasets import AnnotatedDataset, CocoKeypointsDataset, Skipped
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import ConfigError


def test_it_is_that_of_all_images_even_if_their_headers_say_another(tmp_path: Path) -> None:
    file = write_coco(tmp_path, coco_content(tmp_path))
    for path in tmp_path.rglob("*.jpg"):
        exif = Image.Exif()
        exif[ExifTags.Base.FocalLengthIn35mmFilm] = 28
        Image.open(path).save(path, exif=exif)
    dataset = CocoKeypointsDataset(file, on_bad="skip", focal_px=333.0)
    targets = [
        sample[1] for i in range(len(dataset)) if not isinstance(sample := dataset[i], Skipped)
    ]
    assert targets
    for target in targets:
        assert target["K"][0, 0] == target["K"][1, 1] == 333.0
        assert {quality["K_source"] for quality in target["meta"]["quality"]} == {"given"}
    assert "333 px" in " ".join(dataset.source.notes)


def test_a_datasets_own_camera_does_not_hold_for_another_focal_length(animals: Path) -> None:
    dataset = small_dataset(animals, stored_cameras="hypothesis", focal_px=150.0)
    for record in dataset.source.sample(0).records:
        assert isinstance(record, AnimalRecord)
        assert record.K is not None
        assert record.K[0, 0] == 150
        assert record.stored_pose is None
    with pytest.raises(ConfigError, match="'exact' needs cameras"):
        small_dataset(animals, focal_px=150.0)


def test_a_camera_of_the_images_own_stays(tmp_path: Path) -> None:
    root = write_mesh_folder(tmp_path)
    plain, told = AnnotatedDataset(root), AnnotatedDataset(root, focal_px=77.0)
    for index in range(2):
        before, after = plain[index], told[index]
        assert not isinstance(before, Skipped)
        assert not isinstance(after, Skipped)
        assert torch.equal(before[1]["K"], after[1]["K"])


@pytest.mark.parametrize("focal_px", ["0", "-3", "nan", "inf"])
def test_no_focal_length_is_refused(animals: Path, tmp_path: Path, focal_px: str) -> None:
    code, said = ran(
        "label",
        animals,
        "--model",
        model_of(animals),
        "--out",
        tmp_path / "out",
        "--focal-px",
        focal_px,
    )
    assert code == 2
    assert "focal_px must be a positive number" in said


def test_the_command_fills_the_cache_of_the_dataset_with_the_same_focal_length(
    animals: Path, tmp_path: Path
) -> None:
    code, said = ran(
        "label",
        animals,
        "--model",
        model_of(animals),
        "--cache",
        tmp_path / "cache",
        "--focal-px",
        "150",
        "--json",
    )
    assert code == 0, said
    stored = json.loads(said)["stored"]
    dataset = small_dataset(
        animals,
        stored_cameras="hypothesis",
        focal_px=150.0,
        cache=tmp_path / "cache",
        on_bad="skip",
    )
    (folder,) = (tmp_path / "cache").iterdir()
    before = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    assert (
        sum(
            len(sample[1]["labels"])
            for i in range(len(dataset))
            if not isinstance(sample := dataset[i], Skipped)
        )
        <= stored
    )
    assert list((tmp_path / "cache").iterdir()) == [folder]
    assert sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) == before

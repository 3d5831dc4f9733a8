"""Every format through its Dataset: samples that agree with themselves, in every form of batch."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from coco_dataset import coco_content, write_coco
from cuboid_sets import random_set
from deeplabcut_files import table, write_csv, write_images
from mesh_folder_dataset import write_mesh_folder
from PIL import Image

from animal3dbox.datasets import (
    CocoKeypointsDataset,
    DeepLabCutDataset,
    LabelDataset,
    MeshFolderDataset,
    Omni3DDataset,
    Skipped,
    collate,
)
from animal3dbox.datasets.exchange.omni3d_writer import write_omni3d
from animal3dbox.datasets.labelling.skipped import Target
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.transforms import Compose, RandomHorizontalFlip, Resize


def used(dataset: LabelDataset, index: int) -> tuple[torch.Tensor, Target]:
    sample = dataset[index]
    assert not isinstance(sample, Skipped)
    return sample


def coco(folder: Path, **options: object) -> LabelDataset:
    return CocoKeypointsDataset(write_coco(folder, coco_content(folder)), on_bad="skip", **options)  # type: ignore[arg-type]


def mesh_folder(folder: Path, **options: object) -> LabelDataset:
    return MeshFolderDataset(write_mesh_folder(folder), on_bad="skip", **options)  # type: ignore[arg-type]


def omni3d(folder: Path, **options: object) -> LabelDataset:
    boxes = random_set()
    for image in boxes.images:
        (folder / "images").mkdir(exist_ok=True)
        Image.fromarray(np.zeros((*image.image_hw, 3), np.uint8)).save(
            folder / str(image.image_path)
        )
    write_omni3d(boxes, folder / "boxes.json")
    return Omni3DDataset(folder / "boxes.json", heading_known=True, **options)  # type: ignore[arg-type]


def deeplabcut(folder: Path, **options: object) -> LabelDataset:
    write_images(folder, 3)
    write_csv(folder / "labels.csv", table([[90.0], [-90.0], [30.0]]))
    return DeepLabCutDataset(folder, on_bad="skip", **options)  # type: ignore[arg-type]


MAKE: dict[str, Callable[..., LabelDataset]] = {
    "coco": coco,
    "deeplabcut": deeplabcut,
    "mesh_folder": mesh_folder,
    "omni3d": omni3d,
}


@pytest.mark.parametrize("name", MAKE)
def test_targets_agree_with_themselves(tmp_path: Path, name: str) -> None:
    dataset = MAKE[name](tmp_path)
    used = [sample for i in range(len(dataset)) if not isinstance(sample := dataset[i], Skipped)]
    assert used, dataset.report()
    for image, target in used:
        assert image.dtype == torch.uint8
        box = Cuboid(
            target["center"].double(), target["rotation"].double(), target["size"].double()
        )
        assert torch.allclose(box.corners(), target["corners_3d"].double(), atol=1e-4)
        if "distortion" not in target:
            seen = project(target["K"].double(), target["corners_3d"].double())[0]
            assert torch.allclose(
                seen[target["corner_in_front"]],
                target["corners_2d"][target["corner_in_front"]].double(),
                atol=0.1,
                rtol=1e-3,
            )


@pytest.mark.parametrize("name", MAKE)
def test_targets_go_through_transforms_and_batches(tmp_path: Path, name: str) -> None:
    dataset = MAKE[name](tmp_path, transform=Compose([RandomHorizontalFlip(1.0), Resize((64, 96))]))
    if name == "omni3d":  # boxes round the camera have no projection to mirror
        dataset = MAKE[name](tmp_path, transform=Compose([Resize((64, 96))]))
    images, targets = collate([dataset[i] for i in range(len(dataset))])
    assert len(images) == len(targets) > 0
    assert {tuple(image.shape) for image in images} == {(3, 64, 96)}


def test_the_animals_of_an_image_come_together(tmp_path: Path) -> None:
    dataset = coco(tmp_path)
    assert any(dataset.source.animals(i) > 1 for i in range(len(dataset)))
    assert len({dataset.image_id(i) for i in range(len(dataset))}) == len(dataset)


def test_known_cameras_and_units_of_a_mesh_folder_are_used(tmp_path: Path) -> None:
    dataset = mesh_folder(tmp_path)
    sources = {
        q["pose_source"]
        for i in range(len(dataset))
        if not isinstance(sample := dataset[i], Skipped)
        for q in sample[1]["meta"]["quality"]
    }
    assert "given" in sources


def test_boxes_that_come_as_they_are_need_no_animal(tmp_path: Path) -> None:
    dataset = omni3d(tmp_path)
    boxes = random_set()
    assert len(dataset) == len(boxes.images)
    counts = {}
    for index in range(len(dataset)):
        _, target = used(dataset, index)
        counts[target["image_id"]] = len(target["labels"])
        assert target["scale_known"].all()
    assert list(counts.values()) == [4, 1, 0, 2, 3]
    centers = torch.cat([used(dataset, i)[1]["center"] for i in range(len(dataset))])
    assert torch.allclose(
        centers, torch.from_numpy(np.stack([r.center for r in boxes.records])).float(), atol=1e-5
    )


def test_faces_have_no_names_while_the_heading_is_unknown(tmp_path: Path) -> None:
    omni3d(tmp_path)
    dataset = Omni3DDataset(tmp_path / "boxes.json", heading_known=False)
    for index in range(len(dataset)):
        _, target = used(dataset, index)
        assert not [name for name in target if name.startswith("face_")]
        assert target["corners_3d"].shape[1:] == (8, 3)

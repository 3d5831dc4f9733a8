"""Small synthetic datasets in a folder, and ways to spoil them."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from animal3dbox.datasets.format_datasets import Animal3DDataset
from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, animal3d_world
from animal3dbox.datasets.synthetic.world.config import WorldConfig

HW = (120, 160)


def write_small_animals(
    folder: Path, images: int = 8, seed: int = 3, hw: tuple[int, int] = HW
) -> Path:
    """An Animal3D folder of small pictures, its model beside it."""
    world = replace(animal3d_world(WorldConfig()), image_hw=hw)
    write_animal3d(SyntheticSet(seed, images, world), folder, model_of(folder))
    return folder


def model_of(folder: Path) -> Path:
    """The SMAL pickle of a folder."""
    return folder.parent / f"{folder.name}-model.pkl"


def small_dataset(folder: Path, **options: Any) -> Animal3DDataset:
    """Its Dataset, with its bodies and, unless told otherwise, its cameras taken as known."""
    return Animal3DDataset(folder, model_of(folder), **{"stored_cameras": "exact", **options})


def spoiled(folder: Path, change: Callable[[list[dict[str, Any]]], None]) -> None:
    """Change the entries of a folder's train.json."""
    file = folder / "train.json"
    content = json.loads(file.read_text())
    change(content["data"])
    file.write_text(json.dumps(content))

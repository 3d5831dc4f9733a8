"""Draw animals of the foreign world with their true boxes and the labels that "fit" gives them.

    OMP_NUM_THREADS=1 nice -n 5 python benchmarks/teach_pictures.py OUT

The pupils of benchmarks/teach.py learn from these pictures. OUT/train-*.pt and OUT/test-*.pt are
written as they are made, and what is there is not made again. Bodies are stretched beyond the
presets, keypoints are off by 1 px and their places by 3 % of the trunk, joints are beyond their
limits by 5 degrees; species are not told to the fit. Animals with fewer than 10 keypoints are left
out of train, since a rigid body is for them; test has all.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor
from tqdm import tqdm

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.foreign.animals import ForeignAnimal, foreign_animal
from animal3dbox.datasets.synthetic.foreign.config import ForeignConfig
from animal3dbox.datasets.synthetic.world.animals import StandingAnimal
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.datasets.synthetic.world.render import render_scene
from animal3dbox.datasets.synthetic.world.scene import plan_scene
from animal3dbox.evaluate.fit_study import FOREIGN, LEAST_KEYPOINTS, QUICK, fit_arguments
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.labels.label import label_many
from animal3dbox.labels.types import CuboidLabel, Rejection
from animal3dbox.smal.keypoints.exchanges import exchange_order
from animal3dbox.training.detector_targets import crop_boxes

CANVAS_PX, CANVAS_MARGIN = 96, 0.4
"""Side of the stored crops, and the part of the 2D box that is shown beside it."""
FIRST_SEED = {"train": 1000, "test": 5000}
"""The first of the 50 seeds of each split: no body and no scene of one is in the other."""
CHUNK = 48
EXCHANGED_EVERY = 10
"""One animal in so many has its left and right keypoints exchanged, for a second label."""
WORLD: WorldConfig = replace(
    FOREIGN.world, image_hw=(240, 320), focal_px=(250.0, 2500.0), elevation_deg=(5.0, 85.0)
)
CONFIG: ForeignConfig = replace(FOREIGN, world=WORLD, faults=FaultConfig(noise_px=1.0))


def picture_of(animal: ForeignAnimal, seed: int, index: int) -> Tensor:
    """The picture (3, H, W) uint8 of a foreign animal on the ground of the world's own scene."""
    plan = plan_scene(seed, index, WORLD)
    betas, pose, trans = (torch.zeros(0) for _ in range(3))  # drawing needs the vertices alone
    standing = StandingAnimal(
        preset=animal.preset,
        pose_name=animal.pose,
        betas=betas,
        pose=pose,
        trans=trans,
        vertices=animal.vertices,
        R_world_joint=animal.body.R_world_joint[0],
    )
    alone = replace(
        plan, camera=animal.camera, animals=(standing,), coats=plan.coats[:1], things=(), ground_z=0
    )
    return render_scene(alone).image.permute(2, 0, 1)


def fitted_labels(animals: Sequence[ForeignAnimal], *, exchanged: bool) -> dict[str, Tensor]:
    """The labels of animals by bodies fitted to them; NaN, and a confidence of 0, without one."""
    requests = [{**fit_arguments(animal), "body": "fit"} for animal in animals]
    if exchanged:
        for animal, request in zip(animals, requests, strict=True):
            order = list(exchange_order(animal.vocabulary, "all"))
            request["keypoints_2d"] = animal.keypoints_2d[order]
    labels = label_many(requests, QUICK)
    return fields_of(
        [label.cuboid if isinstance(label, CuboidLabel) else None for label in labels],
        [0.0 if isinstance(label, Rejection) else label.confidence for label in labels],
    )


def fields_of(cuboids: Sequence[Cuboid | None], weights: Sequence[float]) -> dict[str, Tensor]:
    """Boxes as a target's fields in float32; NaN for those that are not there."""
    fields = {
        "center": torch.full((len(cuboids), 3), torch.nan),
        "rotation": torch.full((len(cuboids), 3, 3), torch.nan),
        "size": torch.full((len(cuboids), 3), torch.nan),
    }
    for number, cuboid in enumerate(cuboids):
        if cuboid is not None:
            for name, value in fields.items():
                value[number] = getattr(cuboid, name)
    return {**fields, "confidence": torch.tensor(weights)}


def chunk_of(split: str, first: int) -> dict[str, dict[str, Tensor]]:
    """The crops of CHUNK animals from a number on, their true boxes, and for train the fitted."""
    animals, crops = [], []
    for index in range(first, first + CHUNK):
        seed = FIRST_SEED[split] + index % 50
        animal = foreign_animal(seed, index, CONFIG, dataset=0)
        if split == "train" and int((animal.keypoints_2d[:, 2] > 0).sum()) < LEAST_KEYPOINTS:
            continue
        px, _ = animal.camera.project(animal.vertices)
        target = {"boxes": torch.cat((px.amin(0), px.amax(0)))[None], "K": animal.camera.K}
        image = picture_of(animal, seed, index)
        size = (CANVAS_PX, CANVAS_PX)
        crops.append(crop_boxes([image], [target], size, margin=CANVAS_MARGIN))
        animals.append(animal)
    shown = {
        "pixels": torch.cat([crop.pixels for crop in crops]),
        "K": torch.cat([crop.K for crop in crops]).float(),
        "boxes": torch.cat([crop.boxes for crop in crops]).float(),
    }
    chunk = {
        "shown": shown,
        "true": fields_of([one.cuboid for one in animals], [1.0] * len(animals)),
    }
    if split == "train":
        chunk["fitted"] = fitted_labels(animals, exchanged=False)
        second = fitted_labels(animals[::EXCHANGED_EVERY], exchanged=True)
        chunk["exchanged"] = {name: value.clone() for name, value in chunk["fitted"].items()}
        for name, value in second.items():
            chunk["exchanged"][name][::EXCHANGED_EVERY] = value
    return chunk


def main() -> None:
    """Make what is not there yet."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--train", type=int, default=1824, help="animals drawn")
    parser.add_argument("--test", type=int, default=768)
    options = parser.parse_args()
    torch.set_num_threads(1)
    options.out.mkdir(parents=True, exist_ok=True)
    chunks = [("test", k) for k in range(0, options.test, CHUNK)]
    chunks += [("train", k) for k in range(0, options.train, CHUNK)]
    for split, first in tqdm(chunks):
        path = options.out / f"{split}-{first:05d}.pt"
        if not path.exists():
            part = path.with_suffix(".part")
            torch.save(chunk_of(split, first), part)
            part.replace(path)


if __name__ == "__main__":
    main()

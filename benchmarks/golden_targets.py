"""Augmented images and targets for the golden record: animals' and other people's cuboids."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import kornia.augmentation as kornia
import numpy as np
import torch
from golden_datasets import add_samples, golden_sets
from golden_names import named
from golden_values import GoldenValues

SEED = 11
Pipelines = dict[str, tuple[list[Any], dict[str, Any]]]


def transform(name: str, *values: Any, **options: Any) -> Any:
    """One of the package's transforms, or a helper of theirs, called."""
    return named(f"animal3dbox.transforms.{name}")(*values, **options)


def plain_pipelines() -> Pipelines:
    """Pipelines that any target can follow, one with a lens too."""
    flip, crop = transform("RandomHorizontalFlip"), transform("RandomResizedCrop", 96)
    return {
        "train": ([flip, crop, transform("ColorJitter", 0.2, 0.2, 0.2, 0.1)], {}),
        "roll": ([transform("RandomRotation", 25), transform("RandomGaussianNoise", p=1.0)], {}),
        "letter": ([transform("LetterBox", (96, 128)), transform("RandomVerticalFlip", 1.0)], {}),
        "whole": (
            [
                transform("Resize", 90),
                transform("CenterCrop", (80, 100), 0.2),
                transform("PadTo", (130, 170), "top_left"),
                transform("RandomGrayscale", 0.5),
                transform("Normalize"),
            ],
            {"fill": 0.5},
        ),
    }


def camera_pipelines() -> Pipelines:
    """Pipelines that turn the camera, for targets without a lens."""
    turn = transform("RandomVirtualCamera", 5, 5, 10, (0.9, 1.2))
    affine = transform("RandomAffine", 15, (0.1, 0.1), (0.8, 1.2), (-5, 5))
    perspective = transform("RandomPerspective", 0.3, 1.0, allow_skew=True)
    blur, erase = transform("RandomGaussianBlur", p=1.0), transform("RandomErasing", 1.0)
    flip, crop = transform("RandomHorizontalFlip"), transform("RandomResizedCrop", 64)
    mixed = [flip, turn, crop, transform("ColorJitter", 0.2), blur, erase]
    return {
        "mixed": (mixed, {}),
        "noisy": ([turn, kornia.RandomHue((-0.1, 0.1), p=0.5), erase, flip], {}),
        "skew": ([affine, perspective], {"allow_skew": True, "interpolation": "nearest"}),
        "aimed": ([transform("PerspectiveCrop", (80, 80), jitter_deg=2.0)], {}),
        "kornia": (
            [
                kornia.RandomAffine(10.0, (0.05, 0.05), (0.9, 1.1), p=1.0),
                kornia.RandomHorizontalFlip(p=0.5),
                kornia.RandomResizedCrop((80, 100)),
                kornia.ColorJiggle(0.2, 0.2, 0.2, 0.1, p=1.0),
                kornia.RandomGamma((0.7, 1.5), p=1.0),
            ],
            {"allow_skew": True},
        ),
        "kornia-view": (
            [
                kornia.RandomPerspective(0.3, p=1.0),
                kornia.RandomRotation(20.0, p=1.0),
                kornia.RandomGaussianBlur((5, 5), (0.5, 1.5), p=1.0),
                kornia.RandomPlanckianJitter(p=1.0),
                kornia.Resize((90, 90)),
            ],
            {"allow_skew": True},
        ),
    }


def composed(pipeline: tuple[list[Any], dict[str, Any]]) -> Any:
    """The pipeline as one transform with the record's seed."""
    return transform("Compose", pipeline[0], seed=SEED, **pipeline[1])


def record_augmented(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    """Record augmented samples of the Datasets, singly and in batches, in two epochs."""
    sets = golden_sets(inputs)
    lensless = {**plain_pipelines(), **camera_pipelines()}
    jobs: dict[str, Pipelines] = {
        "known": lensless,
        "coco": lensless,
        "things": lensless,
        "world": lensless,
        "dogs": plain_pipelines(),
        "deeplabcut": plain_pipelines(),
        "meshes_cameras": plain_pipelines(),
    }
    for name, pipelines in jobs.items():
        for pipeline, steps in pipelines.items():
            with values.section(f"augmented {name} {pipeline}"):
                dataset = sets[name].opened(transform=composed(steps))
                keys = [(1, number) for number in range(len(dataset))]
                add_samples(values, f"augmented/{name}/{pipeline}", [dataset[k] for k in keys])
                dataset.set_epoch(3)
                batch = dataset.__getitems__([0, 1])
                add_samples(values, f"augmented/{name}/{pipeline}/batch", batch)


def bare_scenes(inputs: Path) -> list[tuple[torch.Tensor, dict[str, Any]]]:
    """Pictures and targets of cuboids that are no animals."""
    arrays = np.load(inputs / "bare.npz")
    scenes = []
    for number in range(3):
        prefix = f"{number}/"
        names = [name for name in arrays.files if name.startswith(prefix)]
        target = {n.removeprefix(prefix): torch.from_numpy(arrays[n]) for n in names}
        image = target.pop("image").permute(2, 0, 1).contiguous()
        scenes.append((image, {**target, "image_id": f"scene-{number}"}))
    return scenes


def record_bare(values: GoldenValues, inputs: Path, scratch: Path) -> None:
    """Record bare cuboids under every pipeline, every transform alone, and back again."""
    scenes = bare_scenes(inputs)
    pipelines = {**plain_pipelines(), **camera_pipelines()}
    for pipeline, steps in list(pipelines.items()):
        pipelines |= {f"{pipeline}-{n}": ([one], steps[1]) for n, one in enumerate(steps[0])}
    for name, steps in pipelines.items():
        with values.section(f"bare {name}"):
            compose = composed(steps)
            for number, (image, target) in enumerate(scenes):
                made, after = compose(image, target, key=(2, number))
                add_samples(values, f"bare/{name}/{number}", [(made, after)])
                _add_back(values, f"bare/{name}/{number}/back", after, image)
    for name, make in _helpers(scenes).items():
        with values.section(f"bare {name}"):
            values.add(f"bare/{name}", make())


def _add_back(values: GoldenValues, name: str, after: dict[str, Any], image: torch.Tensor) -> None:
    """Record an augmented target's boxes as predictions for the original picture."""
    if "H_out_in" not in after:
        return
    fields = ("K", "corners_3d", "center", "rotation", "size", "corners_2d", "boxes")
    predicted = {field: after[field] for field in fields if field in after}
    hw = (image.shape[1], image.shape[2])
    values.add_target(name, transform("inverse", predicted, after["H_out_in"], hw))


def _helpers(scenes: list[tuple[torch.Tensor, dict[str, Any]]]) -> dict[str, Callable[[], Any]]:
    """What stands beside the transforms: batches, plans, moved targets, cameras, kornia's keys."""
    image, target = scenes[1]
    rows = [[0.8, 0.1, 5.0], [-0.1, 0.9, 7.0], [0.0002, 0.0001, 1.0]]
    H = torch.tensor(rows, dtype=torch.float64)
    compose = composed(camera_pipelines()["mixed"])
    images, targets = [one for one, _ in scenes], [one for _, one in scenes]
    keys = [(4, number) for number in range(3)]

    def planned() -> Any:
        plan = compose.sample_params((120, 160), target, (5, 1))
        return compose.apply(image, target, plan)

    def sequential() -> Any:
        torch.manual_seed(7)
        ops = (kornia.RandomHorizontalFlip(p=0.5), kornia.RandomAffine(10.0, p=1.0))
        names = ["input", "K", "corners_3d"]
        augment = transform("CameraAugmentationSequential", *ops, data_keys=names, allow_skew=True)
        batch = (image[None].double() / 255, target["K"][None], target["corners_3d"][None])
        return augment(*batch)

    def moved() -> Any:
        return transform("transform_target", target, H, (120, 160), (100, 140), allow_skew=True)

    return {
        "batch": lambda: compose.batch((images, targets), keys=keys),
        "planned": planned,
        "sequential": sequential,
        "moved": moved,
        "camera": lambda: transform("update_camera", target["K"], H),
        "projected": lambda: transform("project_in_front", target["K"], target["corners_3d"]),
    }

"""How often check_targets finds keypoints that were mirrored alone, and how often it errs.

python benchmarks/mirrored_keypoints.py [--images N] [--data PATH]: the synthetic world, exact and
with 2 px of noise, 10 % outliers and hidden keypoints marked; or a dataset that `animal3dbox label`
reads; both as they are, cropped, turned, and under virtual cameras.
"""

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from animal3dbox.datasets import Skipped, SyntheticDataset, SyntheticSet
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.training.checks import check_targets
from animal3dbox.transforms import (
    Compose,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomRotation,
    RandomVerticalFlip,
    RandomVirtualCamera,
)

HW = (240, 320)
AUGMENTED = (
    Compose([RandomHorizontalFlip(), RandomResizedCrop((200, 260), scale=(0.2, 1.0))], seed=1),
    Compose([RandomHorizontalFlip(), RandomVerticalFlip(), RandomRotation(180)], seed=2),
    Compose(
        [RandomHorizontalFlip(), RandomVirtualCamera(5, 5, 10), RandomResizedCrop(128)], seed=3
    ),
)
FIELDS = ("boxes", "corners_2d", "corner_in_front", "keypoints", "masks")


def animals(image: Tensor, target: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """A target with FIELDS of each animal that has four keypoints in the image."""
    height, width = image.shape[-2:]
    for n, keypoints in enumerate(target["keypoints"]):
        x, y, visibility = keypoints.unbind(-1)
        in_image = (x >= -0.5) & (y >= -0.5) & (x <= width - 0.5) & (y <= height - 0.5)
        if int((in_image & (visibility > 0)).sum()) >= 4:
            yield {name: target[name][n : n + 1] for name in FIELDS if name in target}


def mirrored(animal: dict[str, Any], axis: int, length: int) -> dict[str, Any]:
    """The animal with its keypoints, and nothing else, mirrored."""
    keypoints = animal["keypoints"].clone()
    keypoints[..., axis] = length - 1 - keypoints[..., axis]
    return {**animal, "keypoints": keypoints}


def is_detected(animal: dict[str, Any], image: Tensor, *, by_mask: bool) -> bool:
    """Whether the check objects, in a step that looks at the animal's mask or at its box alone."""
    report = check_targets([animal], [image], step=1 if by_mask else 2, on_fault="count")
    return report.counts["keypoints_on_animal"] > 0


def count_alarms(dataset: LabelDataset, augmented: Sequence[Any]) -> Counter[str]:
    """Number of animals, of false alarms, and of mirrored animals that are detected."""
    counts: Counter[str] = Counter()
    for index in range(len(dataset)):
        sample = dataset[index]
        if isinstance(sample, Skipped):
            continue
        for transform in (None, *augmented):
            image, target = sample if transform is None else transform(*sample, key=(0, index))
            for animal in animals(image, target):
                counts["good animals"] += 1
                counts["false alarms"] += is_detected(animal, image, by_mask=True)
                for axis, name in ((0, "left to right"), (1, "top to bottom")):
                    wrong = mirrored(animal, axis, image.shape[2 - axis])
                    counts[f"{name}, in the mask's turn"] += is_detected(wrong, image, by_mask=True)
                    counts[f"{name}, by boxes"] += is_detected(wrong, image, by_mask=False)
    return counts


def main() -> None:
    """Print the share of mirrored animals that are detected, for each dataset."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=400)
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--data", type=Path)
    options = parser.parse_args()
    torch.set_num_threads(1)
    datasets: dict[str, LabelDataset] = {}
    if options.data is not None:
        datasets[str(options.data)] = AnnotatedDataset(options.data, on_bad="skip")
    else:
        world = SyntheticSet(options.seed, options.images, replace(WorldConfig(), image_hw=HW))
        datasets["synthetic, exact"] = SyntheticDataset(world, on_bad="skip")
        faulty = replace(world, faults=FaultConfig(noise_px=2, outliers=0.1), hidden="marked")
        datasets["synthetic, 2 px, 10 % outliers, hidden ones marked"] = SyntheticDataset(
            faulty, on_bad="skip"
        )
    for name, dataset in datasets.items():
        counts = count_alarms(dataset, AUGMENTED)
        print(
            f"{name}: {counts['good animals']} good animals, {counts['false alarms']} false alarms;"
            " mirrored ones found:"
        )
        for kind, number in counts.items():
            if kind.startswith(("left", "top")):
                print(f"  {kind}: {number / counts['good animals']:.1%}")


if __name__ == "__main__":
    main()

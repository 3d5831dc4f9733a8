"""How often check_targets objects to right targets, under every geometric transform of ours.

The synthetic world's targets, with all fields and as bare cuboids, each as it is and under eleven
pipelines, with every mask and keypoint looked at (no step).

Run: OMP_NUM_THREADS=1 python benchmarks/check_false_alarms.py [--images 500] [--seed 77]
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch
from planted_faults import HW, Sample, bare, samples_of

from animal3dbox.training import TargetReport, check_targets
from animal3dbox.transforms import (
    Compose,
    RandomAffine,
    RandomHorizontalFlip,
    RandomResizedCrop,
    RandomRotation,
    RandomVerticalFlip,
    RandomVirtualCamera,
    Resize,
)

PIPELINES: dict[str, Sequence[Any]] = {
    "as it is": (),
    "flip": (RandomHorizontalFlip(p=1),),
    "vertical flip": (RandomVerticalFlip(p=1),),
    "halved": (Resize((120, 160)),),
    "stretched": (Resize((300, 320)),),
    "crop": (RandomResizedCrop((200, 260), scale=(0.5, 1.0)),),
    "small crop": (RandomResizedCrop(128, scale=(0.1, 0.4)),),
    "rotation": (RandomRotation(30),),
    "any rotation, flip": (RandomRotation(180), RandomHorizontalFlip()),
    "virtual camera": (RandomVirtualCamera(5, 5, 10),),
    "virtual camera, flip, crop": (
        RandomVirtualCamera(5, 5, 10),
        RandomHorizontalFlip(),
        RandomResizedCrop(160, scale=(0.3, 1.0)),
    ),
    "affine": (RandomAffine(10, scale=(0.7, 1.3)),),
}


def report_under(name: str, samples: Sequence[Sample]) -> TargetReport:
    """The faults and warnings of right samples under a pipeline."""
    compose = Compose(PIPELINES[name], seed=5)
    report = TargetReport()
    for index, (hw, target) in enumerate(samples):
        image = torch.zeros(3, *hw, dtype=torch.uint8)
        image, mapped = compose(image, target, key=(0, index))
        report += check_targets([mapped], [tuple(image.shape[-2:])], on_fault="count")
    return replace(report, spans={})


def main() -> None:
    """Print the counts under each pipeline, of all fields and of bare cuboids."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=500)
    parser.add_argument("--seed", type=int, default=77)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print_alarms(samples_of(options.seed, options.images))


def print_alarms(samples: Sequence[Sample]) -> None:
    """Print the counts of some samples of HW under each pipeline."""
    whole = TargetReport()
    for form, own in (("all fields", samples), ("bare", bare(samples))):
        for name in PIPELINES:
            report = report_under(name, own)
            whole += report
            print(
                f"{form}, {name} ({HW[1]} x {HW[0]}): {report.animals} animals, {report.faults}"
                f" errors {dict(report.counts)}, warnings {dict(report.warnings)}",
                flush=True,
            )
            for check, error in report.examples:
                if check in report.counts:
                    print(f"  {check}: {error}")
    print(
        f"in all {whole.animals} animals, {whole.faults} errors, {whole.warnings.total()} warnings"
    )


if __name__ == "__main__":
    main()

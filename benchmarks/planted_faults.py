"""How often check_targets finds each of 65 kinds of mistakes, in our targets and in bare cuboids.

Batches of eight targets of the synthetic world, of which one is spoiled (tests/support/
target_faults.py); the ranges are learned from another seed's targets. Prints the table of
docs/checks.md: of so many batches, in how many an error or (in brackets) at least a warning was
raised that the right batch does not have.

Run: OMP_NUM_THREADS=1 python benchmarks/planted_faults.py [--batches 100] [--learned 600]
"""

import argparse
import copy
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from target_faults import BARE, CLASSES, KINDS, Batch

from animal3dbox.datasets import Skipped, SyntheticDataset, SyntheticSet
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.training import TargetRanges, TargetReport, check_targets, learn_ranges

HW = (240, 320)
LEARNED_SEED, REPORTED_SEED = 21, 77
"""Thresholds were fixed, and ranges are learned, on the first; the second is reported."""
Sample = tuple[tuple[int, int], dict[str, Any]]


def samples_of(seed: int, images: int) -> list[Sample]:
    """Sizes and targets of the synthetic world's images."""
    world = SyntheticSet(seed, images, replace(WorldConfig(), image_hw=HW))
    dataset = SyntheticDataset(world, on_bad="skip")
    made = (dataset[index] for index in range(images))
    return [
        ((sample[0].shape[-2], sample[0].shape[-1]), sample[1])
        for sample in made
        if not isinstance(sample, Skipped) and len(sample[1]["labels"])
    ]


def bare(samples: Sequence[Sample]) -> list[Sample]:
    """The samples with the fields of somebody else's cuboids alone."""
    return [(hw, {name: target[name] for name in BARE}) for hw, target in samples]


def report_of(batch: Batch, ranges: TargetRanges | None) -> TargetReport:
    """What is said of a batch, all of it looked at."""
    return check_targets(
        batch.targets, batch.sizes, on_fault="count", classes=CLASSES, ranges=ranges
    )


def planted(samples: Sequence[Sample], kind: str, seed: int) -> Batch | None:
    """Eight samples of which one is spoiled; None if the kind spoils none of them."""
    rng = np.random.default_rng(seed)
    chosen = [samples[k] for k in rng.choice(len(samples), 8, replace=False)]
    for number in rng.permutation(8).tolist():
        batch = Batch([t for _, t in chosen], [hw for hw, _ in chosen], number, rng)
        batch.targets[number] = copy.copy(batch.targets[number])
        if KINDS[kind](batch):
            return batch
    return None


def counts_of(
    samples: Sequence[Sample], kind: str, ranges: TargetRanges, batches: int
) -> tuple[int, int, int]:
    """How many batches could have the mistake, had an error, and had an error or a warning.

    Errors are those without any range; a warning must be of the spoiled target.
    """
    made = errors = either = 0
    for seed in range(batches):
        batch = planted(samples, kind, seed)
        if batch is None:
            continue
        made += 1
        if report_of(batch, None).faults:
            errors += 1
            either += 1
            continue
        alone = check_targets(
            [batch.target], [batch.hw], on_fault="count", classes=CLASSES, ranges=ranges
        )
        either += alone.warnings["unusual"] > 0
    return made, errors, either


def with_exchanged_sides(samples: Sequence[Sample], part: float) -> list[Sample]:
    """The samples with the names of all keypoints exchanged in a part of the animals."""
    rng = np.random.default_rng(0)
    out = []
    for hw, target in samples:
        keypoints = target["keypoints"].clone()
        for n in np.flatnonzero(rng.random(len(keypoints)) < part).tolist():
            keypoints[n] = keypoints[n, target["keypoint_mirror"]]
        out.append((hw, {**target, "keypoints": keypoints}))
    return out


def print_side_votes(name: str, samples: Sequence[Sample]) -> None:
    """Print what an epoch's votes say of samples as they are, and with sides exchanged."""
    for part in (0.0, 0.05, 0.1, 0.2, 1.0):
        spoiled = with_exchanged_sides(samples, part)
        report = check_targets([t for _, t in spoiled], [hw for hw, _ in spoiled], on_fault="count")
        votes = report.sides
        print(
            f"{name}, sides of {part:.0%} exchanged: {votes.animals[True]} of"
            f" {votes.animals.total()} animals that tell (of {report.animals}) lie the other way"
            f" round; {len(votes.warnings)} warnings"
        )


def main() -> None:
    """Print the table, and what is said of exchanged sides over an epoch."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batches", type=int, default=100)
    parser.add_argument("--learned", type=int, default=600, help="images to learn ranges from")
    parser.add_argument("--seed", type=int, default=REPORTED_SEED)
    options = parser.parse_args()
    torch.set_num_threads(1)
    learned, reported = samples_of(LEARNED_SEED, options.learned), samples_of(options.seed, 400)
    print_side_votes(f"seed {LEARNED_SEED}", learned)
    print_side_votes(f"seed {options.seed}", reported)
    print_tables(learned, reported, options.batches)


def print_tables(learned: Sequence[Sample], reported: Sequence[Sample], batches: int) -> None:
    """Print a row a kind, then the sums."""
    rows: dict[str, list[str]] = {kind: [] for kind in KINDS}
    for form, of in (("ours", lambda s: list(s)), ("bare", bare)):
        own, checked = of(learned), of(reported)
        ranges = learn_ranges([t for _, t in own], [hw for hw, _ in own])
        always = never = kinds = 0
        for kind in KINDS:
            made, errors, either = counts_of(checked, kind, ranges, batches)
            text = f"{errors} ({either})" + ("" if made == batches else f" of {made}")
            rows[kind].append(text if made else "-")
            kinds += made > 0
            always += 0 < made == either
            never += made > 0 == either
        clean = [
            check_targets([t], [hw], on_fault="count", classes=CLASSES, ranges=ranges)
            for hw, t in checked
        ]
        total = sum(clean, TargetReport())
        print(
            f"{form}: always {always}, never {never} of {kinds} kinds; {total.animals} right"
            f" animals: {total.faults} errors, {total.warnings.total()} warnings"
            f" {dict(total.warnings)}"
        )
    print("| kind | ours | bare |\n| --- | --- | --- |")
    for kind, (ours, others) in rows.items():
        print(f"| {kind} | {ours} | {others} |")


if __name__ == "__main__":
    main()

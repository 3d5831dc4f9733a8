"""The time that checking the targets of a batch costs a training step.

Run: OMP_NUM_THREADS=1 python benchmarks/check_targets.py
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))

from scenes import training_target

from animal3dbox.training.checks import check_targets

IMAGES, SIDE = 16, 512


def milliseconds(
    work: Callable[[int], object], rounds: int = 30, steps: int = 50
) -> tuple[float, float]:
    """Median of a call in the quietest round, and in the middle one.

    The quietest is the one that other programs disturbed least.
    """
    medians = []
    for _ in range(rounds):
        times = []
        for step in range(steps):
            start = time.perf_counter()
            work(step)
            times.append((time.perf_counter() - start) * 1e3)
        medians.append(float(np.median(times)))
    return min(medians), float(np.median(medians))


def main() -> None:
    """Time batches of one and of three animals an image, with and without masks."""
    torch.set_num_threads(1)
    images = torch.zeros(IMAGES, 3, SIDE, SIDE)
    for animals in (1, 3):
        for masks in (False, True):
            batch = [
                training_target(animals, (SIDE, SIDE), seed, masks=masks) for seed in range(IMAGES)
            ]
            check_targets(batch, images)
            quiet, usual = milliseconds(
                lambda step, batch=batch: check_targets(batch, images, step=step)  # type: ignore[misc]
            )
            fields = len(batch[0])
            print(
                f"{IMAGES} images, {animals} animals each, {fields} fields, masks {masks}:"
                f" {quiet:.3f} ms (usual round: {usual:.3f})"
            )


if __name__ == "__main__":
    main()

"""False alarms of the check of keypoints' places on clean animals, and what it finds of mistakes.

Animals of the synthetic world, some cut by the frame, crowded or behind things, each with several
draws of keypoints that are off by 2 px: drawing a scene takes a thousand times as long as the
check. Rates are of draws with enough marked keypoints; each mistake is made of every first one.

Run: OMP_NUM_THREADS=1 python benchmarks/keypoint_places.py [--animals 500] [--draws 10]
"""

import argparse
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.labelling.keypoint_places import LEAST_MARKED, keypoints_problem
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet, record_of

Array = NDArray[np.float64]
SEED = 1000
NOISE_PX = 2.0
MISTAKES: dict[str, Callable[[Array, tuple[int, int]], Array]] = {
    "parts of the sides": lambda xy, hw: xy / [hw[1], hw[0]],
    "of a picture twice as large": lambda xy, hw: 2 * xy,
    "of a picture half as large": lambda xy, hw: xy / 2,
    "x and y exchanged": lambda xy, hw: xy[:, ::-1],
    "picture mirrored": lambda xy, hw: xy * [-1, 1] + [hw[1] - 1, 0],
    "y from the bottom": lambda xy, hw: xy * [1, -1] + [0, hw[0] - 1],
}


def spoiled(record: AnimalRecord, mistake: str) -> AnimalRecord:
    """The record with a mistake made of all its marked keypoints."""
    keypoints = record.keypoints_2d.copy()
    marked = keypoints[:, 2] > 0
    keypoints[marked, :2] = MISTAKES[mistake](keypoints[marked, :2], record.image_hw)
    return replace(record, keypoints_2d=keypoints)


def noisy(record: AnimalRecord, rng: np.random.Generator) -> AnimalRecord:
    """The record with its marked keypoints off by some pixels."""
    keypoints = record.keypoints_2d.copy()
    marked = keypoints[:, 2] > 0
    keypoints[marked, :2] += rng.normal(0, NOISE_PX, (int(marked.sum()), 2))
    return replace(record, keypoints_2d=keypoints)


def main() -> None:
    """Count false alarms, then what is found of each mistake, with masks and without."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--animals", type=int, default=500)
    parser.add_argument("--draws", type=int, default=10)
    options = parser.parse_args()
    found, named, animals, alarms, seconds = Counter[str](), Counter[str](), 0, 0, 0.0
    rng = np.random.default_rng(SEED)
    for sample in SyntheticSet(SEED, options.animals, faults=FaultConfig()).samples():
        exact = record_of(sample)
        if int((exact.keypoints_2d[:, 2] > 0).sum()) < LEAST_MARKED:
            continue
        draws, mask = [noisy(exact, rng) for _ in range(options.draws)], exact.mask
        begin = time.process_time()
        alarms += sum(keypoints_problem(record, mask) is not None for record in draws)
        seconds += time.process_time() - begin
        animals += 1
        for mistake in MISTAKES:
            for name, given in ((mistake, mask), (f"{mistake}, no mask", None)):
                problem = keypoints_problem(spoiled(draws[0], mistake), given)
                found[name] += problem is not None
                named[name] += problem is not None and ("would fit" in problem or "look" in problem)
        if animals == options.animals:
            break
    count = animals * options.draws
    print(
        f"{count} draws of {animals} clean animals: {alarms} false alarms,"
        f" {1e3 * seconds / count:.2f} ms each"
    )
    for name, number in found.items():
        print(f"{name:36} found {number / animals:.3f}, its like named {named[name] / animals:.3f}")


if __name__ == "__main__":
    main()

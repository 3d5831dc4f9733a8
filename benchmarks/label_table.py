"""The cost of `label --table` with known poses, by one decode an image.

Run: python benchmarks/label_table.py [--images N] [--rounds R] [--profile]

The synthetic Animal3D world, 640 x 480, one animal an image, its stored cameras taken as known. The
rows of batches, and parts of them written, take turns in one process with the loader's floors,
which decode each JPEG once, with its mask or without (benchmarks/loader.py). Processor time of the
process; ratios are medians over the rounds. With --profile the calls that cost most are printed.
"""

import argparse
import cProfile
import os
import pstats
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import numpy as np
import torch
from loader import Decoded, write_dataset

from animal3dbox.cli.worker_batches import AT_ONCE
from animal3dbox.datasets import Animal3DDataset
from animal3dbox.report import label_table
from animal3dbox.report.table.parts import part_format, write_part

torch.set_num_threads(1)
cv2.setNumThreads(1)
Work = Callable[[Sequence[int]], Any]


def compared(root: Path, model: Path, folder: Path) -> dict[str, Work]:
    """What takes turns, by name; the first is the floor."""
    dataset = Animal3DDataset(root, model, stored_cameras="exact", on_bad="skip")
    cached = Animal3DDataset(
        root, model, stored_cameras="exact", on_bad="skip", cache=folder / "cache"
    )
    jpegs, both = Decoded(dataset, masks=False), Decoded(dataset)
    return {
        "decode JPEG and mask": lambda batch: [both[index] for index in batch],
        "decode JPEG": lambda batch: [jpegs[index] for index in batch],
        "outcomes": dataset.outcomes,
        "rows": lambda batch: label_table(dataset, batch),
        "rows, written": lambda batch: write_part(folder / "parts", label_table(dataset, batch)),
        "rows of cached labels": lambda batch: label_table(cached, batch),
    }


def measure(works: dict[str, Work], images: int, rounds: int) -> None:
    """Print the processor time of an image, and by those of the two floors."""
    batches = [range(i, min(i + AT_ONCE, images)) for i in range(0, images, AT_ONCE)]
    seconds: dict[str, list[float]] = {name: [] for name in works}
    for turn in range(rounds + 1):
        for name, work in works.items():
            begin = time.process_time()
            for batch in batches:
                work(batch)
            if turn:  # the first warms up, and fills the cache
                seconds[name].append((time.process_time() - begin) / images)
    floors = [np.array(seconds[name]) for name in [*works][:2]]
    print(f"{'':24}{'ms an image':>12}{'by JPEG and mask':>18}{'by JPEG':>10}")
    for name, times in seconds.items():
        ratios = [float(np.median(np.array(times) / floor)) for floor in floors]
        print(f"{name:24}{1e3 * np.median(times):12.3f}{ratios[0]:18.2f}{ratios[1]:10.2f}")


def main() -> None:
    """Compare the costs, or profile the rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=128)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        root, model = write_dataset(Path(name), options.images)
        works = compared(root, model, Path(name))
        if options.profile:
            works["rows"](range(options.images))
            with cProfile.Profile() as profile:
                works["rows"](range(options.images))
            pstats.Stats(profile).sort_stats("tottime").print_stats(45)
            return
        print(f"parts are {part_format(Path(name) / 'parts')}")
        measure(works, options.images, options.rounds)


if __name__ == "__main__":
    main()

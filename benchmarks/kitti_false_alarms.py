"""False alarms of the KITTI reader on right files: boxes of the synthetic world as KITTI has them.

The world's animals lie under handheld and flying cameras, so that much of their pitch is lost
(the median IoU of whole boxes with KITTI's is 0.62): files of cars on a street are easier. All
boxes are read as one file, then each as a file of its own, which has least to tell its order by.

Run: OMP_NUM_THREADS=1 python benchmarks/kitti_false_alarms.py --images 250
"""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from animal3dbox.datasets import (
    CuboidRecord,
    CuboidSet,
    Skipped,
    SyntheticDataset,
    read_kitti,
    write_kitti,
)


def true_boxes(images: int, seed: int) -> list[CuboidRecord]:
    """The boxes of a synthetic world's animals, with the 2D boxes of their masks."""
    dataset = SyntheticDataset(images, seed=seed)
    records = []
    for index in range(images):
        sample = dataset[index]
        if isinstance(sample, Skipped):
            continue
        image, target = sample
        for k in range(len(target["labels"])):
            fields = ("center", "rotation", "size")
            center, rotation, size = (target[name][k].double().numpy() for name in fields)
            record = CuboidRecord(
                sample_id=f"{index}.jpg#{k}" if k else f"{index}.jpg",
                image_id=f"{index}.jpg",
                image_path=None,
                image_hw=(image.shape[1], image.shape[2]),
                category="animal",
                K=target["K"].double().numpy(),
                center=center,
                rotation=rotation,
                size=size,
                box=target["boxes"][k].double().numpy(),
            )
            records.append(record)
    return records


def read_as_foreign(records: Sequence[CuboidRecord]) -> tuple[CuboidSet, tuple[float, ...]]:
    """Boxes written as KITTI and read as another program's, and how much of each was kept."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written = write_kitti(CuboidSet("world", tuple(records), ()), folder)
        (folder / "images.txt").unlink()
        (folder / "image_2").mkdir(exist_ok=True)
        sizes = dict.fromkeys((record.image_id, record.image_hw) for record in records)
        for number, (_, (height, width)) in enumerate(sizes):
            Image.new("L", (width, height)).save(folder / "image_2" / f"{number:06d}.png")
        return read_kitti(folder), written.iou or ()


def main() -> None:
    """Count the faults that right files have."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--images", type=int, default=250)
    parser.add_argument("--seed", type=int, default=1000)
    options = parser.parse_args()
    records = true_boxes(options.images, options.seed)
    whole, kept = read_as_foreign(records)
    print(f"{len(records)} boxes; median IoU with what KITTI keeps {np.median(kept):.2f}")
    print(f"one file: {len(whole.faults)} false alarms")
    faults = [fault for record in records for fault in read_as_foreign([record])[0].faults]
    print(f"a file each: {len(faults)} false alarms")
    for fault in faults:
        print(f"  {fault}")


if __name__ == "__main__":
    main()

"""How often the checks object to right targets from every reader and exporter of ours.

The synthetic world is written in the files of each format and read again: annotated animals by
their Datasets, which label them with a preset's body or the file's own, boxes by the exporters and
their readers, and the labels.json of `animal3dbox label`. Animals that a Dataset leaves out are
not counted. Of what readers say only faults of targets are alarms here.

Run: OMP_NUM_THREADS=1 python benchmarks/check_file_alarms.py [--images 40] [--boxes 400]
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from golden_commands import command
from golden_inputs import HW, world_samples, write_coco, write_deeplabcut, write_meshes
from kitti_false_alarms import true_boxes
from PIL import Image

from animal3dbox.cli.check import CheckReport, check_cuboids, check_labels
from animal3dbox.datasets import (
    AnnotatedDataset,
    CuboidRecord,
    CuboidSet,
    KittiDataset,
    Omni3DDataset,
    write_kitti,
    write_omni3d,
)
from animal3dbox.datasets.cuboid_formats import CuboidOptions
from animal3dbox.training import TargetReport, audit

SIZE = ("--width", str(HW[1]), "--height", str(HW[0]), "--noise-px", "1")


def annotated(folder: Path, images: int) -> Iterator[tuple[str, Any]]:
    """A Dataset of each format of annotated animals, of about so many images each."""
    command("synth", "--out", folder / "animals", "--n", str(images), "--seed", "31", *SIZE)
    dogs = ("--format", "stanfordextra", *SIZE)
    command("synth", "--out", folder / "dogs", "--n", str(images), "--seed", "32", *dogs)
    write_coco(folder / "coco", world_samples(33, images, "ap10k17"))
    write_deeplabcut(folder / "deeplabcut", world_samples(34, images, "superanimal39"))
    write_meshes(folder / "cameras", world_samples(35, images, "animal3d26"), known=True)
    write_meshes(folder / "keypoints", world_samples(36, images, "animal3d26"), known=False)
    model = folder / "animals-model.pkl"
    sets: list[tuple[str, dict[str, Any]]] = [
        ("animals", {"model": model}),
        ("animals", {"model": model, "stored_cameras": "exact"}),
        *((name, {"body": "preset"}) for name in ("dogs", "coco", "deeplabcut")),
        ("cameras", {}),
        ("keypoints", {}),
    ]
    for name, options in sets:
        words = f"{name} {options.get('stored_cameras', '')}".strip()
        yield words, AnnotatedDataset(folder / name, on_bad="skip", **options)


def boxes(folder: Path, records: list[CuboidRecord]) -> Iterator[tuple[str, Any]]:
    """Boxes that were written as Omni3D and as KITTI have them, as reports and as Datasets."""
    own = [replace(record, image_path=folder / record.image_id) for record in records]
    for record in own:
        Image.new("RGB", record.image_hw[::-1]).save(folder / record.image_id)
    cuboids = CuboidSet("world", tuple(own), ())
    write_omni3d(cuboids, folder / "omni.json", scale_free=True)
    write_kitti(cuboids, folder / "kitti", scale_free=True)
    yield "omni3d", check_cuboids(folder / "omni.json", CuboidOptions(folder), "omni3d")
    yield "kitti", check_cuboids(folder / "kitti", CuboidOptions(None), "kitti")
    yield "omni3d", Omni3DDataset(folder / "omni.json", images=folder, on_bad="skip")
    yield "kitti", KittiDataset(folder / "kitti", on_bad="skip")


def told(name: str, report: CheckReport | TargetReport) -> tuple[int, int, int]:
    """Print what was found, and return the numbers of animals, errors and warnings."""
    warnings = Counter(report.warnings)
    errors = Counter(report.counts)
    print(
        f"{name}: {report.animals} animals, {errors.total()} errors {dict(errors)},"
        f" {warnings.total()} warnings {dict(warnings)}",
        flush=True,
    )
    examples = report.faults[:3] if isinstance(report, CheckReport) else report.examples[:3]
    for example in examples:
        print(f"  {example}")
    if isinstance(report, TargetReport):
        for sentence in report.sides.warnings:
            print(f"  {sentence}")
    return report.animals, errors.total(), warnings.total()


def main() -> None:
    """Print the counts of each format, and of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=int, default=40)
    parser.add_argument("--boxes", type=int, default=400, help="images whose boxes are written")
    options = parser.parse_args()
    torch.set_num_threads(1)
    sums = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind, dataset in annotated(folder, options.images):
            sums.append(told(f"Dataset of {kind}", audit(dataset)))
        words = ("label", folder / "animals", "--out", folder / "labels")
        command(*words, "--model", folder / "animals-model.pkl", expected=(0, 4))
        sums.append(told("labels.json", check_labels(folder / "labels")))
        (folder / "boxes").mkdir()
        for kind, found in boxes(folder / "boxes", true_boxes(options.boxes, 1000)):
            if isinstance(found, CheckReport):
                sums.append(told(f"check of {kind}", found))
            else:
                sums.append(told(f"Dataset of {kind}", audit(found)))
    animals, errors, warnings = (sum(column) for column in zip(*sums, strict=True))
    print(f"in all {animals} animals, {errors} errors, {warnings} warnings")


if __name__ == "__main__":
    main()

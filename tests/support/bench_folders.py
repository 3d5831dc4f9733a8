"""Benchmarks of a few images, and results on them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec

from animal3dbox.bench import (
    BenchPlan,
    ResultHead,
    bench_plan,
    make_bench,
    read_manifest,
    write_head,
)
from animal3dbox.bench.split_files import ImageDigests
from animal3dbox.datasets import CuboidRecord, write_detections


def tiny_plan(**images: int) -> BenchPlan:
    """The small edition with so many images of some splits, whose dashes are underscores here."""
    plan = bench_plan("small")
    names = {name.replace("_", "-"): count for name, count in images.items()}
    splits = tuple(
        replace(split, images=names[split.name]) for split in plan.splits if split.name in names
    )
    return replace(plan, splits=splits)


def made(root: Path, plan: BenchPlan) -> Path:
    """The folder, in which a benchmark was made."""
    make_bench(plan, root)
    return root


def write_result(
    folder: Path,
    bench: Path,
    split: str,
    records: Sequence[CuboidRecord],
    *,
    method: str = "a test's",
) -> Path:
    """A result's folder with boxes in one split."""
    write_detections(records, bench / "truth" / f"{split}.json", folder / f"{split}.json")
    manifest = read_manifest(bench)
    head = ResultHead(
        version=manifest.version,
        edition=manifest.edition,
        track="image",
        method=method,
        splits={split: manifest.splits[split].digest},
    )
    write_head(folder, head)
    return folder


def digests_of(bench: Path, split: str) -> dict[str, ImageDigests]:
    """What digests/SPLIT.json holds."""
    file = (bench / "digests" / f"{split}.json").read_bytes()
    return msgspec.json.decode(file, type=dict[str, ImageDigests])


def in_both(bench: Path, one: str, other: str) -> tuple[set[str], set[str], set[str]]:
    """The digests of bodies, of scenes and of pixels that two splits share."""
    a, b = ([*digests_of(bench, split).values()] for split in (one, other))
    return (
        {body for image in a for body in image.bodies} & {body for i in b for body in i.bodies},
        {image.scene for image in a} & {image.scene for image in b},
        {image.pixels for image in a} & {image.pixels for image in b},
    )

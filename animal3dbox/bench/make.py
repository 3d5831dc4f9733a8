"""Making a benchmark: its splits image by image, on any number of processes, and resumed.

Work is done in chunks. A chunk's rows are written when all of its images are, so a chunk that is
there need not be drawn again, and whatever a killed run leaves is whole: images, chunks, and the
files of the split so far, which are written anew whenever the number of chunks has doubled, and
after every thousand images.
"""

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import msgspec
import torch

from animal3dbox.bench.card import CARD, card_text
from animal3dbox.bench.image_rows import ImageRow, draw_image, png_bytes
from animal3dbox.bench.manifest import (
    MANIFEST,
    Manifest,
    SplitEntry,
    claim_folder,
    empty_manifest,
    file_sha256,
    pixels_digest,
    read_manifest,
    write_manifest,
)
from animal3dbox.bench.plan import BenchPlan, SplitPlan
from animal3dbox.bench.split_files import split_paths, write_split
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import ConfigError, DatasetFormatError
from animal3dbox.files import user_path, write_whole
from animal3dbox.progress import watched

CHUNK = 25
"""Images that a process draws at a time."""
OFTEN = 40
"""Chunks after which the files of a split are written, too: it takes a second or two."""
WORK = "work"
"""Folder of the chunks of splits that are not whole yet."""


@dataclass(frozen=True)
class ChunkJob:
    """Some images of a split, to be drawn by one process.

    Attributes:
        root: the benchmark's folder.
        split: the split.
        first: number of the first image.
    """

    root: Path
    split: SplitPlan
    first: int

    @property
    def path(self) -> Path:
        """The file of the chunk's rows."""
        return self.root / WORK / self.split.name / f"{self.first:06d}.json"

    @property
    def numbers(self) -> range:
        """The numbers of the chunk's images."""
        return range(self.first, min(self.first + CHUNK, self.split.images))


def make_bench(
    plan: BenchPlan,
    root: Path | str,
    *,
    splits: Sequence[str] = (),
    workers: int = 1,
) -> Manifest:
    """Make the splits of a benchmark that are not whole yet; the same for any number of workers.

    Args:
        plan: see bench_plan.
        root: the folder: new, empty, or left by an earlier call with the same plan.
        splits: names; none: all.
        workers: processes.

    Returns:
        The manifest, as it was written.

    Raises:
        ConfigError: no such split, or the folder holds something else.

    Example:
        >>> import tempfile
        >>> from dataclasses import replace
        >>> from animal3dbox.bench import bench_plan
        >>> plan = bench_plan("small")
        >>> tiny = replace(plan, splits=(replace(plan.split("val"), images=1),))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     manifest = make_bench(tiny, Path(folder))
        >>> manifest.splits["val"].images
        1
    """
    if workers < 1:
        raise ConfigError(f"workers must be at least 1, got {workers}")
    root = user_path(root)
    chosen_splits = [plan.split(name) for name in splits] or list(plan.splits)
    claim_folder(plan, root)
    manifest = read_manifest(root) if (root / MANIFEST).is_file() else empty_manifest(plan)
    write_whole(root / CARD, card_text(plan).encode())
    manifest.files = {CARD: file_sha256(root / CARD)}
    for split in chosen_splits:
        if _is_whole(root, split, manifest):
            _draw_missing(root, split)
        else:
            rows = _drawn(plan, split, root, workers=workers)
            manifest.splits[split.name] = _entry(root, split, rows)
        write_manifest(root, manifest)
        shutil.rmtree(root / WORK / split.name, ignore_errors=True)
    if (root / WORK).is_dir() and not any((root / WORK).iterdir()):
        (root / WORK).rmdir()
    return manifest


def _is_whole(root: Path, split: SplitPlan, manifest: Manifest) -> bool:
    """Whether a split was made, and all of its files but images are there."""
    return split.name in manifest.splits and all(
        (root / path).is_file() for path in split_paths(split.name)
    )


def _draw_missing(root: Path, split: SplitPlan) -> None:
    """Draw the images of a whole split that somebody removed."""
    for index in watched(range(split.images), f"drawing {split.name}", unit="image"):
        path = root / split.image_name(index)
        if not path.is_file():
            write_whole(path, png_bytes(draw_image(split, index)[1]))


def _drawn(plan: BenchPlan, split: SplitPlan, root: Path, *, workers: int) -> list[ImageRow]:
    """The rows of a whole split, whose images and files are written."""
    jobs = [ChunkJob(root, split, first) for first in range(0, split.images, CHUNK)]
    rows: list[ImageRow] = []
    unit = f"{CHUNK} images"
    chunks = watched(_chunks(jobs, workers), f"drawing {split.name}", unit=unit, total=len(jobs))
    for number, chunk in enumerate(chunks, 1):
        rows += chunk
        has_doubled = number & (number - 1) == 0  # 1, 2, 4, 8, ...
        if has_doubled or number % OFTEN == 0 or number == len(jobs):
            write_split(root, plan, split, rows)
    return rows


def _chunks(jobs: Sequence[ChunkJob], workers: int) -> Iterator[list[ImageRow]]:
    """The rows of chunks in their order."""
    if workers == 1:
        yield from map(draw_chunk, jobs)
        return
    with get_context("spawn").Pool(workers) as pool:
        yield from pool.imap(draw_chunk, jobs)


def draw_chunk(job: ChunkJob) -> list[ImageRow]:
    """The rows of a chunk; its images are drawn and written unless an earlier run did so."""
    torch.set_num_threads(1)  # many small problems: more threads would only wait for each other
    if job.path.is_file():
        try:
            earlier: list[ImageRow] = decode_json(job.path, list[ImageRow])
        except DatasetFormatError:
            earlier = []
        images_are_there = all((job.root / row.name).is_file() for row in earlier)
        if len(earlier) == len(job.numbers) and images_are_there:
            return earlier
    rows = []
    for index in job.numbers:
        row, pixels = draw_image(job.split, index)
        write_whole(job.root / row.name, png_bytes(pixels))
        rows.append(row)
    write_whole(job.path, msgspec.json.encode(rows))
    return rows


def _entry(root: Path, split: SplitPlan, rows: Sequence[ImageRow]) -> SplitEntry:
    """What the manifest says of a split whose files are written."""
    return SplitEntry(
        images=len(rows),
        animals=sum(len(row.animals) for row in rows),
        digest=pixels_digest((row.name, row.pixels) for row in rows),
        files={path: file_sha256(root / path) for path in split_paths(split.name)},
    )

"""Verifying a copy of a benchmark: whether its files and pixels are those that were made."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from animal3dbox.bench.editions import EDITIONS
from animal3dbox.bench.image_rows import pixel_digest
from animal3dbox.bench.manifest import (
    Manifest,
    SplitEntry,
    file_sha256,
    pixels_digest,
    read_manifest,
    version_fault,
)
from animal3dbox.bench.plan import BenchPlan, SplitPlan, bench_plan
from animal3dbox.bench.split_files import ImageDigests, split_paths
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import Animal3DBoxError, ConfigError, SampleError
from animal3dbox.files import user_path
from animal3dbox.progress import watched

REMAKE = "delete the file and make the benchmark again there (animal3dbox bench make)"


@dataclass(frozen=True)
class BenchFindings:
    """The result of verifying a benchmark.

    Attributes:
        files: number of files that were compared, VERSION among them.
        images: number of images whose pixels were hashed.
        faults: one error for each file or image that is missing or not as it was made.

    Example:
        >>> BenchFindings(files=6, images=30, faults=()).faults
        ()
    """

    files: int
    images: int
    faults: tuple[SampleError, ...]


def verify_bench(
    root: Path | str, *, splits: Sequence[str] = (), plan: BenchPlan | None = None
) -> BenchFindings:
    """Check every file and every decoded pixel of a benchmark against its manifest and its plan.

    Args:
        root: the benchmark's folder.
        splits: names; none: all that are whole.
        plan: what it was to be; None: the seed file's plan of its edition.

    Returns:
        What was checked, and what is wrong.

    Raises:
        ConfigError: a split is not whole, or the manifest is of another benchmark.
        DatasetNotFoundError: there is no manifest.
        DatasetFormatError: the manifest is damaged.

    Example:
        >>> import tempfile
        >>> from dataclasses import replace
        >>> from animal3dbox.bench import bench_plan, make_bench
        >>> plan = bench_plan("small")
        >>> tiny = replace(plan, splits=(replace(plan.split("val"), images=1),))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = make_bench(tiny, Path(folder))
        ...     findings = verify_bench(Path(folder), plan=tiny)
        >>> findings.files, findings.images, findings.faults
        (7, 1, ())
    """
    root = user_path(root)
    manifest = read_manifest(root)
    plan = plan or _plan_of(manifest)
    if (manifest.version, manifest.plan) != (plan.version, plan.digest):
        raise ConfigError(
            f"{root} was made from another seed file ({manifest.version}, plan {manifest.plan})"
            f" than this package's ({plan.version}, plan {plan.digest}): use the version of"
            " animal3dbox that made it, or make it again"
        )
    names = whole_splits(root, manifest, splits)
    files = dict(manifest.files)
    for name in names:
        files |= manifest.splits[name].files
    faults = [fault for path, sha in files.items() if (fault := _file_fault(root, path, sha))]
    if fault := version_fault(root, manifest):
        faults.insert(0, fault)
    faults += _strangers(root, plan)
    images = 0
    for name in names:
        images += manifest.splits[name].images
        faults += _split_faults(root, plan.split(name), manifest.splits[name])
    return BenchFindings(files=len(files) + 1, images=images, faults=tuple(faults))


def _plan_of(manifest: Manifest) -> BenchPlan:
    """The seed file's plan of a manifest's edition."""
    for edition in EDITIONS:
        if edition == manifest.edition:
            return bench_plan(edition)
    raise ConfigError(f"the manifest's edition is {manifest.edition!r}, not of {EDITIONS}")


def whole_splits(root: Path, manifest: Manifest, splits: Sequence[str]) -> list[str]:
    """The names of splits that are whole: those asked for, each once, or all.

    Raises:
        ConfigError: one that was asked for is not whole, or none is.

    """
    if unfinished := [name for name in splits if name not in manifest.splits]:
        raise ConfigError(
            f"{root} has no whole split {', '.join(unfinished)} (whole:"
            f" {', '.join(manifest.splits) or 'none'}): make it (animal3dbox bench make)"
        )
    return list(dict.fromkeys(splits)) or list(manifest.splits)


def _file_fault(root: Path, path: str, sha256: str) -> SampleError | None:
    """What is wrong with one file, if anything is."""
    try:
        actual = file_sha256(root / path)
    except OSError as error:
        return SampleError(path, "file", f"cannot be read ({error.strerror}): make it again")
    if actual == sha256:
        return None
    return SampleError(path, "sha256", f"is {actual}, and the manifest says {sha256}: {REMAKE}")


def _split_faults(root: Path, split: SplitPlan, entry: SplitEntry) -> list[SampleError]:
    """What is wrong with the images of a split."""
    file = split_paths(split.name)[-1]
    try:
        stated: dict[str, ImageDigests] = decode_json(root / file, dict[str, ImageDigests])
    except Animal3DBoxError as error:
        return [SampleError(file, "digests", f"cannot be used: {error}")]
    faults = []
    digest = pixels_digest([(name, digests.pixels) for name, digests in stated.items()])
    if digest != entry.digest:
        faults.append(
            SampleError(file, "pixels", f"come to {digest}, and the manifest says {entry.digest}")
        )
    for name, digests in watched(stated.items(), f"verifying {split.name}", unit="image"):
        if fault := _image_fault(root, name, digests.pixels):
            faults.append(fault)
    known = {split.image_name(index) for index in range(split.images)}
    faults += [
        SampleError(path, "file", "is no image of the split: remove it")
        for path in _images_in(root, split)
        if path not in known
    ]
    return faults


def _strangers(root: Path, plan: BenchPlan) -> list[SampleError]:
    """An error for each file of images/ that lies in no split's folder."""
    folders = {(root / split.image_name(0)).parent for split in plan.splits}
    return [
        SampleError(
            path.relative_to(root).as_posix(), "file", "lies in no split's folder: remove it"
        )
        for home in {folder.parent for folder in folders}
        for path in sorted(home.rglob("*"))
        if not path.is_dir() and folders.isdisjoint(path.parents)
    ]


def _images_in(root: Path, split: SplitPlan) -> list[str]:
    """The files in a split's folder of images, as paths below the benchmark's folder."""
    folder = (root / split.image_name(0)).parent
    return sorted(path.relative_to(root).as_posix() for path in folder.glob("*"))


def _image_fault(root: Path, name: str, expected: str) -> SampleError | None:
    """What is wrong with the pixels of one image, if anything is."""
    try:
        with Image.open(root / name) as image:
            actual = pixel_digest(np.asarray(image.convert("RGB")))
    except OSError as error:
        problem = error.strerror or str(error)
        return SampleError(name, "image", f"cannot be read ({problem}): {REMAKE}")
    if actual == expected:
        return None
    return SampleError(name, "pixels", f"come to {actual}, and were {expected}: {REMAKE}")

"""MANIFEST.json and VERSION: the benchmark that a folder holds, its whole splits, their digests."""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec

from animal3dbox.bench.plan import BenchPlan
from animal3dbox.datasets.storage.json_files import decode_json
from animal3dbox.errors import (
    ConfigError,
    DatasetFormatError,
    DatasetNotFoundError,
    SampleError,
)
from animal3dbox.files import write_whole

SCHEMA: Final = "animal3dbox.bench"
MANIFEST, VERSION = "MANIFEST.json", "VERSION"
"""The file of all digests, and the line that says which benchmark a folder holds."""
FOLDERS = ("images", "truth", "keypoints", "digests", "work")
"""A benchmark's folders below its own."""
LONGEST = 120
"""Bytes of a wrong VERSION that a message shows."""


class SplitEntry(msgspec.Struct, kw_only=True, frozen=True):
    """What the manifest says of one whole split.

    Attributes:
        images: number of images.
        animals: number of animals.
        digest: of all its images' names and pixels, in their order; results name it.
        files: path -> SHA-256 of each file but the images, whose pixels are hashed decoded.

    Example:
        >>> entry = SplitEntry(images=30, animals=41, digest="0" * 64, files={})
        >>> entry.images
        30
    """

    images: int
    animals: int
    digest: str
    files: dict[str, str]


class Manifest(msgspec.Struct, kw_only=True):
    """The content of MANIFEST.json.

    Attributes:
        version: of the benchmark.
        edition: "full" or "small".
        plan: the seed file's digest for the edition, see BenchPlan.digest.
        splits: the whole splits by name.
        files: path -> SHA-256 of the files that belong to no split.
        schema: SCHEMA.

    Example:
        >>> from animal3dbox.bench import bench_plan
        >>> empty_manifest(bench_plan("small")).splits
        {}
    """

    version: str
    edition: str
    plan: str
    splits: dict[str, SplitEntry]
    files: dict[str, str]
    schema: str = SCHEMA


def empty_manifest(plan: BenchPlan) -> Manifest:
    """The manifest of a benchmark of which no split is whole yet."""
    return Manifest(
        version=plan.version, edition=plan.edition, plan=plan.digest, splits={}, files={}
    )


def read_manifest(root: Path) -> Manifest:
    """The manifest of a benchmark's folder.

    Raises:
        DatasetNotFoundError: there is none.
        DatasetFormatError: it is damaged.

    Example:
        >>> import tempfile
        >>> from animal3dbox.bench import bench_plan
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     write_manifest(Path(folder), empty_manifest(bench_plan("small")))
        ...     read_manifest(Path(folder)).edition
        'small'
    """
    if not (root / MANIFEST).is_file():
        raise DatasetNotFoundError(
            f"{root} holds no {MANIFEST}: make the benchmark there first (animal3dbox bench make)"
        )
    try:
        manifest: Manifest = decode_json(root / MANIFEST, Manifest)
    except DatasetFormatError as error:
        raise DatasetFormatError(
            f"{error}: copy it again from where the benchmark is whole, or delete it and make the"
            " benchmark again there (animal3dbox bench make), which draws every image anew"
        ) from error
    if manifest.schema != SCHEMA:
        raise DatasetFormatError(f"{root / MANIFEST} is a {manifest.schema}, not an {SCHEMA}")
    return manifest


def write_manifest(root: Path, manifest: Manifest) -> None:
    """Write MANIFEST.json whole, its splits and files in alphabetical order."""
    write_whole(root / MANIFEST, msgspec.json.format(msgspec.json.encode(manifest, order="sorted")))


def version_text(plan: BenchPlan) -> str:
    """The content of VERSION: the benchmark, the edition and the plan's digest, on one line."""
    return f"{plan.version} {plan.edition} {plan.digest}\n"


def version_fault(root: Path, manifest: Manifest) -> SampleError | None:
    """What is wrong with VERSION, which must say what the manifest says, if anything is."""
    expected = f"{manifest.version} {manifest.edition} {manifest.plan}\n".encode()
    remedy = f"write this line into it, if the rest verifies: {expected.decode().strip()}"
    try:
        line = (root / VERSION).read_bytes()
    except OSError as error:
        return SampleError(VERSION, "file", f"cannot be read ({error.strerror}): {remedy}")
    if line == expected:
        return None
    shown = line[:LONGEST].decode(errors="replace").strip()
    return SampleError(VERSION, "line", f"is {shown!r}, not what {MANIFEST} says: {remedy}")


def usable_manifest(root: Path) -> Manifest:
    """The manifest of a benchmark whose VERSION says the same, for scores and baselines.

    Raises:
        DatasetNotFoundError: there is no manifest.
        DatasetFormatError: the manifest is damaged, or VERSION is missing or says something else.

    """
    manifest = read_manifest(root)
    if fault := version_fault(root, manifest):
        raise DatasetFormatError(f"{root}: {fault}")
    return manifest


def claim_folder(plan: BenchPlan, root: Path) -> None:
    """Write VERSION into a new folder, or check that the folder is this benchmark's already.

    Raises:
        ConfigError: the folder holds something else.

    """
    file = root / VERSION
    if file.is_file():
        if file.read_text() != version_text(plan):
            raise ConfigError(
                f"{root} holds {file.read_text().strip()!r}, and this would be"
                f" {version_text(plan).strip()!r}: give another folder"
            )
        return
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise ConfigError(f"{root} must be a new or an empty folder, or one of {plan.version}")
    write_whole(file, version_text(plan).encode())


def check_output_folder(out: Path, root: Path, result: Path | None = None) -> None:
    """Raise ConfigError if outputs would lie among a benchmark's files, or a result's.

    Args:
        out: the folder of the outputs.
        root: the benchmark's folder.
        result: the result's folder, if the outputs are scores.

    """
    place, home = out.resolve(), root.resolve()
    is_among = place == home or any(place.is_relative_to(home / name) for name in FOLDERS)
    if is_among:
        raise ConfigError(f"--out {out} is among the benchmark's own files: give another folder")
    if result is not None and place == result.resolve():
        raise ConfigError(f"--out {out} is the result's own folder: give another one")


def pixels_digest(images: Iterable[tuple[str, str]]) -> str:
    """SHA-256 of the names of images and the digests of their pixels, in their order.

    Example:
        >>> pixels_digest([])[:8]
        'e3b0c442'
    """
    lines = "".join(f"{name} {pixels}\n" for name, pixels in images)
    return hashlib.sha256(lines.encode()).hexdigest()


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes; raises OSError."""
    return hashlib.sha256(path.read_bytes()).hexdigest()

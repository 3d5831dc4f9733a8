"""The subcommands of `bench`: each is a dataclass whose fields are its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg, subcommand

from animal3dbox.bench.editions import Edition


@dataclass(frozen=True, kw_only=True)
class MakeJob:
    """Make the benchmark from its seed file, or go on where an earlier call was stopped.

    Example: animal3dbox bench make bench-v1 --edition small
    """

    out: Annotated[Positional[Path], arg(metavar="OUT")]
    """folder: new, or of an earlier call"""
    edition: Edition = "full"
    """full, or small: 300 images, to try things with"""
    split: tuple[str, ...] = ()
    """names of the splits to make: train, val, test-id, ...; none: all"""
    workers: int = 1
    """processes; the files are the same"""


@dataclass(frozen=True, kw_only=True)
class VerifyJob:
    """Check a copy of the benchmark: its files by their bytes, its images by their decoded pixels.

    Example: animal3dbox bench verify bench-v1
    """

    bench: Annotated[Positional[Path], arg(metavar="BENCH")]
    """the benchmark's folder"""
    split: tuple[str, ...] = ()
    """names of the splits to check; none: all that are whole"""


@dataclass(frozen=True, kw_only=True)
class BenchJob:
    """A benchmark of monocular 3D animal detection: make, verify, score.

    Example: animal3dbox bench make bench-v1 --edition small
    """

    action: (
        Annotated[MakeJob, subcommand("make", prefix_name=False)]
        | Annotated[VerifyJob, subcommand("verify", prefix_name=False)]
    )
    """what is done"""

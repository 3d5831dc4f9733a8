"""The subcommands of `bench`: each is a dataclass whose fields are its options."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg, subcommand

from animal3dbox.bench.editions import Baseline, Edition


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
    """the folder that bench make wrote"""
    split: tuple[str, ...] = ()
    """names of the splits to check; none: all that are whole"""


@dataclass(frozen=True, kw_only=True)
class ScoreJob:
    """Score a detector's results on the benchmark, or say why they are refused.

    Example: animal3dbox bench score bench-v1 my-result --out my-score
    """

    bench: Annotated[Positional[Path], arg(metavar="BENCH")]
    """the folder that bench make wrote"""
    result: Annotated[Positional[Path], arg(metavar="RESULT")]
    """the result's folder: about.json, and SPLIT.json in Cube R-CNN's layout; bench baseline writes
    such a folder"""
    out: Path
    """folder for score.json and score.txt"""
    split: tuple[str, ...] = ()
    """names of the splits to score; none: all of the result"""
    resamples: int = 200
    """of the images, for the 95 % intervals; 0: none"""


@dataclass(frozen=True, kw_only=True)
class BaselineJob:
    """Write the result of a baseline that runs on a CPU, to be scored as a detector's is.

    Example: animal3dbox bench baseline bench-v1 constant --split test-id --out constant
    """

    bench: Annotated[Positional[Path], arg(metavar="BENCH")]
    """the folder that bench make wrote"""
    baseline: Annotated[Positional[Baseline], arg(metavar="NAME")]
    """constant, nearest (both learn from train), labels-fit or labels-preset (from keypoints)"""
    out: Path
    """folder for about.json and SPLIT.json, as a detector's result has them"""
    split: tuple[str, ...] = ()
    """names of the splits; none: all that are whole"""


@dataclass(frozen=True, kw_only=True)
class BenchJob:
    """A benchmark of monocular 3D animal detection: make, verify, score.

    Example: animal3dbox bench make bench-v1 --edition small
    """

    action: (
        Annotated[MakeJob, subcommand("make", prefix_name=False)]
        | Annotated[VerifyJob, subcommand("verify", prefix_name=False)]
        | Annotated[ScoreJob, subcommand("score", prefix_name=False)]
        | Annotated[BaselineJob, subcommand("baseline", prefix_name=False)]
    )
    """which part of the benchmark: it is made, verified, scored, or a baseline writes a result"""

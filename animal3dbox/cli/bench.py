"""The command `bench`: make the benchmark, verify a copy of it, score a detector's results."""

import sys
from collections.abc import Iterable

from tqdm import tqdm

from animal3dbox.bench.image_rows import ImageRow
from animal3dbox.bench.make import make_bench
from animal3dbox.bench.plan import bench_plan
from animal3dbox.bench.verify import verify_bench
from animal3dbox.cli.bench_jobs import BenchJob, MakeJob, VerifyJob
from animal3dbox.cli.exit_codes import ExitCode


def run_bench(job: BenchJob) -> ExitCode:
    """Do what the subcommand asks for."""
    if isinstance(job.action, MakeJob):
        return _make(job.action)
    return _verify(job.action)


def _make(job: MakeJob) -> ExitCode:
    """Make the splits, and say what they hold."""
    plan = bench_plan(job.edition)
    manifest = make_bench(plan, job.out, splits=job.split, workers=job.workers, progress=_bar)
    for split in plan.splits:
        if entry := manifest.splits.get(split.name):
            print(f"{split.name}: {entry.images} images, {entry.animals} animals, {entry.digest}")
    return ExitCode.OK


def _verify(job: VerifyJob) -> ExitCode:
    """Check the files and the pixels, and name what is not as it was made."""
    findings = verify_bench(job.bench, splits=job.split)
    for finding in findings.faults:
        print(f"  faulty: {finding}", file=sys.stderr)
    print(f"{findings.files} files and {findings.images} images: {len(findings.faults)} faults")
    return ExitCode.FAULTY if findings.faults else ExitCode.OK


def _bar(chunks: Iterable[list[ImageRow]], count: int) -> Iterable[list[ImageRow]]:
    """A bar over chunks of images."""
    return tqdm(chunks, total=count, desc="images", unit="chunk", disable=None)

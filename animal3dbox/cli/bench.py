"""The command `bench`: make the benchmark, verify a copy of it, score a detector's results."""

import sys

from animal3dbox.bench.baselines import run_baseline
from animal3dbox.bench.make import make_bench
from animal3dbox.bench.manifest import check_output_folder
from animal3dbox.bench.plan import bench_plan
from animal3dbox.bench.score import score_result, score_tables
from animal3dbox.bench.verify import verify_bench
from animal3dbox.cli.bench_jobs import BaselineJob, BenchJob, MakeJob, ScoreJob, VerifyJob
from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.evaluate.files import write_json, write_text
from animal3dbox.plurals import counted


def run_bench(job: BenchJob) -> ExitCode:
    """Do what the subcommand asks for."""
    if isinstance(job.action, MakeJob):
        return _make(job.action)
    if isinstance(job.action, ScoreJob):
        return _score(job.action)
    if isinstance(job.action, BaselineJob):
        return _baseline(job.action)
    return _verify(job.action)


def _make(job: MakeJob) -> ExitCode:
    """Make the splits, and say what they hold."""
    plan = bench_plan(job.edition)
    manifest = make_bench(plan, job.out, splits=job.split, workers=job.workers)
    for split in plan.splits:
        if entry := manifest.splits.get(split.name):
            content = f"{counted(entry.images, 'image')}, {counted(entry.animals, 'animal')}"
            print(f"{split.name}: {content}, {entry.digest}")
    return ExitCode.OK


def _verify(job: VerifyJob) -> ExitCode:
    """Check the files and the pixels, and name what is not as it was made."""
    findings = verify_bench(job.bench, splits=job.split)
    for finding in findings.faults:
        print(f"  faulty: {finding}", file=sys.stderr)
    looked_at = f"{counted(findings.files, 'file')} and {counted(findings.images, 'image')}"
    print(f"{looked_at}: {counted(len(findings.faults), 'fault')}")
    return ExitCode.FAULTY if findings.faults else ExitCode.OK


def _score(job: ScoreJob) -> ExitCode:
    """Score the result, write its tables, and print the short one."""
    check_output_folder(job.out, job.bench, job.result)
    head, scores = score_result(job.bench, job.result, splits=job.split, resamples=job.resamples)
    evaluation = score_tables(head, scores)
    write_json(job.out / "score.json", evaluation)
    write_text(job.out / "score.txt", evaluation)
    print(evaluation.tables[0].text())
    return ExitCode.OK


def _baseline(job: BaselineJob) -> ExitCode:
    """Write the baseline's result, and say how to score it."""
    check_output_folder(job.out, job.bench)
    head = run_baseline(job.bench, job.baseline, job.out, splits=job.split)
    print(f"{head.method} on {', '.join(head.splits)}")
    for split, note in head.notes.items():
        print(f"  {split}: {note}")
    print(f"score it: animal3dbox bench score {job.bench} {job.out} --out {job.out}-score")
    return ExitCode.OK

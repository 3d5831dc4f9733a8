"""``animal3dbox check``: the sanity checks of training loops over labels or cuboids on disk."""

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from torch.utils.data import DataLoader
from tqdm import tqdm

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.export import is_labels, read_cuboids
from animal3dbox.cli.jobs import CheckJob
from animal3dbox.datasets.batches import collate
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.datasets.readers.cuboids.omni3d_recognition import is_omni3d
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.report.label_checks import row_findings
from animal3dbox.report.label_files import labels_file
from animal3dbox.report.label_reading import read_label_rows
from animal3dbox.report.label_targets import target_of_record, target_of_row
from animal3dbox.training.checks import examined, sample_of
from animal3dbox.training.findings import WARNINGS

AT_ONCE = 256
SHOWN = 20
READING = "reading"
"""The check that a file's elements fail that cannot be read."""


class CheckedFault(msgspec.Struct, kw_only=True):
    """One thing that is wrong."""

    check: str
    sample_id: str | None
    field: str
    problem: str


class CheckReport(msgspec.Struct, kw_only=True):
    """What ``check --json`` prints."""

    source: str
    animals: int
    counts: dict[str, int]
    warnings: dict[str, int]
    faults: list[CheckedFault]
    notes: list[str]


def run_check(job: CheckJob) -> ExitCode:
    """Check labels or cuboids, and say what is wrong."""
    if job.workers < 0:
        raise ConfigError(f"--workers must not be negative, got {job.workers}")
    on_disk = is_labels(job.path) or is_omni3d(job.path)
    report = checked(job.path, job.dataset.images) if on_disk else checked_dataset(job)
    if job.json:
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    else:
        print(f"{report.animals} animals in {report.source}: {len(report.faults)} faults")
        for check, count in report.counts.items():
            print(f"  {count} x {check}")
        for check, count in report.warnings.items():
            print(f"  warning: {count} x {check}")
        for fault in report.faults[:SHOWN]:
            print(f"  {fault.sample_id}: {fault.field}: {fault.problem}")
        if len(report.faults) > SHOWN:
            print(f"  and {len(report.faults) - SHOWN} more: --json has all")
        for note in report.notes:
            print(note, file=sys.stderr)
    return ExitCode.FAULTY if report.faults else ExitCode.OK


def checked(path: Path, images: Path | None = None) -> CheckReport:
    """The faults of a labels.json, of the folder that `label` wrote, or of Omni3D's JSON.

    Raises:
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    """
    faults: list[CheckedFault] = []
    targets: list[dict[str, Any]] = []
    sizes: list[tuple[int, int]] = []
    notes: tuple[str, ...] = ()
    if is_labels(path):
        labels, unread = read_label_rows(labels_file(path))
        faults = [_unread(error) for error in unread]
        for row in labels.animals:
            try:
                targets.append(target_of_row(row))
            except SampleError as error:
                faults.append(_unread(error))
                continue
            sizes.append(row.image_hw)
            faults += [
                CheckedFault(check=check, sample_id=row.sample_id, field=field, problem=problem)
                for check, field, problem in row_findings(row)
            ]
    else:
        cuboids = read_cuboids(path, images)
        notes = cuboids.notes
        targets, sizes = (
            [target_of_record(record) for record in cuboids.records],
            [record.image_hw for record in cuboids.records],
        )
        faults = [_unread(error) for error in cuboids.faults]
    found = _examined(targets, sizes)
    faults += [fault for fault in found if fault.check not in WARNINGS]
    warnings = Counter(fault.check for fault in found if fault.check in WARNINGS)
    counts = Counter(fault.check for fault in faults)
    animals = len(targets) + counts[READING]
    return CheckReport(
        source=str(path),
        animals=animals,
        counts=counts,
        warnings=warnings,
        faults=faults,
        notes=list(notes),
    )


def checked_dataset(job: CheckJob) -> CheckReport:
    """What is wrong with the samples of a dataset, labelled on the way as its Dataset does it.

    Raises:
        ConfigError: an option that the dataset has no use for.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    """
    dataset = AnnotatedDataset(
        job.path,
        format=job.dataset.format,
        images=job.dataset.images,
        model=job.dataset.model,
        vocabulary=job.dataset.vocabulary,
        body=job.body,
        on_bad="skip",
        pose=job.stored_camera,
        cache=job.cache,
    )
    loader = DataLoader(dataset, batch_size=8, collate_fn=collate, num_workers=job.workers)
    found: list[CheckedFault] = []
    animals = 0
    for step, (images, targets) in enumerate(
        tqdm(loader, desc="checking", unit="batch", disable=job.json or None)
    ):
        findings, count = examined(
            targets, [(image.shape[1], image.shape[2]) for image in images], step
        )
        animals += count
        for finding in findings:
            found.append(
                CheckedFault(
                    check=finding.check,
                    sample_id=sample_of(finding, targets),
                    field=finding.field,
                    problem=finding.problem,
                )
            )
    report = dataset.report()
    faults = [
        CheckedFault(
            check=READING, sample_id=case.sample_id, field=case.field, problem=case.problem
        )
        for case in report.of("fault")
    ]
    faults += [fault for fault in found if fault.check not in WARNINGS]
    warnings = Counter(fault.check for fault in found if fault.check in WARNINGS) + Counter(
        case.field for case in report.of("rejected")
    )
    notes = [
        *dataset.source.notes,
        *(f"{case.kind}: {case}" for case in report.cases if case.kind != "fault"),
    ]
    counts = Counter(fault.check for fault in faults)
    animals += counts[READING] + len(report.of("rejected"))
    return CheckReport(
        source=str(job.path),
        animals=animals,
        counts=counts,
        warnings=warnings,
        faults=faults,
        notes=notes,
    )


def _unread(error: SampleError) -> CheckedFault:
    """The fault of an element that cannot be read."""
    return CheckedFault(
        check=READING, sample_id=error.sample_id, field=error.field, problem=error.problem
    )


def _examined(
    targets: Sequence[dict[str, Any]], sizes: Sequence[tuple[int, int]]
) -> list[CheckedFault]:
    """The findings in targets of one animal each, under their samples' own names."""
    found = []
    for start in range(0, len(targets), AT_ONCE):
        some = targets[start : start + AT_ONCE]
        findings, _ = examined(some, sizes[start : start + AT_ONCE], start)
        for finding in findings:
            name = some[finding.target]["image_id"]
            found.append(
                CheckedFault(
                    check=finding.check,
                    sample_id=name,
                    field=finding.field,
                    problem=finding.problem,
                )
            )
    return found

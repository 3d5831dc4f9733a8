"""The command `check`: the sanity checks of training loops over labels or cuboids on disk."""

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from torch.utils.data import DataLoader

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.export import is_labels
from animal3dbox.cli.jobs import CheckJob
from animal3dbox.datasets.batches import collate
from animal3dbox.datasets.cuboid_formats import (
    CuboidOptions,
    cuboid_format,
    read_cuboid_set,
)
from animal3dbox.datasets.format_datasets import AnnotatedDataset
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.drafts import EXCHANGED_SIDES
from animal3dbox.labels.pose.problem import AS_GIVEN
from animal3dbox.plurals import counted
from animal3dbox.progress import watched
from animal3dbox.report.label_checks import row_findings
from animal3dbox.report.label_files import labels_file
from animal3dbox.report.label_reading import read_label_rows
from animal3dbox.report.label_targets import target_of_record, target_of_row
from animal3dbox.training.checks import examined, sample_of
from animal3dbox.training.findings import WARNINGS, Finding
from animal3dbox.training.side_votes import SideVotes

AT_ONCE = 256
"""Targets that are examined together."""
SHOWN = 20
"""Faults that are printed; --json has all."""
DOUBTS = ("not_turned", "misplaced", "off_mask")
"""Flags of labels that may not be for the pixels that they lie on."""
READING = "reading"
"""The check that elements of a file fail which cannot be read."""
EXCHANGED = "exchanged"
"""The warning about animals whose left and right keypoints a label exchanged."""

SIDES = "keypoint_sides"
"""The warnings about keypoints that lie on the other side of their cuboids in too many animals."""


class CheckedFault(msgspec.Struct, kw_only=True):
    """One thing that is wrong, where, and in which check's words."""

    check: str
    sample_id: str | None
    field: str
    problem: str


class CheckReport(msgspec.Struct, kw_only=True):
    """All that is wrong with some labels, as `check --json` prints it."""

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
    nouns = ("animal", "animals")
    if is_labels(job.path):
        report = check_labels(job.path)
    elif (format := cuboid_format(job.path, job.dataset.format)) is not None:
        options = CuboidOptions(job.dataset.images, metric=job.metric)
        report = check_cuboids(job.path, options, format)
        nouns = ("box", "boxes")  # perhaps of cars
    else:
        report = check_dataset(job)
    if job.json:
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    else:
        _print(report, nouns)
    return ExitCode.FAULTY if report.faults else ExitCode.OK


def check_labels(path: Path) -> CheckReport:
    """The faults of a labels.json, or of the folder that `label` wrote.

    Raises:
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    """
    labels, unreadable = read_label_rows(labels_file(path))
    faults = [_unreadable(error) for error in unreadable]
    targets: list[dict[str, Any]] = []
    sizes: list[tuple[int, int]] = []
    for row in labels.animals:
        try:
            targets.append(target_of_row(row))
        except SampleError as error:
            faults.append(_unreadable(error))
            continue
        sizes.append(row.image_hw)
        faults += [
            CheckedFault(check=check, sample_id=row.sample_id, field=field, problem=problem)
            for check, field, problem in row_findings(row)
        ]
    findings = _findings_of_targets(targets, sizes)
    return _report(path, len(targets), faults, findings, notes=())


def check_cuboids(path: Path, options: CuboidOptions, format: str) -> CheckReport:
    """The faults of cuboids in a format of datasets.cuboid_formats.

    Raises:
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    """
    cuboids = read_cuboid_set(path, options, format)
    targets = [target_of_record(record) for record in cuboids.records]
    findings = _findings_of_targets(targets, [record.image_hw for record in cuboids.records])
    faults = [_unreadable(error) for error in cuboids.faults]
    return _report(path, len(targets), faults, findings, notes=cuboids.notes)


def check_dataset(job: CheckJob) -> CheckReport:
    """The faults of a dataset's samples, labelled on the way as its Dataset does it.

    Raises:
        ConfigError: an option that the dataset has no use for.
        DatasetNotFoundError: nothing there.
        DatasetFormatError: not readable as a whole.

    """
    if job.metric != "info":
        raise ConfigError("--metric is for files of cuboids: animals' scale comes from elsewhere")
    dataset = _dataset_of(job)
    loader = DataLoader(dataset, batch_size=8, collate_fn=collate, num_workers=job.workers)
    findings: list[CheckedFault] = []
    mended: list[str] = []
    doubts = Counter[str]()
    animals, votes = 0, SideVotes()
    for images, targets in watched(loader, "checking", unit="batch"):
        sizes = [(image.shape[1], image.shape[2]) for image in images]
        of_batch, count, statistics = examined(
            targets, sizes, None, classes=len(dataset.classes) or None
        )
        votes += statistics.sides
        findings += [_checked(finding, sample_of(finding, targets)) for finding in of_batch]
        mended += [one for target in targets for one in mended_animals(target)]
        doubts += doubts_of(targets)
        animals += count
    cases = dataset.report()
    faults = [
        CheckedFault(
            check=READING, sample_id=case.sample_id, field=case.field, problem=case.problem
        )
        for case in cases.of("fault")
    ]
    rejected = cases.of("rejected")
    others = (f"{case.kind}: {case}" for case in cases.cases if case.kind != "fault")
    report = _report(
        job.path,
        animals + len(rejected),
        faults,
        findings,
        notes=(*dataset.source.notes, *votes.warnings, *mended, *others),
    )
    warnings = Counter(report.warnings) + Counter(case.field for case in rejected)
    warnings += Counter({EXCHANGED: len(mended), SIDES: len(votes.warnings)}) + doubts
    return msgspec.structs.replace(report, warnings=warnings)


def _dataset_of(job: CheckJob) -> AnnotatedDataset:
    """The job's dataset, whose bad samples are counted, not raised."""
    return AnnotatedDataset(
        job.path,
        format=job.dataset.format,
        images=job.dataset.images,
        model=job.dataset.model,
        vocabulary=job.dataset.vocabulary,
        optional=job.dataset.optional or "fault",
        visibility=job.dataset.visibility,
        categories=job.dataset.categories,
        apply_orientation=job.dataset.applies_orientation,
        check_paths=job.dataset.check_paths,
        index=job.dataset.index,
        body=job.body,
        on_bad="skip",
        stored_cameras=job.stored_camera,
        cache=job.cache,
    )


def doubts_of(targets: Sequence[Mapping[str, Any]]) -> Counter[str]:
    """The number of labels, by flag, that may not be for the pixels that they lie on."""
    flags = (
        flag
        for target in targets
        for quality in target["meta"]["quality"]
        for flag in quality["flags"]
    )
    return Counter(flag for flag in flags if flag in DOUBTS)


def mended_animals(target: Mapping[str, Any]) -> list[str]:
    """Sentences on a target's animals whose left and right keypoints a label exchanged."""
    meta = target["meta"]
    return [
        f"{sample_id}: {warning}"
        for sample_id, quality in zip(meta["sample_ids"], meta["quality"], strict=True)
        if quality["labeling"] != AS_GIVEN
        for warning in quality["warnings"]
        if warning.startswith(EXCHANGED_SIDES)
    ]


def _report(
    path: Path,
    readable: int,
    faults: Sequence[CheckedFault],
    findings: Sequence[CheckedFault],
    *,
    notes: Sequence[str],
) -> CheckReport:
    """The report on animals that could be read and on those that could not.

    Args:
        path: what was checked.
        readable: how many animals could be read.
        faults: what is wrong for certain, unreadable animals too.
        findings: of the target's checks, some of which only warn.
        notes: of the reader.

    """
    certain = [*faults, *(finding for finding in findings if finding.check not in WARNINGS)]
    counts = Counter(fault.check for fault in certain)
    return CheckReport(
        source=str(path),
        animals=readable + counts[READING],
        counts=counts,
        warnings=Counter(finding.check for finding in findings if finding.check in WARNINGS),
        faults=certain,
        notes=list(notes),
    )


def _findings_of_targets(
    targets: Sequence[dict[str, Any]], sizes: Sequence[tuple[int, int]]
) -> list[CheckedFault]:
    """The findings in targets of one animal each, under their samples' own names."""
    findings: list[CheckedFault] = []
    starts = range(0, len(targets), AT_ONCE)
    for start in watched(starts, "checking", unit=f"{AT_ONCE} boxes"):
        batch = targets[start : start + AT_ONCE]
        of_batch, _, _ = examined(batch, sizes[start : start + AT_ONCE], None)
        findings += [_checked(finding, batch[finding.target]["image_id"]) for finding in of_batch]
    return findings


def _checked(finding: Finding, sample_id: str | None) -> CheckedFault:
    return CheckedFault(
        check=finding.check, sample_id=sample_id, field=finding.field, problem=finding.problem
    )


def _unreadable(error: SampleError) -> CheckedFault:
    """The fault of an element that cannot be read."""
    return CheckedFault(
        check=READING, sample_id=error.sample_id, field=error.field, problem=error.problem
    )


def _print(report: CheckReport, nouns: tuple[str, str]) -> None:
    checked = counted(report.animals, *nouns)
    print(f"{checked} in {report.source}: {counted(len(report.faults), 'fault')}")
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

"""Sanity checks of the targets that reach the loss, cheap enough for every step of training.

The fields of a batch become a few float64 arrays once; each check is a handful of NumPy calls for
all animals together. What float32 rounds is allowed for, nothing else: a target is wrong if two of
its fields cannot both be true.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.training.box_checks import box_findings
from animal3dbox.training.camera_checks import camera_findings
from animal3dbox.training.checked_fields import Target, meta_of
from animal3dbox.training.cuboid_checks import cuboid_findings
from animal3dbox.training.face_checks import face_findings
from animal3dbox.training.findings import WARNINGS, Finding, TargetReport, first_examples
from animal3dbox.training.form_checks import form_findings, target_form
from animal3dbox.training.frame_checks import frame_findings
from animal3dbox.training.keypoint_checks import keypoint_findings
from animal3dbox.training.label_checks import double_findings, label_findings
from animal3dbox.training.mask_checks import mask_findings
from animal3dbox.training.packed import Packed
from animal3dbox.training.packing import groups_of, pack
from animal3dbox.training.places import animal_findings, image_findings
from animal3dbox.training.ranges import TargetRanges, range_findings
from animal3dbox.training.statistics import STATISTICS_EVERY, statistics_of

CHECKS_OF_VALUES = (
    camera_findings,
    cuboid_findings,
    face_findings,
    box_findings,
    frame_findings,
    keypoint_findings,
    mask_findings,
    double_findings,
)
"""The checks of targets whose fields have the right forms, in the order of their report."""


def check_targets(
    batch: Any,
    images: Any = None,
    *,
    on_fault: Literal["raise", "count"] = "raise",
    every: int = 1,
    step: int | None = None,
    classes: int | None = None,
    ranges: TargetRanges | None = None,
) -> TargetReport:
    """Check the targets of a batch.

    Args:
        batch: (images, list of target dicts), or the list alone; any subset of the fields of a
            target may be there.
        images: the images, if they are not in the batch: (B, 3, H, W), a list of (3, H, W), or of
            pairs (height, width), which images that were padded to one size need. Without images
            and masks, nothing is compared with the frame.
        on_fault: "raise" the first fault as an error, or "count" all.
        every: check only the steps that this divides.
        step: the number of the step in a training loop. What would cost too much at once goes in
            turns by this number: even steps look at the mask of one animal, odd ones at its
            keypoints on that mask and at the types and counts of one target by itself (every step,
            at those of the batch together). Without it, all is looked at: every mask, too.
        classes: the number of classes, which labels must stay below.
        ranges: what sizes, depths and other measures are stated or learned to be (TargetRanges).

    Returns:
        What was found; all zero if the step is skipped.

    Raises:
        SampleError: the first fault, with image_id and "#k" of the animal, the field, what is wrong
            and what to do.
        ConfigError: an option cannot be.

    Example:
        >>> import torch
        >>> target = {"center": torch.tensor([[3.0, 0, 4]]), "distance": torch.tensor([5.0])}
        >>> check_targets([target]).faults
        0
        >>> target["distance"] *= 100  # in another unit
        >>> print(check_targets([target], on_fault="count").counts)
        Counter({'distance': 1})
    """
    _check_options(on_fault, every, step)
    if classes is not None and classes < 1:
        raise ConfigError(f"classes must be at least 1, got {classes}")
    if step is not None and step % every:
        return TargetReport()
    targets, images = _opened(batch, images)
    findings, animals, statistics = examined(
        targets, image_sizes(images, targets), step, classes=classes, ranges=ranges
    )
    faults = [finding for finding in findings if finding.check not in WARNINGS]
    if faults and on_fault == "raise":
        raise error_of(faults[0], targets)
    return TargetReport(
        len(targets),
        animals,
        Counter(finding.check for finding in faults),
        Counter(finding.check for finding in findings if finding.check in WARNINGS),
        first_examples((finding.check, error_of(finding, targets)) for finding in findings),
        statistics.labels,
        statistics.spans,
        statistics.sides,
        statistics.left_picture,
    )


def _check_options(on_fault: str, every: int, step: int | None) -> None:
    if on_fault not in ("raise", "count"):
        raise ConfigError(f"on_fault must be raise or count, got {on_fault!r}")
    if every < 1 or (every > 1 and step is None):
        raise ConfigError(
            "every must be at least 1, and above 1 needs the number of the step, got"
            f" every={every}, step={step}"
        )


def examined(
    targets: Sequence[Target],
    image_hw: Sequence[tuple[int, int]] | None,
    step: int | None,
    *,
    classes: int | None = None,
    ranges: TargetRanges | None = None,
) -> tuple[list[Finding], int, TargetReport]:
    """The faults of targets, how many animals were looked at, and their statistics.

    A target whose form is wrong, or that is not finite, is not looked at further.
    """
    findings: list[Finding] = []
    animals, statistics = 0, TargetReport()
    for group in groups_of(targets):
        packed = _packed(targets, group, image_hw, step)
        if packed is None:
            malformed = form_findings([targets[number] for number in group], group)
            findings += malformed
            packed = _packed(targets, _without(group, malformed), image_hw, step)
        else:
            for turn in _forms_in_turn(group, len(targets), step):
                findings += target_form(targets[turn], turn)
        if packed is None:
            continue
        infinite = list(_finite_findings(packed))
        if infinite:
            findings += infinite
            packed = _packed(targets, _without(packed.index, infinite), image_hw, step)
        if packed is not None:
            animals += packed.count
            if step is None or step % STATISTICS_EVERY == 0:
                statistics += statistics_of(packed)
            for check in CHECKS_OF_VALUES:
                findings += check(packed)
            findings += label_findings(packed, classes)
            if ranges is not None:
                findings += range_findings(packed, ranges)
    return findings, animals, statistics


def _forms_in_turn(group: Sequence[int], count: int, step: int | None) -> list[int]:
    """The targets of a group whose forms are looked at one by one at this step."""
    if step is None:
        return list(group)
    turn = step // 2 % count
    return [turn] if (step == 0 or step % 2) and turn in group else []


def _without(group: Sequence[int], findings: Sequence[Finding]) -> list[int]:
    """The targets of a group in which there are no findings."""
    faulty = {finding.target for finding in findings}
    return [number for number in group if number not in faulty]


def _packed(
    targets: Sequence[Target],
    group: Sequence[int],
    image_hw: Sequence[tuple[int, int]] | None,
    step: int | None,
) -> Packed | None:
    if not group:
        return None
    return pack(
        [targets[number] for number in group],
        group,
        None if image_hw is None else [image_hw[number] for number in group],
        step,
    )


def _finite_findings(packed: Packed) -> Iterator[Finding]:
    """Fields that hold NaN or infinite values."""
    sums = sum(float(values.sum()) for values in (packed.block, *packed.per_image.values()))
    if np.isfinite(sums if packed.keypoints is None else sums + float(packed.keypoints.sum())):
        return
    per_animal = (
        packed.floats
        if packed.keypoints is None
        else {**packed.floats, "keypoints": packed.keypoints}
    )
    problem = "holds NaN or infinite values; what is unknown has no field, or a flag"
    for name, values in per_animal.items():
        wrong = ~np.isfinite(values).reshape(packed.count, -1).all(1)
        yield from animal_findings(
            packed, wrong, check="finite", field=name, problem=lambda _: problem
        )
    for name, values in packed.per_image.items():
        yield from image_findings(
            packed,
            ~np.isfinite(values).reshape(len(values), -1).all(1),
            check="finite",
            field=name,
            problem=lambda _: problem,
        )


def image_sizes(images: Any, targets: Sequence[Target]) -> list[tuple[int, int]] | None:
    """Height and width of each image: of the images, else of the masks; None if neither is there.

    Raises:
        ConfigError: there are not as many images as targets.

    """
    if images is not None:
        if len(images) != len(targets):
            raise ConfigError(f"{len(images)} images for {len(targets)} targets")
        if not len(targets):
            return None  # all was left out, and collate_stacked has no image to tell a size by
        if hasattr(images, "shape"):
            return [(int(images.shape[-2]), int(images.shape[-1]))] * len(targets)
        shapes = [getattr(image, "shape", image) for image in images]
        return [(int(shape[-2]), int(shape[-1])) for shape in shapes]
    if targets and all(
        "masks" in target and getattr(target["masks"], "ndim", 0) == 3 for target in targets
    ):
        return [
            (int(target["masks"].shape[-2]), int(target["masks"].shape[-1])) for target in targets
        ]
    return None


def error_of(finding: Finding, targets: Sequence[Target]) -> SampleError:
    """A finding as an error that names the sample, the field, the check and what is wrong."""
    return SampleError(
        sample_of(finding, targets), finding.field, f"{finding.problem} [{finding.check}]"
    )


def sample_of(finding: Finding, targets: Sequence[Target]) -> str:
    """The name of a finding's sample.

    As its dataset does if the target knows, else the image and the animal's number in the target.
    """
    target = targets[finding.target]
    name = str(target.get("image_id", f"target {finding.target} of the batch"))
    if finding.animal is None:
        return name
    sample_ids = meta_of(target).get("sample_ids")
    own = None
    if isinstance(sample_ids, tuple | list) and finding.animal < len(sample_ids):
        own = sample_ids[finding.animal]
    return own if isinstance(own, str) and own else f"{name}#{finding.animal}"


def _opened(batch: Any, images: Any) -> tuple[list[Target], Any]:
    """The targets and images of a batch."""
    if (
        isinstance(batch, tuple | list)
        and len(batch) == 2
        and not isinstance(batch[0], dict)
        and isinstance(batch[1], tuple | list)
    ):
        images, batch = (batch[0] if images is None else images), batch[1]
    if (
        isinstance(batch, dict)
        or not isinstance(batch, tuple | list)
        or not all(hasattr(target, "keys") for target in batch)
    ):
        raise ConfigError(
            f"a batch is (images, list of target dicts), or such a list, got {type(batch).__name__}"
        )
    return list(batch), images

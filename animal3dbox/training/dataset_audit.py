"""The checks of a training loop over a whole dataset, before anything is trained on it."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from animal3dbox.errors import ConfigError
from animal3dbox.training.checks import check_targets
from animal3dbox.training.findings import TargetReport
from animal3dbox.training.ranges import TargetRanges


class SampleSequence(Protocol):
    """What an audit needs of a dataset: torch's map-style protocol."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Any: ...


def audit(
    dataset: SampleSequence,
    *,
    classes: int | None = None,
    ranges: TargetRanges | None = None,
    at_once: int = 16,
) -> TargetReport:
    """Check every target of a dataset, all masks and keypoints too, and count what is wrong.

    Args:
        dataset: gives (image, target) by index; anything else, such as the Skipped of our own
            datasets, is no sample and is left out (their report() counts those).
        classes: the number of classes; None: that of ``dataset.classes`` if it has them.
        ranges: see check_targets; learn_ranges learns them.
        at_once: how many samples are held in memory and checked together.

    Returns:
        What was found, with statistics of all animals; nothing is raised for a fault.

    Raises:
        ConfigError: at_once is below 1, or a target of a sample is no dict.

    Example:
        >>> import torch
        >>> target = {"center": torch.tensor([[3.0, 0, 4]]), "distance": torch.tensor([5.0])}
        >>> report = audit([(torch.zeros(3, 60, 80), target)] * 3)
        >>> report.targets, report.faults, report.spans["depth"]
        (3, 0, (4.0, 4.0))
    """
    if at_once < 1:
        raise ConfigError(f"at_once must be at least 1, got {at_once}")
    if classes is None:
        named = getattr(dataset, "classes", None)
        classes = len(named) if isinstance(named, Sequence | Mapping) and len(named) else None
    report = TargetReport()
    for start in range(0, len(dataset), at_once):
        indices = range(start, min(start + at_once, len(dataset)))
        samples = [sample for sample in map(dataset.__getitem__, indices) if _is_sample(sample)]
        report += check_targets(
            [target for _, target in samples],
            [tuple(image.shape[-2:]) for image, _ in samples],
            on_fault="count",
            classes=classes,
            ranges=ranges,
        )
    return report


def _is_sample(sample: Any) -> bool:
    """Whether this is (image, target)."""
    return isinstance(sample, tuple | list) and len(sample) == 2 and hasattr(sample[0], "shape")

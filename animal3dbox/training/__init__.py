"""Support of training: an order of samples that can be resumed, and sanity checks of targets.

What detectors learn, and how they are measured, are rooms of their own:
`animal3dbox.training.detector_targets` and `animal3dbox.training.metrics`.
The names below are loaded when first used (PEP 562).
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.training.checks import check_targets as check_targets
    from animal3dbox.training.dataset_audit import audit as audit
    from animal3dbox.training.findings import TargetReport as TargetReport
    from animal3dbox.training.ranges import TargetRanges as TargetRanges
    from animal3dbox.training.ranges import learn_ranges as learn_ranges
    from animal3dbox.training.sampler import EpochSampler as EpochSampler

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "dataset_audit": ("audit",),
        "checks": ("check_targets",),
        "findings": ("TargetReport",),
        "ranges": ("TargetRanges", "learn_ranges"),
        "sampler": ("EpochSampler",),
    },
)

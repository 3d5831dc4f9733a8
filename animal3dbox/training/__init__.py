"""Support of training: an order of samples that can be resumed, and sanity checks of targets.

The names below are loaded when first used (PEP 562).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from animal3dbox.training.checks import check_targets as check_targets
    from animal3dbox.training.findings import TargetReport as TargetReport
    from animal3dbox.training.sampler import EpochSampler as EpochSampler

_HOMES = {"EpochSampler": "sampler", "TargetReport": "findings", "check_targets": "checks"}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'animal3dbox.training' has no attribute {name!r}")
    return getattr(import_module(f"animal3dbox.training.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return __all__

"""Metrics of oriented boxes with named faces: whether the animal was found, and its front with it.

docs/metrics.md defines each with its formula. The names below are loaded when first used (PEP 562).
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.training.metrics.box_metrics import BoxMetrics as BoxMetrics
    from animal3dbox.training.metrics.options import MetricOptions as MetricOptions
    from animal3dbox.training.metrics.torchmetrics_door import TorchBoxMetrics as TorchBoxMetrics

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "box_metrics": ("BoxMetrics",),
        "options": ("MetricOptions",),
        "torchmetrics_door": ("TorchBoxMetrics",),
    },
)

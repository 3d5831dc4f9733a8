"""The metrics as one of torchmetrics', for loops that synchronise and reset those."""

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.training.metrics.box_metrics import BoxMetrics, Fields, Metrics

try:
    from torchmetrics import Metric
except ImportError as error:
    raise ConfigError("TorchBoxMetrics needs: pip install 'animal3dbox[metrics]'") from error

STATES = ("image_counts", "prediction_rows", "truth_rows")


class TorchBoxMetrics(Metric):
    """BoxMetrics as a torchmetrics.Metric, which Lightning and DDP know how to handle.

    `compute()` gives the same dict. One object has it all: in a MetricCollection two metrics whose
    states are equal after the first batch share one state from then on, so that two of these with
    different options need `compute_groups=False`.

    Args:
        **options: see MetricOptions.

    Raises:
        ConfigError: an option cannot be; or, at import, torchmetrics is not installed.

    Example:
        >>> import torch
        >>> target = {
        ...     "center": torch.tensor([[0.0, 0, 8]]),
        ...     "rotation": torch.eye(3)[None],
        ...     "size": torch.tensor([[2.0, 1, 1]]),
        ... }
        >>> metric = TorchBoxMetrics()
        >>> metric.update([{**target, "scores": torch.tensor([0.9])}], [target])
        >>> metric.compute()["ap_3d_50"]
        1.0
    """

    is_differentiable = False
    full_state_update = False
    image_counts: list[Tensor] | Tensor
    prediction_rows: list[Tensor] | Tensor
    truth_rows: list[Tensor] | Tensor

    def __init__(self, **options: Any) -> None:
        super().__init__()
        self.options = options
        BoxMetrics(**options)  # refuses what cannot be
        for name in STATES:
            self.add_state(name, default=[], dist_reduce_fx="cat")

    def update(self, predictions: Sequence[Fields], targets: Sequence[Fields]) -> None:
        """Add the predictions and targets of a batch of images; see BoxMetrics.update."""
        states = BoxMetrics(**self.options).states_of(predictions, targets)
        for name, state in zip(STATES, states, strict=True):
            getattr(self, name).append(state.to(self.device))

    def compute(self) -> Metrics:
        """All metrics of all images so far; see BoxMetrics.compute."""
        metrics = BoxMetrics(**self.options)
        for name in STATES:
            state = getattr(self, name)  # one tensor once it was synchronised
            setattr(metrics, name, [state] if isinstance(state, Tensor) else list(state))
        return metrics.compute()

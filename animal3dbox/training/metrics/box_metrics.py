"""The metrics of detectors of oriented boxes: fed batch by batch, computed at the end."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.progress import watched
from animal3dbox.training.metrics.box_table import WIDTH, BoxTable, Floats
from animal3dbox.training.metrics.candidates import Candidates
from animal3dbox.training.metrics.evaluation import Evaluation, Statistic
from animal3dbox.training.metrics.options import MetricOptions
from animal3dbox.training.metrics.read_boxes import read_predictions, read_truths
from animal3dbox.training.metrics.weighted_statistics import resampled

Fields = Mapping[str, Any]
Metrics = dict[str, float | int | None]
"""Each metric by its name; None where it is unknown."""


class BoxMetrics:
    """Metrics of oriented boxes with named faces: AP3D, and what AP3D cannot see.

    Head-for-tail boxes have an AP3D of 1: it knows no front. AP3D-H asks for the heading too, and
    beside it stand the errors of heading, flank, faces, corners, sizes and distance of the pairs
    that were found. docs/metrics.md defines every key of the result; an interval of 95 %, by
    resampling the images, is `<key>_low` to `<key>_high`. Unknown is None.

    The states are three lists of tensors, which are appended to and concatenated, never changed:

    Attributes:
        image_counts: (1, 2) int64 for each image: its predictions and its truths.
        prediction_rows: (N, WIDTH) float64 for each image, on the host.
        truth_rows: (N, WIDTH) float64 for each image, on the host.
        options: what the user chose, see MetricOptions.

    Args:
        **options: see MetricOptions.

    Raises:
        ConfigError: an option cannot be.

    Example:
        >>> target = {
        ...     "center": torch.tensor([[0.0, 0, 8]]),
        ...     "rotation": torch.tensor([[[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]]),
        ...     "size": torch.tensor([[2.0, 1, 1]]),
        ... }
        >>> head_for_tail = target["rotation"] * torch.tensor([-1.0, -1, 1])
        >>> metrics = BoxMetrics()
        >>> metrics.update(
        ...     [{**target, "rotation": head_for_tail, "scores": torch.tensor([0.9])}], [target])
        >>> result = metrics.compute()
        >>> result["ap_3d"], result["ap_3d_h45"], result["heading_error_deg"], result["flip_rate"]
        (1.0, 0.0, 180.0, 1.0)
    """

    def __init__(self, **options: Any) -> None:
        try:
            self.options = MetricOptions(**options)
        except TypeError as error:
            known = ", ".join(MetricOptions.__dataclass_fields__)
            raise ConfigError(f"options of BoxMetrics are {known}; {error}") from error
        self.reset()

    def reset(self) -> None:
        """Empty the states, as before the first `update`."""
        self.image_counts: list[Tensor] = []
        self.prediction_rows: list[Tensor] = []
        self.truth_rows: list[Tensor] = []

    def update(self, predictions: Sequence[Fields], targets: Sequence[Fields]) -> None:
        """Add the predictions and targets of a batch of images.

        Args:
            predictions: for each image a dict of `center`, `rotation`, `size`, `scores` and what
                else of a target's fields the detector gives: `labels`, `boxes`, `face_visible`
                (flags, or probabilities), `face_share`, `flank`; and `heading_known` (N,) if its
                convention folds the front away. A box that is none (not finite, no rotation, a
                size that is not positive) hits nothing.
            targets: for each image a Dataset's target. `iscrowd` animals count neither way.

        Raises:
            SampleError: naming image, animal and field, if a field is missing or of the wrong
                shape, a score is no number or a true box is none; the batch is then left out as a
                whole.
            ConfigError: there are not as many predictions as targets.

        """
        states = self.states_of(predictions, targets)
        self.image_counts.append(states[0])
        self.prediction_rows.append(states[1])
        self.truth_rows.append(states[2])

    def states_of(
        self, predictions: Sequence[Fields], targets: Sequence[Fields]
    ) -> tuple[Tensor, Tensor, Tensor]:
        """What a batch adds to the three lists; see update.

        Returns:
            image_counts: (B, 2) int64.
            prediction_rows: (D, WIDTH) float64.
            truth_rows: (G, WIDTH) float64.

        """
        for name, given in (("predictions", predictions), ("targets", targets)):
            if isinstance(given, Mapping) or not all(isinstance(one, Mapping) for one in given):
                raise ConfigError(f"{name} must be a list of dicts, one an image")
        if len(predictions) != len(targets):
            raise ConfigError(f"{len(predictions)} predictions for {len(targets)} targets")
        tables: list[tuple[BoxTable, BoxTable]] = []
        first = sum(len(counts) for counts in self.image_counts)
        for number, (prediction, target) in enumerate(zip(predictions, targets, strict=True)):
            image_id = str(target.get("image_id", f"image {first + number} of the metrics"))
            truths = read_truths(target, image_id, self.options)
            tables.append((read_predictions(prediction, target, image_id, self.options), truths))
        empty = np.zeros((0, WIDTH))
        rows = [np.concatenate([empty, *(pair[side].rows() for pair in tables)]) for side in (0, 1)]
        counts = torch.tensor([[len(p), len(t)] for p, t in tables], dtype=torch.int64)
        return counts.reshape(-1, 2), torch.from_numpy(rows[0]), torch.from_numpy(rows[1])

    def merge(self, other: "BoxMetrics") -> None:
        """Add the images of another process's metrics.

        Raises:
            ConfigError: it was made with other options.

        """
        if self.options != other.options:
            raise ConfigError(
                f"metrics of other options cannot be merged: {self.options} and {other.options}"
            )
        self.image_counts += other.image_counts
        self.prediction_rows += other.prediction_rows
        self.truth_rows += other.truth_rows

    def compute(self) -> Metrics:
        """All metrics of all images so far, by the keys of docs/metrics.md."""
        evaluation = Evaluation(self._candidates(), self.options)
        statistics = evaluation.statistics()
        relative: Metrics = {"rel_ap_3d": None, "rel_scale": None}
        if self.options.relative and (best := evaluation.best_scale()) is not None:
            relative["rel_scale"], statistic = best
            statistics.append(statistic)
        return {
            **evaluation.counts(),
            **relative,
            **self._values(statistics, evaluation.candidates.images),
        }

    def _values(self, statistics: Sequence[Statistic], images: int) -> Metrics:
        """Each metric, and its interval."""
        values: Metrics = {}
        intervals: Metrics = {}
        once, resamples = np.ones((1, images), np.int64), self.options.resamples
        # One image says nothing of others: its intervals are unknown
        draws = resampled(images, resamples, self.options.seed) if images > 1 else once
        for statistic in watched(statistics, "measuring", unit="group of metrics"):
            values |= {name: _or_none(value[0]) for name, value in statistic(once).items()}
            if resamples:
                for name, sample in statistic(draws).items():
                    intervals |= _interval(name, sample if images > 1 else sample[:0])
        return {**values, **intervals}

    def _candidates(self) -> Candidates:
        counts = _joined(self.image_counts, 2).astype(np.int64)
        number = np.arange(len(counts))
        return Candidates(
            predictions=BoxTable.from_rows(_joined(self.prediction_rows, WIDTH)),
            truths=BoxTable.from_rows(_joined(self.truth_rows, WIDTH)),
            prediction_image=np.repeat(number, counts[:, 0]),
            truth_image=np.repeat(number, counts[:, 1]),
            images=len(counts),
            max_detections=self.options.max_detections,
        )


def _joined(states: Sequence[Tensor], width: int) -> Floats:
    """The rows (N, width) of a list of tensors."""
    return np.concatenate(
        [np.zeros((0, width)), *(state.numpy(force=True).astype(np.float64) for state in states)]
    )


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _interval(name: str, sample: Floats) -> Metrics:
    """The 2.5th and 97.5th percentile of the resamples in which a metric is known."""
    known = sample[~np.isnan(sample)]
    if len(known) == 0:
        return {f"{name}_low": None, f"{name}_high": None}
    low, high = np.percentile(known, (2.5, 97.5)).tolist()
    return {f"{name}_low": low, f"{name}_high": high}

"""All metrics of predictions and truths, as functions of how often each image is taken."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from animal3dbox.geometry.cuboid import FACE_NAMES
from animal3dbox.progress import watched
from animal3dbox.training.metrics.average_precision import AveragePrecision
from animal3dbox.training.metrics.box_table import Flags, Floats, Whole
from animal3dbox.training.metrics.candidates import Candidates
from animal3dbox.training.metrics.matching import Matches, match
from animal3dbox.training.metrics.options import MetricOptions
from animal3dbox.training.metrics.pair_errors import (
    Pairs,
    corner_errors,
    distance_errors,
    flanks_right,
    heading_errors_deg,
    hungarian_distances,
    share_errors,
    size_errors,
)
from animal3dbox.training.metrics.weighted_statistics import (
    F1,
    Auc,
    Mean,
    Median,
    mean_of_known,
    ratio,
)

IOU_PERCENT = (5, 10, 15, 20, 25, 30, 35, 40, 45, 50)
IOU_THRESHOLDS = tuple(percent / 100 for percent in IOU_PERCENT)
"""The thresholds that AP3D is the mean over."""
SINGLE_PERCENT = (15, 25, 50)
"""Those that have a value of their own."""
HEADING_TOLERANCES_DEG = (30, 45)
DEPTHS_M = {"near": (0.0, 10.0), "medium": (10.0, 35.0), "far": (35.0, np.inf)}
"""Ranges of the depth of a box's centre, in metres: from, and below."""
SCALES = tuple(round(0.1 * tenths, 1) for tenths in range(3, 31))
"""The 28 factors that Rel-AP3D chooses from."""

Values = dict[str, Floats]
"""Metrics (R,) by their names, NaN where unknown."""
Statistic = Callable[[Whole], Values]
"""From weights (R, I), how often each of I images is taken, to metrics under each weighting."""


@dataclass(frozen=True)
class Evaluation:
    """Predictions and truths, and what is computed of them once.

    Attributes:
        candidates: predictions, truths and their images.
        options: the metrics'.
    """

    candidates: Candidates
    options: MetricOptions

    def statistics(self) -> list[Statistic]:
        """Everything that docs/metrics.md defines, but for Rel-AP3D."""
        return [
            self._overall_precision,
            *(partial(self._heading_precision, tolerance) for tolerance in HEADING_TOLERANCES_DEG),
            *(partial(self._depth_precision, name) for name in DEPTHS_M),
            self._pair_means,
            self._faces,
        ]

    @cached_property
    def iou(self) -> Floats:
        """The IoU (P,) of the cuboids of each candidate pair."""
        return self.candidates.overlaps()

    @cached_property
    def matches(self) -> Matches:
        """Predictions on truths at all thresholds of AP3D."""
        return match(self.candidates, self.iou, IOU_THRESHOLDS)

    @cached_property
    def pairs(self) -> Pairs:
        """The predictions (P,) and truths (P,) that errors are taken of."""
        by_cuboids = self.options.pair_by == "iou_3d"
        iou = self.iou if by_cuboids else self.candidates.box_overlaps()
        matches = match(self.candidates, iou, (self.options.least_pair_iou,))
        prediction = np.flatnonzero(matches.hit[:, 0])
        return prediction, matches.truth[prediction, 0]

    @cached_property
    def pair_image(self) -> Whole:
        """The image (P,) of each pair."""
        return self.candidates.truth_image[self.pairs[1]]

    def _overall_precision(self, weights: Whole) -> Values:
        """AP3D, AP15, AP25, AP50, and AP3D of each class."""
        precision = AveragePrecision(self.candidates, self.matches)
        by_class = precision.by_class(weights)  # (R, C, T)
        by_level = mean_of_known(by_class, 1)
        values = {"ap_3d": by_level.mean(1)}
        for percent in SINGLE_PERCENT:
            values[f"ap_3d_{percent}"] = by_level[:, IOU_PERCENT.index(percent)]
        if not self.options.class_agnostic:
            for name in self.options.classes or ():  # unknown, unless a truth of it is there
                values[f"ap_3d_class_{name}"] = np.full(len(weights), np.nan)
            for column, label in enumerate(precision.labels.tolist()):
                values[f"ap_3d_class_{self._class_name(label)}"] = by_class[:, column].mean(1)
        return values

    def _class_name(self, label: int) -> str:
        names = self.options.classes
        return str(label) if names is None or not 0 <= label < len(names) else names[label]

    @cached_property
    def _candidate_heading_deg(self) -> Floats:
        """The heading error (P,) of every candidate pair; NaN where a front is not known."""
        c = self.candidates
        return heading_errors_deg(c.predictions, c.truths, c.pairs)

    @cached_property
    def heading_matches(self) -> dict[int, Matches | None]:
        """Predictions on truths of AP3D-H by tolerance; None if no front is known on a side."""
        c = self.candidates
        heading_known = c.truths.heading_known
        has_fronts = not len(c.predictions) or bool(c.predictions.heading_known.any())
        if not has_fronts or not heading_known.any():
            return dict.fromkeys(HEADING_TOLERANCES_DEG)
        unknown_truth = ~heading_known[c.pairs[1]]
        return {
            tolerance: match(
                c,
                self.iou,
                IOU_THRESHOLDS,
                eligible=(self._candidate_heading_deg <= tolerance) | unknown_truth,
                ignored_truths=~heading_known,
            )
            for tolerance in HEADING_TOLERANCES_DEG
        }

    def _heading_precision(self, tolerance: int, weights: Whole) -> Values:
        """AP3D-H at a tolerance in degrees."""
        return {f"ap_3d_h{tolerance}": self._precision(self.heading_matches[tolerance], weights)}

    def _precision(self, matches: Matches | None, weights: Whole) -> Floats:
        """The mean of AP over the thresholds, (R,)."""
        if matches is None:
            return np.full(len(weights), np.nan)
        by_level = AveragePrecision(self.candidates, matches)(weights)
        return np.asarray(by_level.mean(1))

    @cached_property
    def depth_matches(self) -> dict[str, Matches | None]:
        """Predictions on truths by range of depth; None without a metric truth."""
        c = self.candidates
        if not c.truths.metric.any():
            return dict.fromkeys(DEPTHS_M)
        metric_image = np.ones(c.images, bool)
        metric_image[c.truth_image[~c.truths.metric]] = False
        return {
            name: match(
                c,
                self.iou,
                IOU_THRESHOLDS,
                ignored_truths=~c.truths.metric | ~_within(c.truths.center[:, 2], bounds),
                ignored_if_unmatched=~metric_image[c.prediction_image]
                | ~_within(c.predictions.center[:, 2], bounds),
            )
            for name, bounds in DEPTHS_M.items()
        }

    def _depth_precision(self, name: str, weights: Whole) -> Values:
        """AP3D of a range of depth."""
        return {f"ap_3d_{name}": self._precision(self.depth_matches[name], weights)}

    @cached_property
    def pair_values(self) -> Values:
        """The errors (P,) whose means are metrics, by the metrics' names; NaN where unknown."""
        tables = (self.candidates.predictions, self.candidates.truths, self.pairs)
        truths, (_, of_truth) = self.candidates.truths, self.pairs
        degrees, apart, sizes = (
            error(*tables) for error in (heading_errors_deg, distance_errors, size_errors)
        )
        return {
            "heading_error_deg": degrees,
            "flip_rate": np.where(np.isnan(degrees), np.nan, degrees > 90),
            "flank_accuracy": flanks_right(*tables),
            "corner_error": corner_errors(*tables),
            "nhd": hungarian_distances(*tables),
            "length_error": sizes[:, 0],
            "width_error": sizes[:, 1],
            "height_error": sizes[:, 2],
            "distance_error": ratio(apart, truths.distance[of_truth]),
            "distance_error_m": np.where(truths.metric[of_truth], apart, np.nan),
            "face_share_error": share_errors(*tables),
        }

    def _pair_means(self, weights: Whole) -> Values:
        """The means of the pairs' errors, and the median of the one that has two humps."""
        means = {
            name: Mean(values, self.pair_image, self.candidates.images)(weights)
            for name, values in self.pair_values.items()
        }
        heading = Median(self.pair_values["heading_error_deg"], self.pair_image)
        return {**means, "heading_median_deg": heading(weights)}

    def _faces(self, weights: Whole) -> Values:
        """F1 and AUC of each face, and their means over the faces."""
        c, (of_prediction, of_truth) = self.candidates, self.pairs
        scores = c.predictions.face_score[of_prediction]
        true = c.truths.face_score[of_truth]
        visible = np.where(np.isnan(true), np.nan, true > 0.5)
        f1 = [F1(*both, self.pair_image, c.images)(weights) for both in _columns(scores, visible)]
        auc = [Auc(*both, self.pair_image)(weights) for both in _columns(scores, visible)]
        values = {
            "face_f1": mean_of_known(np.stack(f1), 0),
            "face_auc": mean_of_known(np.stack(auc), 0),
        }
        for name, face_f1, face_auc in zip(FACE_NAMES, f1, auc, strict=True):
            values |= {f"face_f1_{name}": face_f1, f"face_auc_{name}": face_auc}
        return values

    def counts(self) -> dict[str, int]:
        """How many of everything there is."""
        predictions, truths = self.candidates.predictions, self.candidates.truths
        return {
            "images": self.candidates.images,
            "truths": int((~truths.crowd).sum()),
            "predictions": len(predictions),
            "degenerate_predictions": int((~predictions.usable).sum()),
            "pairs": len(self.pairs[0]),
            "heading_count": self._known("heading_error_deg"),
            "flank_count": self._known("flank_accuracy"),
        }

    def _known(self, name: str) -> int:
        """How many pairs an error is known of."""
        return int((~np.isnan(self.pair_values[name])).sum())

    def best_scale(self) -> tuple[float, Statistic] | None:
        """Rel-AP3D: the factor of SCALES under which AP3D is highest, and the AP3D under it.

        None without a truth. Of equal factors the one nearest to 1 is taken.
        """
        once = np.ones((1, self.candidates.images), np.int64)
        best: tuple[float, float, Matches] | None = None
        scales = sorted(SCALES, key=lambda factor: abs(np.log(factor)))
        for scale in watched(scales, "matching", unit="scale"):
            matches = match(self.candidates, self.candidates.overlaps(scale), IOU_THRESHOLDS)
            value = float(self._precision(matches, once)[0])
            if not np.isnan(value) and (best is None or value > best[0]):
                best = value, scale, matches
        if best is None:
            return None
        _, scale, matches = best
        return scale, lambda weights: {"rel_ap_3d": self._precision(matches, weights)}


def _within(depth: Floats, bounds: tuple[float, float]) -> Flags:
    """Which depths (N,) lie in a range."""
    return np.asarray((depth >= bounds[0]) & (depth < bounds[1]))


def _columns(scores: Floats, visible: Floats) -> list[tuple[Floats, Floats]]:
    """Scores and truths (P,) of each face."""
    return list(zip(scores.T, visible.T, strict=True))

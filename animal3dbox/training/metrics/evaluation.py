"""All metrics of predictions and truths, as functions of how often each image is taken."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from animal3dbox.geometry.cuboid import FACE_NAMES
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
from animal3dbox.training.metrics.weighted_statistics import F1, Auc, Mean, mean_of_known

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
            self._heading_errors,
            self._place_errors,
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

    def mean(self, values: Floats) -> Mean:
        """The mean of numbers (P,) of the pairs."""
        return Mean(values, self.pair_image, self.candidates.images)

    def _overall_precision(self, weights: Whole) -> Values:
        """AP3D, AP15, AP25, AP50, and AP3D of each class."""
        precision = AveragePrecision(self.candidates, self.matches)
        by_class = precision.by_class(weights)  # (R, C, T)
        by_level = mean_of_known(by_class, 1)
        values = {"ap_3d": by_level.mean(1)}
        for percent in SINGLE_PERCENT:
            values[f"ap_3d_{percent}"] = by_level[:, IOU_PERCENT.index(percent)]
        if not self.options.class_agnostic:
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

    def _heading_errors(self, weights: Whole) -> Values:
        """Heading error, flip rate and flank accuracy."""
        c = self.candidates
        degrees = self._heading_deg
        flipped = np.where(np.isnan(degrees), np.nan, degrees > 90)
        return {
            "heading_error_deg": self.mean(degrees)(weights),
            "flip_rate": self.mean(flipped)(weights),
            "flank_accuracy": self.mean(self._flanks_right)(weights),
            "corner_error": self.mean(corner_errors(c.predictions, c.truths, self.pairs))(weights),
        }

    @cached_property
    def _heading_deg(self) -> Floats:
        return heading_errors_deg(self.candidates.predictions, self.candidates.truths, self.pairs)

    @cached_property
    def _flanks_right(self) -> Floats:
        return flanks_right(self.candidates.predictions, self.candidates.truths, self.pairs)

    def _place_errors(self, weights: Whole) -> Values:
        """NHD, and errors of sizes and distance."""
        predictions, truths = self.candidates.predictions, self.candidates.truths
        tables = (predictions, truths, self.pairs)
        apart, sizes = distance_errors(*tables), size_errors(*tables)
        of_truth = self.pairs[1]
        metres = np.where(truths.metric[of_truth], apart, np.nan)
        values = {
            "nhd": self.mean(hungarian_distances(*tables))(weights),
            "distance_error": self.mean(apart / truths.distance[of_truth])(weights),
            "distance_error_m": self.mean(metres)(weights),
        }
        for axis, name in enumerate(("length", "width", "height")):
            values[f"{name}_error"] = self.mean(sizes[:, axis])(weights)
        return values

    def _faces(self, weights: Whole) -> Values:
        """F1 and AUC of each face and their means over the faces, and the error of the shares."""
        c, (of_prediction, of_truth) = self.candidates, self.pairs
        scores = c.predictions.face_score[of_prediction]
        true = c.truths.face_score[of_truth]
        visible = np.where(np.isnan(true), np.nan, true > 0.5)
        f1 = [F1(*both, self.pair_image, c.images)(weights) for both in _columns(scores, visible)]
        auc = [Auc(*both, self.pair_image)(weights) for both in _columns(scores, visible)]
        values = {
            "face_f1": mean_of_known(np.stack(f1), 0),
            "face_auc": mean_of_known(np.stack(auc), 0),
            "face_share_error": self.mean(share_errors(c.predictions, c.truths, self.pairs))(
                weights
            ),
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
            "heading_count": int((~np.isnan(self._heading_deg)).sum()),
            "flank_count": int((~np.isnan(self._flanks_right)).sum()),
        }

    def best_scale(self) -> tuple[float, Statistic] | None:
        """Rel-AP3D: the factor of SCALES under which AP3D is highest, and the AP3D under it.

        None without a truth. Of equal factors the one nearest to 1 is taken.
        """
        once = np.ones((1, self.candidates.images), np.int64)
        best: tuple[float, float, Matches] | None = None
        for scale in sorted(SCALES, key=lambda factor: abs(np.log(factor))):
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

"""Average precision over 101 recalls, as COCO's, for many weightings of the images at once.

A weighting says how often each image is taken: once each for the metric itself, and as a resample
drew them for its interval. Predictions with the same score keep the order of their images.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from animal3dbox.training.metrics.box_table import Flags, Floats, Whole
from animal3dbox.training.metrics.candidates import Candidates
from animal3dbox.training.metrics.matching import Matches
from animal3dbox.training.metrics.weighted_statistics import mean_of_known

RECALLS: Floats = np.linspace(0.0, 1.0, 101)
CELLS_AT_ONCE = 2_000_000
"""About so many (weighting, prediction) cells are summed in one go."""


@dataclass(frozen=True)
class AveragePrecision:
    """The average precision of each class at each threshold.

    Attributes:
        candidates: predictions, truths and their images.
        matches: what hits what, at T thresholds.
    """

    candidates: Candidates
    matches: Matches

    @cached_property
    def labels(self) -> Whole:
        """The C classes of which there is a truth to be hit."""
        return np.unique(self.candidates.truths.label[self.matches.counted_truths])

    def by_class(self, weights: Whole) -> Floats:
        """The average precision (R, C, T) under weightings (R, I); NaN without truths."""
        return np.stack(
            [self._of_class(label, weights) for label in self.labels.tolist()]
            or [np.zeros((len(weights), 0))],
            axis=1,
        ).reshape(len(weights), len(self.labels), self.matches.truth.shape[1])

    def __call__(self, weights: Whole) -> Floats:
        """The mean (R, T) over the classes that have truths; NaN if none has."""
        return mean_of_known(self.by_class(weights), 1)

    def _of_class(self, label: int, weights: Whole) -> Floats:
        """The average precision (R, T) of one class."""
        c, matches = self.candidates, self.matches
        # What counts at no threshold is left out from the start
        mine = np.flatnonzero((c.predictions.label == label) & ~matches.ignored.all(1))
        mine = mine[np.argsort(-c.predictions.score[mine], kind="stable")]
        truths = matches.counted_truths & (c.truths.label == label)
        total = weights @ np.bincount(c.truth_image[truths], minlength=c.images)
        chunk = max(1, CELLS_AT_ONCE // max(1, len(mine)))
        return np.concatenate(
            [
                _precisions(
                    weights[start : start + chunk][:, c.prediction_image[mine]],
                    matches.hit[mine],
                    ~matches.ignored[mine],
                    total[start : start + chunk],
                )
                for start in range(0, len(weights), chunk)
            ]
        )


def _precisions(weights: Whole, hit: Flags, counts: Flags, total: Whole) -> Floats:
    """The average precision (R, T) of predictions by falling score.

    With tp and n the hits and the predictions up to some score, precision is tp / n and recall
    tp / total; a recall's precision is the best one at it or at any higher recall, and the average
    is over RECALLS.

    Args:
        weights: (R, D) how often each prediction is taken.
        hit: (D, T).
        counts: (D, T) which predictions count at all.
        total: (R,) the truths to be hit.

    """
    needed = _hits_needed(total)  # (R, 101)
    average = np.full((len(weights), hit.shape[1]), np.nan)
    known = total > 0
    n_with_ignored = np.cumsum(weights, axis=1)
    for level in range(hit.shape[1]):
        hits = np.flatnonzero(hit[:, level])
        if len(hits) == 0:
            average[known, level] = 0.0
            continue
        n = n_with_ignored[:, hits] - _ignored_before(weights, ~counts[:, level], hits)
        tp = np.cumsum(weights[:, hits], axis=1)
        precision = tp / np.maximum(n, 1)
        best = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
        # The first place with hits enough; rows are kept apart, so that one search serves all
        apart = np.arange(len(weights))[:, None] * (int(max(total.max(), tp.max())) + 2)
        place = np.searchsorted((tp + apart).ravel(), (needed + apart).ravel(), side="left")
        place = place.reshape(needed.shape) - np.arange(len(weights))[:, None] * len(hits)
        reached = place < len(hits)
        chosen = np.take_along_axis(best, np.minimum(place, len(hits) - 1), axis=1)
        average[known, level] = np.where(reached, chosen, 0.0).mean(1)[known]
    return average


def _ignored_before(weights: Whole, ignored: Flags, hits: Whole) -> Whole:
    """How often predictions that do not count were taken before each hit, (R, H)."""
    places = np.flatnonzero(ignored)
    before = np.searchsorted(places, hits)
    sums = np.zeros((len(weights), len(places) + 1), np.int64)
    np.cumsum(weights[:, places], axis=1, out=sums[:, 1:])
    return np.asarray(sums[:, before])


def _hits_needed(total: Whole) -> Whole:
    """The fewest hits (R, 101) whose recall, as a float, reaches each of RECALLS."""
    needed = np.floor(RECALLS * total[:, None]).astype(np.int64)
    return needed + (needed / np.maximum(total, 1)[:, None] < RECALLS)

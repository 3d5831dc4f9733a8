"""Means, medians, F1 and AUC over images taken with weights: one formula serves intervals too.

Each statistic takes weights (R, I), how often each image is taken, and gives (R,) or (R, K); NaN
where nothing is known.
"""

from dataclasses import dataclass

import numpy as np

from animal3dbox.training.metrics.box_table import Floats, Whole


def per_image(values: Floats, image: Whole, images: int) -> Floats:
    """The sums of values (P,) over the pairs of each image, (I,)."""
    return np.asarray(np.bincount(image, weights=values, minlength=images), dtype=np.float64)


def ratio(numerator: Floats, denominator: Floats) -> Floats:
    """A quotient, NaN where the denominator is 0."""
    with np.errstate(all="ignore"):
        return np.where(denominator > 0, numerator / denominator, np.nan)


def mean_of_known(values: Floats, axis: int) -> Floats:
    """The mean along an axis of the values that are not NaN; NaN where none is."""
    known = ~np.isnan(values)
    sums = np.where(known, values, 0.0).sum(axis)
    return ratio(np.asarray(sums), np.asarray(known.sum(axis), dtype=np.float64))


@dataclass(frozen=True)
class Mean:
    """The mean of values (P,) of pairs, of those that are known.

    Attributes:
        values: (P,), NaN where unknown.
        image: (P,) the image of each pair.
        images: I.
    """

    values: Floats
    image: Whole
    images: int

    def __call__(self, weights: Whole) -> Floats:
        """The mean (R,) under weightings (R, I) of the images; NaN where nothing is known."""
        known = ~np.isnan(self.values)
        sums = per_image(np.where(known, self.values, 0.0), self.image, self.images)
        counts = per_image(known.astype(np.float64), self.image, self.images)
        return ratio(weights @ sums, weights @ counts)


@dataclass(frozen=True)
class Median:
    """The median of values (P,) of pairs that are known; of an even number the mean of two.

    Attributes:
        values: (P,), NaN where unknown.
        image: (P,) the image of each pair.
    """

    values: Floats
    image: Whole

    def __call__(self, weights: Whole) -> Floats:
        """The median (R,) under weightings (R, I) of the images; NaN where nothing is known."""
        known = np.flatnonzero(~np.isnan(self.values))
        if len(known) == 0:
            return np.full(len(weights), np.nan)
        order = known[np.argsort(self.values[known], kind="stable")]
        below = np.cumsum(weights[:, self.image[order]], axis=1)  # how many are up to each value
        total = below[:, -1:]
        lower, upper = ((2 * below >= total), (2 * below > total))
        middle = np.stack([self.values[order][flags.argmax(1)] for flags in (lower, upper)])
        return np.where(total[:, 0] > 0, middle.mean(0), np.nan)


@dataclass(frozen=True)
class F1:
    """F1 = 2 TP / (2 TP + FP + FN) of one face: a score above 0.5 says that it is seen.

    Attributes:
        scores: (P,) of the predictions, NaN where unknown.
        visible: (P,) 1 or 0 of the truths, NaN where unknown.
        image: (P,) the image of each pair.
        images: I.
    """

    scores: Floats
    visible: Floats
    image: Whole
    images: int

    def __call__(self, weights: Whole) -> Floats:
        """F1 (R,); NaN if the face is neither seen nor said to be."""
        claimed, visible = (self.scores > 0.5).astype(np.float64), self.visible > 0.5
        claimed[np.isnan(self.scores) | np.isnan(self.visible)] = 0
        visible &= ~np.isnan(self.scores)
        right = per_image(claimed * visible, self.image, self.images)
        both = per_image(claimed + visible, self.image, self.images)  # 2 TP + FP + FN
        return ratio(2 * (weights @ right), weights @ both)


@dataclass(frozen=True)
class Auc:
    """How often a face that is seen scores higher than one that is not; ties count half.

    Attributes:
        scores: (P,) of the predictions, NaN where unknown.
        visible: (P,) 1 or 0 of the truths, NaN where unknown.
        image: (P,) the image of each pair.
    """

    scores: Floats
    visible: Floats
    image: Whole

    def __call__(self, weights: Whole) -> Floats:
        """The area under the curve (R,); NaN unless faces of both kinds are there."""
        known = np.flatnonzero(~np.isnan(self.scores) & ~np.isnan(self.visible))
        if len(known) == 0:
            return np.full(len(weights), np.nan)
        order = known[np.argsort(self.scores[known], kind="stable")]
        starts = np.flatnonzero(np.diff(self.scores[order], prepend=-np.inf) > 0)
        weight = weights[:, self.image[order]].astype(np.float64)
        visible = self.visible[order] > 0.5
        positive = np.add.reduceat(weight * visible, starts, axis=1)  # of each score, (R, S)
        negative = np.add.reduceat(weight * ~visible, starts, axis=1)
        below = np.cumsum(negative, axis=1) - negative / 2
        wins = (positive * below).sum(1)
        return ratio(wins, positive.sum(1) * negative.sum(1))


def resampled(images: int, resamples: int, seed: int) -> Whole:
    """Weights (resamples, I): how often each image is drawn, of as many draws as there are."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(images, np.full(images, 1 / images), size=resamples)

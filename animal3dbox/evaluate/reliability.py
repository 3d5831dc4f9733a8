"""How well confidence tells good labels from bad ones, and whether it is a probability."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from animal3dbox.evaluate.tables import Cell, Table, percent, quantile, table_from_records

Array = NDArray[np.float64]
BINS = 10
LEAST_IN_BIN = 5
"""A bin of the reliability curve has no fewer labels."""
CHANCE_DRAWS = 100
BASE_RATES = (0.15, 0.3, 0.5)
"""Parts of bad labels for which the calibration error is told."""


@dataclass(frozen=True)
class Judged:
    """One label's confidence beside the truth.

    Attributes:
        body: the body source, see confidence_mix.Family.
        has_mask: whether it was made with a mask.
        probability: that the label is good, as told.
        is_good: whether it is.
        corner_error: the mean distance of corners that was told to be expected.
        corner_part: what it is; both as parts of the diagonal.
    """

    body: str
    has_mask: bool
    probability: float
    is_good: bool
    corner_error: float
    corner_part: float


def area_under_curve(score: Array, is_good: NDArray[np.bool_]) -> float | None:
    """The probability that a good label's score is above a bad one's; ties count half.

    Example:
        >>> area_under_curve(np.array([0.9, 0.4, 0.4]), np.array([True, True, False]))
        0.75
    """
    good, bad = score[is_good], score[~is_good]
    if not len(good) or not len(bad):
        return None
    above = (good[:, None] > bad).mean() + (good[:, None] == bad).mean() / 2
    return float(above)


def calibration_error(
    probability: Array, is_good: NDArray[np.bool_], bad: float | None = None
) -> float | None:
    """The mean difference of told and true frequency over BINS bins of equal count.

    Args:
        probability: (N,).
        is_good: (N,).
        bad: the part of bad labels for which it is told: labels are weighted to that, and the
            probabilities are moved by the odds of that part to the labels' own. None: as they are.

    Example:
        >>> calibration_error(np.full(20, 0.5), np.arange(20) % 2 == 0)
        0.0
    """
    own = float(1 - is_good.mean()) if len(is_good) else 0.0
    if bad is None or not 0 < own < 1:
        weight = np.ones(len(is_good))
    else:
        weight = np.where(is_good, (1 - bad) / (1 - own), bad / own)
    if len(is_good) < BINS:
        return None
    order = np.argsort(probability, kind="stable")
    middles = np.cumsum(weight[order]) - weight[order] / 2
    bins = np.minimum((middles / weight.sum() * BINS).astype(int), BINS - 1)
    error = 0.0
    for k in range(BINS):
        ids = order[bins == k]
        if len(ids):
            told = np.average(probability[ids], weights=weight[ids])
            true = np.average(is_good[ids], weights=weight[ids])
            error += weight[ids].sum() / weight.sum() * abs(told - true)
    return float(error)


def error_by_chance(probability: Array) -> float | None:
    """The calibration error that a true probability (N,) would show by chance, on the mean.

    Example:
        >>> error_by_chance(np.ones(20))
        0.0
    """
    rng = np.random.default_rng(0)
    errors = [
        calibration_error(probability, rng.random(len(probability)) < probability)
        for _ in range(CHANCE_DRAWS)
    ]
    known = [error for error in errors if error is not None]
    return float(np.mean(known)) if known else None


def reliability_table(judged: Sequence[Judged]) -> Table:
    """Confidence against truth, by body source and with and without a mask."""
    groups: list[tuple[str, list[Judged]]] = [
        ("all, with mask", [one for one in judged if one.has_mask]),
        ("all, without mask", [one for one in judged if not one.has_mask]),
    ]
    for body in sorted({one.body for one in judged}):
        for has_mask in (True, False):
            group = [one for one in judged if (one.body, one.has_mask) == (body, has_mask)]
            groups.append((f"{body}, {'with' if has_mask else 'without'} mask", group))
    records = [{"labels": name, **_row(group)} for name, group in groups if group]
    notes = (
        "good: the cuboid is turned by less than 15 degrees from the trunk's truth. AUC: the"
        " probability that a good label has more confidence than a bad one.",
        "ECE: mean difference of told and true frequency over ten bins of equal count, labels"
        " weighted so that the part named of them are bad. By chance: what a true probability would"
        " show.",
        "corner error: as told and as it is, in % of the diagonal, medians.",
    )
    return table_from_records(
        "reliability",
        "Reliability of confidence",
        records,
        notes=notes,
        columns=("labels", *_row(())),
    )


def curve_table(judged: Sequence[Judged]) -> Table:
    """The reliability curve: told and true frequency, bin by bin, with and without a mask.

    There are BINS bins of equal count, or fewer, so that each has LEAST_IN_BIN labels at least, and
    none of a group that is smaller.
    """
    records: list[dict[str, Cell]] = []
    for has_mask in (True, False):
        group = [one for one in judged if one.has_mask == has_mask]
        told = np.array([one.probability for one in group])
        good = np.array([one.is_good for one in group])
        n_bins = min(BINS, len(group) // LEAST_IN_BIN)
        order = np.argsort(told, kind="stable")
        for k, ids in enumerate(np.array_split(order, n_bins) if n_bins else ()):
            records.append(
                {
                    "labels": "with mask" if has_mask else "without mask",
                    "bin": k + 1,
                    "n": len(ids),
                    "told": float(told[ids].mean()),
                    "true": float(good[ids].mean()),
                }
            )
    return table_from_records(
        "curve",
        "Reliability curve of confidence",
        records,
        notes=(
            "told: the confidence that the bin's labels state, on average; true: the part of them"
            " that is good. Bins of equal count, from the least confidence to the most, none of a"
            f" group of fewer than {LEAST_IN_BIN} labels.",
        ),
        columns=("labels", "bin", "n", "told", "true"),
    )


def _row(group: Sequence[Judged]) -> dict[str, Cell]:
    """The cells of the table for one group."""
    told = np.array([one.probability for one in group], dtype=np.float64)
    good = np.array([one.is_good for one in group], dtype=np.bool_)
    return {
        "n": len(group),
        "bad %": percent([not one.is_good for one in group]),
        "AUC": area_under_curve(told, good),
        **{f"ECE at {rate:.0%} bad": calibration_error(told, good, rate) for rate in BASE_RATES},
        "by chance": error_by_chance(told),
        "corner error told %": quantile([100 * one.corner_error for one in group], 0.5),
        "corner error %": quantile([100 * one.corner_part for one in group], 0.5),
    }

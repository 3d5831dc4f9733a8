"""Fit the coefficients of a label's confidence, and judge them on another mix of animals.

    python benchmarks/fit_confidence.py --n 2500 --judge 1000 --judge-from 2000 --fits 500 \
        --judge-fits 400

The coefficients are made with the mix "learned" of animal3dbox.evaluate.confidence_mix, its labels
weighted so that part BASE_RATE are bad of those with a mask and of those without; fits count as
they are. They go into animal3dbox/labels/assets/confidence.json. The table is of the mix "judged".
--draws FOLDER keeps and reuses the labels of both.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from animal3dbox.evaluate.confidence_mix import BAD_DEG, FAMILIES, FITTED, Family, outcomes
from animal3dbox.evaluate.reliability import Judged, reliability_table
from animal3dbox.evaluate.tables import shown
from animal3dbox.labels.confidence import (
    FEATURES,
    Coefficients,
    KindCoefficients,
    coefficients,
    confidence_of,
    features,
    kind_of,
)
from animal3dbox.labels.types import Quality

Array = NDArray[np.float64]
ASSET = Path(__file__).parents[1] / "animal3dbox" / "labels" / "assets" / "confidence.json"
BASE_RATE = 0.3
RIDGE = 4.0
"""Strength of the penalty on weights of standardised features."""
MASKED = "+mask"
KINDS = ("own", "own+mask", "rigid", "rigid+mask", "fit", "fit+mask")
RIGID = ("species", "dog")


class Draw(msgspec.Struct):
    """One label of a mix beside its truth; see evaluate.confidence_mix.Outcome."""

    body: str
    quality: Quality
    rotation_deg: float
    corner_part: float

    @property
    def is_rigid(self) -> bool:
        """See confidence_of."""
        return self.body in RIGID

    @property
    def has_template(self) -> bool:
        """See confidence_of."""
        return self.body != "alone"


def draws_of(family: Family, numbers: range, folder: Path | None) -> list[Draw]:
    """The labels of some animals of a mix, kept in a folder if there is one."""
    name = f"{family.name}-fit" if family in FITTED.values() else family.name
    kept = None if folder is None else folder / f"{name}-{numbers.start}-{numbers.stop}.json"
    if kept is not None and kept.exists():
        return msgspec.json.decode(kept.read_bytes(), type=list[Draw])
    draws = [
        Draw(one.body, one.label.quality, one.rotation_deg, one.corner_part)
        for one in outcomes(family, numbers)
    ]
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_bytes(msgspec.json.encode(draws))
    return draws


def coefficients_of(draws: Sequence[Draw], bad_part: float | None) -> KindCoefficients:
    """The coefficients of the labels of one kind.

    Args:
        draws: of the kind.
        bad_part: how many of its like are bad, so that they are weighted to BASE_RATE; None: they
            count as they are.

    """
    X = np.array([features(one.quality, has_template=one.has_template) for one in draws])
    good = np.array([one.rotation_deg < BAD_DEG for one in draws])
    weight = np.ones(len(draws))
    if bad_part is not None:
        weight = np.where(good, (1 - BASE_RATE) / (1 - bad_part), BASE_RATE / bad_part)
    middle, spread = X.mean(0), X.std(0)
    middle[0], spread = 0.0, np.where(spread > 1e-9, spread, np.inf)
    spread[0] = 1.0
    Z = (X - middle) / spread

    def loss(w: Array) -> tuple[float, Array]:
        score = Z @ w
        probability = 1 / (1 + np.exp(-score))
        value = (weight * (np.logaddexp(0, score) - good * score)).sum()
        slope = Z.T @ (weight * (probability - good))
        held = np.concatenate(([0.0], w[1:]))
        return float(value + RIDGE / 2 * (held @ held)), slope + RIDGE * held

    w = minimize(loss, np.zeros(Z.shape[1]), jac=True, method="BFGS").x
    log_error = np.log(np.maximum([one.corner_part for one in draws], 1e-4))
    ridge = RIDGE * np.diag([0.0] + [1.0] * (Z.shape[1] - 1))
    v = np.linalg.solve(Z.T @ (weight[:, None] * Z) + ridge, Z.T @ (weight * log_error))
    factor = np.average(np.exp(log_error - Z @ v), weights=weight)
    return KindCoefficients(
        weights=_plain(w, middle, spread),
        corner_weights=_plain(v, middle, spread),
        corner_factor=round(float(factor), 4),
        n=len(draws),
        bad=round(float(1 - good.mean()), 4),
    )


def _plain(w: Array, middle: Array, spread: Array) -> tuple[float, ...]:
    """Weights of features as they are, of those of standardised ones."""
    plain = w / spread
    plain[0] = w[0] - (w[1:] / spread[1:] * middle[1:]).sum()
    return tuple(round(float(value), 4) for value in plain)


def _bad_part(draws: Sequence[Draw], has_mask: bool) -> float:
    """The part of the labels with a mask, or of those without, that is bad."""
    group = [one for one in draws if (one.quality.mask_iou is not None) == has_mask]
    return float(np.mean([one.rotation_deg >= BAD_DEG for one in group]))


def axes_part(draws: Sequence[Draw]) -> float:
    """Part of the well fitting labels whose box is right: what is left is the axes' fault."""
    sure = [one for one in draws if (one.quality.rotation_sd_deg or 99.0) < 3]
    right = sum(one.rotation_deg < BAD_DEG for one in sure)
    return round((right + 1) / (len(sure) + 2), 4)  # Laplace's: a few labels make nothing certain


def main() -> None:
    """Fit, write, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, default=2500)
    parser.add_argument("--judge", type=int, default=1000)
    parser.add_argument("--fits", type=int, default=500)
    parser.add_argument("--judge-fits", type=int, default=400)
    parser.add_argument("--judge-from", type=int, default=2000)
    parser.add_argument("--draws", type=Path, default=None)
    options = parser.parse_args()
    torch.set_num_threads(1)
    learned = draws_of(FAMILIES["learned"], range(options.n), options.draws)
    fits = draws_of(FITTED["learned"], range(options.fits), options.draws)
    bad_parts = {has_mask: _bad_part(learned, has_mask) for has_mask in (True, False)}
    by_kind: dict[str, list[Draw]] = {kind: [] for kind in KINDS}
    for one in (*learned, *fits):
        by_kind[kind_of(one.quality, is_rigid=one.is_rigid)].append(one)
    made = Coefficients(
        command=(
            f"python benchmarks/fit_confidence.py --n {options.n} --judge {options.judge}"
            f" --judge-from {options.judge_from} --fits {options.fits}"
            f" --judge-fits {options.judge_fits}"
        ),
        mix=(
            f"learned, {len(learned)} labels, weighted to {BASE_RATE:.0%} bad; {len(fits)} fits as"
            " they are"
        ),
        features=FEATURES,
        kinds={
            kind: coefficients_of(
                draws, None if kind.startswith("fit") else bad_parts[kind.endswith(MASKED)]
            )
            for kind, draws in by_kind.items()
        },
        axes={
            "template": axes_part([one for one in learned if one.body == "own"]),
            "landmarks": axes_part([one for one in learned if one.body == "alone"]),
        },
    )
    ASSET.write_bytes(msgspec.json.format(msgspec.json.encode(made), indent=1) + b"\n")
    coefficients.cache_clear()  # the labels above were made with those before
    given = range(options.judge_from, options.judge_from + options.judge)
    fitted = range(options.judge_from, options.judge_from + options.judge_fits)
    print_table(draws_of(FAMILIES["judged"], given, options.draws))
    print_table(draws_of(FITTED["judged"], fitted, options.draws))


def print_table(draws: Sequence[Draw]) -> None:
    """The reliability of the confidence that the coefficients give some labels."""
    judged = []
    for one in draws:
        told = confidence_of(one.quality, has_template=one.has_template, is_rigid=one.is_rigid)
        judged.append(_judged(one, told.probability, told.corner_error))
    table: Any = reliability_table(judged)
    print(table.title)
    for row in (table.columns, *table.rows):
        print("  ".join(f"{shown(cell):>16}" for cell in row))


def _judged(one: Draw, probability: float, corner_error: float | None) -> Judged:
    return Judged(
        body=one.body,
        has_mask=one.quality.mask_iou is not None,
        probability=probability,
        is_good=one.rotation_deg < BAD_DEG,
        corner_error=corner_error or 0.0,
        corner_part=one.corner_part,
    )


if __name__ == "__main__":
    main()

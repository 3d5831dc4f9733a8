"""Measures that inspections share."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.inspection.result import Residual

_T = TypeVar("_T")


def spread(items: Sequence[_T], most: int) -> list[_T]:
    """At most so many items, evenly taken from first to last."""
    if len(items) <= most:
        return list(items)
    return [items[i] for i in np.linspace(0, len(items) - 1, most).round().astype(int)]


def extent(points: NDArray[np.float64]) -> float:
    """The longer side of points' (N, 2) or (N, 3) bounding box."""
    return float(np.ptp(points, axis=0).max())


def residual(animals: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> Residual | None:
    """The distances of points (N, 2) from marks (N, 2), a pair an animal.

    None without any animal, or where a point is not finite.
    """
    distances, shares = [], []
    for points, marks in animals:
        off = np.linalg.norm(points - marks, axis=1)
        if not np.isfinite(off).all():
            return None
        distances.append(off)
        shares.append(100 * float(np.median(off)) / max(extent(marks), 1e-9))
    if not distances:
        return None
    every = np.concatenate(distances)
    return Residual(
        len(shares),
        _short(np.median(every)),
        _short(np.percentile(every, 95)),
        _short(np.median(shares)),
    )


def _short(value: float | np.floating) -> float:
    """To six digits: residuals are not known better."""
    return float(f"{float(value):.6g}")


def least_squares_scale(
    points: NDArray[np.float64], marks: NDArray[np.float64], shifted: bool
) -> tuple[float, NDArray[np.float64]]:
    """The scale and the shift (2,) with marks = scale points + shift as nearly as possible.

    Args:
        points: (N, 2).
        marks: (N, 2).
        shifted: whether there is a shift, or it is 0.

    """
    middle = points.mean(0) if shifted else np.zeros(2)
    target = marks.mean(0) if shifted else np.zeros(2)
    centred = points - middle
    scale = float(
        (centred * (marks - target)).sum() / max(float((centred * centred).sum()), 1e-300)
    )
    return scale, target - scale * middle

"""Measures that several inspections share: samples, extents, residuals, least squares."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.inspection.result import Residual

_T = TypeVar("_T")


def spread(items: Sequence[_T], most: int) -> list[_T]:
    """At most so many items of a sequence, evenly taken from the first to the last."""
    if len(items) <= most:
        return list(items)
    return [items[i] for i in np.linspace(0, len(items) - 1, most).round().astype(int)]


def extent(points: NDArray[np.float64]) -> float:
    """The longest side of the bounding box of points (N, 2) or (N, 3)."""
    return float(np.ptp(points, axis=0).max())


def residual(animals: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> Residual | None:
    """The distances of points (N, 2) from marked keypoints (N, 2), over pairs of one animal each.

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
        animals=len(shares),
        median_px=_short(np.median(every)),
        p95_px=_short(np.percentile(every, 95)),
        median_percent=_short(np.median(shares)),
    )


def _short(value: float | np.floating) -> float:
    """A residual to six digits, better than which it is not known."""
    return float(f"{float(value):.6g}")


def least_squares_scale(
    points: NDArray[np.float64], marks: NDArray[np.float64], shifted: bool
) -> tuple[float, NDArray[np.float64]]:
    """The scale and the shift (2,) that bring points nearest to marks, in the least squares.

    Args:
        points: (N, 2).
        marks: (N, 2).
        shifted: whether the shift is fitted, or 0.

    """
    # marks ≈ scale · points + shift
    middle = points.mean(0) if shifted else np.zeros(2)
    target = marks.mean(0) if shifted else np.zeros(2)
    centred = points - middle
    scale = float(
        (centred * (marks - target)).sum() / max(float((centred * centred).sum()), 1e-300)
    )
    return scale, target - scale * middle

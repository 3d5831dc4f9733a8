"""Edges as the rows of pixel centres meet them.

One formula for torch and NumPy, so that all that is drawn agrees.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic

from animal3dbox.geometry.arrays import AnyArray, clip, counting, namespace, repeated, take, whole

ROWS_AT_ONCE = 1 << 20
"""Crossings or pixels made at a time: what bounds the memory, at about 100 bytes each."""


@dataclass(frozen=True)
class Sides(Generic[AnyArray]):
    """Edges from the upper end, included, to the lower one, excluded.

    Attributes:
        first_row: (N,) int64, in the image.
        rows: (N,) int64, how many.
        first_u: (N,) where the edge meets its first row; means nothing if there is none.
        slope: (N,) how far it moves in a row; likewise.

    """

    first_row: AnyArray
    rows: AnyArray
    first_u: AnyArray
    slope: AnyArray

    def columns(self, side: AnyArray, down: AnyArray, width: int) -> AnyArray:
        """The first columns (N,), 0 ..

        Width, not left of these sides (N,) so many rows (N,) below their first.
        """
        u = take(self.first_u, side) + down * take(self.slope, side)
        columns: AnyArray = whole(clip(namespace(u).ceil(u), 0, width))
        return columns


def sides_between(
    u: AnyArray, v: AnyArray, upper: AnyArray, lower: AnyArray, height: int
) -> Sides[AnyArray]:
    """The edges between (N,) upper and (N,) lower ones of the points (P,).

    Of one without height, or above or below the image, no rows.
    """
    v_upper, v_lower, u_upper = take(v, upper), take(v, lower), take(u, upper)
    ceil = namespace(v).ceil
    first_v = clip(ceil(v_upper), 0, height)
    slope = (take(u, lower) - u_upper) / (v_lower - v_upper)
    rows = whole(clip(ceil(v_lower), 0, height) - first_v)
    return Sides(whole(first_v), rows, u_upper + (first_v - v_upper) * slope, slope)


def runs_at_once(counts: AnyArray, limit: int) -> Iterator[tuple[int, int]]:
    """Split a list of (N,) counts into runs [first, last) whose sums stay under the limit, or of
    one each."""
    total = counts.cumsum(0)
    if len(counts) == 0 or int(total[-1]) <= limit:
        yield 0, len(counts)
        return
    first, done = 0, 0
    while first < len(counts):
        last = max(int(namespace(total).searchsorted(total, done + limit, side="right")), first + 1)
        yield first, last
        first, done = last, int(total[last - 1])


def expand(counts: AnyArray) -> tuple[AnyArray, AnyArray]:
    """For (N,) counts.

    Which of the N each unit belongs to, and its number within, both (sum of counts,).
    """
    index = repeated(counting(counts, len(counts)), counts)
    return index, counting(counts, len(index)) - take(counts.cumsum(0) - counts, index)

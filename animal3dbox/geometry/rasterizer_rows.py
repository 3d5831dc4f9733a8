"""The places where edges cross the rows of pixel centres.

One formula for torch and NumPy, so that silhouettes and z-buffers agree.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic

from animal3dbox.geometry.arrays import AnyArray, clip, counting, namespace, repeated, take, whole

ROWS_AT_ONCE = 1 << 20
"""Crossings or pixels computed at a time, which bounds the memory at about 100 bytes each."""


@dataclass(frozen=True)
class Sides(Generic[AnyArray]):
    """Edges as rows of pixel centres cross them, from the upper end to the lower one, excluded.

    Attributes:
        first_row: (N,) int64, the first row of the image that each crosses.
        rows: (N,) int64, how many rows it crosses.
        first_u: (N,) where the edge meets its first row; means nothing if there is none.
        slope: (N,) how far it moves in a row, du / dv; likewise.

    """

    first_row: AnyArray
    rows: AnyArray
    first_u: AnyArray
    slope: AnyArray

    def columns(self, side: AnyArray, down: AnyArray, width: int) -> AnyArray:
        """The first columns that do not lie left of sides.

        Args:
            side: (N,) indices of the sides.
            down: (N,) rows below the first one of each.
            width: of the image.

        Returns:
            (N,) from 0 to width.

        """
        u = take(self.first_u, side) + down * take(self.slope, side)
        columns: AnyArray = whole(clip(namespace(u).ceil(u), 0, width))
        return columns


def sides_between(
    u: AnyArray, v: AnyArray, upper: AnyArray, lower: AnyArray, *, height: int
) -> Sides[AnyArray]:
    """The sides between points; one without height, or outside the image's rows, has no rows.

    Args:
        u: (P,) px of the points.
        v: (P,) px.
        upper: (N,) indices of the upper ends.
        lower: (N,) of the lower ends.
        height: of the image.

    """
    v_upper, v_lower, u_upper = take(v, upper), take(v, lower), take(u, upper)
    ceil = namespace(v).ceil
    first_v = clip(ceil(v_upper), 0, height)
    slope = (take(u, lower) - u_upper) / (v_lower - v_upper)
    rows = whole(clip(ceil(v_lower), 0, height) - first_v)
    return Sides(whole(first_v), rows, u_upper + (first_v - v_upper) * slope, slope)


def runs_at_once(counts: AnyArray, limit: int) -> Iterator[tuple[int, int]]:
    """Split (N,) counts into runs [first, last) whose sums stay under a limit.

    A count above the limit makes a run of its own.
    """
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
    """Owner of each unit of (N,) counts, and its number there: [2, 1] -> [0, 0, 1], [0, 1, 0].

    Returns:
        Which of the N each unit belongs to, and its number there from 0, both (sum of counts,).

    """
    index = repeated(counting(counts, len(counts)), counts)
    return index, counting(counts, len(index)) - take(counts.cumsum(0) - counts, index)

"""COCO's run-length masks: the lengths of runs of 0 and 1 in turn, down the columns.

They are lists of numbers, or compressed into text of six bits a character. The reading is our own,
so that one damaged mask is one error and spoils no other.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import Animal3DBoxError

MOST_GROUPS = 6
"""Groups of five bits of a number, 30 bits, of a mask without a fault."""


class RleError(Animal3DBoxError, ValueError):
    """A run-length mask that does not describe a mask of its size."""


def decode_counts(text: str) -> list[int]:
    """The run lengths that a compressed string stands for.

    Each number is written in groups of five bits, low ones first, as characters from "0" on; a
    sixth bit says that more follow, and the last group's highest bit is the sign. From the fourth
    on, a number is the difference to the one two places before.

    Raises:
        RleError: a character outside "0" to "o", or a number that does not end.

    """
    counts: list[int] = []
    value = shift = 0
    for character in text:
        group = ord(character) - 48
        if not 0 <= group < 64:
            raise RleError(f"has the character {character!r}, which no compressed mask has")
        value |= (group & 31) << shift
        shift += 5
        if shift > 60:
            raise RleError("has a number of more than 60 bits")
        if not group & 32:
            if group & 16:
                value -= 1 << shift
            counts.append(value + (counts[-2] if len(counts) > 2 else 0))
            value = shift = 0
    if shift:
        raise RleError("ends within a number: it was cut off")
    return counts


def ordinary_counts(text: str) -> NDArray[np.int64] | None:
    """decode_counts of a text without a fault, all numbers at once; None of any other.

    In a quarter of its time: of opening StanfordExtra that was a fifth
    (benchmarks/opening_lists.py, "stanfordextra").
    """
    characters = np.frombuffer(text.encode("utf-8", "surrogatepass"), dtype=np.uint8)
    groups = characters.astype(np.int64) - 48
    ends = np.flatnonzero(groups & 32 == 0)
    if not len(ends) or ends[-1] != len(groups) - 1 or groups.min() < 0 or groups.max() > 63:
        return None
    begins = np.append(0, ends[:-1] + 1)
    lengths = ends + 1 - begins
    if lengths.max() > MOST_GROUPS:
        return None
    shifts = 5 * (np.arange(len(groups)) - np.repeat(begins, lengths))
    counts = np.add.reduceat((groups & 31) << shifts, begins)
    counts -= np.where(groups[ends] & 16, 1 << (5 * lengths), 0)
    counts[1::2] = counts[1::2].cumsum()
    counts[2::2] = counts[2::2].cumsum()
    return counts


def encode_counts(counts: Sequence[int]) -> str:
    """The compressed string that stands for run lengths; the inverse of decode_counts."""
    text = []
    for i, count in enumerate(counts):
        value = count - counts[i - 2] if i > 2 else count
        more = True
        while more:
            group = value & 31
            value >>= 5
            more = value != (-1 if group & 16 else 0)
            text.append(chr(48 + (group | (32 if more else 0))))
    return "".join(text)


def decode_mask(counts: str | Sequence[int], image_hw: tuple[int, int]) -> NDArray[np.bool_]:
    """The mask (H, W) that run lengths describe, compressed or not.

    Raises:
        RleError: the runs do not fill the image exactly.

    """
    runs, (height, width) = _runs(counts, image_hw), image_hw
    values = np.arange(len(runs)) % 2 == 1
    return np.repeat(values, runs).reshape(width, height).T


def mask_area(counts: str | Sequence[int], image_hw: tuple[int, int]) -> int:
    """How many pixels of a mask are 1; raises as decode_mask, which it need not make for that.

    Example:
        >>> mask_area("231", (2, 3))
        3
    """
    return int(_runs(counts, image_hw)[1::2].sum())


def _runs(counts: str | Sequence[int], image_hw: tuple[int, int]) -> NDArray[np.int64]:
    """The run lengths of a mask, which fill its image exactly; raises RleError."""
    runs = ordinary_counts(counts) if isinstance(counts, str) else None
    area = image_hw[0] * image_hw[1]
    if runs is None or runs.min() < 0 or runs.max() > area or runs.sum() != area:
        return np.array(_checked_runs(counts, image_hw), dtype=np.int64)
    return runs


def _checked_runs(counts: str | Sequence[int], image_hw: tuple[int, int]) -> list[int]:
    """The run lengths of a mask; raises an RleError unless they fill the image exactly."""
    runs = decode_counts(counts) if isinstance(counts, str) else list(counts)
    height, width = image_hw
    if any(run < 0 for run in runs):
        raise RleError(f"has a run of {min(runs)} pixels: it is damaged")
    if sum(runs) != height * width:
        raise RleError(
            f"has runs of {sum(runs)} pixels in all, but the image has {height} x {width} ="
            f" {height * width}: it is another image's, or cut off"
        )
    return runs


def encode_mask(mask: NDArray[np.bool_]) -> str:
    """The compressed run lengths of a mask (H, W); the inverse of decode_mask."""
    flat = np.asarray(mask, dtype=bool).T.ravel()
    changes = np.flatnonzero(np.diff(flat)) + 1
    edges = np.concatenate(([0], changes, [flat.size]))
    runs = np.diff(edges).tolist()
    return encode_counts([0, *runs] if flat.size and flat[0] else runs)

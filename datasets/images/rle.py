"""COCO's run-length masks: the lengths of runs of 0 and 1 in turn, down the columns.

They are lists of numbers, or compressed into text of six bits a character. The reading is our own,
so that one damaged mask is one error and spoils no other.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from animal3dbox.errors import Animal3DBoxError


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
    runs = decode_counts(counts) if isinstance(counts, str) else list(counts)
    height, width = image_hw
    if any(run < 0 for run in runs):
        raise RleError(f"has a run of {min(runs)} pixels: it is damaged")
    if sum(runs) != height * width:
        raise RleError(
            f"has runs of {sum(runs)} pixels in all, but the image has {height} x {width} ="
            f" {height * width}: it is another image's, or cut off"
        )
    values = np.arange(len(runs)) % 2 == 1
    return np.repeat(values, runs).reshape(width, height).T


def encode_mask(mask: NDArray[np.bool_]) -> str:
    """The compressed run lengths of a mask (H, W); the inverse of decode_mask."""
    flat = np.asarray(mask, dtype=bool).T.ravel()
    changes = np.flatnonzero(np.diff(flat)) + 1
    edges = np.concatenate(([0], changes, [flat.size]))
    runs = np.diff(edges).tolist()
    return encode_counts([0, *runs] if flat.size and flat[0] else runs)

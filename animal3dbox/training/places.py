"""Places of faults in a batch: rows of packed arrays as targets and animals."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from animal3dbox.training.findings import Finding
from animal3dbox.training.packed import Packed

Flags = NDArray[np.bool_] | np.bool_
"""The types that NumPy gives the results of comparisons."""


def animal_findings(
    packed: Packed, wrong: Flags, *, check: str, field: str, problem: Callable[[int], str]
) -> Iterator[Finding]:
    """A finding for each animal (N,) that is wrong; problem describes the n-th."""
    for n in np.flatnonzero(wrong).tolist():
        target = int(packed.owner[n])
        yield Finding(check, packed.index[target], n - int(packed.first[target]), field, problem(n))


def image_findings(
    packed: Packed, wrong: Flags, *, check: str, field: str, problem: Callable[[int], str]
) -> Iterator[Finding]:
    """A finding for each target (B,) that is wrong; problem describes the b-th."""
    for b in np.flatnonzero(wrong).tolist():
        yield Finding(check, packed.index[b], None, field, problem(b))

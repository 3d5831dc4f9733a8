"""A cost near states of the fit: its value, its gradient and what stands for its curvature."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LocalFit:
    """The cost near states: cost + b . step + step . A step / 2.

    Attributes:
        cost: (B,); infinite where a state is not allowed.
        A: (B, P, P).
        b: (B, P).
    """

    cost: Array
    A: Array
    b: Array

    def __add__(self, other: "LocalFit") -> "LocalFit":
        return LocalFit(self.cost + other.cost, self.A + other.A, self.b + other.b)

    def replaced(self, ids: NDArray[np.intp], other: "LocalFit") -> "LocalFit":
        """This, that of some indices being the other."""
        cost, A, b = self.cost.copy(), self.A.copy(), self.b.copy()
        cost[ids], A[ids], b[ids] = other.cost, other.A, other.b
        return LocalFit(cost, A, b)

    def where(self, mask: NDArray[np.bool_], other: "LocalFit") -> "LocalFit":
        """This where a mask (B,) says so, else the other."""
        return LocalFit(
            np.where(mask, self.cost, other.cost),
            np.where(mask[:, None, None], self.A, other.A),
            np.where(mask[:, None], self.b, other.b),
        )

"""The places of a vocabulary's keypoints on a body, to read them off all at once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray


@dataclass(frozen=True)
class LandmarkPlaces:
    """The places of keypoints on a body, as weights of vertices.

    Attributes:
        ids: (N,) the vertices that some keypoint is read off.
        parts: (N, J) the weight of each in each keypoint; NaN for one that the body has no place
            for.
    """

    ids: np.ndarray
    parts: np.ndarray

    @classmethod
    def of(
        cls, places: Sequence[Sequence[int] | Tensor | None], n_vertices: int
    ) -> "LandmarkPlaces":
        """The places of J keypoints: vertex ids, whose mean it is, weights (V,), or None."""
        weights = np.zeros((len(places), n_vertices))
        for row, place in zip(weights, places, strict=True):
            if isinstance(place, Tensor):
                row[:] = place.numpy()
            elif place is not None:
                np.add.at(row, list(place), 1 / len(place))
        ids = np.flatnonzero(weights.any(0))
        if not len(ids):  # a row of no numbers could not be NaN
            ids = np.zeros(1, dtype=np.intp)
        weights = weights[:, ids]
        weights[[place is None for place in places]] = np.nan
        return cls(ids, np.ascontiguousarray(weights.T))

    def read(self, vertices: AnyArray) -> AnyArray:
        """The keypoints (..., J, 3) on bodies (..., V, 3)."""
        if isinstance(vertices, Tensor):
            parts = torch.from_numpy(self.parts).to(vertices)
            tensor: Tensor = parts.mT @ vertices[..., torch.from_numpy(self.ids), :]
            return tensor
        # Along memory: posed vertices lie there coordinate by coordinate
        points: np.ndarray = (vertices.mT.take(self.ids, -1) @ self.parts).mT
        return points

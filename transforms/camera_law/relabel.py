"""The names of left and right under a mirror.

The group {identity, mirror} acts on everything that is called left or right.

A mirrored picture shows the mirrored animal: its left flank is the image of the old right one. One
object holds whether a map mirrors, and acts alike on corners, faces, keypoints, box parameters and
points of the world.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import AnyArray, as_numpy, like, namespace
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.cuboid import MIRRORED_CORNERS, MIRRORED_FACES

# As arrays, by which NumPy picks entries in a fifth of the time that it takes for lists.
CORNER_ORDER, FACE_ORDER = np.array(MIRRORED_CORNERS), np.array(MIRRORED_FACES)


@dataclass(frozen=True)
class Relabelling:
    """The action of a map of pixels on names.

    Attributes:
        mirrored: (...,) bool tensor or array, whether the map mirrors; its batch dimensions lead
            those of every argument below.

    Example:
        >>> mirror = Relabelling(np.array(True))
        >>> mirror.faces(np.array([1, 2, 3, 4, 5, 6])).tolist()  # left and right change places
        [1, 2, 4, 3, 5, 6]
        >>> bool((mirror @ mirror).mirrored)
        False
    """

    mirrored: Any

    @property
    def _is_idle(self) -> bool:
        """Whether there is one map and it does not mirror, so that all names stay."""
        return self.mirrored.ndim == 0 and not bool(self.mirrored)

    def _pick(self, values: AnyArray, swapped: AnyArray) -> AnyArray:
        """The values of the maps that mirror under their new names; for maps that are not idle."""
        if self.mirrored.ndim == 0:
            return swapped
        mirrored = self.mirrored.reshape(
            *self.mirrored.shape, *[1] * (values.ndim - self.mirrored.ndim)
        )
        picked: AnyArray = namespace(values).where(mirrored, swapped, values)
        return picked

    def corners(self, values: AnyArray) -> AnyArray:
        """Per-corner values (..., 8, D) under their new names."""
        check_shape("values", values, "... 8 D")
        return values if self._is_idle else self._pick(values, values[..., CORNER_ORDER, :])

    def faces(self, values: AnyArray) -> AnyArray:
        """Per-face values (..., 6) under their new names: left and right change places."""
        check_shape("values", values, "... 6")
        return values if self._is_idle else self._pick(values, values[..., FACE_ORDER])

    def sides(self, values: AnyArray) -> AnyArray:
        """Sides of the animal (...,) under their new names: 1 left, 2 right change places, 0 stays.

        Example:
            >>> Relabelling(np.array(True)).sides(np.array([0, 1, 2])).tolist()
            [0, 2, 1]
        """
        if self._is_idle:
            return values
        exchanged: AnyArray = namespace(values).where(values > 0, 3 - values, values)
        return self._pick(values, exchanged)

    def keypoints(self, values: AnyArray, permutation: Tensor | np.ndarray) -> AnyArray:
        """Per-keypoint values (..., J, D) under their new names.

        Args:
            values: (..., J, D).
            permutation: (J,) for each keypoint its counterpart on the other side; an involution.

        """
        check_keypoint_mirror(permutation, values.shape[-2])
        return (
            values if self._is_idle else self._pick(values, values[..., as_numpy(permutation), :])
        )

    def box_axes(self, rotation: AnyArray) -> AnyArray:
        """Box axes (..., 3, 3), already turned by Q of det -1, as a rotation again.

        Left is negated.
        """
        check_shape("rotation", rotation, "... 3 3")
        if self._is_idle:
            return rotation
        return self._pick(rotation, rotation * like(rotation, [1.0, -1.0, 1.0]))

    def world_points(self, points: AnyArray) -> AnyArray:
        """Points (..., 3) fixed to the world, such as a mesh's vertices.

        S = diag(1, -1, 1) mirrors the world.
        """
        check_shape("points", points, "... 3")
        if self._is_idle:
            return points
        return self._pick(points, points * like(points, [1.0, -1.0, 1.0]))

    def __matmul__(self, before: "Relabelling") -> "Relabelling":
        """First before, then this one: two mirrors are none."""
        return Relabelling(self.mirrored ^ before.mirrored)


def check_keypoint_mirror(permutation: Tensor | np.ndarray, count: int) -> None:
    """Raise a ShapeError unless this is a permutation of the keypoints that is its own inverse."""
    counterparts = permutation.tolist()
    if sorted(counterparts) != list(range(count)):
        raise ShapeError(
            f"keypoint_mirror must be a permutation of 0 to {count - 1}, one entry a keypoint, got"
            f" {counterparts}"
        )
    if [counterparts[other] for other in counterparts] != list(range(count)):
        raise ShapeError(
            f"keypoint_mirror must swap keypoints in pairs (p[p[j]] = j), got {counterparts}"
        )

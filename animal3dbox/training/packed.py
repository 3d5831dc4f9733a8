"""The targets of a batch as a few NumPy arrays.

Each check is a handful of calls then, for all animals at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.arrays import norm
from animal3dbox.geometry.box_visibility import NEAR_PER_DIAGONAL
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import FACES, corners_of
from animal3dbox.training.checked_fields import Target

Floats = NDArray[np.float64]

DIAGONALS = np.array([[face[2], face[3], face[0], face[1]] for face in FACES.values()])
"""The corners of each face at which its two diagonals end, and at which they start, (6, 4)."""


@dataclass(frozen=True, kw_only=True)
class Packed:
    """The fields of targets that have the same fields, of N animals in B targets.

    Attributes:
        targets: the targets themselves.
        index: which of the batch they are.
        block: (N, F), all floats beside each other.
        floats: field -> (N, ...) float64, views of block.
        others: field -> (N, ...) flags and whole numbers.
        per_image: field -> (B, ...) float64.
        keypoints: (N, J, 3) float64, filled up with absent ones where targets have fewer; None if
            there are none.
        owner: (N,) which of targets an animal belongs to.
        first: (B,) the first animal of each target.
        image_hw: (B, 2) height and width; None if it is not known.
        step: number of the training step, by which costly checks take turns; None: all of them.
    """

    targets: Sequence[Target]
    index: Sequence[int]
    block: Floats
    floats: dict[str, Floats]
    others: dict[str, NDArray[Any]]
    per_image: dict[str, Floats]
    keypoints: Floats | None
    owner: NDArray[np.intp]
    first: NDArray[np.intp]
    image_hw: NDArray[np.intp] | None
    step: int | None

    @property
    def count(self) -> int:
        """The number of animals, N."""
        return len(self.owner)

    def in_turn(self, *, even: bool) -> range:
        """The animals whose pixels are read at this step, in even or odd steps.

        One of them in a training loop, all without the number of a step.
        """
        if self.step is None:
            return range(self.count)
        if self.count == 0 or ((self.step % 2 == 0) != even and self.step != 0):
            return range(0)
        n = self.step // 2 % self.count
        return range(n, n + 1)

    @cached_property
    def K(self) -> Floats | None:
        """Intrinsics of each animal's image, (N, 3, 3)."""
        return np.asarray(self.per_image["K"][self.owner]) if "K" in self.per_image else None

    @cached_property
    def far_corners(self) -> Floats | None:
        """Where the frame of each image ends, (B, 2): x, y = W - 0.5, H - 0.5."""
        return None if self.image_hw is None else np.asarray(self.image_hw[:, ::-1] - 0.5)

    @cached_property
    def frame(self) -> Floats | None:
        """Where the frame of each animal's image ends, (N, 2): x, y = W - 0.5, H - 0.5."""
        return None if self.far_corners is None else np.asarray(self.far_corners[self.owner])

    @cached_property
    def has_box(self) -> bool:
        """Whether center, rotation and size are all there."""
        return "center" in self.floats and "rotation" in self.floats and "size" in self.floats

    @cached_property
    def corners(self) -> Floats | None:
        """Corners (N, 8, 3) in the camera frame; None if nothing says where the boxes are."""
        if "corners_3d" in self.floats:
            return self.floats["corners_3d"]
        if not self.has_box:
            return None
        return corners_of(self.floats["center"], self.floats["rotation"], self.floats["size"])

    @cached_property
    def all_in_front(self) -> NDArray[np.bool_] | None:
        """Whether every corner of a box lies in front of the camera, (N,).

        As corner_in_front says; without it, by the depths of the corners.
        """
        if "corner_in_front" in self.others:
            return np.asarray(self.others["corner_in_front"].all(1))
        if self.corners is None:
            return None
        near = NEAR_PER_DIAGONAL * self.diagonal
        return np.asarray((self.corners[..., 2] > near[:, None]).all(1))

    @cached_property
    def projections(self) -> Floats | None:
        """The corners' pixels (N, 8, 2): corners_2d, else as K and its lens see the corners."""
        if "corners_2d" in self.floats:
            return self.floats["corners_2d"]
        if self.K is None or self.corners is None:
            return None
        return projected(self, self.K, self.corners)

    @cached_property
    def outline(self) -> tuple[Floats, Floats] | None:
        """The least and the greatest x, y of the projected corners, (N, 2) each."""
        px = self.projections
        return None if px is None else (px.min(1), px.max(1))

    @cached_property
    def quad_areas(self) -> Floats | None:
        """Areas (N, 6) of the faces between corners_2d, px^2.

        Half the cross product of the diagonals; right for boxes in front.
        """
        if "corners_2d" not in self.floats:
            return None
        ends = self.floats["corners_2d"][:, DIAGONALS]  # (N, 6, 4, 2)
        across = ends[:, :, :2] - ends[:, :, 2:]
        return np.asarray(
            0.5
            * np.abs(
                across[:, :, 0, 0] * across[:, :, 1, 1] - across[:, :, 0, 1] * across[:, :, 1, 0]
            )
        )

    @cached_property
    def reach(self) -> Floats:
        """Largest coordinate of each box, (N,): float32 rounds by a part of it.

        Without corners, at most that: of the centre, and the diagonal.
        """
        if "corners_3d" in self.floats:
            return np.asarray(np.abs(self.floats["corners_3d"]).max((1, 2)))
        return np.asarray(np.abs(self.floats["center"]).max(1) + self.diagonal)

    @cached_property
    def diagonal(self) -> Floats:
        """Diagonal of each box, (N,)."""
        if "size" in self.floats:
            return norm(self.floats["size"])
        return norm(self.floats["corners_3d"][:, 6] - self.floats["corners_3d"][:, 0])


def projected(packed: Packed, K: Floats, corners: Floats) -> Floats:
    """Corners (N, 8, 2) as cameras K (N, 3, 3) see them, through their lenses."""
    if not any("distortion" in target for target in packed.targets):
        return project(K, corners)[0]
    px = np.zeros((packed.count, 8, 2))
    for b, target in enumerate(packed.targets):
        rows = packed.owner == b
        lens = (
            np.asarray(target["distortion"], dtype=np.float64) if "distortion" in target else None
        )
        px[rows] = project(packed.per_image["K"][b], corners[rows], lens)[0]
    return px

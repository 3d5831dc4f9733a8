"""Oriented boxes with named faces.

The one place that fixes the order of corners, faces and edges; everything else imports it. A box's
own frame is x forward, y to ITS left, z up.

Example:
    >>> CORNER_SIGNS[6]  # forward, left, up
    (1, 1, 1)
    >>> FACE_NAMES
    ('front', 'back', 'left', 'right', 'top', 'bottom')
    >>> FACES["front"], FACE_NAMES[OPPOSITE_FACES[0]]
    ((1, 2, 6, 5), 'back')
    >>> EDGES[0], len(EDGES)
    ((0, 1), 12)
    >>> MIRRORED_CORNERS[0], FACE_NAMES[MIRRORED_FACES[2]]
    (3, 'right')
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import AnyArray, as_numpy, like
from animal3dbox.geometry.checks import check_finite, check_rotation, check_shape

CORNER_SIGNS = (
    (-1, -1, -1),
    (1, -1, -1),
    (1, 1, -1),
    (-1, 1, -1),
    (-1, -1, 1),
    (1, -1, 1),
    (1, 1, 1),
    (-1, 1, 1),
)
"""Signs of (x, y, z) of the eight corners: round the bottom, then round the top."""

FACES = {
    "front": (1, 2, 6, 5), "back": (0, 4, 7, 3),
    "left": (3, 7, 6, 2), "right": (0, 1, 5, 4),
    "top": (4, 5, 6, 7), "bottom": (0, 3, 2, 1),
}  # fmt: skip
"""Corners of the six faces, counter-clockwise seen from outside; the order of every (6,) field."""

FACE_NAMES = tuple(FACES)
"""The names of the six faces, in the order of every (6,) field."""
OPPOSITE_FACES = (1, 0, 3, 2, 5, 4)
"""For each face the index of the one on the other side of the box."""
EDGES = (
    *((0, 1), (1, 2), (2, 3), (3, 0)),
    *((4, 5), (5, 6), (6, 7), (7, 4)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
)
"""The twelve edges by their corners: round the bottom, round the top, then from bottom to top."""
MIRRORED_CORNERS = (3, 2, 1, 0, 7, 6, 5, 4)
"""The order of a mirrored box's corners: corners' = (Q corners)[MIRRORED_CORNERS], Q a mirror."""
MIRRORED_FACES = (0, 1, 3, 2, 4, 5)
"""The order of a mirrored box's faces: left and right change places."""


def corners_of(center: AnyArray, rotation: AnyArray, size: AnyArray) -> AnyArray:
    """The eight corners of boxes, in the frame of their centres (section 2.1.2, corners_world).

    corner_k = center + rotation (sign_k * size / 2), with sign_k of CORNER_SIGNS::

            7 -------- 6
           /|         /|        z (back up)
          4 -------- 5 |        |  y (its left)
          | 3 -------|- 2       | /
          |/         |/         |/
          0 -------- 1          +---- x (nose)

    Args:
        center: (..., 3).
        rotation: (..., 3, 3) columns forward, left, up.
        size: (..., 3) full length, width, height along these columns.

    Returns:
        (..., 8, 3), arrays or tensors as they came.

    Example:
        >>> import numpy as np
        >>> corners_of(np.zeros(3), np.eye(3), np.array([4.0, 2.0, 2.0]))[1].tolist()
        [2.0, -1.0, -1.0]
    """
    offsets = like(size, CORNER_SIGNS) * size[..., None, :] / 2
    corners: AnyArray = center[..., None, :] + offsets @ rotation.mT
    return corners


@dataclass(frozen=True)
class Cuboid:
    """An oriented box, or a batch of them, in some frame.

    Attributes:
        center: (..., 3) the centre of the box.
        rotation: (..., 3, 3) columns forward, left, up; det +1.
        size: (..., 3) full length, width, height along those columns.

    Raises:
        ShapeError: an attribute has the wrong shape, is not finite, is no rotation, or a size is
            negative.

    Example:
        >>> box = Cuboid(torch.zeros(3), torch.eye(3), torch.tensor([4.0, 2.0, 1.0]))
        >>> box.corners()[1].tolist()
        [2.0, -1.0, -0.5]
        >>> box.contains(torch.tensor([[1.9, 0, 0], [2.1, 0, 0]])).tolist()
        [True, False]
    """

    center: Tensor
    rotation: Tensor
    size: Tensor

    def __post_init__(self) -> None:
        check_shape("center", self.center, "... 3")
        check_shape("size", self.size, "... 3")
        check_finite("center", self.center)
        check_finite("size", self.size)
        check_rotation("rotation", self.rotation)
        if self.size.numel() and as_numpy(self.size).min() < 0:
            raise ShapeError(f"size must not be negative, got {self.size.tolist()}")

    @classmethod
    def from_arrays(
        cls,
        center: NDArray[np.floating],
        rotation: NDArray[np.floating],
        size: NDArray[np.floating],
    ) -> "Cuboid":
        """The box of NumPy arrays, in tensors of its own."""
        return cls(*(torch.from_numpy(part.copy()) for part in (center, rotation, size)))

    def __getitem__(self, index: int) -> "Cuboid":
        """One box of a batch, in memory of its own.

        Raises:
            TypeError: this is one box already.
            IndexError: the batch is shorter.

        """
        if self.center.ndim == 1:
            raise TypeError("this is one box, not a batch of them")
        box = object.__new__(Cuboid)  # without the checks, which the batch has passed
        for name in ("center", "rotation", "size"):
            batch = getattr(self, name)
            plain = batch.is_cpu and not batch.requires_grad
            one = torch.from_numpy(batch.numpy()[index].copy()) if plain else batch[index].clone()
            object.__setattr__(box, name, one)
        return box

    @property
    def diagonal(self) -> Tensor:
        """The length (...,) of the space diagonal, in the box's unit."""
        length: Tensor = torch.linalg.vector_norm(self.size, dim=-1)
        return length

    def corners(self) -> Tensor:
        """The eight corners (..., 8, 3) in CORNER_SIGNS' order, see corners_of."""
        return corners_of(self.center, self.rotation, self.size)

    def to_box(self, points: Tensor) -> Tensor:
        """Points (..., N, 3) of the box's surroundings in its own frame, about its centre."""
        check_shape("points", points, "... N 3")
        # rows: R^T (point - center)
        return (points - self.center[..., None, :]) @ self.rotation

    def contains(self, points: Tensor, tolerance: float = 0.0) -> Tensor:
        """Which points (..., N, 3) lie in the box or at most tolerance outside it, (..., N)."""
        return (self.to_box(points).abs() <= self.size[..., None, :] / 2 + tolerance).all(-1)

    def transformed(self, T: Tensor) -> "Cuboid":
        """The box in frame a, of the box in frame b and a rigid T_a_b (..., 4, 4)."""
        R, t = T[..., :3, :3], T[..., :3, 3]
        return Cuboid((R @ self.center[..., None])[..., 0] + t, R @ self.rotation, self.size)

    def scaled(self, factor: float) -> "Cuboid":
        """The box in a frame whose unit is 1 / factor of the old one."""
        if not factor > 0:
            raise ShapeError(f"factor must be positive, got {factor}")
        return Cuboid(self.center * factor, self.rotation, self.size * factor)

    def mirrored(self, Q: Tensor) -> "Cuboid":
        """The box of the mirrored animal: its left is the old right.

        Args:
            Q: (..., 3, 3) orthogonal with det -1, acting on the frame the box is in.

        Returns:
            The box whose corners are (Q corners)[MIRRORED_CORNERS].

        """
        check_shape("Q", Q, "... 3 3")
        if not bool((torch.linalg.det(Q) < 0).all()):
            raise ShapeError(
                "Q must have determinant -1 to mirror; a rotation goes through transformed"
            )
        flip_y = torch.diag(torch.tensor([1.0, -1.0, 1.0], dtype=Q.dtype, device=Q.device))
        return Cuboid((Q @ self.center[..., None])[..., 0], Q @ self.rotation @ flip_y, self.size)

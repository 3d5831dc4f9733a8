"""The box that eight corners span, and what other libraries' corner orders look like.

Several orders are in use. Read in the wrong one, most sets of corners are no box, and that is told;
but one that goes round in the same loops about OTHER axes, as Omni3D's does, is a box in our order
too, with its forward, left and up exchanged. Numbers cannot tell it: it must be known.
"""

from itertools import product

import torch
from torch import Tensor
from torch.nn.functional import normalize

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.checks import check_finite, check_shape
from animal3dbox.geometry.cuboid import CORNER_SIGNS, Cuboid, corners_of

LENGTHS = ((0, 1), (3, 2), (4, 5), (7, 6))
"""The four edges along x, from back to front."""
WIDTHS = ((0, 3), (1, 2), (4, 7), (5, 6))
"""The four edges along y, from right to left."""

OTHER_ORDERS = {
    "the Cartesian product of (-, +), x slowest": tuple(product((-1, 1), repeat=3)),
    "the Cartesian product of (-, +), x fastest": tuple(
        (x, y, z) for z, y, x in product((-1, 1), repeat=3)
    ),
    "KITTI's development kit": (
        *((1, 1, -1), (1, -1, -1), (-1, -1, -1), (-1, 1, -1)),
        *((1, 1, 1), (1, -1, 1), (-1, -1, 1), (-1, 1, 1)),
    ),
    "nuScenes' development kit": (
        *((1, 1, 1), (1, -1, 1), (1, -1, -1), (1, 1, -1)),
        *((-1, 1, 1), (-1, -1, 1), (-1, -1, -1), (-1, 1, -1)),
    ),
}
"""Orders in which corners are no box of ours: signs of (forward, left, up) as in CORNER_SIGNS."""


def corners_to_cuboid(corners: Tensor, *, tolerance: float = 1e-4) -> Cuboid:
    """The boxes whose corners these are, the inverse of `Cuboid.corners`; differentiable.

    The corners must be in our order (`CORNER_SIGNS`), which is PyTorch3D's for a box whose x is
    forward and z is up. Omni3D's order fits as well but means other axes: take
    `corners[..., [3, 2, 6, 7, 0, 1, 5, 4], :]` of it first.

    Args:
        corners: (..., 8, 3) in any right-handed frame and unit.
        tolerance: how far a corner may be off the box, as a share of the box's diagonal.

    Returns:
        The boxes (...,), in the frame and unit of the corners.

    Raises:
        ShapeError: the corners are no boxes, by how much, and in which known order they would be;
            or a box has no length or no width, so that its axes are not known.

    Example:
        >>> box = Cuboid(torch.zeros(3), torch.eye(3), torch.tensor([4.0, 2.0, 1.0]))
        >>> corners_to_cuboid(box.corners()).size.tolist()
        [4.0, 2.0, 1.0]
    """
    check_shape("corners", corners, "... 8 3")
    check_finite("corners", corners)
    _check_extent(corners)
    center, rotation, size = _spanned_box(corners)
    off = _share_off(corners, corners_of(center, rotation, size))
    if off > tolerance:
        raise ShapeError(
            f"corners must be boxes in the order of CORNER_SIGNS, but one is off by {off:.2g} of"
            f" its box's diagonal (tolerance {tolerance:g}){_advice(corners.detach(), tolerance)}"
        )
    return Cuboid(center, rotation, size)


def _check_extent(corners: Tensor) -> None:
    """Raise if corners (..., 8, 3) coincide along x or y, from which a box's axes are known."""
    for name, edges in (("length", LENGTHS), ("width", WIDTHS)):
        starts, ends = ([edge[k] for edge in edges] for k in (0, 1))
        if bool((corners[..., ends, :] == corners[..., starts, :]).flatten(-2).all(-1).any()):
            raise ShapeError(f"corners span a box without {name}, so that its axes are not known")


def _spanned_box(corners: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The center, rotation and size of boxes from the mean edges of corners (..., 8, 3).

    Forward is along the length, left square to it, up square to both.
    """
    length, width = (
        torch.stack([corners[..., end, :] - corners[..., start, :] for start, end in edges]).mean(0)
        for edges in (LENGTHS, WIDTHS)
    )
    height = corners[..., 4:, :].mean(-2) - corners[..., :4, :].mean(-2)
    forward = normalize(length, dim=-1)
    left = normalize(width - (width * forward).sum(-1, keepdim=True) * forward, dim=-1)
    up = torch.linalg.cross(forward, left)
    # A height that points down, as that of corners in a mirrored order, leaves a box of height 0
    size = [
        (edge * axis).sum(-1) for edge, axis in ((length, forward), (width, left), (height, up))
    ]
    rotation = torch.stack((forward, left, up), dim=-1)
    return corners.mean(-2), rotation, torch.stack(size, dim=-1).clamp_min(0)


def _share_off(corners: Tensor, built: Tensor) -> float:
    """How far corners (..., 8, 3) are off those built at most, per diagonal of their box."""
    if not corners.numel():
        return 0.0
    off = torch.linalg.vector_norm(built - corners, dim=-1).amax(-1)
    center = corners.mean(-2, keepdim=True)
    diagonal = 2 * torch.linalg.vector_norm(corners - center, dim=-1).amax(-1)
    return float((off / diagonal.clamp_min(torch.finfo(corners.dtype).tiny)).detach().amax())


def _advice(corners: Tensor, tolerance: float) -> str:
    """In which other orders corners (..., 8, 3) would be boxes, for the end of an error."""
    fitting = []
    for name, signs in OTHER_ORDERS.items():
        order = [signs.index(own) for own in CORNER_SIGNS]
        reordered = corners[..., order, :]
        if _share_off(reordered, corners_of(*_spanned_box(reordered))) <= tolerance:
            fitting.append(f"{name} (then pass corners[..., {order}, :])")
    return f": they are in the order of {', or of '.join(fitting)}" if fitting else ""

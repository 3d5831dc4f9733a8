"""Rigid transforms and rotations."""

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray, like, namespace
from animal3dbox.geometry.checks import check_shape

CROSS = (
    (0.0, 0, 0, 0, 0, -1, 0, 1, 0),
    (0.0, 0, 1, 0, 0, 0, -1, 0, 0),
    (0.0, -1, 0, 1, 0, 0, 0, 0, 0),
)
"""What each coordinate of v puts into the nine entries of v's cross-product matrix."""
TINY = 1e-30
"""Added to angles, radians, that something is divided by."""
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def rigid(R: Tensor, t: Tensor) -> Tensor:
    """The transform T_a_b of R_a_b and t_a_b.

    Args:
        R: (..., 3, 3).
        t: (..., 3).

    Returns:
        (..., 4, 4).

    """
    check_shape("R", R, "... 3 3")
    check_shape("t", t, "... 3")
    top = torch.cat((R, t[..., None]), dim=-1)
    bottom = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=R.dtype, device=R.device).expand(
        *top.shape[:-2], 1, 4
    )
    return torch.cat((top, bottom), dim=-2)


def invert_rigid(T: Tensor) -> Tensor:
    """T_b_a of a rigid T_a_b, (..., 4, 4)."""
    check_shape("T", T, "... 4 4")
    R_b_a = T[..., :3, :3].mT
    return rigid(R_b_a, -(R_b_a @ T[..., :3, 3:])[..., 0])


def transform_points(T: Tensor, points: Tensor) -> Tensor:
    """Points in frame a of points in frame b.

    Args:
        T: (..., 4, 4), T_a_b.
        points: (..., N, 3) in frame b.

    Returns:
        (..., N, 3) in frame a.

    """
    check_shape("T", T, "... 4 4")
    check_shape("points", points, "... N 3")
    return points @ T[..., :3, :3].mT + T[..., None, :3, 3]


def cross_matrix(vectors: AnyArray) -> AnyArray:
    """The matrices (..., 3, 3) whose product with p is the cross product v x p, for v (..., 3)."""
    matrices: AnyArray = (vectors @ like(vectors, CROSS)).reshape(*vectors.shape, 3)
    return matrices


def rotation_from_axis_angle(axis_angle: AnyArray) -> AnyArray:
    """Rotation matrices of axis-angle vectors (Rodrigues), differentiable at zero.

    Args:
        axis_angle: (..., 3) in radians.

    Returns:
        (..., 3, 3).

    """
    check_shape("axis_angle", axis_angle, "... 3")
    square = (axis_angle * axis_angle).sum(-1)[..., None, None]
    sine, cosine = _rodrigues_factors(square)
    skew = cross_matrix(axis_angle)
    R: AnyArray = like(axis_angle, IDENTITY) + sine * skew + cosine * (skew @ skew)
    return R


def _rodrigues_factors(square: AnyArray) -> tuple[AnyArray, AnyArray]:
    """sin(a) / a and (1 - cos(a)) / a^2 of squared angles a^2, of any shape."""
    if not isinstance(
        square, Tensor
    ):  # no derivatives to keep: the limits at zero come by themselves
        angle = np.sqrt(square) + TINY
        half = np.sin(angle / 2) / angle
        return np.sin(angle) / angle, 2 * half * half
    small = square < 1e-8
    safe = torch.where(small, 1.0, square)
    angle = torch.sqrt(safe)
    return torch.where(small, 1 - square / 6, torch.sin(angle) / angle), torch.where(
        small, 0.5 - square / 24, (1 - torch.cos(angle)) / safe
    )


def axis_angle_from_rotation(R: Tensor) -> Tensor:
    """The axis-angle vector of a rotation, up to pi long; the inverse of rotation_from_axis_angle.

    By the quaternion's largest entry, so that it keeps its digits near 0 and near pi.

    Args:
        R: (..., 3, 3).

    Returns:
        (..., 3) in radians.

    """
    check_shape("R", R, "... 3 3")
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (row.unbind(-1) for row in R.unbind(-2))
    rows = (
        (1 + xx + yy + zz, zy - yz, xz - zx, yx - xy), (zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx),
        (xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy), (yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz),
    )  # fmt: skip
    outer = torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)  # 4 q q^T
    best = outer.diagonal(dim1=-2, dim2=-1).argmax(-1)
    q = torch.nn.functional.normalize(
        outer.gather(-2, best[..., None, None].expand(*best.shape, 1, 4))[..., 0, :], dim=-1
    )
    q = torch.where(q[..., :1] < 0, -q, q)
    sine = torch.linalg.vector_norm(q[..., 1:], dim=-1, keepdim=True)
    factor = torch.where(
        sine > 0, 2 * torch.atan2(sine, q[..., :1]) / torch.where(sine > 0, sine, 1.0), 2.0
    )
    return factor * q[..., 1:]


def rotation_angle(R_a: Tensor, R_b: Tensor) -> Tensor:
    """The angle between rotations, from sine and cosine, so that it is exact near 0 and near pi (section 3.1, theta_R).

    The paper computes the same angle by arccos of a trace, which cannot tell 0 from about
    1e-8 rad in float64 or 0.003 degrees in float32.

    Args:
        R_a: (..., 3, 3).
        R_b: (..., 3, 3).

    Returns:
        (...,) in radians, 0 to pi.

    """
    D = R_a @ R_b.mT
    axis = torch.stack(
        (D[..., 2, 1] - D[..., 1, 2], D[..., 0, 2] - D[..., 2, 0], D[..., 1, 0] - D[..., 0, 1]),
        dim=-1,
    )
    return torch.atan2(axis.norm(dim=-1), D.diagonal(dim1=-2, dim2=-1).sum(-1) - 1)


def alignment_variation(ideal: Tensor, actual: Tensor) -> Tensor:
    """How far a direction strays from where it should point.

    1 - cos of the angle between them (section 3.1, delta_a).

    Args:
        ideal: (..., 3), any length but zero.
        actual: (..., 3), likewise.

    Returns:
        (...,) from 0 to 2; half the squared distance of the unit vectors, which keeps its digits
        near 0.

    """
    apart = torch.nn.functional.normalize(ideal, dim=-1) - torch.nn.functional.normalize(
        actual, dim=-1
    )
    return 0.5 * (apart * apart).sum(-1)


def nearest_rotation(M: AnyArray) -> AnyArray:
    """The rotation nearest to a matrix in the Frobenius norm, det +1 (orthogonal Procrustes).

    Args:
        M: (..., 3, 3).

    Returns:
        (..., 3, 3).

    """
    xp = namespace(M)
    U, _, Vt = xp.linalg.svd(M)
    turned: AnyArray = U @ Vt
    sign = xp.linalg.det(turned)
    if not isinstance(M, Tensor):
        if (sign > 0).all():
            return turned
        sign = np.where(sign < 0, -1.0, 1.0)  # exactly, so that no matrix depends on the others
    R: AnyArray = xp.concatenate((U[..., :2], U[..., 2:] * sign[..., None, None]), -1) @ Vt
    return R

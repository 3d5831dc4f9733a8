"""Rigid transforms T_a_b (points_a = T_a_b points_b), and rotations as matrices and vectors."""

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from animal3dbox.geometry.arrays import AnyArray, like, namespace
from animal3dbox.geometry.checks import check_shape

CROSS = (
    (0.0, 0, 0, 0, 0, -1, 0, 1, 0),
    (0.0, 0, 1, 0, 0, 0, -1, 0, 0),
    (0.0, -1, 0, 1, 0, 0, 0, 0, 0),
)
"""What the coordinates of v put into the nine entries of v's cross-product matrix, row by row."""
TINY = 1e-30
"""Added to angles, radians, that something is divided by."""
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def rigid(R: Tensor, t: Tensor) -> Tensor:
    """The rigid transform T_a_b of a rotation R_a_b and a translation t_a_b.

    Args:
        R: (..., 3, 3).
        t: (..., 3).

    Returns:
        (..., 4, 4).

    Example:
        >>> rigid(torch.eye(3), torch.tensor([1.0, 2.0, 3.0]))[:, 3].tolist()
        [1.0, 2.0, 3.0, 1.0]
    """
    check_shape("R", R, "... 3 3")
    check_shape("t", t, "... 3")
    top = torch.cat((R, t[..., None]), dim=-1)
    bottom = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=R.dtype, device=R.device).expand(
        *top.shape[:-2], 1, 4
    )
    return torch.cat((top, bottom), dim=-2)


def invert_rigid(T: Tensor) -> Tensor:
    """The inverse T_b_a of a rigid transform T_a_b, (..., 4, 4).

    Example:
        >>> invert_rigid(rigid(torch.eye(3), torch.tensor([1.0, 2.0, 3.0])))[:3, 3].tolist()
        [-1.0, -2.0, -3.0]
    """
    check_shape("T", T, "... 4 4")
    # T^-1 = [R^T | -R^T t]
    R_b_a = T[..., :3, :3].mT
    return rigid(R_b_a, -(R_b_a @ T[..., :3, 3:])[..., 0])


def transform_points(T: Tensor, points: Tensor) -> Tensor:
    """Transform points from frame b to frame a.

    Args:
        T: (..., 4, 4), T_a_b.
        points: (..., N, 3) in frame b.

    Returns:
        (..., N, 3) in frame a.

    Example:
        >>> T_a_b = rigid(torch.eye(3), torch.tensor([1.0, 2.0, 3.0]))
        >>> transform_points(T_a_b, torch.tensor([[0.0, 0.0, 1.0]])).tolist()
        [[1.0, 2.0, 4.0]]
    """
    check_shape("T", T, "... 4 4")
    check_shape("points", points, "... N 3")
    return points @ T[..., :3, :3].mT + T[..., None, :3, 3]


def cross_matrix(vectors: AnyArray) -> AnyArray:
    """The matrices (..., 3, 3) whose product with p is the cross product v x p, for v (..., 3)."""
    matrices: AnyArray = (vectors @ like(vectors, CROSS)).reshape(*vectors.shape, 3)
    return matrices


def rotation_from_axis_angle(axis_angle: AnyArray) -> AnyArray:
    """The rotation matrices of axis-angle vectors (Rodrigues), differentiable at zero.

    R = I + sin(a) / a [v]x + (1 - cos(a)) / a^2 [v]x^2, with a the length of v.

    Args:
        axis_angle: (..., 3) in radians, arrays or tensors.

    Returns:
        (..., 3, 3).

    Example:
        >>> quarter_turn_about_z = torch.tensor([0.0, 0.0, torch.pi / 2])
        >>> rotation_from_axis_angle(quarter_turn_about_z).round().int().tolist()
        [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    """
    check_shape("axis_angle", axis_angle, "... 3")
    square = (axis_angle * axis_angle).sum(-1)[..., None, None]
    sine, cosine = _rodrigues_factors(square)
    skew = cross_matrix(axis_angle)
    R: AnyArray = like(axis_angle, IDENTITY) + sine * skew + cosine * (skew @ skew)
    return R


def _rodrigues_factors(square: AnyArray) -> tuple[AnyArray, AnyArray]:
    """The factors sin(a) / a and (1 - cos(a)) / a^2 of squared angles a^2, of any shape."""
    if not isinstance(square, Tensor):
        angle = np.sqrt(square) + TINY  # without derivatives the limits at zero come by themselves
        half = np.sin(angle / 2) / angle
        return np.sin(angle) / angle, 2 * half * half
    small = square < 1e-8
    safe = torch.where(small, 1.0, square)
    angle = torch.sqrt(safe)
    # Near zero the first terms of the series, whose derivatives exist there
    sine = torch.where(small, 1 - square / 6, torch.sin(angle) / angle)
    return sine, torch.where(small, 0.5 - square / 24, (1 - torch.cos(angle)) / safe)


def axis_angle_from_rotation(R: Tensor) -> Tensor:
    """The axis-angle vector of a rotation, up to pi long; the inverse of rotation_from_axis_angle.

    It goes by the quaternion's largest entry, so that it keeps its digits near 0 and near pi.

    Args:
        R: (..., 3, 3).

    Returns:
        (..., 3) in radians.

    Example:
        >>> quarter_turn_about_z = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        >>> [round(x, 4) for x in axis_angle_from_rotation(quarter_turn_about_z).tolist()]
        [0.0, 0.0, 1.5708]
    """
    check_shape("R", R, "... 3 3")
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (row.unbind(-1) for row in R.unbind(-2))
    rows = (
        (1 + xx + yy + zz, zy - yz, xz - zx, yx - xy),
        (zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx),
        (xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy),
        (yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz),
    )
    # 4 q q^T of the quaternion q = (cos(a / 2), sin(a / 2) axis)
    outer = torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
    best = outer.diagonal(dim1=-2, dim2=-1).argmax(-1)
    q = outer.gather(-2, best[..., None, None].expand(*best.shape, 1, 4))[..., 0, :]
    q = normalize(q, dim=-1)
    q = torch.where(q[..., :1] < 0, -q, q)
    sine = torch.linalg.vector_norm(q[..., 1:], dim=-1, keepdim=True)
    # v = a axis, with axis = q[1:] / sin(a / 2); at a = 0 the factor's limit is 2
    angle = 2 * torch.atan2(sine, q[..., :1])
    factor = torch.where(sine > 0, angle / torch.where(sine > 0, sine, 1.0), 2.0)
    return factor * q[..., 1:]


def rotation_angle(R_a: Tensor, R_b: Tensor) -> Tensor:
    """The angle between two rotations (section 3.1, theta_R).

    From sine and cosine, so that it is exact near 0 and near pi. The paper computes the same angle
    by arccos of a trace, which cannot tell 0 from about 1e-8 rad in float64 or 0.003 degrees in
    float32.

    Args:
        R_a: (..., 3, 3).
        R_b: (..., 3, 3).

    Returns:
        (...,) in radians, 0 to pi.

    Example:
        >>> quarter_turn_about_z = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        >>> round(float(rotation_angle(quarter_turn_about_z, torch.eye(3))), 4)
        1.5708
    """
    D = R_a @ R_b.mT
    axis = torch.stack(
        (D[..., 2, 1] - D[..., 1, 2], D[..., 0, 2] - D[..., 2, 0], D[..., 1, 0] - D[..., 0, 1]),
        dim=-1,
    )
    # The axis' length is 2 sin(a), the trace 1 + 2 cos(a)
    return torch.atan2(axis.norm(dim=-1), D.diagonal(dim1=-2, dim2=-1).sum(-1) - 1)


def alignment_variation(ideal: Tensor, actual: Tensor) -> Tensor:
    """How far a direction strays from the ideal one: 1 - cos of their angle (section 3.1, delta_a).

    Args:
        ideal: (..., 3), any length but zero.
        actual: (..., 3), likewise.

    Returns:
        (...,) from 0 to 2; half the squared distance of the unit vectors, which keeps its digits
        near 0.

    """
    apart = normalize(ideal, dim=-1) - normalize(actual, dim=-1)
    return 0.5 * (apart * apart).sum(-1)


def nearest_rotation(M: AnyArray) -> AnyArray:
    """The rotation nearest to a matrix in the Frobenius norm, det +1 (orthogonal Procrustes).

    Args:
        M: (..., 3, 3), arrays or tensors.

    Returns:
        (..., 3, 3).

    Example:
        >>> nearest_rotation(torch.diag(torch.tensor([2.0, 3.0, 4.0]))).round().tolist()
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    xp = namespace(M)
    U, _, Vt = xp.linalg.svd(M)
    orthogonal: AnyArray = U @ Vt
    sign = xp.linalg.det(orthogonal)
    if not isinstance(M, Tensor):
        if (sign > 0).all():
            return orthogonal
        sign = np.where(sign < 0, -1.0, 1.0)  # exactly, so that no matrix depends on the others
    R: AnyArray = xp.concatenate((U[..., :2], U[..., 2:] * sign[..., None, None]), -1) @ Vt
    return R

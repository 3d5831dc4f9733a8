"""Maps of pixels, and what they do to the camera that took the picture.

For any invertible H there is exactly one camera whose picture is the mapped picture: with H K = k
K' Q, K' upper triangular with a positive diagonal and K'[2, 2] = 1, and Q orthogonal, a point seen
at x through K [R | t] is seen at H x through K' [Q R | Q t]. det Q = sign det H: a mirrored picture
is the picture of the mirrored scene.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import AnyArray, at_least, cross, namespace, norm
from animal3dbox.geometry.checks import check_finite, check_shape


def apply_homography(H_out_in: AnyArray, points_px: AnyArray) -> AnyArray:
    """Map pixels by a homography.

    (u', v', w') = H (u, v, 1), and the new pixel is (u' / w', v' / w').

    Args:
        H_out_in: (..., 3, 3).
        points_px: (..., N, 2).

    Returns:
        (..., N, 2).

    Example:
        >>> import torch
        >>> half_the_size = torch.diag(torch.tensor([0.5, 0.5, 1.0]))
        >>> apply_homography(half_the_size, torch.tensor([[4.0, 6.0]])).tolist()
        [[2.0, 3.0]]
    """
    check_shape("H_out_in", H_out_in, "... 3 3")
    check_shape("points_px", points_px, "... N 2")
    mapped = points_px @ H_out_in[..., :2].mT + H_out_in[..., None, :, 2]
    points: AnyArray = mapped[..., :2] / mapped[..., 2:]
    return points


def oriented_homography(H_out_in: AnyArray, anchor_px: AnyArray) -> AnyArray:
    """The same map with its sign chosen so that w > 0 at the anchor (the object).

    Args:
        H_out_in: (..., 3, 3).
        anchor_px: (..., 2), a pixel of the object.

    Returns:
        (..., 3, 3), H or -H.

    Raises:
        ShapeError: the anchor is mapped to infinity.

    """
    w = (H_out_in[..., 2, :2] * anchor_px).sum(-1) + H_out_in[..., 2, 2]
    if bool((w == 0).any()):
        raise ShapeError(f"H_out_in maps the anchor {anchor_px.tolist()} to infinity")
    signed: AnyArray = H_out_in * namespace(w).sign(w)[..., None, None]
    return signed


def rq(A: AnyArray) -> tuple[AnyArray, AnyArray]:
    """The RQ decomposition A = U Q, by Gram-Schmidt from the last row up.

    U is upper triangular with a positive diagonal, and Q orthogonal.

    Args:
        A: (..., 3, 3), invertible.

    Returns:
        U: (..., 3, 3).
        Q: (..., 3, 3), det Q = sign det A.

    """
    check_shape("A", A, "... 3 3")
    if isinstance(A, np.ndarray) and A.ndim == 2:
        return _rq_of_one(A)
    xp = namespace(A)
    row_0, row_1, row_2 = A[..., 0, :], A[..., 1, :], A[..., 2, :]
    q_2 = row_2 / norm(row_2)[..., None]
    rest_1 = row_1 - (row_1 * q_2).sum(-1)[..., None] * q_2
    rest_1 = rest_1 - (rest_1 * q_2).sum(-1)[..., None] * q_2  # twice is enough for full precision
    q_1 = rest_1 / norm(rest_1)[..., None]
    normal = cross(q_1, q_2)
    q_0 = normal * xp.sign((row_0 * normal).sum(-1))[..., None]
    Q = xp.stack((q_0, q_1, q_2), -2)
    return xp.triu(A @ Q.mT), Q


def _rq_of_one(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The steps of rq in plain numbers, for one array (3, 3).

    A worker updates the camera twice a sample, which takes NumPy's small calls ten times as long
    (benchmarks/augment.py, all targets).
    """
    row_0, row_1, row_2 = A.tolist()
    q_2 = _scaled(row_2, 1 / math.sqrt(_dot(row_2, row_2)))
    rest_1 = _without(_without(row_1, q_2), q_2)
    q_1 = _scaled(rest_1, 1 / math.sqrt(_dot(rest_1, rest_1)))
    normal = _cross(q_1, q_2)
    q_0 = _scaled(normal, math.copysign(1, _dot(row_0, normal)))
    U = (
        (_dot(row_0, q_0), _dot(row_0, q_1), _dot(row_0, q_2)),
        (0, _dot(row_1, q_1), _dot(row_1, q_2)),
        (0, 0, _dot(row_2, q_2)),
    )
    return np.array(U, dtype=A.dtype), np.array((q_0, q_1, q_2), dtype=A.dtype)


Vector = Sequence[float]
"""Three plain numbers."""


def _dot(a: Vector, b: Vector) -> float:
    """The product a . b of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    """The cross product a x b of two vectors."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _scaled(a: Vector, factor: float) -> Vector:
    """A vector times a number."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def _without(a: Vector, unit: Vector) -> Vector:
    """The part of a vector that is at right angles to a unit vector."""
    along = _dot(a, unit)
    return (a[0] - along * unit[0], a[1] - along * unit[1], a[2] - along * unit[2])


def handedness(A: AnyArray) -> AnyArray:
    """The determinants (...,) of matrices (..., 3, 3) as triple products of their rows.

    Good enough for a sign, and without LAPACK.
    """
    if isinstance(A, np.ndarray) and A.ndim == 2:  # in plain numbers, like _rq_of_one
        row_0, row_1, row_2 = A.tolist()
        product: AnyArray = A.dtype.type(_dot(row_0, _cross(row_1, row_2)))
        return product
    triple: AnyArray = (A[..., 0, :] * cross(A[..., 1, :], A[..., 2, :])).sum(-1)
    return triple


@dataclass(frozen=True)
class CameraUpdate(Generic[AnyArray]):
    """The camera of a mapped picture, and how it is turned against the old one.

    Attributes:
        K: (..., 3, 3) the new intrinsics.
        Q: (..., 3, 3) orthogonal: points_cam' = Q points_cam; det -1 under a mirror.
        k: (...,) the scale in H K = k K' Q; depth maps update as depth' = w depth / k, w being the
            map's denominator.
        R: (..., 3, 3) the new R_cam_world, det +1; None if none was given.
        t: (..., 3) the new t_cam_world; None if none was given.

    Example:
        >>> import torch
        >>> flip = torch.tensor([[-1.0, 0, 9], [0, 1, 0], [0, 0, 1]])  # u' = 9 - u, 10 px wide
        >>> bool(update_camera(flip, torch.diag(torch.tensor([50.0, 50, 1]))).mirrored)
        True
    """

    K: AnyArray
    Q: AnyArray
    k: AnyArray
    R: AnyArray | None = None
    t: AnyArray | None = None

    @property
    def mirrored(self) -> AnyArray:
        """Whether left and right changed places, (...,) bool."""
        return handedness(self.Q) < 0


def update_camera(
    H_out_in: AnyArray, K: AnyArray, R: AnyArray | None = None, t: AnyArray | None = None
) -> CameraUpdate[AnyArray]:
    """The camera of the mapped image, exactly, for any invertible map of pixels.

    A mirror mirrors the world as well, by S = diag(1, -1, 1) fixed in world coordinates
    (points_world' = S points_world), so that R' = Q R S stays a rotation.

    Args:
        H_out_in: (..., 3, 3) with w > 0 at the object (see oriented_homography).
        K: (..., 3, 3) intrinsics of the image before.
        R: R_cam_world before, of a shape that multiplies with (..., 3, 3); (N, 3, 3) for one map
            and the worlds of N animals.
        t: t_cam_world before, likewise (..., 3).

    Returns:
        The new intrinsics, the turn of the camera frame, and the new R and t.

    Raises:
        ShapeError: H_out_in is singular, or not finite.

    Example:
        >>> import torch
        >>> half_the_size = torch.diag(torch.tensor([0.5, 0.5, 1.0]))
        >>> K = torch.tensor([[100.0, 0, 10], [0, 100, 5], [0, 0, 1]])
        >>> update_camera(half_the_size, K).K.tolist()
        [[50.0, 0.0, 5.0], [0.0, 50.0, 2.5], [0.0, 0.0, 1.0]]
    """
    check_shape("H_out_in", H_out_in, "... 3 3")
    check_shape("K", K, "... 3 3")
    check_finite("H_out_in", H_out_in)
    xp = namespace(H_out_in)
    HK = H_out_in @ K
    lengths = norm(HK)
    if bool((abs(handedness(HK / at_least(lengths, 1e-300)[..., None])) < 1e-14).any()):
        raise ShapeError(
            "H_out_in must be invertible, but its determinant is zero: it flattens the image"
        )
    U, Q = rq(HK)
    k = U[..., 2, 2]
    if R is not None:
        S = xp.ones_like(Q[..., 0, :])  # the diagonal of the world's mirror, if there is one
        S[..., 1] = xp.sign(handedness(Q))
        R = Q @ R * S[..., None, :]
    if t is not None:
        t = (Q @ t[..., None])[..., 0]
    return CameraUpdate(K=U / k[..., None, None], Q=Q, k=k, R=R, t=t)

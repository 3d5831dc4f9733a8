"""What a map of pixels does to the camera that took them.

For any invertible H there is exactly one camera whose picture is the mapped picture: with H K = k K' Q, K' upper
triangular with a positive diagonal and K'[2, 2] = 1, and Q orthogonal, a point seen at x through K [R | t] is seen at
H x through K' [Q R | Q t]. det Q = sign det H: a mirrored picture is the picture of the mirrored scene.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.checks import check_finite, check_shape


def apply_homography(H_out_in: Tensor, points_px: Tensor) -> Tensor:
    """Map pixels.

    Args:
        H_out_in: (..., 3, 3).
        points_px: (..., N, 2).

    Returns:
        (..., N, 2).

    """
    check_shape("H_out_in", H_out_in, "... 3 3")
    check_shape("points_px", points_px, "... N 2")
    mapped = points_px @ H_out_in[..., :2].mT + H_out_in[..., None, :, 2]
    return mapped[..., :2] / mapped[..., 2:]


def oriented_homography(H_out_in: Tensor, anchor_px: Tensor) -> Tensor:
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
    return H_out_in * torch.sign(w)[..., None, None]


def rq(A: Tensor) -> tuple[Tensor, Tensor]:
    """A = U Q with U upper triangular with positive diagonal and Q orthogonal, by Gram-Schmidt from the last row up.

    Args:
        A: (..., 3, 3), invertible.

    Returns:
        U: (..., 3, 3).
        Q: (..., 3, 3), det Q = sign det A.

    """
    check_shape("A", A, "... 3 3")
    row_0, row_1, row_2 = A.unbind(-2)
    q_2 = row_2 / row_2.norm(dim=-1, keepdim=True)
    rest_1 = row_1 - (row_1 * q_2).sum(-1, keepdim=True) * q_2
    rest_1 = rest_1 - (rest_1 * q_2).sum(-1, keepdim=True) * q_2  # twice is enough for full precision
    q_1 = rest_1 / rest_1.norm(dim=-1, keepdim=True)
    handed = torch.linalg.cross(q_1, q_2)
    q_0 = handed * torch.sign((row_0 * handed).sum(-1, keepdim=True))
    Q = torch.stack((q_0, q_1, q_2), dim=-2)
    return torch.triu(A @ Q.mT), Q


def handedness(A: Tensor) -> Tensor:
    """Determinants (...,) of matrices (..., 3, 3) as triple products of their rows: for what only asks for the sign, without LAPACK."""
    row_0, row_1, row_2 = A.unbind(-2)
    triple: Tensor = (row_0 * torch.linalg.cross(row_1, row_2)).sum(-1)
    return triple


@dataclass(frozen=True)
class CameraUpdate:
    """What a map of pixels did to a camera.

    Attributes:
        K: (..., 3, 3) the new intrinsics.
        Q: (..., 3, 3) orthogonal: points_cam' = Q points_cam; det -1 under a mirror.
        k: (...,) the scale in H K = k K' Q; depth maps update as depth' = w depth / k, w being the map's denominator.
        R: (..., 3, 3) the new R_cam_world, det +1; None if none was given.
        t: (..., 3) the new t_cam_world; None if none was given.
    """

    K: Tensor
    Q: Tensor
    k: Tensor
    R: Tensor | None = None
    t: Tensor | None = None

    @property
    def mirrored(self) -> Tensor:
        """Whether left and right changed places, (...,) bool."""
        return handedness(self.Q) < 0


def update_camera(H_out_in: Tensor, K: Tensor, R: Tensor | None = None, t: Tensor | None = None) -> CameraUpdate:
    """The camera of the mapped image, exactly, for any invertible map of pixels.

    A mirror mirrors the world as well, by S = diag(1, -1, 1) fixed in world coordinates (points_world' = S points_world), so
    that R' = Q R S stays a rotation.

    Args:
        H_out_in: (..., 3, 3) with w > 0 at the object (see oriented_homography).
        K: (..., 3, 3) intrinsics of the image before.
        R: R_cam_world before, of a shape that multiplies with (..., 3, 3); (N, 3, 3) for one map and the worlds of N animals.
        t: t_cam_world before, likewise (..., 3).

    Returns:
        The new intrinsics, the turn of the camera frame, and the new R and t.

    Raises:
        ShapeError: H_out_in is singular, or not finite.

    """
    check_shape("H_out_in", H_out_in, "... 3 3")
    check_shape("K", K, "... 3 3")
    check_finite("H_out_in", H_out_in)
    scale = H_out_in.abs().amax((-2, -1)).clamp_min(torch.finfo(H_out_in.dtype).tiny)
    if bool((handedness(H_out_in / scale[..., None, None]).abs() < 1e-14).any()):
        raise ShapeError("H_out_in must be invertible, but its determinant is zero: it flattens the image")
    U, Q = rq(H_out_in @ K)
    k = U[..., 2, 2]
    if R is not None:
        side = torch.ones_like(Q[..., 0, :])
        side[..., 1] = torch.sign(handedness(Q))
        R = Q @ R * side[..., None, :]
    return CameraUpdate(U / k[..., None, None], Q, k, R, None if t is None else (Q @ t[..., None])[..., 0])

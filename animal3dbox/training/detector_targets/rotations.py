"""Rotations as networks learn them: six numbers without jumps, and as an animal looks in its crop.

An animal that walks past a camera keeps its rotation in the camera's frame (egocentric), and shows
ever other sides; a crop of it shows the rotation against the line of sight (allocentric).
"""

import torch
from torch import Tensor
from torch.nn.functional import normalize

from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.rigid_transforms import cross_matrix


def rotation_to_6d(R: Tensor) -> Tensor:
    """The first two columns of rotations, forward and left, as six numbers.

    They are continuous in the rotation, as no three or four numbers are (Zhou et al., 2019).
    PyTorch3D and Cube R-CNN take the first two rows: rotation_to_6d(R.mT) is theirs.

    Args:
        R: (..., 3, 3).

    Returns:
        (..., 6): forward x, y, z, left x, y, z.

    Example:
        >>> rotation_to_6d(torch.eye(3)).tolist()
        [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    """
    check_shape("R", R, "... 3 3")
    return R[..., :2].mT.flatten(-2)


def rotation_from_6d(numbers: Tensor) -> Tensor:
    """The rotations of six numbers each, by Gram-Schmidt; the inverse of rotation_to_6d.

    x = a / |a|,  y = (b - (x . b) x) / |...|,  z = x × y.

    Args:
        numbers: (..., 6) a and b, any that are not parallel, as a network gives them.

    Returns:
        (..., 3, 3), det +1; differentiable.

    Example:
        >>> rotation_from_6d(torch.tensor([2.0, 0, 0, 5, 0.5, 0])).tolist()
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    check_shape("numbers", numbers, "... 6")
    a, b = numbers[..., :3], numbers[..., 3:]
    x = normalize(a, dim=-1)
    y = normalize(b - (x * b).sum(-1, keepdim=True) * x, dim=-1)
    return torch.stack((x, y, torch.linalg.cross(x, y)), dim=-1)


def ray_rotation(rays: Tensor) -> Tensor:
    """The smallest rotations (..., 3, 3) that turn the optical axis into rays (..., 3).

    With r the unit ray, v = z × r and c = r_z: I + [v]x + [v]x^2 / (1 + c). Rays must not point
    straight backward, where there is no smallest rotation.
    """
    check_shape("rays", rays, "... 3")
    r = normalize(rays, dim=-1)
    v = torch.stack((-r[..., 1], r[..., 0], torch.zeros_like(r[..., 0])), dim=-1)
    skew = cross_matrix(v)
    factor = 1 / (1 + r[..., 2]).clamp_min(torch.finfo(r.dtype).eps)
    identity = torch.eye(3, dtype=r.dtype, device=r.device)
    return identity + skew + factor[..., None, None] * (skew @ skew)


def allocentric_from_egocentric(R_cam_box: Tensor, rays: Tensor) -> Tensor:
    """Rotations of boxes against their lines of sight, of those in the camera frame.

    R_allocentric = R_ray^T R_cam_box, with R_ray the smallest rotation from the optical axis to the
    ray. Boxes that look alike in their crops have the same.

    Args:
        R_cam_box: (..., 3, 3).
        rays: (..., 3) towards the boxes' centres, any length, forward.

    Returns:
        (..., 3, 3).

    Example:
        >>> straight_ahead = torch.tensor([0.0, 0, 5])
        >>> allocentric_from_egocentric(torch.eye(3), straight_ahead).tolist()
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    check_shape("R_cam_box", R_cam_box, "... 3 3")
    return ray_rotation(rays).mT @ R_cam_box


def egocentric_from_allocentric(R_ray_box: Tensor, rays: Tensor) -> Tensor:
    """Rotations of boxes in the camera frame; the inverse of allocentric_from_egocentric.

    Args:
        R_ray_box: (..., 3, 3) against the lines of sight.
        rays: (..., 3) towards the boxes' centres, any length, forward.

    Returns:
        (..., 3, 3) R_cam_box.

    Example:
        >>> to_the_right = torch.tensor([1.0, 0, 1])
        >>> R_cam_box = egocentric_from_allocentric(torch.eye(3), to_the_right)
        >>> [round(x, 3) for x in R_cam_box[:, 2].tolist()]  # what pointed along the ray
        [0.707, 0.0, 0.707]
    """
    check_shape("R_ray_box", R_ray_box, "... 3 3")
    return ray_rotation(rays) @ R_ray_box

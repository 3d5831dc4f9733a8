"""The pinhole camera: x right, y down, z forward; pixel centres at whole numbers."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from animal3dbox.geometry.arrays import AnyArray, namespace
from animal3dbox.geometry.checks import check_image_hw, check_intrinsics, check_shape
from animal3dbox.geometry.distortion import distort
from animal3dbox.geometry.rigid_transforms import transform_points


def intrinsics(
    focal_px: float | tuple[float, float], image_hw: tuple[int, int], skew: float = 0.0
) -> Tensor:
    """Intrinsics with the principal point at the centre of the image.

    Args:
        focal_px: one focal length in pixels, or (fx, fy).
        image_hw: height and width; the centre is ((W - 1) / 2, (H - 1) / 2).
        skew: K[0, 1] in pixels.

    Returns:
        (3, 3) float64.

    """
    check_image_hw("image_hw", image_hw)
    fx, fy = focal_px if isinstance(focal_px, tuple) else (focal_px, focal_px)
    height, width = image_hw
    return torch.tensor(
        [[fx, skew, (width - 1) / 2], [0.0, fy, (height - 1) / 2], [0.0, 0.0, 1.0]],
        dtype=torch.float64,
    )


def project(
    K: AnyArray, points_cam: AnyArray, distortion: AnyArray | None = None
) -> tuple[AnyArray, AnyArray]:
    """Project points of the camera frame to pixels (section 2.2, P).

    Args:
        K: (..., 3, 3).
        points_cam: (..., N, 3).
        distortion: (4,), (5,), (8,) or (12,) coefficients of OpenCV's lens; None for a pinhole.

    Returns:
        points_px: (..., N, 2); meaningless where depth is not positive (finite all the same), see
            project_in_front.
        depth: (..., N) along the optical axis, positive in front of the camera.

    """
    depth = points_cam[..., 2]
    xp = namespace(depth)
    safe = xp.where(abs(depth) < 1e-12, xp.full_like(depth, 1e-12), depth)
    if distortion is None:
        return (points_cam @ K.mT)[..., :2] / safe[..., None], depth
    bent = distort(points_cam[..., :2] / safe[..., None], distortion)
    return bent @ K[..., :2, :2].mT + K[..., None, :2, 2], depth


def project_in_front(
    K: Tensor, points_cam: Tensor, near: float | Tensor = 0.0, distortion: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Project points of the camera frame to pixels.

    A point behind the camera never comes back as one that is seen.

    Args:
        K: (..., 3, 3).
        points_cam: (..., N, 3).
        near: a point counts as in front if its depth exceeds this; a number, or a tensor that
            broadcasts to (..., N).
        distortion: coefficients of OpenCV's lens, see project.

    Returns:
        points_px: (..., N, 2), exactly 0 where the point is not in front.
        in_front: (..., N) bool.

    """
    points_px, depth = project(K, points_cam, distortion)
    in_front = (depth > near) & torch.isfinite(points_px).all(-1)
    return torch.where(in_front[..., None], points_px, torch.zeros_like(points_px)), in_front


@dataclass(frozen=True)
class PinholeCamera:
    """A camera without lens distortion.

    Attributes:
        K: (3, 3) intrinsics in pixels of an image of image_hw; skew allowed.
        T_cam_world: (4, 4).
        image_hw: height and width.
    """

    K: Tensor
    T_cam_world: Tensor
    image_hw: tuple[int, int]

    def __post_init__(self) -> None:
        check_intrinsics("K", self.K)
        check_shape("T_cam_world", self.T_cam_world, "4 4")
        check_image_hw("image_hw", self.image_hw)

    @property
    def center_world(self) -> Tensor:
        """Where the camera stands, (3,) in world (section 2.3.1, C_pos)."""
        return -self.T_cam_world[:3, :3].mT @ self.T_cam_world[:3, 3]

    def project(self, points_world: Tensor) -> tuple[Tensor, Tensor]:
        """Project points to pixels.

        Args:
            points_world: (N, 3).

        Returns:
            points_px: (N, 2); meaningless where depth is not positive.
            depth: (N,) along the optical axis, positive in front of the camera.

        """
        check_shape("points_world", points_world, "N 3")
        return project(self.K, transform_points(self.T_cam_world, points_world))

    def resized(self, H_out_in: Tensor, image_hw: tuple[int, int]) -> "PinholeCamera":
        """The camera of the cropped and resized image.

        H_out_in only scales and shifts (any other map turns the camera: update_camera).
        """
        return replace(self, K=H_out_in @ self.K, image_hw=image_hw)


def look_at(eye: Tensor, target: Tensor, up: Tensor) -> Tensor:
    """T_cam_world of a camera at eye that looks at target with up pointing up in the image.

    Args:
        eye: (..., 3) in world.
        target: (..., 3) in world.
        up: (..., 3) in world, not along the line of sight.

    Returns:
        (..., 4, 4).

    """
    forward = torch.nn.functional.normalize(target - eye, dim=-1)
    right = torch.nn.functional.normalize(
        torch.linalg.cross(forward, up.expand_as(forward)), dim=-1
    )
    R = torch.stack((right, torch.linalg.cross(forward, right), forward), dim=-2)
    t = -(R @ eye[..., None])
    bottom = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=eye.dtype, device=eye.device).expand(
        *R.shape[:-2], 1, 4
    )
    return torch.cat((torch.cat((R, t), dim=-1), bottom), dim=-2)

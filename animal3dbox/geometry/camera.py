"""The pinhole camera: x right, y down, z forward; pixel centres lie at whole numbers."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn.functional import normalize

from animal3dbox.errors import ShapeError
from animal3dbox.geometry.arrays import AnyArray, as_numpy, namespace
from animal3dbox.geometry.checks import check_image_hw, check_intrinsics, check_shape
from animal3dbox.geometry.distortion import distort
from animal3dbox.geometry.frame import in_frame
from animal3dbox.geometry.rigid_transforms import rigid, transform_points

WEAK_FOCAL = 1e7
"""Focal length in px of a camera so far away that it stands for one that sees no depth."""


def intrinsics(
    focal_px: float | tuple[float, float], image_hw: tuple[int, int], skew: float = 0.0
) -> Tensor:
    """The intrinsics K of a camera whose principal point is the centre of the image.

    Args:
        focal_px: one focal length in pixels, or (fx, fy).
        image_hw: height and width; the centre is ((W - 1) / 2, (H - 1) / 2).
        skew: K[0, 1] in pixels.

    Returns:
        (3, 3) float64.

    Example:
        >>> intrinsics(500.0, (480, 640)).tolist()
        [[500.0, 0.0, 319.5], [0.0, 500.0, 239.5], [0.0, 0.0, 1.0]]
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

    u = (fx x + skew y) / z + cx, v = fy y / z + cy.

    Args:
        K: (..., 3, 3).
        points_cam: (..., N, 3).
        distortion: (4,), (5,), (8,) or (12,) coefficients of OpenCV's lens; None for a pinhole.

    Returns:
        points_px: (..., N, 2); meaningless where depth is not positive (finite all the same), see
            project_in_front.
        depth: (..., N) along the optical axis, positive in front of the camera.

    Raises:
        ShapeError: K and points_cam have other shapes, or are exchanged.

    Example:
        >>> K = intrinsics(100.0, (11, 21))
        >>> px, depth = project(K, torch.tensor([[0.4, -0.1, 2.0]], dtype=torch.float64))
        >>> px.tolist(), depth.tolist()
        ([[30.0, 0.0]], [2.0])
    """
    _check_camera_and_points(K, points_cam)
    depth = points_cam[..., 2]
    xp = namespace(depth)
    divisor = xp.where(abs(depth) < 1e-12, xp.full_like(depth, 1e-12), depth)[..., None]
    if distortion is None:
        return (points_cam @ K.mT)[..., :2] / divisor, depth
    bent = distort(points_cam[..., :2] / divisor, distortion)
    return bent @ K[..., :2, :2].mT + K[..., None, :2, 2], depth


def project_in_front(
    K: Tensor, points_cam: Tensor, near: float | Tensor = 0.0, distortion: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Project points of the camera frame to pixels, and say which of them a camera can see.

    Those behind the camera come back as pixel 0, 0 and False, never as pixels that look valid.

    Args:
        K: (..., 3, 3).
        points_cam: (..., N, 3).
        near: a point counts as in front if its depth exceeds this; a number, or a tensor that
            broadcasts to (..., N).
        distortion: coefficients of OpenCV's lens, see project.

    Returns:
        points_px: (..., N, 2), exactly 0 where the point is not in front.
        in_front: (..., N) bool.

    Raises:
        ShapeError: K and points_cam have other shapes, or are exchanged.

    Example:
        >>> K = intrinsics(100.0, (11, 21))
        >>> px, in_front = project_in_front(K, torch.tensor([[1.0, 0, 8], [1.0, 0, -8]]).double())
        >>> px.tolist(), in_front.tolist()
        ([[22.5, 5.0], [0.0, 0.0]], [True, False])
    """
    points_px, depth = project(K, points_cam, distortion)
    in_front = (depth > near) & torch.isfinite(points_px).all(-1)
    return torch.where(in_front[..., None], points_px, torch.zeros_like(points_px)), in_front


def _check_camera_and_points(K: AnyArray, points_cam: AnyArray) -> None:
    """Raise a ShapeError unless K (..., 3, 3) and points (..., N, 3) come in this order.

    Of three points the shapes do not tell: they are taken for a K if only they are one.
    """
    for name, value in (("K", K), ("points_cam", points_cam)):
        if not hasattr(value, "shape"):
            raise ShapeError(
                f"{name} must be a tensor or an array, got a {type(value).__name__}: make one of it"
                " with torch.tensor or numpy.array"
            )
    if K.shape[-2:] == (3, 3) and points_cam.shape[-1:] == (3,) and points_cam.ndim > 1:
        if points_cam.shape[-2] != 3 or _may_be_intrinsics(K) or not _may_be_intrinsics(points_cam):
            return
        problem = "what is given as points_cam is a camera's K"
    elif points_cam.shape[-2:] == (3, 3) and K.shape[-1:] == (3,):
        problem = f"got K of shape {tuple(K.shape)} and points_cam of {tuple(points_cam.shape)}"
    else:
        check_shape("K", K, "... 3 3")
        check_shape("points_cam", points_cam, "... N 3")
        return
    raise ShapeError(f"K and points_cam are exchanged, {problem}: K comes first, then the points")


def _may_be_intrinsics(matrices: AnyArray) -> bool:
    """Whether matrices (..., 3, 3) all have zeros below their diagonal, and 1 at its end."""
    below = as_numpy(matrices).reshape(-1, 9)[:, [3, 6, 7, 8]]
    return bool((below == (0, 0, 0, 1)).all())


@dataclass(frozen=True)
class PinholeCamera:
    """A camera without lens distortion: where it stands, and how it maps the world to pixels.

    Attributes:
        K: (3, 3) intrinsics in pixels of an image of image_hw; skew allowed.
        T_cam_world: (4, 4); see `rigid` for one of R and t.
        image_hw: height and width.

    Raises:
        ShapeError: an attribute has the wrong shape, or K is none.

    Example:
        >>> up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
        >>> T_cam_world = look_at(eye=-4 * up.roll(1), target=0 * up, up=up)
        >>> camera = PinholeCamera(intrinsics(100.0, (11, 21)), T_cam_world, (11, 21))
        >>> px, depth = camera.project(torch.tensor([[0.0, 0.0, 0.2]], dtype=torch.float64))
        >>> px.tolist(), depth.tolist()
        ([[10.0, 0.0]], [4.0])
    """

    K: Tensor
    T_cam_world: Tensor
    image_hw: tuple[int, int]

    def __post_init__(self) -> None:
        check_intrinsics("K", self.K)
        check_shape("T_cam_world", self.T_cam_world, "4 4")
        check_image_hw("image_hw", self.image_hw)

    @property
    def R_cam_world(self) -> Tensor:
        """The rotation (3, 3) from world to camera."""
        return self.T_cam_world[:3, :3]

    @property
    def t_cam_world(self) -> Tensor:
        """The translation (3,) from world to camera: the world's origin in the camera frame."""
        return self.T_cam_world[:3, 3]

    @property
    def center_world(self) -> Tensor:
        """The place (3,) in world where the camera stands (section 2.3.1, C_pos)."""
        # C = -R^T t
        return -self.R_cam_world.mT @ self.t_cam_world

    def project(self, points_world: Tensor) -> tuple[Tensor, Tensor]:
        """Project points of the world to pixels.

        Args:
            points_world: (N, 3).

        Returns:
            points_px: (N, 2); meaningless where depth is not positive.
            depth: (N,) along the optical axis, positive in front of the camera.

        """
        check_shape("points_world", points_world, "N 3")
        return project(self.K, transform_points(self.T_cam_world, points_world))

    def sees(self, points_world: Tensor) -> Tensor:
        """Which points (N, 3) in world lie in front of the camera and inside its frame, (N,)."""
        points_px, depth = self.project(points_world)
        return (depth > 0) & in_frame(points_px, self.image_hw)

    def resized(self, H_out_in: Tensor, image_hw: tuple[int, int]) -> "PinholeCamera":
        """The camera of the cropped and resized image.

        Args:
            H_out_in: (3, 3), only scales and shifts; any other map turns the camera as well, see
                update_camera.
            image_hw: of the new image.

        """
        return replace(self, K=H_out_in @ self.K, image_hw=image_hw)


def look_at(eye: Tensor, target: Tensor, up: Tensor) -> Tensor:
    """The T_cam_world of a camera at eye that looks at target, with up pointing up in the image.

    Args:
        eye: (..., 3) in world.
        target: (..., 3) in world.
        up: (..., 3) in world, not along the line of sight.

    Returns:
        (..., 4, 4).

    Example:
        >>> eye, target, up = torch.eye(3).neg().unbind()
        >>> T_cam_world = look_at(eye, target, -up)
        >>> [round(float(x), 3) for x in T_cam_world[:3, :3] @ eye + T_cam_world[:3, 3]]
        [0.0, 0.0, 0.0]
    """
    forward = normalize(target - eye, dim=-1)
    right = normalize(torch.linalg.cross(forward, up.expand_as(forward)), dim=-1)
    # The rows of R are the camera's axes in world: right, down, forward
    R = torch.stack((right, torch.linalg.cross(forward, right), forward), dim=-2)
    return rigid(R, -(R @ eye[..., None])[..., 0])

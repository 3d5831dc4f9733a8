"""Pictures that another camera at the same place would take.

The full family of maps that are exact and have no skew.
"""

import math

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.augmentations.affine import Range
from animal3dbox.transforms.augmentations.resizing import fitting
from animal3dbox.transforms.camera_law.maps import (
    Size,
    camera_rotation,
    center_of,
    check_size,
    inverse_map,
)
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import check_probability, check_range
from animal3dbox.transforms.steps import Keep, Step, Warp
from animal3dbox.transforms.transform import Transform


def required_K(context: DrawContext, name: str) -> np.ndarray:
    """The intrinsics by now, or a ConfigError saying that the transform needs them."""
    if context.K is None:
        raise ConfigError(f"{name} turns the camera, so the target needs its intrinsics K (3, 3)")
    return context.K


class RandomVirtualCamera(Transform):
    """Turn the camera on the spot, and zoom: H = K' R K^-1.

    The picture is the one that another camera at the same place would have taken, so everything
    stays exact. K: the focal lengths are scaled by the zoom. The camera frame is turned; no skew
    comes in.

    Args:
        yaw: range in degrees, to the right; a number x means [-x, x].
        pitch: range in degrees, up.
        roll: range in degrees, clockwise (the picture turns the other way).
        zoom: range of the factor of the focal length.
        p: probability.

    Example:
        >>> K = np.array([[90.0, 0, 39.5], [0, 90, 29.5], [0, 0, 1]])
        >>> turn = RandomVirtualCamera((3, 3), (0, 0), (0, 0), zoom=(2, 2))
        >>> image, target = turn(np.zeros((60, 80, 3), np.uint8), {"K": K})
        >>> (target["K"].round(6) + 0).tolist()
        [[180.0, 0.0, 39.5], [0.0, 180.0, 29.5], [0.0, 0.0, 1.0]]
    """

    geometric = True

    def __init__(
        self,
        yaw: Range = 5.0,
        pitch: Range = 5.0,
        roll: Range = 5.0,
        zoom: tuple[float, float] = (1.0, 1.0),
        *,
        p: float = 1.0,
    ) -> None:
        super().__init__(p)
        self.yaw, self.pitch, self.roll = (
            check_range(*named) for named in (("yaw", yaw), ("pitch", pitch), ("roll", roll))
        )
        for name, (low, high) in (("yaw", self.yaw), ("pitch", self.pitch)):
            if low <= -90 or high >= 90:
                raise ConfigError(
                    f"{name} must lie within (-90, 90) degrees: nothing of the picture would be"
                    f" left, got {(low, high)}"
                )
        self.zoom = check_range("zoom", zoom, about=None, least=1e-3)

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw the turn and the zoom of the camera."""
        K = required_K(context, type(self).__name__)
        R = camera_rotation(
            rng.uniform(*self.yaw), rng.uniform(*self.pitch), rng.uniform(*self.roll)
        )
        K_new = K.copy()
        K_new[:2, :2] *= math.exp(rng.uniform(math.log(self.zoom[0]), math.log(self.zoom[1])))
        return (Warp(K_new @ R @ inverse_map(K), context.image_hw),)


class PerspectiveCrop(Transform):
    """Look straight at one animal.

    The camera turns until the box's centre lies on the optical axis, and zooms to fill the picture.

    K: the principal point is the middle, fx = fy. What a crop leaves oblique is seen head-on, so
    the apparent shape no longer depends on where in the picture the animal stood.

    Args:
        size: (height, width) after, or one number for both.
        margin: range of the empty part of the picture on either side of the box, in [0, 1).
        jitter_deg: range by which the camera misses the centre, in yaw and pitch.
        min_visible: drop animals of which less than this part remains visible; the one looked at
            stays. None keeps all.

    With several animals one that lies in front of the camera is drawn; with none the picture is
    fitted into the size.

    Example:
        >>> cuboid = {"center": np.array([[1.0, 0.5, 6.0]]), "rotation": np.eye(3)[None]}
        >>> K = np.array([[90.0, 0, 39.5], [0, 90, 29.5], [0, 0, 1]])
        >>> target = {"K": K, **cuboid, "size": np.ones((1, 3))}
        >>> image, target = PerspectiveCrop(64)(np.zeros((60, 80, 3), np.uint8), target)
        >>> (target["center"].round(3) + 0).tolist()  # on the optical axis, as far away as before
        [[0.0, 0.0, 6.103]]
    """

    geometric = True

    def __init__(
        self,
        size: Size,
        margin: tuple[float, float] = (0.05, 0.2),
        jitter_deg: float = 0.0,
        min_visible: float | None = 0.1,
    ) -> None:
        super().__init__()
        self.size = check_size("size", size)
        self.margin = check_range("margin", margin, about=None, least=0)
        if self.margin[1] >= 1:
            raise ConfigError(f"margin must lie in [0, 1), got {margin!r}")
        self.jitter_deg = check_range("jitter_deg", jitter_deg)
        self.min_visible = (
            None if min_visible is None else check_probability("min_visible", min_visible)
        )

    def steps(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw an animal, the camera that looks at it, and say which animals stay."""
        K = required_K(context, type(self).__name__)
        # Everything is drawn before it is known whether there is an animal to look at, so that the
        # transforms behind this one draw the same in any case.
        choice, yaw, pitch, margin = (
            rng.random(),
            rng.uniform(*self.jitter_deg),
            rng.uniform(*self.jitter_deg),
            rng.uniform(*self.margin),
        )
        candidates = np.flatnonzero(context.in_front())
        if context.corners_cam is None or not len(candidates):
            return (Warp(fitting(context.image_hw, self.size), self.size),)
        row = int(candidates[int(choice * len(candidates))])
        corners = context.corners_cam[row]
        R = camera_rotation(yaw, pitch, 0) @ look_along(corners.mean(axis=0))
        K_new = focused(corners @ R.T, self.size, margin)
        warp = Warp(K_new @ R @ inverse_map(K), self.size)
        return (warp, *self._keep_visible(context.after(warp), row))

    def _keep_visible(self, context: DrawContext, subject: int) -> tuple[Keep, ...]:
        """The step that keeps the animal looked at, by its row, and all that are still visible."""
        parts = None if self.min_visible is None else context.parts_in_picture()
        if parts is None or self.min_visible is None:
            return ()
        indices = tuple(
            index
            for row, index in enumerate(context.alive)
            if row == subject or parts[row] >= self.min_visible
        )
        return (Keep(indices, self.min_visible),)


def look_along(direction: np.ndarray) -> np.ndarray:
    """The rotation R_new_old (3, 3) without roll that makes a direction the optical axis.

    Args:
        direction: (3,) in the camera frame, of any length > 0.
    """
    x, y, z = direction / np.linalg.norm(direction)
    return camera_rotation(
        math.degrees(math.atan2(x, z)), math.degrees(math.atan2(-y, math.hypot(x, z))), 0
    )


def focused(corners_cam: np.ndarray, size: tuple[int, int], margin: float) -> np.ndarray:
    """Intrinsics (3, 3), the principal point in the middle, under which a box fills a picture.

    Args:
        corners_cam: (8, 3) of the box, in front of the camera.
        size: (height, width) of the picture.
        margin: the part of half the picture that stays empty, in [0, 1).
    """
    spread = np.abs(corners_cam[:, :2] / corners_cam[:, 2:]).max(axis=0)
    focal = (1 - margin) * min(size[1] / 2 / spread[0], size[0] / 2 / spread[1])
    across, down = center_of(size)
    return np.array([[focal, 0, across], [0, focal, down], [0, 0, 1.0]])

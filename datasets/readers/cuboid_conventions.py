"""The meaning of a camera, a box, a corner and a pixel in each exchange format of cuboids.

Reading and writing use the same statement, a Convention.

Facts, and how sure they are: Omni3D's axes, corners and dimensions are those of its DATA.md and of
the code that trains on it. That code flips x to W - x and scales K with the image, so (0, 0) is the
image's corner there, as it is for COCO's 2D boxes; the K of the datasets that were gathered into it
were copied as each calibration gave them, so half a pixel is open: first_pixel is the one field to
replace. COCO's keypoints are pixel indices. KITTI's 2D boxes are "0-based indices", its P2 an
OpenCV calibration.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from animal3dbox.geometry.cuboid import CORNER_SIGNS

Floats = NDArray[np.float64]
"""An array of float64."""
Axes = tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]
"""Three axes as a matrix (3, 3), row by row."""

OPENCV: Axes = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
FORWARD_LEFT_UP: Axes = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
FORWARD_DOWN_LEFT: Axes = ((1, 0, 0), (0, 0, 1), (0, -1, 0))
"""Row by row; the columns are the format's box axes x, y, z in our forward, left, up."""

LOOP = CORNER_SIGNS
"""Corner signs (8, 3): round one side of the box, then round the opposite one.

They are ours, and Omni3D and PyTorch3D apply them to their own axes.
"""


@dataclass(frozen=True)
class Convention:
    """The meaning that one format gives to a cuboid in an image.

    Attributes:
        name: the format's name.
        camera_axes: (3, 3) R_format_cam, row by row; ours are x right, y down, z forward.
        box_axes: (3, 3) R_box_format, row by row: its columns are the format's own box axes in our
            forward, left, up.
        corner_signs: (8, 3) along the format's own box axes, in its order.
        dimensions: the numbers of the format's own box axes along which its first, second and third
            dimension lie.
        location: the point of the box that it gives, in half sizes along its own box axes from the
            centre.
        first_pixel: the coordinate of the top-left pixel's centre in K and in 2D boxes: 0.5 where
            (0, 0) is the image's corner.
        first_keypoint_pixel: the same coordinate for keypoints.
        unit: "metres", or "none" for a format of the image plane alone.
        yaw_only: whether its boxes stand on the ground plane, so that pitch and roll are lost.
        decimals: digits after the point in text files; None where numbers are written whole.
    """

    name: str
    camera_axes: Axes = OPENCV
    box_axes: Axes = FORWARD_LEFT_UP
    corner_signs: tuple[tuple[int, int, int], ...] = LOOP
    dimensions: tuple[int, int, int] = (0, 1, 2)
    location: tuple[float, float, float] = (0.0, 0.0, 0.0)
    first_pixel: float = 0.0
    first_keypoint_pixel: float = 0.0
    unit: Literal["metres", "none"] = "metres"
    yaw_only: bool = False
    decimals: int | None = None

    def K_out(self, K: Floats) -> Floats:
        """Our intrinsics (..., 3, 3) as the format writes them."""
        return self._shifted(K, self.first_pixel)

    def K_in(self, K: Floats) -> Floats:
        """The format's intrinsics (..., 3, 3) as ours."""
        return self._shifted(K, -self.first_pixel)

    @staticmethod
    def _shifted(K: Floats, pixels: float) -> Floats:
        """Intrinsics (..., 3, 3) whose principal point lies so many pixels further."""
        K_out = np.array(K, dtype=np.float64)
        K_out[..., :2, 2] += pixels * K_out[..., 2:, 2]  # cx, cy += pixels * K[2, 2]
        return K_out

    def boxes_2d_out(self, px: Floats) -> Floats:
        """Our pixel coordinates of 2D boxes, of any shape, as the format's."""
        return np.asarray(px, dtype=np.float64) + self.first_pixel

    def boxes_2d_in(self, px: Floats) -> Floats:
        """The format's pixel coordinates of 2D boxes, of any shape, as ours."""
        return np.asarray(px, dtype=np.float64) - self.first_pixel

    def keypoints_out(self, px: Floats) -> Floats:
        """Our pixel coordinates of keypoints, of any shape, as the format's."""
        return np.asarray(px, dtype=np.float64) + self.first_keypoint_pixel

    def boxes_out(
        self, center: Floats, rotation: Floats, size: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Our boxes in the format's frames and orders.

        Args:
            center: (..., 3) in our camera frame.
            rotation: (..., 3, 3) R_cam_box.
            size: (..., 3) length, width, height.

        Returns:
            location (..., 3), rotation (..., 3, 3) and dimensions (..., 3), the rotation's columns
            being the format's box axes.

        """
        R_format_cam, R_box_format = self._axes()
        rotation_out = R_format_cam @ rotation @ R_box_format
        size_out = size @ np.abs(R_box_format)
        offset = (rotation_out @ (size_out * self.location / 2)[..., None])[..., 0]
        location = center @ R_format_cam.T + offset
        return location, rotation_out, size_out[..., list(self.dimensions)]

    def boxes_in(
        self, location: Floats, rotation: Floats, dimensions: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """The format's boxes as our center, rotation and size; the inverse of boxes_out."""
        R_format_cam, R_box_format = self._axes()
        size_out = np.empty_like(np.asarray(dimensions, dtype=np.float64))
        size_out[..., list(self.dimensions)] = dimensions
        center = location - (rotation @ (size_out * self.location / 2)[..., None])[..., 0]
        return (
            center @ R_format_cam,
            R_format_cam.T @ rotation @ R_box_format.T,
            size_out @ np.abs(R_box_format).T,
        )

    def corners_out(self, center: Floats, rotation: Floats, size: Floats) -> Floats:
        """The corners (..., 8, 3) of our boxes in the format's order and camera axes."""
        R_format_cam, R_box_format = self._axes()
        half = (size @ np.abs(R_box_format))[..., None, :] / 2
        offsets = np.array(self.corner_signs) * half
        rotation_out = R_format_cam @ rotation @ R_box_format
        return (center @ R_format_cam.T)[..., None, :] + offsets @ rotation_out.swapaxes(-1, -2)

    def _axes(self) -> tuple[Floats, Floats]:
        """R_format_cam and R_box_format, (3, 3) each."""
        camera_axes = np.array(self.camera_axes, dtype=np.float64)
        return camera_axes, np.array(self.box_axes, dtype=np.float64)


OMNI3D = Convention("omni3d", box_axes=FORWARD_DOWN_LEFT, dimensions=(2, 1, 0), first_pixel=0.5)
"""Omni3D: dimensions [W, H, L] along its z, y, x; R_cam's columns are forward, down and left."""

COCO = Convention("coco", first_pixel=0.5, unit="none")
"""COCO: boxes count from the image's corner, keypoints are pixel indices.

The eight corners are keypoints in our own order.
"""

KITTI = Convention(
    "kitti",
    box_axes=FORWARD_DOWN_LEFT,
    dimensions=(1, 2, 0),
    location=(0.0, 1.0, 0.0),
    yaw_only=True,
    decimals=6,
)
"""KITTI: dimensions height, width, length; the location is the middle of the bottom.

A rotation_y of 0 faces along the camera's x.
"""

CONVENTIONS = {convention.name: convention for convention in (OMNI3D, COCO, KITTI)}
"""Every format of cuboids that is written, by name."""


def yaw_rotation(rotation_y: Floats) -> Floats:
    """The rotations (..., 3, 3) about the camera's y axis that KITTI's angles (...,) stand for.

    An angle of 0 faces along x, one of pi / 2 towards the camera (-z).
    """
    cosine, sine = np.cos(rotation_y), np.sin(rotation_y)
    zero, one = np.zeros_like(cosine), np.ones_like(cosine)
    rows = ((cosine, zero, sine), (zero, one, zero), (-sine, zero, cosine))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def yaw_of(rotation: Floats) -> Floats:
    """KITTI's rotation_y (...,), from -pi to pi, of rotations (..., 3, 3).

    Of an animal that looks straight up or down, the axis to its left decides.

    Args:
        rotation: with the format's columns: forward, down, left.

    """
    forward, left = rotation[..., :, 0], rotation[..., :, 2]
    level = np.hypot(forward[..., 0], forward[..., 2]) > np.hypot(left[..., 0], left[..., 2]) * 1e-3
    return np.where(
        level, np.arctan2(-forward[..., 2], forward[..., 0]), np.arctan2(left[..., 0], left[..., 2])
    )

"""Which faces of a box a camera sees, and how much of the picture each of them fills.

The visible faces of a convex box tile its silhouette, and so do the hidden ones: the area of the
silhouette is the sum over the hidden faces, which stays true when the box is cut by the near plane.
"""

from dataclasses import dataclass
from typing import Any, Generic

import numpy as np
import torch
from torch import Tensor

from animal3dbox.geometry.arrays import (
    AnyArray,
    as_type_of,
    at_least,
    clip,
    cross,
    namespace,
    norm,
    rows_at,
)
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.checks import check_image_hw, check_shape
from animal3dbox.geometry.cuboid import FACES, Cuboid
from animal3dbox.geometry.frame import in_frame
from animal3dbox.geometry.polygon import area_in_frame, clip_to_near, polygon_area

QUADS = np.array(list(FACES.values()))
"""The corners (6, 4) of the faces."""
NEAR_PER_DIAGONAL = 1e-2
"""The near plane stands at this fraction of the box diagonal: nearer things project to nowhere."""


@dataclass(frozen=True)
class FaceVisibility(Generic[AnyArray]):
    """The faces of boxes that a camera sees, and their areas; faces in FACES' order.

    Attributes:
        visible: (..., 6) bool, n . v > 0 of the paper; nothing is visible from inside the box.
        area: (..., 6) projected area in px^2, 0 for hidden faces, clipped at the near plane but not
            by the frame.
        share: (..., 6) area over its sum; all 0 if nothing is seen.
        share_in_image: (..., 6) the same of the areas clipped by the frame.
        truncation: (...,) 1 - (silhouette inside the frame) / silhouette; 0 if there is no
            silhouette.

    Example:
        >>> K = torch.tensor([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]])
        >>> ahead = Cuboid(torch.tensor([0.0, 0, 5]), torch.eye(3), torch.full((3,), 2.0))
        >>> face_visibility(ahead, K, (101, 101)).share.tolist()  # the bottom: box z is depth here
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    """

    visible: AnyArray
    area: AnyArray
    share: AnyArray
    share_in_image: AnyArray
    truncation: AnyArray


def face_normals(corners: AnyArray) -> AnyArray:
    """The outward unit normals of boxes' faces, from two edges' cross product (section 2.3.1, n).

    Args:
        corners: (..., 8, 3) in CORNER_SIGNS' order.

    Returns:
        (..., 6, 3); zero for a face without area.

    Example:
        >>> box = Cuboid(torch.zeros(3), torch.eye(3), torch.tensor([4.0, 2.0, 1.0]))
        >>> face_normals(box.corners())[0].tolist()  # the front
        [1.0, 0.0, 0.0]
    """
    check_shape("corners", corners, "... 8 3")
    normals = _outward(corners, rows_at(corners, QUADS))
    unit: AnyArray = normals / at_least(norm(normals), 1e-300)[..., None]
    return unit


def _outward(corners: AnyArray, quads: AnyArray) -> AnyArray:
    """The outward normals (..., 6, 3) of boxes' faces, as long as the faces are large.

    Args:
        corners: (..., 8, 3) of the boxes.
        quads: (..., 6, 4, 3) of their faces.

    """
    first = quads[..., 0, :]
    normals = cross(quads[..., 1, :] - first, quads[..., 3, :] - first)
    # Four times the way from the box's middle to the face's
    outward = quads.sum(-2) - corners.sum(-2)[..., None, :] / 2
    inwards = (normals * outward).sum(-1)[..., None] < 0
    oriented: AnyArray = normals * (1 - 2 * as_type_of(inwards, normals))
    return oriented


def visible_faces(corners: AnyArray, camera_center: AnyArray) -> AnyArray:
    """Which faces of boxes turn towards the camera (section 2.3.2, visibility and v).

    A face does where n . v > 0, with n its outward normal and v from its centre to the camera.

    Args:
        corners: (..., 8, 3) in any frame.
        camera_center: (..., 3) in the same frame.

    Returns:
        (..., 6) bool.

    Example:
        >>> box = Cuboid(torch.zeros(3), torch.eye(3), torch.tensor([4.0, 2.0, 1.0]))
        >>> visible_faces(box.corners(), torch.tensor([9.0, 9.0, 0.0])).tolist()  # front and left
        [True, False, True, False, False, False]
    """
    check_shape("corners", corners, "... 8 3")
    quads = rows_at(corners, QUADS)
    view = 4 * camera_center[..., None, :] - quads.sum(-2)  # 4 v
    visible: AnyArray = (_outward(corners, quads) * view).sum(-1) > 0
    return visible


def visible_face_shares(areas: AnyArray) -> AnyArray:
    """Each visible face's part of the area of all visible faces (section 2.3.2, percentage).

    Args:
        areas: (..., 6), 0 for hidden faces.

    Returns:
        (..., 6), summing to 1; all 0 where all areas are.

    """
    total = areas.sum(-1)[..., None]
    shares: AnyArray = areas / (total + (total <= 0))
    return shares


def near_depth(cuboid: Cuboid) -> Tensor:
    """The near plane's depth for boxes, (...,), in their unit."""
    return NEAR_PER_DIAGONAL * cuboid.diagonal


def near_depth_of_corners(corners: AnyArray) -> AnyArray:
    """The near plane's depth (...,) for boxes given by their corners (..., 8, 3), in their unit."""
    near: AnyArray = NEAR_PER_DIAGONAL * norm(corners[..., 6, :] - corners[..., 0, :])
    return near


def corners_in_front(cuboid_cam: Cuboid) -> Tensor:
    """Which corners of boxes lie beyond the near plane, so that their projection means something.

    Args:
        cuboid_cam: boxes (...,) in the camera frame.

    Returns:
        (..., 8) bool.

    Example:
        >>> around_the_camera = Cuboid(torch.zeros(3), torch.eye(3), torch.full((3,), 2.0))
        >>> corners_in_front(around_the_camera).tolist()
        [False, False, False, False, True, True, True, True]
    """
    return cuboid_cam.corners()[..., 2] > near_depth(cuboid_cam)[..., None]


def face_visibility(
    cuboid_cam: Cuboid, K: Tensor, image_hw: tuple[int, int]
) -> FaceVisibility[Tensor]:
    """The faces of boxes that a camera sees, from boxes given in its frame.

    Args:
        cuboid_cam: boxes (...,) in the camera frame.
        K: (..., 3, 3) in pixels.
        image_hw: height and width of the image.

    Returns:
        Booleans, areas and shares of the faces (section 2.3), and the truncation.

    Example:
        >>> K = torch.tensor([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]])
        >>> ahead = Cuboid(torch.tensor([0.0, 0, 5]), torch.eye(3), torch.full((3,), 2.0))
        >>> seen = face_visibility(ahead, K, (101, 101))
        >>> seen.visible.tolist(), seen.area[5].item()  # the bottom face: 50 by 50 px
        ([False, False, False, False, False, True], 2500.0)
    """
    corners_cam = cuboid_cam.corners()
    return corners_visibility(
        corners_cam, K, image_hw, visible_faces(corners_cam, torch.zeros_like(cuboid_cam.center))
    )


def projected_faces(
    corners_cam: AnyArray,
    K: AnyArray,
    distortion: AnyArray | None = None,
    *,
    corners_px: AnyArray | None = None,
) -> AnyArray:
    """The faces of boxes in the picture, clipped at the near plane.

    Args:
        corners_cam: (..., 8, 3).
        K: (..., 3, 3) in pixels.
        distortion: coefficients of OpenCV's lens (edges stay straight between the bent corners);
            None for a pinhole.
        corners_px: (..., 8, 2) the projected corners, if somebody has computed them already.

    Returns:
        (..., 6, P, 2) px, P = 4 if every corner lies in front of its near plane, else 5.

    """
    near = near_depth_of_corners(corners_cam)
    if bool((corners_cam[..., 2] > near[..., None]).all()):
        if corners_px is None:
            corners_px = project(K, corners_cam, distortion)[0]
        return rows_at(corners_px, QUADS)
    quads = rows_at(corners_cam, QUADS)
    if isinstance(quads, Tensor):
        clipped = clip_to_near(quads, near[..., None, None])
        return project(K[..., None, :, :], clipped, distortion)[0]
    clipped_array = clip_to_near(
        torch.from_numpy(quads), torch.from_numpy(near)[..., None, None]
    ).numpy()
    return project(K[..., None, :, :], clipped_array, distortion)[0]


def corners_visibility(
    corners_cam: AnyArray,
    K: AnyArray,
    image_hw: tuple[int, int],
    visible: AnyArray,
    *,
    distortion: AnyArray | None = None,
    corners_px: AnyArray | None = None,
) -> FaceVisibility[AnyArray]:
    """The areas and shares of boxes' faces, where it is known already which of them are visible.

    A map of pixels, for one, changes the areas but never which faces are visible.

    Args:
        corners_cam: (..., 8, 3) in the camera frame, in CORNER_SIGNS' order.
        K: (..., 3, 3) in pixels.
        image_hw: height and width of the image.
        visible: (..., 6) bool, see visible_faces.
        distortion: coefficients of OpenCV's lens; None for a pinhole.
        corners_px: (..., 8, 2) the projected corners, if somebody has computed them already.

    Returns:
        Booleans, areas and shares of the faces (section 2.3), and the truncation.

    """
    check_shape("K", K, "... 3 3")
    check_image_hw("image_hw", image_hw)
    quads_px = projected_faces(corners_cam, K, distortion, corners_px=corners_px)
    # (..., 6): each face by itself, whatever else is in the batch
    inside: Any = in_frame(quads_px, image_hw).all(-1)
    area = area_in_image = polygon_area(quads_px)
    if not bool(inside.all()):
        area_in_image = namespace(area).where(inside, area, area_in_frame(quads_px, image_hw))
    # The hidden faces tile the silhouette too, and do so when the near plane cuts the box
    silhouette, silhouette_in_image = ((a * ~visible).sum(-1) for a in (area, area_in_image))
    truncation = (1 - silhouette_in_image / (silhouette + (silhouette <= 0))) * (silhouette > 0)
    area, area_in_image = area * visible, area_in_image * visible
    return FaceVisibility(
        visible=visible,
        area=area,
        share=visible_face_shares(area),
        share_in_image=visible_face_shares(area_in_image),
        truncation=clip(truncation, 0, 1),
    )

"""Which faces of a box are seen, and how much of the picture each fills.

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
    like,
    namespace,
    norm,
    rows_at,
)
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.checks import check_image_hw, check_shape
from animal3dbox.geometry.cuboid import FACES, Cuboid
from animal3dbox.geometry.polygon import area_in_frame, clip_to_near, polygon_area

QUADS = np.array(list(FACES.values()))
NEAR_PER_DIAGONAL = 1e-2
"""The near plane stands at this fraction of the box diagonal.

Nearer things have no useful projection.
"""


@dataclass(frozen=True)
class FaceVisibility(Generic[AnyArray]):
    """What a camera sees of boxes; faces in FACES' order.

    Attributes:
        visible: (..., 6) bool, n . v > 0 of the paper; nothing is visible from inside the box.
        area: (..., 6) projected area in px^2, 0 for hidden faces, clipped at the near plane but not
            by the frame.
        share: (..., 6) area over its sum; all 0 if nothing is seen.
        share_in_image: (..., 6) the same of the areas clipped by the frame.
        truncation: (...,) 1 - (silhouette inside the frame) / silhouette; 0 if there is no
            silhouette.
    """

    visible: AnyArray
    area: AnyArray
    share: AnyArray
    share_in_image: AnyArray
    truncation: AnyArray


def face_normals(corners: AnyArray) -> AnyArray:
    """Outward unit normals of boxes' faces by the cross product of two edges (section 2.3.1, n).

    Args:
        corners: (..., 8, 3) in CORNER_SIGNS' order.

    Returns:
        (..., 6, 3); zero for a face without area.

    """
    check_shape("corners", corners, "... 8 3")
    normals = _outward(corners, rows_at(corners, QUADS))
    unit: AnyArray = normals / at_least(norm(normals), 1e-300)[..., None]
    return unit


def _outward(corners: AnyArray, quads: AnyArray) -> AnyArray:
    """Outward normals (..., 6, 3) of the faces (..., 6, 4, 3) of boxes (..., 8, 3), as long as
    their faces are large."""
    first = quads[..., 0, :]
    normals = cross(quads[..., 1, :] - first, quads[..., 3, :] - first)
    outward = (
        quads.sum(-2) - corners.sum(-2)[..., None, :] / 2
    )  # four times the way from the box's middle to the face's
    inwards = (normals * outward).sum(-1)[..., None] < 0
    turned: AnyArray = normals * (1 - 2 * as_type_of(inwards, normals))
    return turned


def visible_faces(corners: AnyArray, camera_center: AnyArray) -> AnyArray:
    """Which faces turn towards the camera: n .

    V > 0 with v from the face's centre to the camera (section 2.3.2, visibility and v).

    Args:
        corners: (..., 8, 3) in any frame.
        camera_center: (..., 3) in the same frame.

    Returns:
        (..., 6) bool.

    """
    check_shape("corners", corners, "... 8 3")
    quads = rows_at(corners, QUADS)
    view = 4 * camera_center[..., None, :] - quads.sum(-2)
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
    """The near plane's depth for boxes given by their corners (..., 8, 3) in any frame, (...,), in
    their unit."""
    near: AnyArray = NEAR_PER_DIAGONAL * norm(corners[..., 6, :] - corners[..., 0, :])
    return near


def corners_in_front(cuboid_cam: Cuboid) -> Tensor:
    """Which corners lie beyond the near plane, so that their projection means something, (..., 8)
    bool."""
    return cuboid_cam.corners()[..., 2] > near_depth(cuboid_cam)[..., None]


def face_visibility(
    cuboid_cam: Cuboid, K: Tensor, image_hw: tuple[int, int]
) -> FaceVisibility[Tensor]:
    """What a camera sees of boxes given in its frame.

    Args:
        cuboid_cam: boxes (...,) in the camera frame.
        K: (..., 3, 3) in pixels.
        image_hw: height and width of the image.

    Returns:
        Booleans, areas and shares of the faces (section 2.3), and the truncation.

    """
    corners_cam = cuboid_cam.corners()
    return corners_visibility(
        corners_cam, K, image_hw, visible_faces(corners_cam, torch.zeros_like(cuboid_cam.center))
    )


def projected_faces(
    corners_cam: AnyArray, K: AnyArray, distortion: AnyArray | None = None
) -> AnyArray:
    """The faces of boxes in the picture, clipped at the near plane.

    Args:
        corners_cam: (..., 8, 3).
        K: (..., 3, 3) in pixels.
        distortion: coefficients of OpenCV's lens (edges stay straight between the bent corners);
            None for a pinhole.

    Returns:
        (..., 6, P, 2) px, P = 4 if every corner lies in front of its near plane, else 5.

    """
    near = near_depth_of_corners(corners_cam)
    if bool((corners_cam[..., 2] > near[..., None]).all()):
        return rows_at(project(K, corners_cam, distortion)[0], QUADS)
    quads = rows_at(corners_cam, QUADS)
    if isinstance(quads, Tensor):
        return project(K[..., None, :, :], clip_to_near(quads, near[..., None, None]), distortion)[
            0
        ]
    clipped = clip_to_near(torch.from_numpy(quads), torch.from_numpy(near)[..., None, None]).numpy()
    return project(K[..., None, :, :], clipped, distortion)[0]


def corners_visibility(
    corners_cam: AnyArray,
    K: AnyArray,
    image_hw: tuple[int, int],
    visible: AnyArray,
    distortion: AnyArray | None = None,
) -> FaceVisibility[AnyArray]:
    """What a camera sees of boxes whose visible faces are known already, such as after a map of pixels, which changes none.

    Args:
        corners_cam: (..., 8, 3) in the camera frame, in CORNER_SIGNS' order.
        K: (..., 3, 3) in pixels.
        image_hw: height and width of the image.
        visible: (..., 6) bool, see visible_faces.
        distortion: coefficients of OpenCV's lens; None for a pinhole.

    Returns:
        Booleans, areas and shares of the faces (section 2.3), and the truncation.

    """
    check_shape("K", K, "... 3 3")
    check_image_hw("image_hw", image_hw)
    quads_px = projected_faces(corners_cam, K, distortion)
    beyond = like(quads_px, [image_hw[1] - 0.5, image_hw[0] - 0.5])
    inside: Any = (
        ((quads_px >= -0.5) & (quads_px <= beyond)).all(-1).all(-1)
    )  # (..., 6): each face by itself, whatever else is in the batch
    area = polygon_area(quads_px)
    area_in_image = (
        area
        if bool(inside.all())
        else namespace(area).where(inside, area, area_in_frame(quads_px, image_hw))
    )
    silhouette, silhouette_in_image = ((a * ~visible).sum(-1) for a in (area, area_in_image))
    truncation = (1 - silhouette_in_image / (silhouette + (silhouette <= 0))) * (silhouette > 0)
    area, area_in_image = area * visible, area_in_image * visible
    return FaceVisibility(
        visible,
        area,
        visible_face_shares(area),
        visible_face_shares(area_in_image),
        clip(truncation, 0, 1),
    )

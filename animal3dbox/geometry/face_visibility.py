"""Which faces of a box are seen, and how much of the picture each fills.

The visible faces of a convex box tile its silhouette, and so do the hidden ones: the area of the silhouette is the sum
over the hidden faces, which stays true when the box is cut by the near plane.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from animal3dbox.geometry.camera import project
from animal3dbox.geometry.checks import check_image_hw, check_shape
from animal3dbox.geometry.cuboid import FACES, Cuboid
from animal3dbox.geometry.polygon import area_in_frame, clip_to_near, polygon_area

NEAR_PER_DIAGONAL = 1e-2
"""The near plane stands at this fraction of the box diagonal: nearer things have no useful projection."""


@dataclass(frozen=True)
class FaceVisibility:
    """What a camera sees of boxes; faces in FACES' order.

    Attributes:
        visible: (..., 6) bool, n . v > 0 of the paper; nothing is visible from inside the box.
        area: (..., 6) projected area in px^2, 0 for hidden faces, clipped at the near plane but not by the frame.
        share: (..., 6) area over its sum; all 0 if nothing is seen.
        share_in_image: (..., 6) the same of the areas clipped by the frame.
        truncation: (...,) 1 - (silhouette inside the frame) / silhouette; 0 if there is no silhouette.
    """

    visible: Tensor
    area: Tensor
    share: Tensor
    share_in_image: Tensor
    truncation: Tensor


def face_normals(corners: Tensor) -> Tensor:
    """Outward unit normals of boxes' faces by the cross product of two edges (section 2.3.1, n).

    Args:
        corners: (..., 8, 3) in CORNER_SIGNS' order.

    Returns:
        (..., 6, 3); zero for a face without area.

    """
    check_shape("corners", corners, "... 8 3")
    quads = corners[..., torch.tensor(list(FACES.values()), device=corners.device), :]
    normals = torch.linalg.cross(quads[..., 1, :] - quads[..., 0, :], quads[..., 3, :] - quads[..., 0, :])
    normals = torch.nn.functional.normalize(normals, dim=-1, eps=1e-300)
    outward = quads.mean(-2) - corners.mean(-2, keepdim=True)
    flip = (normals * outward).sum(-1, keepdim=True) < 0
    return torch.where(flip, -normals, normals)


def visible_faces(corners: Tensor, camera_center: Tensor) -> Tensor:
    """Which faces turn towards the camera: n . v > 0 with v from the face's centre to the camera (section 2.3.2, visibility and v).

    Args:
        corners: (..., 8, 3) in any frame.
        camera_center: (..., 3) in the same frame.

    Returns:
        (..., 6) bool.

    """
    quads = corners[..., torch.tensor(list(FACES.values()), device=corners.device), :]
    view = torch.nn.functional.normalize(camera_center[..., None, :] - quads.mean(-2), dim=-1)
    return (face_normals(corners) * view).sum(-1) > 0


def visible_face_shares(areas: Tensor) -> Tensor:
    """Each visible face's part of the area of all visible faces (section 2.3.2, percentage).

    Args:
        areas: (..., 6), 0 for hidden faces.

    Returns:
        (..., 6), summing to 1; all 0 where all areas are.

    """
    total = areas.sum(-1, keepdim=True)
    return torch.where(total > 0, areas / torch.where(total > 0, total, torch.ones_like(total)), torch.zeros_like(areas))


def near_depth(cuboid: Cuboid) -> Tensor:
    """The near plane's depth for boxes, (...,), in their unit."""
    return NEAR_PER_DIAGONAL * cuboid.diagonal


def near_depth_of_corners(corners: Tensor) -> Tensor:
    """The near plane's depth for boxes given by their corners (..., 8, 3) in any frame, (...,), in their unit."""
    diagonal: Tensor = torch.linalg.vector_norm(corners[..., 6, :] - corners[..., 0, :], dim=-1)
    return NEAR_PER_DIAGONAL * diagonal


def corners_in_front(cuboid_cam: Cuboid) -> Tensor:
    """Which corners lie beyond the near plane, so that their projection means something, (..., 8) bool."""
    return cuboid_cam.corners()[..., 2] > near_depth(cuboid_cam)[..., None]


def face_visibility(cuboid_cam: Cuboid, K: Tensor, image_hw: tuple[int, int]) -> FaceVisibility:
    """What a camera sees of boxes given in its frame.

    Args:
        cuboid_cam: boxes (...,) in the camera frame.
        K: (..., 3, 3) in pixels.
        image_hw: height and width of the image.

    Returns:
        Booleans, areas and shares of the faces (section 2.3), and the truncation.

    """
    corners_cam = cuboid_cam.corners()
    return corners_visibility(corners_cam, K, image_hw, visible_faces(corners_cam, torch.zeros_like(cuboid_cam.center)))


def projected_faces(corners_cam: Tensor, K: Tensor, distortion: Tensor | None = None) -> Tensor:
    """The faces of boxes in the picture, clipped at the near plane.

    Args:
        corners_cam: (..., 8, 3).
        K: (..., 3, 3) in pixels.
        distortion: coefficients of OpenCV's lens (edges stay straight between the bent corners); None for a pinhole.

    Returns:
        (..., 6, P, 2) px, P = 4 if every corner lies in front of its near plane, else 5.

    """
    indices = torch.tensor(list(FACES.values()), device=corners_cam.device)
    near = near_depth_of_corners(corners_cam)
    if bool((corners_cam[..., 2] > near[..., None]).all()):
        return project(K, corners_cam, distortion)[0][..., indices, :]
    return project(K[..., None, :, :], clip_to_near(corners_cam[..., indices, :], near[..., None, None]), distortion)[0]


def corners_visibility(
    corners_cam: Tensor, K: Tensor, image_hw: tuple[int, int], visible: Tensor, distortion: Tensor | None = None
) -> FaceVisibility:
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
    beyond = quads_px.new_tensor([image_hw[1] - 0.5, image_hw[0] - 0.5])
    inside = bool(((quads_px >= -0.5) & (quads_px <= beyond)).all())
    area = polygon_area(quads_px)
    area_in_image = area if inside else area_in_frame(quads_px, image_hw)
    silhouette, silhouette_in_image = ((a * ~visible).sum(-1) for a in (area, area_in_image))
    truncation = 1 - torch.where(silhouette > 0, silhouette_in_image / silhouette.clamp_min(1e-300), torch.ones_like(silhouette))
    area, area_in_image = area * visible, area_in_image * visible
    return FaceVisibility(visible, area, visible_face_shares(area), visible_face_shares(area_in_image), truncation.clamp(0, 1))

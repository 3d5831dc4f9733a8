"""Cameras, oriented boxes, their overlap and visibility, and a rasteriser: no animals here.

The names below are loaded when first used (PEP 562).
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.geometry.box_overlap import box_intersection_volume as box_intersection_volume
    from animal3dbox.geometry.box_overlap import box_iou as box_iou
    from animal3dbox.geometry.box_overlap import pairwise_box_iou as pairwise_box_iou
    from animal3dbox.geometry.box_visibility import FaceVisibility as FaceVisibility
    from animal3dbox.geometry.box_visibility import corners_in_front as corners_in_front
    from animal3dbox.geometry.box_visibility import face_normals as face_normals
    from animal3dbox.geometry.box_visibility import face_visibility as face_visibility
    from animal3dbox.geometry.box_visibility import visible_faces as visible_faces
    from animal3dbox.geometry.camera import PinholeCamera as PinholeCamera
    from animal3dbox.geometry.camera import intrinsics as intrinsics
    from animal3dbox.geometry.camera import look_at as look_at
    from animal3dbox.geometry.camera import project as project
    from animal3dbox.geometry.camera import project_in_front as project_in_front
    from animal3dbox.geometry.cuboid import CORNER_SIGNS as CORNER_SIGNS
    from animal3dbox.geometry.cuboid import EDGES as EDGES
    from animal3dbox.geometry.cuboid import FACE_NAMES as FACE_NAMES
    from animal3dbox.geometry.cuboid import FACES as FACES
    from animal3dbox.geometry.cuboid import MIRRORED_CORNERS as MIRRORED_CORNERS
    from animal3dbox.geometry.cuboid import MIRRORED_FACES as MIRRORED_FACES
    from animal3dbox.geometry.cuboid import OPPOSITE_FACES as OPPOSITE_FACES
    from animal3dbox.geometry.cuboid import Cuboid as Cuboid
    from animal3dbox.geometry.cuboid import corners_of as corners_of
    from animal3dbox.geometry.cuboid_from_corners import corners_to_cuboid as corners_to_cuboid
    from animal3dbox.geometry.distortion import distort as distort
    from animal3dbox.geometry.distortion import undistort as undistort
    from animal3dbox.geometry.frame import frame_box as frame_box
    from animal3dbox.geometry.frame import in_frame as in_frame
    from animal3dbox.geometry.homography import CameraUpdate as CameraUpdate
    from animal3dbox.geometry.homography import apply_homography as apply_homography
    from animal3dbox.geometry.homography import update_camera as update_camera
    from animal3dbox.geometry.rasterizer import Raster as Raster
    from animal3dbox.geometry.rasterizer import rasterize as rasterize
    from animal3dbox.geometry.rasterizer import silhouette as silhouette
    from animal3dbox.geometry.rigid_transforms import (
        axis_angle_from_rotation as axis_angle_from_rotation,
    )
    from animal3dbox.geometry.rigid_transforms import invert_rigid as invert_rigid
    from animal3dbox.geometry.rigid_transforms import nearest_rotation as nearest_rotation
    from animal3dbox.geometry.rigid_transforms import rigid as rigid
    from animal3dbox.geometry.rigid_transforms import rotation_angle as rotation_angle
    from animal3dbox.geometry.rigid_transforms import (
        rotation_from_axis_angle as rotation_from_axis_angle,
    )
    from animal3dbox.geometry.rigid_transforms import transform_points as transform_points

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "box_overlap": ("box_intersection_volume", "box_iou", "pairwise_box_iou"),
        "box_visibility": (
            "FaceVisibility",
            "corners_in_front",
            "face_normals",
            "face_visibility",
            "visible_faces",
        ),
        "camera": ("PinholeCamera", "intrinsics", "look_at", "project", "project_in_front"),
        "cuboid": (
            "CORNER_SIGNS",
            "EDGES",
            "FACES",
            "FACE_NAMES",
            "MIRRORED_CORNERS",
            "MIRRORED_FACES",
            "OPPOSITE_FACES",
            "Cuboid",
            "corners_of",
        ),
        "cuboid_from_corners": ("corners_to_cuboid",),
        "distortion": ("distort", "undistort"),
        "frame": ("frame_box", "in_frame"),
        "homography": ("CameraUpdate", "apply_homography", "update_camera"),
        "rasterizer": ("Raster", "rasterize", "silhouette"),
        "rigid_transforms": (
            "axis_angle_from_rotation",
            "invert_rigid",
            "nearest_rotation",
            "rigid",
            "rotation_angle",
            "rotation_from_axis_angle",
            "transform_points",
        ),
    },
)

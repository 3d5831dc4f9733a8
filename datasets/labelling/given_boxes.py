"""Boxes that a dataset comes with, as labels.

Nothing is estimated, all that follows from box and camera is computed.
"""

import numpy as np
import torch

from animal3dbox.datasets.records import CuboidRecord
from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.box_visibility import corners_in_front, face_visibility, near_depth
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.checks import check_intrinsics, check_rotation
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.labels.assemble import points_box
from animal3dbox.labels.types import CuboidLabel, Quality

GIVEN = "given by the dataset"


def given_label(record: CuboidRecord) -> CuboidLabel:
    """The label of a box; its mesh's frame is the box's own.

    Raises:
        SampleError: the camera or the box is none.

    """
    K, center, rotation, size = (
        _tensor(record, name) for name in ("K", "center", "rotation", "size")
    )
    try:
        check_intrinsics("K", K)
        check_rotation("rotation", rotation)
        cuboid = Cuboid(center, rotation, size)
    except ShapeError as error:
        raise SampleError(record.sample_id, str(error).split()[0], str(error)) from error
    corners = cuboid.corners()
    corners_2d, depth = project(K, corners)
    faces = face_visibility(cuboid, K, record.image_hw)
    in_front = corners_in_front(cuboid)
    box = (
        points_box(corners_2d, depth * in_front, record.image_hw).numpy()
        if record.box is None
        else record.box
    )
    quality = Quality(
        reprojection_error_px=None, n_keypoints=0, n_inliers=0, mask_iou=None, orientation_rule=GIVEN, pose_source="given", pose_hypothesis="given",
        bounds_source=GIVEN, mask_source="none", K_source="given", warnings=(),
    )  # fmt: skip
    return CuboidLabel(
        sample_id=record.sample_id, image_hw=record.image_hw, corners_3d=corners, center=center, rotation=rotation, size=size, corners_2d=corners_2d,
        corner_in_front=in_front, face_visible=faces.visible, face_area=faces.area, face_share=faces.share,
        face_share_in_image=faces.share_in_image, K=K, R=rotation, t=center, box=torch.from_numpy(np.asarray(box, dtype=np.float64)),
        surface_share=None, truncation=float(faces.truncation), behind_camera=bool((depth <= near_depth(cuboid)).any()), keypoints=None,
        cuboid_mesh=Cuboid(torch.zeros(3, dtype=torch.float64), torch.eye(3, dtype=torch.float64), size), quality=quality,
        scale_m_per_unit=1.0 if record.metric else None, scale_source="dataset" if record.metric else "unknown",
    )  # fmt: skip


def _tensor(record: CuboidRecord, name: str) -> torch.Tensor:
    value = np.asarray(getattr(record, name), dtype=np.float64)
    if not np.isfinite(value).all():
        raise SampleError(record.sample_id, name, f"must be finite, got {value.tolist()}")
    return torch.from_numpy(value.copy())

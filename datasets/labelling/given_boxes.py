"""Boxes that a dataset comes with, as labels.

Nothing is estimated, all that follows from box and camera is computed.
"""

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.records import CuboidRecord
from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.arrays import norm
from animal3dbox.geometry.checks import check_intrinsics, check_rotation
from animal3dbox.geometry.cuboid import Cuboid, corners_of
from animal3dbox.geometry.pixel_boxes import points_box
from animal3dbox.labels.assemble import NO_SURFACE, box_fields
from animal3dbox.labels.flank import decided_flanks, lateral_angle
from animal3dbox.labels.label_row import rows_of
from animal3dbox.labels.types import CuboidLabel, Quality

Array = NDArray[np.float64]
GIVEN = "given by the dataset"


def given_label(record: CuboidRecord) -> CuboidLabel:
    """The label of a box; its mesh's frame is the box's own.

    Raises:
        SampleError: the camera or the box is none.

    """
    K, center, rotation, size = (
        _finite(record, name) for name in ("K", "center", "rotation", "size")
    )
    try:
        check_intrinsics("K", K)
        check_rotation("rotation", rotation)
        Cuboid.from_arrays(center, rotation, size)
    except ShapeError as error:
        raise SampleError(record.sample_id, str(error).split()[0], str(error)) from error
    fields = box_fields(corners_of(center, rotation, size)[None], K[None], record.image_hw)
    depth = fields.pop("depth")[0]
    box = record.box
    if box is None:
        in_front = fields["corner_in_front"][0]
        box = points_box(fields["corners_2d"][0], depth * in_front, record.image_hw)
    camera_frame = {"center": center, "rotation": rotation, "size": size, "R": rotation}
    alone = {
        **camera_frame,
        **_flank(center, rotation),
        "t": center,
        "K": K,
        "distance": norm(center),
        "box": box,
        "surface_share": NO_SURFACE,
        "mesh_center": np.zeros(3),
        "mesh_rotation": np.eye(3),
        "mesh_size": size,
    }
    rows = rows_of(fields | {name: np.asarray(value)[None] for name, value in alone.items()})
    return CuboidLabel(
        sample_id=record.sample_id,
        image_hw=record.image_hw,
        row=rows[0],
        keypoints_2d=None,
        quality=_QUALITY,
        scale_m_per_unit=1.0 if record.metric else None,
        scale_source="dataset" if record.metric else "unknown",
    )


def _flank(center: Array, rotation: Array) -> dict[str, float]:
    """The flank of a box whose camera is known, and its probability, as a label's row has them."""
    theta = lateral_angle(center[None], rotation[None])
    flank, confidence = decided_flanks(
        theta, NO_SURFACE[None], np.zeros(1), known_camera=np.array([True])
    )
    return {"flank": float(flank[0]), "flank_confidence": float(confidence[0])}


_QUALITY = Quality(
    reprojection_error_px=None,
    n_keypoints=0,
    n_inliers=0,
    mask_iou=None,
    orientation_rule=GIVEN,
    pose_source="given",
    pose_hypothesis="given",
    bounds_source=GIVEN,
    mask_source="none",
    K_source="given",
    warnings=(),
)


def _finite(record: CuboidRecord, name: str) -> Array:
    value = np.array(getattr(record, name), dtype=np.float64)
    if not np.isfinite(value).all():
        raise SampleError(record.sample_id, name, f"must be finite, got {value.tolist()}")
    return value

"""Whether the fields of a target belong together.

A camera or boxes left stale by another library are found before they are augmented further.
"""

from animal3dbox.errors import SampleError
from animal3dbox.geometry.arrays import as_numpy, norm
from animal3dbox.geometry.box_visibility import near_depth_of_corners
from animal3dbox.geometry.camera import project
from animal3dbox.transforms.camera_law.fields import Fields
from animal3dbox.transforms.camera_law.law import cuboid_corners, parameter_corners

COMPARED = ("K", "distortion", "corners_3d", "corners_2d", "center", "rotation", "size")
TOLERANCE_PX = 0.5
TOLERANCE_RELATIVE = 1e-3
"""Tolerances: float32 targets agree to about 1e-6 of their values, and those that differ by more
than these belong to different cameras."""


def check_consistent(fields: Fields) -> None:
    """Raise a SampleError unless the target's cuboids, their projections and its camera agree.

    corners_3d must be those of center, rotation and size, and corners_2d their projections.
    """
    values = {name: as_numpy(fields.values[name]) for name in COMPARED if name in fields.values}
    corners = cuboid_corners(values)
    if corners is None or not fields.count:
        return
    near = near_depth_of_corners(corners)
    boxes = parameter_corners(values)
    if boxes is not None and "corners_3d" in values:
        off = norm(boxes - corners).max(-1)
        if (off > 100 * TOLERANCE_RELATIVE * near).any():
            worst = int(off.argmax())
            raise SampleError(
                fields.sample_id,
                "corners_3d",
                f"animal {worst}: corners differ from those of center, rotation and size by"
                f" {off[worst]:.3g}; the corner order is that of"
                " animal3dbox.geometry.cuboid.CORNER_SIGNS, the frame the camera's",
            )
    if "corners_2d" in values and "K" in values:
        px, depth = project(values["K"], corners, values.get("distortion"))
        off = norm(px - values["corners_2d"]) * (depth > near[:, None])
        wrong = off > TOLERANCE_PX + TOLERANCE_RELATIVE * norm(px)
        if wrong.any():
            worst = int((off * wrong).max(-1).argmax())
            raise SampleError(
                fields.sample_id,
                "K",
                f"is stale: animal {worst}'s corners_2d differ from the projection of its cuboid by"
                f" {off[worst].max():.3g} px; something changed the picture without the camera (or"
                " the camera without the picture)",
            )

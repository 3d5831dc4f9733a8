"""The camera law: how a map of pixels changes everything that is known about an image.

With H K = k K' Q (RQ decomposition), the mapped image is the one that the camera K' sees after its
frame has been turned by Q: points' = Q points. Where det Q = -1 the scene is mirrored, and left and
right change their names (relabel.py).
"""

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.arrays import namespace
from animal3dbox.geometry.box_visibility import (
    corners_visibility,
    near_depth_of_corners,
    visible_faces,
)
from animal3dbox.geometry.camera import project
from animal3dbox.geometry.cuboid import corners_of
from animal3dbox.geometry.distortion import check_field_of_view, turned_distortion
from animal3dbox.geometry.frame import in_frame
from animal3dbox.geometry.homography import (
    CameraUpdate,
    apply_homography,
    handedness,
    update_camera,
)
from animal3dbox.target_schema import names_of
from animal3dbox.transforms.camera_law.boxes import extent, keeps_axes, mapped_boxes
from animal3dbox.transforms.camera_law.fields import Fields
from animal3dbox.transforms.camera_law.relabel import Relabelling

UNMOVED = frozenset(names_of(under_map="unmoved"))
"""Fields that no map of pixels changes: sizes, distances, classes, identities."""
SIDES = names_of(under_map="mirrored")
"""Fields that name a side of the animal: a mirror exchanges left and right."""
SKEW_TOLERANCE = 1e-6
"""Skew below this fraction of the focal length counts as none: it is rounding."""
VISIBILITY = {
    "face_area": "area",
    "face_share": "share",
    "face_share_in_image": "share_in_image",
    "truncation": "truncation",
}
"""Fields of a target that FaceVisibility computes, and their names there."""


def map_fields(
    fields: Fields,
    H_out_in: np.ndarray,
    image_hw_out: tuple[int, int],
    *,
    keypoint_mirror: np.ndarray | None = None,
    allow_skew: bool = False,
) -> Fields:
    """The fields of a target after a map of pixels, but for pixel arrays (masks, depth).

    Args:
        fields: the target before.
        H_out_in: (3, 3) float64, of the sign that makes w > 0 on the part that stays in the
            picture: -H would be the camera looking backwards.
        image_hw_out: of the image after.
        keypoint_mirror: (J,) each keypoint's counterpart on the other side; the target's own field
            goes before.
        allow_skew: let K'[0, 1] become non-zero.

    Returns:
        The target after; H_out_in is accumulated, mirrored is whether all maps together mirror.

    Raises:
        SampleError: naming the field that cannot follow the map.

    """
    values = fields.values
    H: Any = next(
        (
            torch.from_numpy(H_out_in).to(value.device)
            for value in values.values()
            if isinstance(value, Tensor)
        ),
        H_out_in,
    )
    relabel = Relabelling(handedness(H) < 0)
    out = _without_pixels(values, relabel)
    out["H_out_in"] = H @ values["H_out_in"] if "H_out_in" in values else H
    update = _updated_camera(fields, H, allow_skew) if "K" in values else None
    if update is not None:
        out |= _in_new_camera(fields, update, relabel)
    corners = cuboid_corners(out) if update is not None else None
    out |= _renamed_faces(values, H, relabel, has_cuboids=corners is not None)
    if corners is not None:
        try:
            out |= _projected(values, out, corners, image_hw_out)
        except ShapeError as error:
            raise SampleError(fields.sample_id, "distortion", str(error)) from error
    if update is None and "corners_2d" in values:
        out["corners_2d"] = relabel.corners(apply_homography(H, values["corners_2d"]))
    if "keypoints" in values:
        out["keypoints"] = _renamed_keypoints(
            fields, mapped_keypoints(values["keypoints"], H, image_hw_out), relabel, keypoint_mirror
        )
    if "vertices" in values:
        out["vertices"] = relabel.world_points(values["vertices"])
    if "keypoints_3d" in values:
        out["keypoints_3d"] = _renamed_keypoints(
            fields, relabel.world_points(values["keypoints_3d"]), relabel, keypoint_mirror
        )
    if "boxes" in values:
        outline = None if corners is None or keeps_axes(H) else _projected_outline(out, corners)
        out["boxes"] = mapped_boxes(values["boxes"], H, image_hw_out, outline)
    mirrored = bool(fields.others.get("mirrored", False)) ^ bool(relabel.mirrored)
    pixels = {name: value for name, value in values.items() if name in ("masks", "depth")}
    return replace(fields, values={**pixels, **out}, others={**fields.others, "mirrored": mirrored})


def _without_pixels(values: dict[str, Any], relabel: Relabelling) -> dict[str, Any]:
    """The fields that a map of pixels leaves as they are, or whose sides a mirror exchanges."""
    unmoved = {name: value for name, value in values.items() if name in UNMOVED}
    return unmoved | {name: relabel.sides(values[name]) for name in SIDES if name in values}


def _renamed_faces(
    values: dict[str, Any], H: Any, relabel: Relabelling, *, has_cuboids: bool
) -> dict[str, Any]:
    """The fields about faces, as far as a map of pixels tells them without the cuboids.

    The rest is left out, not left stale. An affine map scales all areas by one factor, so that
    their shares stay; a projective one scales each part of the picture by its own.
    """
    out: dict[str, Any] = {}
    # The camera's centre does not move, so no face appears or disappears.
    if "face_visible" in values:
        out["face_visible"] = relabel.faces(values["face_visible"])
    if bool(H[2, :2].any()):
        return out
    growth = abs(H[0, 0] * H[1, 1] - H[0, 1] * H[1, 0]) / H[2, 2] ** 2
    scales = {"surface_share": 1}
    if not has_cuboids:
        scales |= {"face_area": growth, "face_share": 1}
    return out | {
        name: relabel.faces(values[name] * by) for name, by in scales.items() if name in values
    }


def _updated_camera(fields: Fields, H: Any, allow_skew: bool) -> CameraUpdate[Any]:
    """The camera that sees the mapped picture, or a SampleError if none does, or a skewed one."""
    K = fields.values["K"]
    try:
        update = update_camera(H, K, fields.values.get("R"), fields.values.get("t"))
    except ShapeError as error:
        raise SampleError(fields.sample_id, "H_out_in", str(error)) from error
    skews = abs(float(update.K[0, 1])) > SKEW_TOLERANCE * float(update.K[0, 0])
    if skews and not allow_skew and abs(float(K[0, 1])) <= SKEW_TOLERANCE * float(K[0, 0]):
        raise SampleError(
            fields.sample_id,
            "K",
            f"the map gives the camera a skew of {float(update.K[0, 1]):.3g} px, which most"
            " detectors ignore; use RandomRotation and RandomVirtualCamera (exact, no skew), or"
            " Compose(allow_skew=True) if yours reads K[0, 1]",
        )
    return update


def _in_new_camera(
    fields: Fields, update: CameraUpdate[Any], relabel: Relabelling
) -> dict[str, Any]:
    """The new camera, and everything in its frame: points' = Q points, renamed under a mirror."""
    values, Q = fields.values, update.Q
    out = {"K": update.K}
    if update.R is not None:
        out["R"] = update.R
    if update.t is not None:
        out["t"] = update.t
    if "distortion" in values:
        try:
            out["distortion"] = turned_distortion(values["distortion"], Q)
        except ShapeError as error:
            raise SampleError(fields.sample_id, "distortion", str(error)) from error
    if "corners_3d" in values:
        out["corners_3d"] = relabel.corners(values["corners_3d"] @ Q.mT)
    if "center" in values:
        out["center"] = values["center"] @ Q.mT
    if "rotation" in values:
        out["rotation"] = relabel.box_axes(Q @ values["rotation"])
    return out


def cuboid_corners(values: dict[str, Any]) -> Any:
    """Corners (N, 8, 3) in the camera frame, from the corners or from center, rotation and size.

    None if there are no boxes.
    """
    return values["corners_3d"] if "corners_3d" in values else parameter_corners(values)


def parameter_corners(values: dict[str, Any]) -> Any:
    """Corners (N, 8, 3) in the camera frame of center, rotation and size.

    None if one of them is missing.
    """
    if not {"center", "rotation", "size"} <= set(values):
        return None
    return corners_of(values["center"], values["rotation"], values["size"])


def _projected(
    values: dict[str, Any], out: dict[str, Any], corners: Any, image_hw: tuple[int, int]
) -> dict[str, Any]:
    """Projections, areas, shares and truncation under the new camera.

    Args:
        values: the target before; the fields that it has are computed anew.
        out: the target after, as far as it is computed: the camera and its lens, and face_visible.
        corners: (N, 8, 3) in the new camera's frame.
        image_hw: of the image after.
    """
    projected: dict[str, Any] = {}
    if "distortion" in out:
        check_field_of_view(out["distortion"], corners)
    corners_px = project(out["K"], corners, out.get("distortion"))[0]
    if "corners_2d" in values:
        projected["corners_2d"] = corners_px
    in_front = corners[..., 2] > near_depth_of_corners(corners)[..., None]
    if "corner_in_front" in values:
        projected["corner_in_front"] = _typed(in_front, values["corner_in_front"])
    if "behind_camera" in values:
        projected["behind_camera"] = _typed(~in_front.all(-1), values["behind_camera"])
    if any(name in values for name in VISIBILITY):
        visible = (
            out["face_visible"] != 0
            if "face_visible" in out
            else visible_faces(corners, corners[:, 0] * 0)
        )
        visibility = corners_visibility(
            corners,
            out["K"],
            image_hw,
            visible,
            distortion=out.get("distortion"),
            corners_px=corners_px,
        )
        projected |= {
            name: getattr(visibility, attribute)
            for name, attribute in VISIBILITY.items()
            if name in values
        }
    return projected


def _typed(flags: Any, before: Any) -> Any:
    """Booleans in the dtype that the field had."""
    return (
        flags.to(before.dtype)
        if isinstance(flags, Tensor)
        else flags.astype(before.dtype, copy=False)
    )


def mapped_keypoints(keypoints: Any, H: Any, image_hw: tuple[int, int]) -> Any:
    """Keypoints (N, J, 3) after a map, under their old names.

    Visibility becomes 0 outside the new frame and beyond the map's horizon (w <= 0).
    """
    xp = namespace(keypoints)
    mapped = keypoints[..., :2] @ H[:, :2].mT + H[:, 2]
    w = mapped[..., 2]
    safe = xp.where(abs(w) < 1e-12, xp.full_like(w, 1e-12), w)
    px = mapped[..., :2] / safe[..., None]
    visibility = keypoints[..., 2] * ((w > 0) & in_frame(px, image_hw))
    return xp.concatenate((px, visibility[..., None]), -1)


def _renamed_keypoints(
    fields: Fields, keypoints: Any, relabel: Relabelling, permutation: np.ndarray | None
) -> Any:
    """Keypoints under their new names, or a SampleError if nobody says which those are."""
    if not bool(relabel.mirrored):
        return keypoints
    permutation = fields.values.get("keypoint_mirror", permutation)
    if permutation is None:
        raise SampleError(
            fields.sample_id,
            "keypoints",
            "a mirror needs each keypoint's counterpart on the other side: give"
            " target['keypoint_mirror'] or Compose(keypoint_mirror=...)",
        )
    try:
        return relabel.keypoints(keypoints, permutation)
    except ShapeError as error:
        raise SampleError(fields.sample_id, "keypoint_mirror", str(error)) from error


def _projected_outline(out: dict[str, Any], corners: Any) -> tuple[Any, Any]:
    """Upright boxes (N, 4) round the projected cuboids, to tighten 2D boxes by.

    And which of them mean something (N,): those of cuboids that lie in front of the camera.
    """
    px = (
        out["corners_2d"]
        if "corners_2d" in out
        else project(out["K"], corners, out.get("distortion"))[0]
    )
    in_front = corners[..., 2] > near_depth_of_corners(corners)[..., None]
    return namespace(px).concatenate(extent(px), -1), in_front.all(-1)

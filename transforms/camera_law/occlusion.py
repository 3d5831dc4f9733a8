"""Rectangles painted over a picture, and the parts of the animals that they hide."""

from collections.abc import Sequence
from typing import Any

from animal3dbox.geometry.arrays import like, namespace
from animal3dbox.geometry.box_visibility import projected_faces, visible_faces
from animal3dbox.geometry.polygon import area_in_box, area_in_frame
from animal3dbox.transforms.camera_law.fields import Fields
from animal3dbox.transforms.camera_law.law import cuboid_corners

PixelBox = tuple[int, int, int, int]
"""A rectangle of whole pixels: x least, y least, x past, y past."""


def hide_fields(fields: Fields, boxes: Sequence[PixelBox], image_hw: tuple[int, int]) -> Fields:
    """The target after rectangles were painted over its picture.

    Masks and depth lose their pixels, keypoints below them get visibility 0, and occlusion grows:
    occlusion' = 1 - (1 - occlusion)(1 - hidden part of the visible rest).

    Args:
        fields: the target before.
        boxes: the rectangles, one after the other.
        image_hw: of the image.
    """
    for box in boxes:
        part = _hidden_part(fields, box, image_hw)
        values: dict[str, Any] = {}
        if part is not None:
            visible = 1 - fields.values.get("occlusion", 0 * part)
            values["occlusion"] = 1 - visible * (1 - part)
        x_least, y_least, x_past, y_past = box
        for name in ("masks", "depth"):
            if name in fields.values:
                values[name] = fields.values[name] + 0  # a copy
                values[name][..., y_least:y_past, x_least:x_past] = 0
        if "keypoints" in fields.values:
            values["keypoints"] = _hidden_keypoints(fields.values["keypoints"], box)
        fields = fields.updated(**values)
    return fields


def _edges(array: Any, box: PixelBox) -> Any:
    """The outer edges of a rectangle's pixels, x, y least and x, y greatest, in an array's form."""
    return like(array, [edge - 0.5 for edge in box])


def _hidden_keypoints(keypoints: Any, box: PixelBox) -> Any:
    """Keypoints (N, J, 3); visibility 0 below the rectangle."""
    edges = _edges(keypoints, box)
    px = keypoints[..., :2]
    below = ((px >= edges[:2]) & (px <= edges[2:])).all(-1)
    visibility = (keypoints[..., 2] * ~below)[..., None]
    return namespace(keypoints).concatenate((px, visibility), -1)


def _hidden_part(fields: Fields, box: PixelBox, image_hw: tuple[int, int]) -> Any:
    """The part (N,) of each animal that a rectangle hides, of what was visible until then.

    Of its mask, else of its cuboid's silhouette in the picture; None if there is neither.
    """
    x_least, y_least, x_past, y_past = box
    if "masks" in fields.values:
        masks = fields.values["masks"] > 0
        whole = masks.sum((-2, -1))
        return masks[:, y_least:y_past, x_least:x_past].sum((-2, -1)) / (whole + (whole == 0))
    corners = cuboid_corners(fields.values) if "K" in fields.values else None
    if corners is None:
        return None
    # The hidden faces of a box tile its silhouette, as the visible ones do.
    hidden_faces = ~visible_faces(corners, corners[:, 0] * 0)
    quads = projected_faces(corners, fields.values["K"], fields.values.get("distortion"))
    whole = (area_in_frame(quads, image_hw) * hidden_faces).sum(-1)
    covered = (area_in_box(quads, _edges(quads, box)) * hidden_faces).sum(-1)
    return covered / (whole + (whole == 0))

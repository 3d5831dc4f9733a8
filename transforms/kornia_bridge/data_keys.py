"""The data keys of CameraAugmentationSequential: kornia's own, and fields of a target."""

from typing import Any

import torch
from torch import Tensor

from animal3dbox.errors import ConfigError, ShapeError
from animal3dbox.target_schema import FIELDS, Field

KORNIAS = {
    "input": "(B, C, H, W)",
    "mask": "(B, C, H, W) or (B, H, W)",
    "keypoints": "(B, J, 2)",
    "bbox": "(B, N, 4, 2) or a list of (N, 4, 2)",
    "bbox_xyxy": "(B, N, 4) or a list of (N, 4)",
    "class": "(B, ...)",
}
"""Keys with kornia's own meaning, but that bbox and bbox_xyxy are clipped to the frame."""
BOX_KEYS = {"bbox": (4, 2), "bbox_xyxy": (4,)}
"""Keys of 2D boxes, and the shape of one: four corners from the top left clockwise, or xyxy."""

LEFT_OUT = ("boxes", "surface_share")
"""Fields of a label that are no keys: kornia's bbox_xyxy stands for the first, and some maps of
pixels leave no surface_share, so that a batch of it could not be stacked."""


def batch_shape(field: Field) -> str:
    """The shape of a field in a batch of B pictures with N boxes each, for messages."""
    axes = field.shape.split()
    of_image, of_animals = f"({', '.join(('B', *axes))})", f"({', '.join(('B', 'N', *axes))})"
    if field.per == "either":
        return f"{of_image} or {of_animals}"
    return of_image if field.per == "image" else of_animals


SHAPES = KORNIAS | {
    field.name: batch_shape(field)
    for field in FIELDS
    if (field.label_name is not None or field.name == "distortion") and field.name not in LEFT_OUT
}
"""Every key and its shape.

Those that are not kornia's are fields of a target (target_schema.py), of N boxes in the camera
frame, and follow the law.
"""


def data_key(name: Any) -> str:
    """The name of a data key, or a ConfigError: an unknown one would be left stale."""
    text = name if isinstance(name, str) else str(getattr(name, "name", name)).lower()
    text = {"image": "input", "IMAGE": "input"}.get(text, text)
    if text not in SHAPES:
        listing = ", ".join(f"{key} {shape}" for key, shape in SHAPES.items())
        raise ConfigError(
            f"unknown data key {name!r}, which would be left stale; known are {listing} (and image"
            " for input)"
        )
    return text


def checked_images(values: dict[str, Any]) -> Tensor:
    """The images, after the shapes of all values have been compared with theirs."""
    images = values.get("input")
    if (
        not isinstance(images, Tensor)
        or images.ndim != 4
        or images.dtype not in (torch.float32, torch.float64)
        or 0 in images.shape
    ):
        received = (
            f"{tuple(images.shape)} {images.dtype}"
            if isinstance(images, Tensor)
            else type(images).__name__
        )
        raise ShapeError(
            f"input must be images {SHAPES['input']} float32 or float64, not empty, got {received}"
        )
    for name, value in values.items():
        if name in BOX_KEYS:
            _check_boxes(name, value, len(images))
        elif not isinstance(value, Tensor) or value.ndim == 0 or value.shape[0] != len(images):
            received = (
                str(tuple(value.shape)) if isinstance(value, Tensor) else type(value).__name__
            )
            raise ShapeError(
                f"{name} must be a tensor {SHAPES[name]} with the images' B = {len(images)}, got"
                f" {received}"
            )
    points = values.get("keypoints")
    if points is not None and (points.ndim != 3 or points.shape[-1] != 2):
        raise ShapeError(f"keypoints must be {SHAPES['keypoints']}, got {tuple(points.shape)}")
    if "mask" in values and (
        values["mask"].ndim not in (3, 4) or values["mask"].shape[-2:] != images.shape[-2:]
    ):
        raise ShapeError(
            f"mask must be {SHAPES['mask']} of the images' size {tuple(images.shape[-2:])}, got"
            f" {tuple(values['mask'].shape)}"
        )
    return images


def _check_boxes(name: str, value: Any, count: int) -> None:
    """Raise a ShapeError unless boxes are a tensor or a list, one entry a picture."""
    entry = BOX_KEYS[name]
    rows = list(value) if isinstance(value, Tensor | list | tuple) else None
    if rows is not None and len(rows) == count:
        if all(isinstance(row, Tensor) and row.shape[1:] == entry for row in rows):
            return
        received = str([tuple(getattr(row, "shape", ())) for row in rows])
    else:
        received = type(value).__name__ if rows is None else f"{len(rows)} entries"
    raise ShapeError(f"{name} must be {SHAPES[name]} with the images' B = {count}, got {received}")

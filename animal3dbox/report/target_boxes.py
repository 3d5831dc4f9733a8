"""The pictures and boxes of targets and predictions, checked before they are drawn."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.report.inset import Picture

Fields = Mapping[str, Any]


def picture_of(image: torch.Tensor | Picture) -> Picture:
    """An image as (H, W, 3) uint8."""
    array = image.permute(1, 2, 0).numpy(force=True) if isinstance(image, torch.Tensor) else image
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype != np.uint8:
        raise ShapeError(
            f"image must be uint8, (3, H, W) as a tensor or (H, W, 3) as an array, got"
            f" {array.dtype} {tuple(image.shape)}"
        )
    return np.ascontiguousarray(array)


def cuboids_of(fields: Fields, image: str, kind: str) -> list[Cuboid | None]:
    """The boxes of a target or a prediction; None for one that is none.

    Args:
        fields: with `center` (N, 3), `rotation` (N, 3, 3) and `size` (N, 3).
        image: its name, for errors.
        kind: "target" or "prediction", for errors.

    Raises:
        SampleError: a field is missing or of the wrong shape.

    """
    parts = [
        checked_field(fields, image, kind, name=name, spec=spec)
        for name, spec in (("center", "N 3"), ("rotation", "N 3 3"), ("size", "N 3"))
    ]
    return [_cuboid(*row) for row in zip(*parts, strict=True)]


def _cuboid(center: torch.Tensor, rotation: torch.Tensor, size: torch.Tensor) -> Cuboid | None:
    try:
        return Cuboid(center, rotation, size)
    except ShapeError:
        return None


def checked_field(fields: Fields, image: str, kind: str, *, name: str, spec: str) -> torch.Tensor:
    """A field as float64 on the host."""
    if name not in fields:
        raise SampleError(image, f"{kind} {name}", "is missing, and nothing is drawn without it")
    value: torch.Tensor = fields[name].detach().double().cpu()
    try:
        check_shape(name, value, spec)
    except ShapeError as error:
        raise SampleError(image, f"{kind} {name}", str(error)) from error
    return value

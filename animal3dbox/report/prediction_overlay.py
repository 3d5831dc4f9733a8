"""A detector's cuboids drawn beside those of the target: the label solid, the detection dashed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from animal3dbox.errors import SampleError, ShapeError
from animal3dbox.geometry.checks import check_shape
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.report.overlay import Picture, draw_cuboid, enlarged, with_words

Fields = Mapping[str, Any]


def draw_predictions(
    image: torch.Tensor | Picture,
    target: Fields,
    prediction: Fields,
    *,
    least_score: float = 0.3,
) -> Picture:
    """The picture with a target's cuboids, solid, and those of a detector, dashed; a new array.

    Front is green and back blue on both, so that a box that looks the wrong way is seen at once.

    Args:
        image: (3, H, W) uint8, as a Dataset gives it, or (H, W, 3) uint8 RGB.
        target: a Dataset's, with `center`, `rotation`, `size` (N of each) and `K`.
        prediction: the same fields and `scores` (M,); drawn with the target's K. Boxes that are
            none (not finite, no rotation, a negative size) are left out and counted in the words.
        least_score: detections of lower scores are left out.

    Returns:
        (H', W', 3) uint8 RGB; enlarged if it was small, with a line of words below.

    Raises:
        SampleError: a field is missing or of the wrong shape.

    Example:
        >>> target = {
        ...     "center": torch.tensor([[0.0, 0, 5]]),
        ...     "rotation": torch.eye(3)[None],
        ...     "size": torch.tensor([[2.0, 1, 1]]),
        ...     "K": torch.tensor([[100.0, 0, 79.5], [0, 100, 59.5], [0, 0, 1]]),
        ... }
        >>> prediction = {**target, "scores": torch.tensor([0.9])}
        >>> image = torch.zeros(3, 120, 160, dtype=torch.uint8)
        >>> draw_predictions(image, target, prediction).shape
        (388, 480, 3)
    """
    canvas, factor = enlarged(_picture(image))
    image_id = str(target.get("image_id", "target"))
    if "K" not in target:
        raise SampleError(image_id, "target K", "is missing, and nothing can be drawn without it")
    K = target["K"].detach().double().cpu()
    animals = _cuboids(target, image_id, "target")
    scores = _field(prediction, image_id, "prediction", name="scores", spec="M").tolist()
    detections = [
        cuboid
        for cuboid, score in zip(_cuboids(prediction, image_id, "prediction"), scores, strict=True)
        if score >= least_score
    ]
    for cuboids, dashed in ((animals, False), (detections, True)):
        for cuboid in cuboids:
            if cuboid is not None:
                draw_cuboid(canvas, cuboid, K, factor, dashed=dashed)
    broken = sum(cuboid is None for cuboid in detections)
    words = f"{len(animals)} labelled, {len(detections)} detected (dashed, score {least_score}+)"
    return with_words(canvas, [f"{words}, {broken} of them no boxes" if broken else words])


def _picture(image: torch.Tensor | Picture) -> Picture:
    """An image as (H, W, 3) uint8."""
    array = image.permute(1, 2, 0).numpy(force=True) if isinstance(image, torch.Tensor) else image
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype != np.uint8:
        raise ShapeError(
            f"image must be uint8, (3, H, W) as a tensor or (H, W, 3) as an array, got"
            f" {array.dtype} {tuple(image.shape)}"
        )
    return np.ascontiguousarray(array)


def _cuboids(fields: Fields, image: str, kind: str) -> list[Cuboid | None]:
    """The boxes of a target or a prediction; None for one that is none."""
    parts = [
        _field(fields, image, kind, name=name, spec=spec)
        for name, spec in (("center", "N 3"), ("rotation", "N 3 3"), ("size", "N 3"))
    ]
    return [_cuboid(*row) for row in zip(*parts, strict=True)]


def _cuboid(center: torch.Tensor, rotation: torch.Tensor, size: torch.Tensor) -> Cuboid | None:
    try:
        return Cuboid(center, rotation, size)
    except ShapeError:
        return None


def _field(fields: Fields, image: str, kind: str, *, name: str, spec: str) -> torch.Tensor:
    """A field as float64 on the host."""
    if name not in fields:
        raise SampleError(image, f"{kind} {name}", "is missing, and nothing is drawn without it")
    value: torch.Tensor = fields[name].detach().double().cpu()
    try:
        check_shape(name, value, spec)
    except ShapeError as error:
        raise SampleError(image, f"{kind} {name}", str(error)) from error
    return value

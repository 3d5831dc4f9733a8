"""Plans of a batch, run side by side: images of one kind, size and form go through together."""

from collections.abc import Sequence

import torch
from torch import Tensor

from animal3dbox.transforms.rendering.torch_executor import run_stage
from animal3dbox.transforms.steps import Local, Pass


def run_batch(
    images: Sequence[Tensor],
    stages: Sequence[Sequence[Pass | Local]],
    interpolation: str,
    fill: tuple[float, ...],
    *,
    uint8: bool,
) -> list[Tensor]:
    """Run every image through its own stages.

    Args:
        images: (C, H, W) float each: grey levels 0 to 255 if uint8, else colours in [0, 1].
        stages: of each image.
        interpolation: see sampling.INTERPOLATIONS.
        fill: grey levels 0 to 255.
        uint8: whether the images came as uint8.

    Returns:
        (C, H', W') float each.

    """
    current = list(images)
    for turn in range(max((len(plan) for plan in stages), default=0)):
        groups: dict[tuple[object, ...], list[int]] = {}
        for row, plan in enumerate(stages):
            if turn < len(plan):
                groups.setdefault(_alike(plan[turn], current[row]), []).append(row)
        for rows in groups.values():
            together = torch.stack([current[row] for row in rows])
            results = run_stage(
                together, [stages[row][turn] for row in rows], interpolation, fill, uint8=uint8
            )
            for row, result in zip(rows, results, strict=True):
                current[row] = result
    return current


def _alike(stage: Pass | Local, image: Tensor) -> tuple[object, ...]:
    """The properties in which images must agree to go through the device together."""
    if isinstance(stage, Pass):
        return (
            "pass",
            stage.image_hw,
            stage.H_out_in is None,
            stage.colour is None,
            stage.standardise is None,
            tuple(image.shape),
        )
    return (type(stage).__name__, tuple(image.shape))

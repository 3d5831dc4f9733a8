"""Targets after a pipeline, without any image."""

from typing import Any

from animal3dbox.transforms import (
    Compose,
)
from animal3dbox.transforms.camera_law.target_dict import read_target, write_target
from animal3dbox.transforms.pipeline import mapped_fields
from animal3dbox.transforms.steps import Plan


def mapped(
    compose: Compose,
    target: dict[str, Any],
    image_hw: tuple[int, int],
    key: tuple[int, ...] = (0, 0),
) -> tuple[dict[str, Any], Plan]:
    """The target after a pipeline, without any image."""
    plan = compose.sample_params(image_hw, target, key)
    fields = read_target(target, image_hw)
    return write_target(mapped_fields(fields, plan, plan.stages(), compose.options)), plan


def final_hw(plan: Plan) -> tuple[int, int]:
    hw = plan.image_hw
    for step in plan.steps:
        hw = getattr(step, "image_hw", hw)
    return hw

"""One picture's way through a pipeline: draw everything, fuse it, then read the pixels once.

This lies below `Transform`, so that a transform on its own and a `Compose` of many go the same way:
a pipeline is whatever draws steps (`Draw`), and the options under which its steps are rendered.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.transforms.camera_law.consistency import check_consistent
from animal3dbox.transforms.camera_law.fields import Declared, Fields
from animal3dbox.transforms.camera_law.occlusion import hide_fields
from animal3dbox.transforms.conventions_door import (
    PixelOrigin,
    as_subclass,
    check_colours,
    close_target,
    open_target,
)
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.randomness import SampleKey, sample_generator
from animal3dbox.transforms.rendering import opencv_executor
from animal3dbox.transforms.rendering.batch import run_batch
from animal3dbox.transforms.rendering.images import (
    AnyImage,
    ImageForm,
    image_form,
    image_from_bchw,
    image_to_bchw,
    owned,
)
from animal3dbox.transforms.rendering.pixel_fields import mapped_with_pixels
from animal3dbox.transforms.steps import Erase, Keep, Local, Pass, Plan, Standardise, Step

Draw = Callable[[np.random.Generator, DrawContext], tuple[Step, ...]]
"""Whatever draws the steps for one picture: the method `sample` of a Transform or a Compose."""


@dataclass(frozen=True, kw_only=True)
class PipelineOptions:
    """The options of a pipeline, which its steps are rendered under; see Compose.

    Attributes:
        seed: of the draws.
        interpolation: one of sampling.INTERPOLATIONS.
        fill: grey levels 0 to 255 outside the picture, one or one a channel.
        keypoint_mirror: for each keypoint its counterpart on the other side, or None.
        allow_skew: whether the camera may get a skew K[0, 1].
        check: whether a target's fields are compared with each other first.
        declared: the user's own fields.
        pixel_origin: where targets count pixels from, "center" or "edge".
        channels_last: whether (C, H, W) tensors leave with a pixel's colours side by side.
    """

    seed: int = 0
    interpolation: str = "bilinear"
    fill: tuple[float, ...] = (0.0,)
    keypoint_mirror: tuple[int, ...] | None = None
    allow_skew: bool = False
    check: bool = True
    declared: Declared = field(default_factory=Declared)
    pixel_origin: PixelOrigin = "center"
    channels_last: bool = False

    def form(self, image: AnyImage) -> ImageForm:
        """The form in which an image comes, and its result leaves."""
        form = image_form(image)
        return replace(form, channels_last=True) if self.channels_last else form

    @cached_property
    def permutation(self) -> np.ndarray | None:
        """The counterparts of the keypoints as an array (J,), or None."""
        return None if self.keypoint_mirror is None else np.array(self.keypoint_mirror)


def run_pipeline(
    draw: Draw,
    image: AnyImage,
    target: Mapping[str, Any],
    *,
    options: PipelineOptions,
    key: SampleKey | None,
) -> tuple[AnyImage, dict[str, Any]]:
    """One image and its target after what is drawn for them; see Transform.__call__."""
    form = options.form(image)
    fields = checked_fields(target, form.image_hw, options)
    plan = draw_plan(draw, fields, form.image_hw, seed=options.seed, key=key)
    return rendered((image, target), fields, plan, form=form, options=options)


def replay_plan(
    image: AnyImage, target: Mapping[str, Any], plan: Plan, options: PipelineOptions
) -> tuple[AnyImage, dict[str, Any]]:
    """Another image and target after a plan that was drawn before; see Compose.apply."""
    form = options.form(image)
    if form.image_hw != tuple(plan.image_hw):
        raise ConfigError(
            f"the plan was drawn for an image of {tuple(plan.image_hw)} (height, width), this"
            f" one has {form.image_hw}"
        )
    fields = open_target(target, form.image_hw, options.declared, options.pixel_origin)
    if plan.keep is not None and any(index >= fields.count for index in plan.keep):
        raise SampleError(
            fields.sample_id,
            "labels",
            f"the plan keeps animals {plan.keep}, the target has {fields.count}",
        )
    return rendered((image, target), fields, plan, form=form, options=options)


def run_batch_pipeline(
    draw: Draw,
    images: Tensor | Sequence[Tensor],
    targets: Sequence[Mapping[str, Any]],
    *,
    options: PipelineOptions,
    keys: Sequence[SampleKey | None],
) -> tuple[list[Tensor], list[dict[str, Any]]]:
    """The images and targets of a batch, rendered together where they can; see Compose.batch."""
    forms = [options.form(image) for image in images]
    _check_alike(forms)
    plans: list[Plan] = []
    mapped_targets = []
    for image, form, target, key in zip(images, forms, targets, keys, strict=True):
        fields = checked_fields(target, form.image_hw, options)
        plan = draw_plan(draw, fields, form.image_hw, seed=options.seed, key=key)
        check_colours(image, plan.steps, fields.sample_id)
        plans.append(plan)
        mapped_targets.append(_closed(fields, target, plan, plan.stages(), options=options))
    if not forms:
        return [], []
    batch = run_batch(
        [image_to_bchw(image, form)[0] for image, form in zip(images, forms, strict=True)],
        [plan.stages() for plan in plans],
        options.interpolation,
        options.fill,
        uint8=forms[0].is_uint8,
    )
    rendered_images = [
        as_subclass(
            owned(image_from_bchw(result[None], form, normalised=_normalises(plan)), image), image
        )
        for result, form, plan, image in zip(batch, forms, plans, images, strict=True)
    ]
    return rendered_images, mapped_targets


def _check_alike(forms: Sequence[ImageForm]) -> None:
    """Raise a ConfigError unless the images of a batch can go through one device together."""
    if (
        any(not form.tensor or form.layout != "chw" for form in forms)
        or len({form.dtype for form in forms}) > 1
    ):
        raise ConfigError(
            "batch must hold (C, H, W) tensors of one dtype; single images of any kind go"
            " through compose(image, target)"
        )


def checked_fields(
    target: Mapping[str, Any], image_hw: tuple[int, int], options: PipelineOptions
) -> Fields:
    """The fields of a target, compared with each other if the options say so."""
    fields = open_target(target, image_hw, options.declared, options.pixel_origin)
    if options.check:
        check_consistent(fields)
    return fields


def draw_plan(
    draw: Draw,
    fields: Fields,
    image_hw: tuple[int, int],
    *,
    seed: int,
    key: SampleKey | None,
) -> Plan:
    """Everything that is drawn for one sample.

    Args:
        draw: of the transform, or of the pipeline.
        fields: the sample's target.
        image_hw: of its image.
        seed: of the pipeline.
        key: of the sample; without it the target's own, meta["sample_key"], and without that
            torch's default generator decides.
    """
    key = fields.sample_key if key is None else key
    before = DrawContext.of(image_hw, fields)
    steps = draw(sample_generator(seed, key), before)
    return Plan(image_hw, (*steps, *returning_animals(steps, before)))


def returning_animals(steps: Sequence[Step], before: DrawContext) -> tuple[Keep, ...]:
    """The step that takes dropped animals back which a later map shows again.

    Maps are fused, so what a crop cuts off is read again when a later map makes room for it; and a
    picture never shows an animal without its label.

    Args:
        steps: all steps of a plan.
        before: the picture before any of them.
    """
    drops = [step for step in steps if isinstance(step, Keep)]
    if not drops or isinstance(steps[-1], Keep):
        return ()
    final = before
    for step in steps:
        final = final.after(step)
    everyone = replace(final, alive=tuple(range(final.count)))
    parts, parts_before = everyone.parts_in_picture(), everyone.before().parts_in_picture()
    if parts is None or parts_before is None:
        return ()
    enough = parts >= min(step.min_visible for step in drops) * parts_before
    indices = tuple(
        index
        for index in everyone.alive
        if index in final.alive or (enough[index] and parts[index] > 0)
    )
    return (Keep(indices),) if indices != final.alive else ()


def _closed(
    fields: Fields,
    target: Mapping[str, Any],
    plan: Plan,
    stages: Sequence[Pass | Local],
    *,
    options: PipelineOptions,
) -> dict[str, Any]:
    """The target after a plan and its stages, in the form in which it came."""
    sizes = [stage.image_hw for stage in stages if isinstance(stage, Pass)]
    return close_target(
        mapped_fields(fields, plan, stages, options),
        target,
        image_hw=sizes[-1] if sizes else plan.image_hw,
        origin=options.pixel_origin,
    )


def rendered(
    sample: tuple[AnyImage, Mapping[str, Any]],
    fields: Fields,
    plan: Plan,
    *,
    form: ImageForm,
    options: PipelineOptions,
) -> tuple[AnyImage, dict[str, Any]]:
    """The image and the target after a plan, in the form in which they came.

    Tensors that need gradients or live on a device are rendered in torch, everything else by
    OpenCV, which is several times faster for the one picture of a worker.
    """
    image, target = sample
    stages = plan.stages()
    check_colours(image, plan.steps, fields.sample_id)
    target = _closed(fields, target, plan, stages, options=options)
    if isinstance(image, Tensor) and (image.requires_grad or image.device.type != "cpu"):
        batch = run_batch(
            [image_to_bchw(image, form)[0]],
            [stages],
            options.interpolation,
            options.fill,
            uint8=form.is_uint8,
        )[0][None]
        result = image_from_bchw(batch, form, normalised=_normalises(plan))
        return as_subclass(owned(result, image), image), target
    result = opencv_executor.run_stages(
        image, form, stages, interpolation=options.interpolation, fill=options.fill
    )
    return as_subclass(owned(result, image), image), target


def _normalises(plan: Plan) -> bool:
    return any(isinstance(step, Standardise) for step in plan.steps)


def mapped_fields(
    fields: Fields, plan: Plan, stages: Sequence[Pass | Local], options: PipelineOptions
) -> Fields:
    """The fields of a target after a plan and its stages, masks and depth included."""
    if plan.keep is not None:
        fields = fields.selected(plan.keep)
    image_hw = plan.image_hw
    for stage in stages:
        if isinstance(stage, Pass) and stage.H_out_in is not None:
            fields = mapped_with_pixels(
                fields,
                stage.H_out_in,
                stage.image_hw,
                keypoint_mirror=options.permutation,
                allow_skew=options.allow_skew,
            )
            image_hw = stage.image_hw
        elif isinstance(stage, Erase):
            fields = hide_fields(fields, stage.boxes, image_hw)
    return fields if "H_out_in" in fields.values else _unmoved(fields)


def _unmoved(fields: Fields) -> Fields:
    """The target of a picture whose pixels did not move: H_out_in is the identity."""
    devices = [value.device for value in fields.values.values() if isinstance(value, Tensor)]
    H = torch.eye(3, dtype=torch.float64, device=devices[0]) if devices else np.eye(3)
    copies = {name: fields.values[name] + 0 for name in ("masks", "depth") if name in fields.values}
    mirrored = bool(fields.others.get("mirrored", False))
    fields = fields.updated(**copies, H_out_in=H)
    return replace(fields, others={**fields.others, "mirrored": mirrored})

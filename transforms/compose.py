"""Pipelines: draw everything first, fuse it, then read the pixels once."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.transforms.augmentations.erasing import hide_fields
from animal3dbox.transforms.camera_law.consistency import check_consistent
from animal3dbox.transforms.camera_law.fields import Declared, Fields, read_target, write_target
from animal3dbox.transforms.camera_law.relabel import check_keypoint_mirror
from animal3dbox.transforms.kornia_bridge.door import as_transform
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
from animal3dbox.transforms.rendering.sampling import check_interpolation
from animal3dbox.transforms.steps import Erase, Keep, Pass, Plan, Standardise
from animal3dbox.transforms.transform import Transform
from animal3dbox.transforms.view import View

DEFAULTS: dict[str, Any] = {
    "interpolation": "bilinear", "fill": 0.0, "keypoint_mirror": None, "mirror": "relabel", "allow_skew": False, "seed": 0, "check": True,
}  # fmt: skip
"""Options of a pipeline that did not ask for any."""


class Compose(Transform):
    """Transforms in a row, fused into one reading of the pixels.

    ``image, target = compose(image, target)``. The target is a plain dict of the fields in
    fields.PER_ANIMAL and PER_IMAGE, all optional; what is there is updated, and H_out_in (all maps
    of pixels so far) and mirrored are left in it.

    Args:
        transforms: ours, other pipelines, or kornia's augmentations (see kornia_door).
        seed: of the draws. They are a function of seed and the sample's key alone.
        interpolation: "bilinear", "bicubic" or "nearest"; masks and depth are always nearest.
        fill: grey level 0 to 255 of what lies outside the picture, one or one a channel.
        keypoint_mirror: for each keypoint its counterpart on the other side, for targets that do
            not hold their own.
        mirror: "relabel", or "forbid" to refuse transforms that may mirror.
        allow_skew: let the camera get a skew K[0, 1].
        check: compare the target's fields with each other before anything is done, so that a camera
            left stale by another library is found.
        per_animal: further fields of the user's own with one entry an animal, which follow when
            animals are dropped.
        per_image: further fields of the user's own that have nothing to do with pixels, cameras or
            single animals.

    """

    def __init__(
        self,
        transforms: Iterable[Any],
        *,
        seed: int = 0,
        interpolation: str = "bilinear",
        fill: float | tuple[float, ...] = 0.0,
        keypoint_mirror: Sequence[int] | None = None,
        mirror: str = "relabel",
        allow_skew: bool = False,
        check: bool = True,
        per_animal: Sequence[str] = (),
        per_image: Sequence[str] = (),
    ) -> None:
        super().__init__()
        self.declared = Declared(tuple(per_animal), tuple(per_image))
        if mirror not in ("relabel", "forbid"):
            raise ConfigError(f"mirror must be 'relabel' or 'forbid', got {mirror!r}")
        options = {
            "interpolation": interpolation,
            "fill": fill,
            "keypoint_mirror": keypoint_mirror,
            "mirror": mirror,
            "allow_skew": allow_skew,
        }
        self._options = {**options, "seed": seed, "check": check}
        self.transforms = tuple(self._flat(transforms))
        mirrors = [repr(transform) for transform in self.transforms if transform.mirrors]
        if mirror == "forbid" and mirrors:
            raise ConfigError(
                f"mirror='forbid', but these may mirror: {', '.join(mirrors)}; take them out or"
                " give them mirror='forbid'"
            )
        self.seed, self.interpolation, self.check = seed, check_interpolation(interpolation), check
        self.fill = fill if isinstance(fill, tuple) else (float(fill),)
        self.keypoint_mirror = None if keypoint_mirror is None else np.array(list(keypoint_mirror))
        if self.keypoint_mirror is not None:
            check_keypoint_mirror(self.keypoint_mirror, len(self.keypoint_mirror))
        self.allow_skew = allow_skew or any(
            getattr(transform, "allow_skew", False) for transform in self.transforms
        )

    def _flat(self, transforms: Iterable[Any]) -> list[Transform]:
        flat: list[Transform] = []
        for transform in transforms:
            if not isinstance(transform, Compose):
                flat.append(as_transform(transform))
                continue
            lost = [
                name
                for name, value in transform._options.items()
                if value not in (DEFAULTS[name], self._options[name])
            ]
            if lost:
                raise ConfigError(
                    f"a Compose inside a Compose is fused with it, so its {', '.join(lost)} would"
                    " be lost: give them to the outer one"
                )
            flat += transform.transforms
        return flat

    def sample(self, rng: np.random.Generator, view: View) -> tuple[Any, ...]:
        """Draw the steps of all transforms in order."""
        steps: list[Any] = []
        for transform in self.transforms:
            for step in transform.sample(rng, view):
                steps.append(step)
                view = view.after(step)
        return (*steps, *shown_again(steps, view))

    def sample_params(
        self, image_hw: tuple[int, int], target: Mapping[str, Any], key: SampleKey | None = None
    ) -> Plan:
        """Draw everything for one sample; apply it with apply.

        Args:
            image_hw: of the image.
            target: see the class.
            key: (epoch, index) of the sample; without it target["sample_key"], and without that
                torch's default generator.

        """
        return self._plan(read_target(target, image_hw, self.declared), image_hw, key)

    def _plan(self, fields: Fields, image_hw: tuple[int, int], key: SampleKey | None) -> Plan:
        if key is None and "sample_key" in fields.others:
            given: Any = fields.others["sample_key"]
            key = tuple(given)
        return Plan(
            image_hw, self.sample(sample_generator(self.seed, key), View.of(image_hw, fields))
        )

    def __call__(
        self, image: AnyImage, target: Mapping[str, Any], key: SampleKey | None = None
    ) -> tuple[AnyImage, dict[str, Any]]:
        """Transform one image and its target.

        Args:
            image: (C, H, W) tensor or (H, W, C) array, uint8 (0 to 255) or float (0 to 1).
            target: see the class; it is left as it was.
            key: see sample_params.

        Returns:
            The image and the target, in the form in which they came.

        Raises:
            SampleError: naming the sample and the field that is wrong or cannot follow.

        """
        form = image_form(image)
        fields = read_target(target, form.image_hw, self.declared)
        if self.check:
            check_consistent(fields)
        return self._apply(image, form, fields, self._plan(fields, form.image_hw, key))

    def apply(
        self, image: AnyImage, target: Mapping[str, Any], plan: Plan
    ) -> tuple[AnyImage, dict[str, Any]]:
        """Do again what was drawn before, to this or another image of the same size, such as the
        other eye of a stereo pair."""
        form = image_form(image)
        if form.image_hw != tuple(plan.image_hw):
            raise ConfigError(
                f"the plan was drawn for an image of {tuple(plan.image_hw)} (height, width), this"
                f" one has {form.image_hw}"
            )
        fields = read_target(target, form.image_hw, self.declared)
        if plan.keep is not None and any(index >= fields.count for index in plan.keep):
            raise SampleError(
                fields.sample_id,
                "labels",
                f"the plan keeps animals {plan.keep}, the target has {fields.count}",
            )
        return self._apply(image, form, fields, plan)

    def _apply(
        self, image: AnyImage, form: ImageForm, fields: Fields, plan: Plan
    ) -> tuple[AnyImage, dict[str, Any]]:
        stages = plan.stages()
        moved = write_target(self.map_target(fields, plan, stages))
        if isinstance(image, Tensor) and (image.requires_grad or image.device.type != "cpu"):
            batch = run_batch(
                [image_to_bchw(image, form)[0]],
                [stages],
                self.interpolation,
                self.fill,
                uint8=form.is_uint8,
            )[0][None]
            normalised = any(isinstance(step, Standardise) for step in plan.steps)
            return owned(image_from_bchw(batch, form, normalised=normalised), image), moved
        return (
            owned(
                opencv_executor.run_stages(image, form, stages, self.interpolation, self.fill),
                image,
            ),
            moved,
        )

    def map_target(self, fields: Fields, plan: Plan, stages: Sequence[Any] | None = None) -> Fields:
        """The target's fields after a plan, masks and depth included."""
        if plan.keep is not None:
            fields = fields.selected(plan.keep)
        image_hw = plan.image_hw
        for stage in plan.stages() if stages is None else stages:
            if isinstance(stage, Pass) and stage.H_out_in is not None:
                fields = mapped_with_pixels(
                    fields,
                    stage.H_out_in,
                    stage.image_hw,
                    keypoint_mirror=self.keypoint_mirror,
                    allow_skew=self.allow_skew,
                )
                image_hw = stage.image_hw
            elif isinstance(stage, Erase):
                fields = hide_fields(fields, stage, image_hw)
        return fields if "H_out_in" in fields.values else _untouched(fields)

    def batch(
        self,
        batch: tuple[Tensor | Sequence[Tensor], Sequence[Mapping[str, Any]]],
        keys: Sequence[SampleKey] | None = None,
    ) -> tuple[Tensor | list[Tensor], list[dict[str, Any]]]:
        """Transform a collated batch on its device, differentiable in the images.

        Draws are the same as one by one with the same keys, whatever the batch.

        Args:
            batch: images (B, C, H, W), or a list of (C, H, W), and a list of targets.
            keys: one (epoch, index) an image; see sample_params.

        Returns:
            Images, stacked if they agree in size, and targets.

        """
        images, targets = batch
        if len(images) != len(targets) or (keys is not None and len(keys) != len(targets)):
            raise ConfigError(
                f"batch holds {len(images)} images, {len(targets)} targets and"
                f" {'no' if keys is None else len(keys)} keys"
            )
        forms = [image_form(image) for image in images]
        if (
            any(not form.tensor or form.layout != "chw" for form in forms)
            or len({form.dtype for form in forms}) > 1
        ):
            raise ConfigError(
                "batch must hold (C, H, W) tensors of one dtype; single images of any kind go"
                " through compose(image, target)"
            )
        plans, moved = [], []
        for row, (form, target) in enumerate(zip(forms, targets, strict=True)):
            fields = read_target(target, form.image_hw, self.declared)
            if self.check:
                check_consistent(fields)
            plans.append(self._plan(fields, form.image_hw, None if keys is None else keys[row]))
            moved.append(write_target(self.map_target(fields, plans[-1])))
        if not forms:
            return images if isinstance(images, Tensor) else list(images), []
        floats = [image_to_bchw(image, form)[0] for image, form in zip(images, forms, strict=True)]
        results = run_batch(
            floats,
            [plan.stages() for plan in plans],
            self.interpolation,
            self.fill,
            uint8=forms[0].is_uint8,
        )
        done: list[Any] = []
        for result, form, plan in zip(results, forms, plans, strict=True):
            normalised = any(isinstance(step, Standardise) for step in plan.steps)
            done.append(
                owned(image_from_bchw(result[None], form, normalised=normalised), images[len(done)])
            )
        return (
            torch.stack(done) if len({tuple(image.shape) for image in done}) == 1 else done
        ), moved


def shown_again(steps: Sequence[Any], final: View) -> tuple[Keep, ...]:
    """The step that takes dropped animals back which a later map shows again.

    A picture never shows an animal without its label.
    """
    dropped = [step for step in steps if isinstance(step, Keep)]
    if not dropped or isinstance(steps[-1], Keep):
        return ()
    everyone = replace(final, alive=tuple(range(final.count)))
    parts, before = everyone.parts_in_picture(), everyone.before().parts_in_picture()
    if parts is None or before is None:
        return ()
    enough = parts >= min(step.min_visible for step in dropped) * before
    kept = tuple(
        index
        for index in everyone.alive
        if index in final.alive or (enough[index] and parts[index] > 0)
    )
    return (Keep(kept),) if kept != final.alive else ()


def _untouched(fields: Fields) -> Fields:
    """The target of a picture whose pixels did not move."""
    others = {**fields.others, "mirrored": bool(fields.others.get("mirrored", False))}
    devices = [value.device for value in fields.values.values() if isinstance(value, Tensor)]
    fields = fields.updated(
        **{name: fields.values[name] + 0 for name in ("masks", "depth") if name in fields.values}
    )  # copies
    return replace(
        fields.updated(
            H_out_in=torch.eye(3, dtype=torch.float64, device=devices[0]) if devices else np.eye(3)
        ),
        others=others,
    )

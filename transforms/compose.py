"""Pipelines: draw everything first, fuse it, then read the pixels once."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from animal3dbox.errors import ConfigError
from animal3dbox.transforms.camera_law.fields import Declared
from animal3dbox.transforms.camera_law.relabel import check_keypoint_mirror
from animal3dbox.transforms.conventions_door import (
    PIXEL_ORIGINS,
    PixelOrigin,
    open_target,
)
from animal3dbox.transforms.draw_context import DrawContext
from animal3dbox.transforms.kornia_bridge.door import as_transform
from animal3dbox.transforms.pipeline import (
    PipelineOptions,
    draw_plan,
    replay_plan,
    run_batch_pipeline,
)
from animal3dbox.transforms.randomness import SampleKey
from animal3dbox.transforms.rendering.images import AnyImage
from animal3dbox.transforms.rendering.sampling import check_interpolation
from animal3dbox.transforms.steps import Plan, Step
from animal3dbox.transforms.transform import Transform

FUSED_OPTIONS = (
    "interpolation",
    "fill",
    "keypoint_mirror",
    "allow_skew",
    "seed",
    "check",
    "pixel_origin",
    "channels_last",
)
"""The options that a Compose inside a Compose would lose, since it is fused with the outer one."""


class Compose(Transform):
    """Transforms in a row, fused into one reading of the pixels.

    ``image, target = compose(image, target)``. The target is a plain dict of the fields of
    animal3dbox.target_schema, all optional; what is there is updated, and H_out_in (all maps of
    pixels so far) and mirrored are left in it. Book-keeping in target["meta"] is passed on.

    Args:
        transforms: ours, other pipelines, or kornia's augmentations (see kornia_bridge).
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
        pixel_origin: where the targets count pixels from. "center": pixel centres lie at whole
            numbers and the picture covers [-0.5, W - 0.5]. "edge", as torchvision and
            albumentations have it: it covers [0, W], and boxes, keypoints, corners_2d, K and
            H_out_in are all larger by half a pixel.
        channels_last: whether (C, H, W) tensors leave with the colours of a pixel side by side in
            memory, as torch.channels_last has them and as Datasets give them; shape and values are
            the same.

    Example:
        >>> from animal3dbox.transforms import RandomHorizontalFlip, Resize
        >>> augment = Compose([RandomHorizontalFlip(p=1), Resize((30, 40))], seed=0)
        >>> image = np.zeros((60, 80, 3), np.uint8)
        >>> K = np.array([[90.0, 0, 44.5], [0, 90, 29.5], [0, 0, 1]])
        >>> image, target = augment(image, {"K": K}, key=(0, 0))  # (epoch, index)
        >>> image.shape, target["K"][0].tolist(), target["mirrored"]
        ((30, 40, 3), [45.0, 0.0, 17.0], True)
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
        pixel_origin: PixelOrigin = "center",
        channels_last: bool = False,
    ) -> None:
        super().__init__()
        if mirror not in ("relabel", "forbid"):
            raise ConfigError(f"mirror must be 'relabel' or 'forbid', got {mirror!r}")
        if pixel_origin not in PIXEL_ORIGINS:
            raise ConfigError(f"pixel_origin must be 'center' or 'edge', got {pixel_origin!r}")
        members = [
            member if isinstance(member, Compose) else as_transform(member) for member in transforms
        ]
        self.mirror = mirror
        self.transforms = flattened(members)
        self._options = PipelineOptions(
            seed=seed,
            interpolation=check_interpolation(interpolation),
            fill=fill if isinstance(fill, tuple) else (float(fill),),
            keypoint_mirror=_checked_counterparts(keypoint_mirror),
            allow_skew=allow_skew or any(member.allow_skew for member in self.transforms),
            check=check,
            declared=Declared(tuple(per_animal), tuple(per_image)),
            pixel_origin=pixel_origin,
            channels_last=channels_last,
        )
        for member in members:
            if isinstance(member, Compose):
                self._check_fused(member)
        if mirror == "forbid":
            _check_mirrors(self.transforms)

    @property
    def options(self) -> PipelineOptions:
        """The options that the constructor was given."""
        return self._options

    def _check_fused(self, inner: "Compose") -> None:
        """Raise a ConfigError if fusing another pipeline into this one would lose its options."""
        default = PipelineOptions()
        lost = [
            name
            for name in FUSED_OPTIONS
            if getattr(inner.options, name)
            not in (getattr(default, name), getattr(self.options, name))
        ]
        lost += ["mirror"] if inner.mirror not in ("relabel", self.mirror) else []
        if lost:
            raise ConfigError(
                f"a Compose inside a Compose is fused with it, so its {', '.join(lost)} would"
                " be lost: give them to the outer one"
            )

    def sample(self, rng: np.random.Generator, context: DrawContext) -> tuple[Step, ...]:
        """Draw the steps of all transforms in order, each in the picture that the last one left."""
        steps: list[Step] = []
        for transform in self.transforms:
            for step in transform.sample(rng, context):
                steps.append(step)
                context = context.after(step)
        return tuple(steps)

    def sample_params(
        self, image_hw: tuple[int, int], target: Mapping[str, Any], key: SampleKey | None = None
    ) -> Plan:
        """Draw everything for one sample; `apply` applies it, as often as wanted.

        Args:
            image_hw: of the image.
            target: see the class.
            key: (epoch, index) of the sample; without it `target["meta"]["sample_key"]`; without
                that torch's default generator decides.
        """
        options = self.options
        fields = open_target(target, image_hw, options.declared, options.pixel_origin)
        return draw_plan(self.sample, fields, image_hw, seed=self.options.seed, key=key)

    def apply(
        self, image: AnyImage, target: Mapping[str, Any], plan: Plan
    ) -> tuple[AnyImage, dict[str, Any]]:
        """Do again what was drawn before, to this or another image of the same size.

        The other eye of a stereo pair gets the same augmentation so.

        Args:
            image: of the size that the plan was drawn for.
            target: see the class; it is left as it was.
            plan: of `sample_params`.
        """
        return replay_plan(image, target, plan, self.options)

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
        augmented, mapped_targets = run_batch_pipeline(
            self.sample,
            images,
            targets,
            options=self.options,
            keys=[None] * len(targets) if keys is None else keys,
        )
        if not augmented:
            return images if isinstance(images, Tensor) else list(images), []
        same_size = len({tuple(image.shape) for image in augmented}) == 1
        if not same_size:
            return augmented, mapped_targets
        stacked = torch.stack(augmented)
        if self.options.channels_last and stacked.ndim == 4:
            stacked = stacked.contiguous(memory_format=torch.channels_last)
        return stacked, mapped_targets

    def __repr__(self) -> str:
        default = PipelineOptions()
        options = [
            f"{name}={value!r}"
            for name in FUSED_OPTIONS
            if (value := getattr(self.options, name)) != getattr(default, name)
        ]
        return f"Compose({', '.join([repr(list(self.transforms)), *options])})"


def flattened(members: Iterable[Transform]) -> tuple[Transform, ...]:
    """Transforms in their order, with those of a Compose in its place."""
    return tuple(
        transform
        for member in members
        for transform in (member.transforms if isinstance(member, Compose) else (member,))
    )


def _checked_counterparts(keypoint_mirror: Sequence[int] | None) -> tuple[int, ...] | None:
    if keypoint_mirror is None:
        return None
    counterparts = np.array(list(keypoint_mirror))
    check_keypoint_mirror(counterparts, len(counterparts))
    return tuple(counterparts.tolist())


def _check_mirrors(transforms: Iterable[Transform]) -> None:
    """Raise a ConfigError that lists the transforms that may mirror."""
    mirrors = [repr(transform) for transform in transforms if transform.mirrors]
    if mirrors:
        raise ConfigError(
            f"mirror='forbid', but these may mirror: {', '.join(mirrors)}; take them out or"
            " give them mirror='forbid'"
        )
